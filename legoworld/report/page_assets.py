"""The folder beside a page, and what a page is never written over."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from legoworld.errors import LegoWorldError
from legoworld.files import atomic_path, write_text

#: The names of the files that lie there.
_OURS: Final = ("view-*.js", "photo-*.webp", "render-*.webp", "overlay-*.webp", "scene-*.js")


def refuse_others(path: Path, mark: str) -> None:
    """Only a page of ours, which begins with the mark, is written over; else LegoWorldError."""
    if not path.exists():
        return
    start = path.read_bytes()[: len(mark)] if path.is_file() else b""
    if start != mark.encode("ascii"):
        raise LegoWorldError(
            f"{path.name} exists and is not a report",
            found="something that is not a page of legoworld",
            expected="a new file name, or an earlier page",
            next_step="choose another -o",
        )


def write_assets(
    folder: Path,
    *,
    views: Sequence[str],
    pictures: Mapping[str, Sequence[bytes]],
    scenes: Sequence[bytes],
) -> None:
    """Views and scenes as scripts, which a page opened from file:// may load; pictures as they are.

    LegoWorldError where the folder holds anything else.
    """
    _clear(folder)
    for k, view in enumerate(views):
        write_text(folder / f"view-{k:06}.js", f"legoworldView({k}, {view});\n")
    for k, scene in enumerate(scenes):
        text = base64.b64encode(scene).decode("ascii")
        write_text(folder / f"scene-{k:06}.js", f'legoworldScene({k}, "{text}");\n')
    for kind, files in pictures.items():
        for k, picture in enumerate(files):
            with atomic_path(folder / f"{kind}-{k:06}.webp") as temporary:
                temporary.write_bytes(picture)


def _clear(folder: Path) -> None:
    """Without the files of an earlier page."""
    if not folder.is_dir():
        return
    known = {p for pattern in _OURS for p in folder.glob(pattern)}
    strangers = sorted(p.name for p in folder.iterdir() if p not in known)
    if strangers:
        raise LegoWorldError(
            f"{folder.name} exists and is not a folder of a report",
            found=", ".join(strangers[:5]),
            expected="no such folder, or that of an earlier page",
            next_step="choose another -o",
        )
    for path in known:
        path.unlink()
