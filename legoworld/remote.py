"""Folders at URLs (s3://, gs://, memory://, ...): fetched before use, published afterwards.

fsspec implements each protocol. The rest of the package sees only local folders: inputs are
fetched first and outputs are published last.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import Any, Final

from legoworld import exit_codes, extras
from legoworld.errors import LegoWorldError
from legoworld.files import TEMPORARY_SUFFIX, refused_by_machine

Place = Path | str
"""A local folder, or the URL of a remote one."""

#: Never published: these files only mean something on the machine that wrote them.
_STAYS: Final = (".lock",)


class PlaceError(LegoWorldError):
    """A URL cannot be reached, read or written."""

    code = "url_unreachable"
    exit_code = exit_codes.BLOCKED


def is_url(text: str) -> bool:
    """Whether a place is addressed by a URL rather than a path."""
    return "://" in text


def child(url: str, name: str) -> str:
    """The URL of something below a URL's folder; "." is the folder itself."""
    return url if name == "." else f"{url.rstrip('/')}/{name}"


def fetch_folder(url: str, into: Path) -> int:
    """Copy every file below a URL into a local folder; returns the number of files.

    An empty URL is not an error: the folder is then not created. PlaceError when the URL cannot be
    reached or a name there leads out of the folder; OSError when this machine cannot write.
    """
    with _open_filesystem(url) as (system, top):
        names = _names_below(system, top)
        for name in names:
            _refuse_odd(name)
            target = into / name
            with _here():
                target.parent.mkdir(parents=True, exist_ok=True)
            system.get_file(f"{top}/{name}", str(target))
    return len(names)


def _refuse_odd(name: str) -> None:
    """Stores accept any name; as a path, a name with `..` would be written elsewhere."""
    parts = name.split("/")
    if not {"..", ".", ""}.isdisjoint(parts) or "\0" in name:
        raise PlaceError(
            "a name in the store is not a path inside its folder",
            found=repr(name),
            expected="path components that are neither empty nor dots",
            next_step="delete or rename that object in the store",
        )


class _HereError(Exception):
    """An error of this machine, as opposed to one of the remote store."""

    def __init__(self, refusal: OSError) -> None:
        super().__init__(str(refusal))
        self.refusal = refusal


@contextmanager
def _here() -> Iterator[None]:
    """Mark local work, so that its errors are not attributed to the URL."""
    try:
        yield
    except OSError as error:
        raise _HereError(error) from error


def publish_folder(folder: Path, url: str, *, last: str) -> None:
    """Copy every finished file of a folder to a URL; `last` is deleted first and written last.

    A reader that finds `last` finds a complete folder. PlaceError when the URL cannot be written.
    """
    names = sorted(
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*")
        if path.is_file() and path.name not in _STAYS and path.suffix != TEMPORARY_SUFFIX
    )
    names.sort(key=lambda name: name == last)
    with _open_filesystem(url) as (system, top):
        present = _names_below(system, top)
        if last in present:
            system.rm_file(f"{top}/{last}")
        for name in names:
            target = f"{top}/{name}"
            system.makedirs(target.rpartition("/")[0], exist_ok=True)
            system.put_file(str(folder / name), target)
        for name in set(present) - {*names, last}:
            system.rm_file(f"{top}/{name}")


def folders_holding(url: str, names: tuple[str, ...]) -> list[str]:
    """Sorted paths, below a URL, of the folders that contain a file with one of these names."""
    with _open_filesystem(url) as (system, top):
        paths = [PurePosixPath(name) for name in _names_below(system, top)]
    visible = [p for p in paths if not any(part.startswith(".") for part in p.parts[:-1])]
    return sorted({p.parent.as_posix() for p in visible if p.name in names})


def _names_below(system: Any, top: str) -> list[str]:
    if not system.exists(top):
        return []
    system.invalidate_cache()
    return sorted(str(path).removeprefix(top).lstrip("/") for path in system.find(top))


@contextmanager
def _open_filesystem(url: str) -> Iterator[tuple[Any, str]]:
    """The fsspec file system of a URL, and the path in it. Its errors become PlaceError."""
    kind = url.partition("://")[0]
    try:
        import fsspec
    except ImportError as error:
        raise PlaceError(
            f"{kind}:// needs the package fsspec",
            found="it is not installed",
            expected="legoworld's extra `url`",
            next_step=extras.install_command("url"),
        ) from error
    try:
        system, top = fsspec.core.url_to_fs(url)
        yield system, str(top).rstrip("/")
    except PlaceError:
        raise
    except _HereError as error:
        raise error.refusal from None
    except Exception as error:  # each protocol raises the errors of its own library
        if isinstance(error, OSError) and refused_by_machine(error):
            raise  # a full disk here, whatever the credentials are
        raise PlaceError(
            f"{url} cannot be reached",
            found=f"{type(error).__name__}: {error}",
            expected="a folder that can be read, and written if it is for results",
            next_step=f"check the URL, the credentials, and that fsspec's {kind} is installed",
        ) from error
