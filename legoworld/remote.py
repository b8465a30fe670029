"""Folders at URLs (s3://, gs://, memory://, ...): fetched to this machine, and put there from it.

fsspec knows how each kind is reached. Nothing else of the package knows that there are URLs: what
is read was fetched before, what was written is published after.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import Any, Final

from legoworld import exit_codes
from legoworld.errors import LegoWorldError
from legoworld.files import TEMPORARY_SUFFIX, refused_by_machine

Place = Path | str
"""A folder of this machine, or the URL of one elsewhere."""

#: Never published: what only means something to the machine that wrote it.
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
    """Copy every file below a URL into a folder of this machine; returns how many there were.

    Nothing there is no error: the folder then stays away. PlaceError when it cannot be reached, or
    when a name there leads out of the folder; OSError where this machine cannot write.
    """
    with _reaching(url) as (system, top):
        names = _names_below(system, top)
        for name in names:
            _refuse_odd(name)
            target = into / name
            with _here():
                target.parent.mkdir(parents=True, exist_ok=True)
            system.get_file(f"{top}/{name}", str(target))
    return len(names)


def _refuse_odd(name: str) -> None:
    """Stores take any name; as a path, one with `..` in it would be written somewhere else."""
    parts = name.split("/")
    if not {"..", ".", ""}.isdisjoint(parts) or "\0" in name:
        raise PlaceError(
            "a name in the store is no path inside its folder",
            found=repr(name),
            expected="parts that are neither empty nor dots",
            next_step="delete or rename what is stored under that name",
        )


class _HereError(Exception):
    """What this machine refused, as opposed to the place at the URL."""

    def __init__(self, refusal: OSError) -> None:
        super().__init__(str(refusal))
        self.refusal = refusal


@contextmanager
def _here() -> Iterator[None]:
    """Marks what is done on this machine, so that the URL is not blamed for it."""
    try:
        yield
    except OSError as error:
        raise _HereError(error) from error


def publish_folder(folder: Path, url: str, *, last: str) -> None:
    """Copy every finished file of a folder to a URL; `last` goes before and comes after all others.

    A reader that finds `last` there finds a whole folder. PlaceError when it cannot be written.
    """
    names = sorted(
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*")
        if path.is_file() and path.name not in _STAYS and path.suffix != TEMPORARY_SUFFIX
    )
    names.sort(key=lambda name: name == last)
    with _reaching(url) as (system, top):
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
    """Paths below a URL of the folders that hold a file of one of these names, sorted."""
    with _reaching(url) as (system, top):
        found = [PurePosixPath(name) for name in _names_below(system, top)]
    visible = [p for p in found if not any(part.startswith(".") for part in p.parts[:-1])]
    return sorted({p.parent.as_posix() for p in visible if p.name in names})


def _names_below(system: Any, top: str) -> list[str]:
    if not system.exists(top):
        return []
    system.invalidate_cache()
    return sorted(str(path).removeprefix(top).lstrip("/") for path in system.find(top))


@contextmanager
def _reaching(url: str) -> Iterator[tuple[Any, str]]:
    """fsspec's file system of a URL, and the path in it. Whatever it raises is a PlaceError."""
    kind = url.partition("://")[0]
    try:
        import fsspec
    except ImportError as error:
        raise PlaceError(
            f"{kind}:// needs the package fsspec",
            found="it is not installed",
            expected="legoworld's extra `url`",
            next_step="pip install 'legoworld[url]'",
        ) from error
    try:
        system, top = fsspec.core.url_to_fs(url)
        yield system, str(top).rstrip("/")
    except PlaceError:
        raise
    except _HereError as error:
        raise error.refusal from None
    except Exception as error:  # each kind of place raises errors of its own library
        if isinstance(error, OSError) and refused_by_machine(error):
            raise  # a full disk here, whatever the credentials are
        raise PlaceError(
            f"{url} cannot be reached",
            found=f"{type(error).__name__}: {error}",
            expected="a folder that may be read, and written where results go",
            next_step=f"check the URL, the credentials, and that fsspec's {kind} is installed",
        ) from error
