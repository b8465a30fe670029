"""Matching the arrays of a folder to photos by their names."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path, PurePosixPath
from typing import Final

from legoworld.depth_files.errors import DepthFileError
from legoworld.depth_files.read_depth import SUFFIXES
from legoworld.tracks.track import TrackImage

_JOINTS: Final = ("_", "__", "-")
#: An image and the suffixes its file may have -> the names it goes by, without the format.
_Rule = Callable[[TrackImage, Sequence[str]], list[str]]


@dataclass(frozen=True, kw_only=True)
class Match:
    """A photo's file. how: the rule that matched its name."""

    path: Path
    how: str


@dataclass(frozen=True, kw_only=True)
class Matches:
    """The files of a folder by image id, the errors of ambiguous images, and unmatched files."""

    by_image: dict[int, Match]
    errors: dict[int, DepthFileError]
    strangers: tuple[str, ...]

    def of(self, image: TrackImage) -> Match | None:
        """An image's file; None without one, DepthFileError if the match is ambiguous."""
        if image.id in self.errors:
            raise self.errors[image.id]
        return self.by_image.get(image.id)


@dataclass(frozen=True, kw_only=True)
class Naming:
    """How a family's files are named. noun: what one holds; endings: what tools add to names."""

    noun: str
    endings: tuple[str, ...]


def match_files(
    folder: Path, images: Sequence[TrackImage], suffix: str | None, naming: Naming
) -> Matches:
    """Match the arrays below a folder to a track's photos, the strictest rule first.

    The rules, for <path>/X.JPG: the same path (`<path>/X.npy`), with the photo's extension
    (`<path>/X.JPG.npy`), with one of the known endings (`<path>/X_depth.npy`); then, for files that
    lie in the folder itself, the path joined by _, __ or - (`<path>_X.npy`), and the photo's name
    alone where no other photo of the track has it; then all of these whatever their case. A file
    goes to the first rule that finds a photo for it. suffix: what every name ends in before its
    format, or with it (`_pred`, `_pred.npy`); other files are strangers and no other suffix counts.
    """
    left = dict(_bodies(folder, suffix))
    suffixes = ("",) if suffix is not None else ("", *naming.endings)
    matched: dict[int, Match] = {}
    errors: dict[int, DepthFileError] = {}
    for fold, rule in product((False, True), _RULES):
        waiting = [i for i in images if i.id not in matched and i.id not in errors]
        claims = _claims(left, waiting, rule, suffixes, fold=fold)
        rivals = _rivals(claims, images, by_name_alone=rule is _photo_name_alone)
        for image, found in claims:
            if len(found) > 1 or len(rivals[image.id]) > 1:
                errors[image.id] = _ambiguous(image, found, rivals[image.id], naming.noun)
            else:
                how = rule.__name__.strip("_") + ("_in_another_case" if fold else "")
                matched[image.id] = Match(path=folder / found[0], how=how)
        taken = {name for _, found in claims for name in found}
        left = {name: body for name, body in left.items() if name not in taken}
    return Matches(by_image=matched, errors=errors, strangers=tuple(sorted(left)))


def _claims(
    files: Mapping[str, str],
    images: Sequence[TrackImage],
    rule: _Rule,
    suffixes: Sequence[str],
    *,
    fold: bool,
) -> list[tuple[TrackImage, list[str]]]:
    """The images for which a rule finds files, and the files' names. fold: ignore case."""
    by_body: dict[str, list[str]] = defaultdict(list)
    for name, body in files.items():
        by_body[body.casefold() if fold else body].append(name)
    claims = []
    for image in images:
        keys = {key.casefold() if fold else key for key in rule(image, suffixes)}
        found = sorted({name for key in keys for name in by_body.get(key, ())})
        if found:
            claims.append((image, found))
    return claims


def _rivals(
    claims: Sequence[tuple[TrackImage, list[str]]],
    images: Sequence[TrackImage],
    *,
    by_name_alone: bool,
) -> dict[int, list[str]]:
    """The photos, by image id, that the image's files could belong to, including itself."""
    by_file: dict[str, list[str]] = defaultdict(list)
    for image, found in claims:
        for name in found:
            by_file[name].append(image.file_name)
    by_base: dict[str, list[str]] = defaultdict(list)
    for image in images if by_name_alone else ():
        by_base[_base(image)].append(image.file_name)
    return {
        image.id: max((by_base[_base(image)], *(by_file[name] for name in found)), key=len)
        for image, found in claims
    }


def _same_path(image: TrackImage, _suffixes: Sequence[str]) -> list[str]:
    return [image.scene]


def _extension_kept(image: TrackImage, _suffixes: Sequence[str]) -> list[str]:
    return [image.file_name]


def _suffix_added(image: TrackImage, suffixes: Sequence[str]) -> list[str]:
    return [name + s for name in (image.scene, image.file_name) for s in suffixes]


def _path_joined(image: TrackImage, suffixes: Sequence[str]) -> list[str]:
    names = []
    for name in (image.scene, image.file_name):
        parts = PurePosixPath(name).parts
        if len(parts) > 1:
            names += [joint.join(p) for joint in _JOINTS for p in (parts, (parts[0], parts[-1]))]
    return [name + s for name in names for s in suffixes]


def _photo_name_alone(image: TrackImage, suffixes: Sequence[str]) -> list[str]:
    names = [PurePosixPath(name).name for name in (image.scene, image.file_name)]
    return [name + s for name in names for s in suffixes]


_RULES: Final[tuple[_Rule, ...]] = (
    _same_path,
    _extension_kept,
    _suffix_added,
    _path_joined,
    _photo_name_alone,
)


def _bodies(folder: Path, suffix: str | None) -> Iterator[tuple[str, str]]:
    """The arrays below a folder, each with its path without format and suffix."""
    for path in sorted(folder.rglob("*")):
        if path.suffix.lower() not in SUFFIXES or not path.is_file():
            continue
        name = path.relative_to(folder).as_posix()
        body = name[: -len(path.suffix)]
        if suffix is not None:
            with_format = suffix.lower().endswith(SUFFIXES)
            whole = name if with_format else body
            # A stranger keeps its whole name, which is no photo's.
            body = whole[: -len(suffix)] if suffix and whole.endswith(suffix) else f"{name}/"
        yield name, body


def _base(image: TrackImage) -> str:
    return PurePosixPath(image.scene).name.casefold()


def _ambiguous(
    image: TrackImage, found: Sequence[str], others: Sequence[str], noun: str
) -> DepthFileError:
    if len(others) > 1:
        return DepthFileError(
            f"{found[0]} could be the {noun} of several photos",
            found=", ".join(others[:5]),
            expected=f"{image.scene}{PurePosixPath(found[0]).suffix}, which names one",
        )
    return DepthFileError(
        f"{image.file_name} has more than one {noun} file",
        found=", ".join(found[:5]),
        expected="one",
        next_step=f"name what the right ones end in, such as --suffix {_ending(found[0], image)}",
    )


def _ending(name: str, image: TrackImage) -> str:
    """The part of a file's name after the photo's."""
    _, _, ending = PurePosixPath(name).name.casefold().partition(_base(image))
    return name[len(name) - len(ending) :] if ending else PurePosixPath(name).suffix
