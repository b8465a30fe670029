"""What an .npz, or the TOML file of its folder, says of an array; and where a truth is."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

from numpy.typing import NDArray

from legoworld.depth_files.errors import DepthFileError
from legoworld.depth_files.headers import SizeCheck
from legoworld.depth_files.read_depth import SUFFIXES, Npz, files_named, refuse_photo
from legoworld.errors import LegoWorldError, UsageError, cause
from legoworld.evaluation.pixels.rows import photo_stem
from legoworld.files import Json, utf8_text, write_text
from legoworld.pluralize import share
from legoworld.records.run_rows import RunImage


def read_declared(
    path: Path,
    fits: Mapping[str, Callable[[Json], bool]],
    *,
    expected: str,
    error: type[LegoWorldError],
) -> dict[str, Any]:
    """The values of a folder's file by their keys; none without one. The error if it is invalid.

    fits: the keys that there are, and whether a value can be theirs.
    """
    if not path.is_file():
        return {}
    try:
        values = tomllib.loads(utf8_text(path.read_bytes()))
    except (OSError, ValueError, RecursionError) as broken:
        raise error(f"{path.name} cannot be read", found=cause(broken)) from broken
    wrong = [key for key in values if key not in fits]
    wrong += [key for key, value in values.items() if key in fits and not fits[key](value)]
    if wrong:
        raise error(
            f"{path.name} has an unknown key or value",
            found=f"{wrong[0]} = {values[wrong[0]]!r}",
            expected=expected,
        )
    return values


def is_text(value: Json) -> bool:
    """Whether a value is a text."""
    return isinstance(value, str)


def declare(path: Path, there: Mapping[str, Json], given: Mapping[str, str | None]) -> str | None:
    """Write what is given into a folder's file, unless there is one; None where it says it already.

    there: what it declares. UsageError where that is something else.
    """
    stated = {key: value for key, value in given.items() if value is not None}
    wanted = {**there, **stated}
    if wanted == there:
        return None
    if path.exists():
        raise UsageError(
            f"{path.name} declares {path.parent.name} differently",
            found=", ".join(f"{key} {there[key]!r}" for key in given),
            expected=", ".join(f"{key} {wanted[key]!r}" for key in given)
            + ", as on the command line",
            next_step=f"correct {path.name}, or omit {' and '.join(f'--{key}' for key in given)}",
        )
    text = "".join(f'{key} = "{value}"\n' for key, value in stated.items())
    write_text(path, text)
    return text


def claimed_size(path: Path, read: Callable[[Path, SizeCheck], object]) -> tuple[int, int]:
    """The (width, height) that a file's header claims; `read` does not come to the values."""
    told: list[tuple[int, int]] = []

    def stop(size_wh: tuple[int, int]) -> None:
        told.append(size_wh)
        raise _SizeToldError

    with suppress(_SizeToldError):
        read(path, stop)
    return told[0]


class _SizeToldError(Exception):
    """Aborts reading once the size is known."""


@contextmanager
def fits_into_memory(path: Path) -> Iterator[None]:
    """DepthFileError for a file whose array does not fit into memory."""
    try:
        yield
    except MemoryError as error:
        raise DepthFileError(
            f"{path.name} does not fit into memory",
            found=f"a file of {path.stat().st_size} bytes",
            expected="an array that this process can hold",
        ) from error


def picture_name(
    path: Path, contents: Npz, candidates: Sequence[str], noun: str, declaration: str
) -> str:
    """The array's name: one of the candidates; without any, and with a choice, the only picture.

    Raises DepthFileError where that is not one array.
    """
    present = [name for name in candidates if name in contents.names]
    if not present and len(candidates) > 1 and len(contents.pictures) == 1:
        return contents.pictures[0]
    if len(present) != 1:
        raise DepthFileError(
            f"{path.name} does not have one {noun} array",
            found=", ".join(contents.names) or "no arrays",
            expected=" or ".join(candidates),
            next_step=f'name it in {declaration}: array = "..."',
        )
    return present[0]


def text_label(arrays: Mapping[str, NDArray[Any]], name: str, path: Path) -> str | None:
    """A text stored as a 0-d array; None when absent or empty. DepthFileError for another array."""
    if name not in arrays:
        return None
    if arrays[name].ndim != 0 or arrays[name].dtype.kind != "U":
        raise DepthFileError(
            f"{path.name}: {name} is no text",
            found=f"{arrays[name].dtype}, shape {arrays[name].shape}",
            expected="a 0-d string array",
        )
    return str(arrays[name]) or None


def merge_declarations(name: str, own: str | None, other: str | None, path: Path) -> str | None:
    """A file's own declaration and the given one; DepthFileError where they contradict."""
    if own is not None and other is not None and own != other:
        raise DepthFileError(
            f"{path.name} has contradictory declarations",
            found=f"{name} {own!r} and {other!r}",
            expected="one",
        )
    return own if own is not None else other


def check_version(arrays: Mapping[str, NDArray[Any]], path: Path, latest: int) -> None:
    """DepthFileError unless a 0-d format_version is 1 to latest; a file may be without one."""
    version = arrays.get("format_version")
    if version is None:
        return
    if version.ndim != 0 or version.dtype.kind != "i" or not 1 <= int(version) <= latest:
        raise DepthFileError(
            f"{path.name} has an unknown format version",
            found=f"format_version {version.tolist()!r}",
            expected=f"1 to {latest}",
            next_step="read it with the version of legoworld that wrote it",
        )


F = TypeVar("F")


def find_all_truth(
    truth: Path,
    images: Sequence[RunImage],
    find: Callable[[RunImage], F | None],
    *,
    noun: str,
    layout: str,
    error: type[LegoWorldError],
) -> tuple[F, ...]:
    """What `find` finds of every image, in image order; the error where it finds nothing.

    Nothing is scored against incomplete ground truth. layout: of a dataset, besides arrays that
    are named like the photos.
    """
    files: list[F] = []
    absent: list[RunImage] = []
    for image in images:
        file = find(image)
        if file is None:
            absent.append(image)
        else:
            files.append(file)
    if absent:
        raise error(
            f"{truth.name or truth} lacks the {noun} of "
            f"{share(len(absent), len(images), 'image', 'images')}",
            found=f"nothing for {absent[0].file_name}",
            expected=f"{layout}, or"
            f" {photo_stem(absent[0].file_name)} with one of {' '.join(SUFFIXES)}",
            next_step="point --truth at the dataset's folder, or use a track of the present images",
        )
    return tuple(files)


def find_array(
    truth: Path,
    image: RunImage,
    *,
    noun: str,
    error: type[LegoWorldError],
    stems: Callable[[str], Sequence[str]] = lambda stem: (stem,),
) -> Path | None:
    """The one array named like a photo; None without one, the error for several.

    stems: of a photo's path without extension the names, the first that there is.
    """
    names = stems(photo_stem(image.file_name))
    files = next((found for name in names if (found := files_named(truth / name))), [])
    if len(files) > 1:
        raise error(
            f"{image.file_name} has more than one ground-truth file",
            found=", ".join(p.name for p in files),
            expected=f"one {noun} file",
        )
    if not files:
        return None
    refuse_photo(files[0])
    return files[0]
