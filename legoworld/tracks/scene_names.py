"""Scene folders that match no image of a track, and the images they may be meant for."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Final

from legoworld.pluralize import nearest_names

#: An extension of a photo, left on a scene folder's name.
_EXTENSION: Final = re.compile(r"\.(jpe?g|png|webp|bmp|tiff?|blend|glb|py)$")
#: Common additions to a photo's name.
_SUFFIX: Final = re.compile(r"[ _.-]+(scene|final|output|blend|render|copy|new|v?\d{1,2})$")
_PREFIX: Final = re.compile(r"^(coco_(train|val|test)20\d\d|scene|image|img|photo)[ _-]+")


@dataclass(frozen=True, kw_only=True)
class Stranger:
    """A scene folder that matches no image. meant: the nearest scene name, or None."""

    folder: str
    meant: str | None


def strangers(
    folders: Iterable[str], known: Sequence[str], absent: Sequence[str]
) -> list[Stranger]:
    """The folders that match no image, sorted, each with the nearest image without a scene.

    known: the scene names of all images; absent: those of images without a scene.
    """
    left = sorted(set(folders) - set(known))
    by_key: dict[str, list[str]] = {}
    for name in absent:
        for key in _keys(name):
            by_key.setdefault(key, []).append(name)
    return [Stranger(folder=name, meant=_meant(name, by_key, absent)) for name in left]


def lower_top(strangers: Sequence[Stranger]) -> str | None:
    """The folder below SCENES that contains the scenes under their correct names, or None."""
    tops = {
        s.folder.removesuffix(s.meant).rstrip("/")
        for s in strangers
        if s.meant is not None and s.folder.endswith(f"/{s.meant}")
    }
    return tops.pop() if len(tops) == 1 else None


def _meant(folder: str, by_key: Mapping[str, list[str]], absent: Sequence[str]) -> str | None:
    for key in _keys(folder):
        names = set(by_key.get(key, ()))
        if len(names) == 1:
            return names.pop()
    near = nearest_names(folder, absent, 2, cutoff=0.8)
    digits = folder.isdigit()  # names with different numbers are different photos, however similar
    return near[0] if len(near) == 1 and not digits else None


def _keys(name: str) -> list[str]:
    """Normalised forms of a name, from the most to the least specific."""
    whole = name.casefold()
    last = PurePosixPath(whole).name
    bare = _EXTENSION.sub("", last)
    plain = _SUFFIX.sub("", _PREFIX.sub("", bare)) or bare
    keys = [whole, last, bare, bare.replace(" ", "_").replace("-", "_"), plain]
    keys += [key.lstrip("0") for key in (bare, plain) if key.isdigit() and key.strip("0")]
    return list(dict.fromkeys(keys))
