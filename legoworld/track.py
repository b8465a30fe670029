"""Tracks: the images a result is about and the vocabulary; public, never an annotation."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from legoworld.dataset_versions import dataset_of
from legoworld.errors import CatalogError
from legoworld.files import sha256_of_file
from legoworld.places import Place, folders_holding
from legoworld.repeats import repeated
from legoworld.vocabulary import LARGEST_ID, Vocabulary, from_json

_SCENE_FILES = ("scene.blend", "scene.glb")
_PRIVATE_KEYS = ("annotations", "segmentation", "bbox", "area", "iscrowd")


@dataclass(frozen=True, kw_only=True)
class TrackImage:
    """One photo of a track. scene: its scene folder's path below SCENES, "/"-separated."""

    id: int
    file_name: str
    size_wh: tuple[int, int] | None  # None: the scene's own render size
    scene: str


@dataclass(frozen=True, kw_only=True)
class Track:
    """Images in ascending id, and the vocabulary the track carries (None when it has none)."""

    images: tuple[TrackImage, ...]
    vocabulary: Vocabulary | None
    sha256: str | None
    info: dict[str, Any]


def load_track(path: Path, called: str | None = None) -> Track:
    """Read a track file (COCO "image info" JSON). CatalogError says what cannot be used.

    called: the file's name in messages, where it is another one's.
    """
    source = called or path.name
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise CatalogError(
            f"the track {source} cannot be read",
            found=str(error),
            expected='COCO image-info JSON: {"info", "images", "categories"}',
            next_step="make one with `legoworld track make`",
        ) from error
    entries = document.get("images") if isinstance(document, dict) else None
    if not isinstance(entries, list) or not entries:
        raise CatalogError(
            f"the track {source} lists no image",
            found=f'"images" is {type(entries).__name__}',
            expected='a list of {"id", "file_name", "width", "height"}',
        )
    _refuse_annotations(document, entries, source)
    images = sorted((_image(entry, source) for entry in entries), key=lambda i: i.id)
    _refuse_duplicates(images, source)
    categories = document.get("categories")
    return Track(
        images=tuple(images),
        vocabulary=from_json(categories, source) if categories else None,
        sha256=sha256_of_file(path),
        info=document.get("info") or {},
    )


def serves(track: Track, task: str) -> bool:
    """Whether a track is of a task's dataset; COCO's boxes and masks share theirs."""
    made_for = track.info.get("task")
    return made_for is None or dataset_of(str(made_for)) == dataset_of(task)


def track_of_folder(scenes: Place) -> Track:
    """Every folder below SCENES with a scene file is an image, numbered in sorted order."""
    if isinstance(scenes, str):
        top = PurePosixPath(scenes).name
        found = folders_holding(scenes, _SCENE_FILES)
    else:
        top = scenes.resolve().name
        found = sorted(
            Path(folder).relative_to(scenes).as_posix()
            for folder, files in _visible_folders(scenes)
            if any(name in files for name in _SCENE_FILES)
        )
    if not found:
        raise CatalogError(
            "there is no scene to read",
            found=f"no scene.blend or scene.glb below {top}",
            expected="SCENES/<photo name without extension>/scene.blend",
            next_step="pass the folder that holds the scene folders",
        )
    images = tuple(
        TrackImage(id=i, file_name=top if name == "." else name, size_wh=None, scene=name)
        for i, name in enumerate(found, start=1)
    )
    return Track(images=images, vocabulary=None, sha256=None, info={})


def _visible_folders(top: Path) -> Iterator[tuple[str, list[str]]]:
    """Folders below one with their files' names; links are followed, hidden folders left out."""
    seen: set[str] = set()
    for folder, below, files in os.walk(top, followlinks=True):
        real = os.path.realpath(folder)
        if real in seen:
            below.clear()
            continue
        seen.add(real)
        below[:] = sorted(name for name in below if not name.startswith("."))
        yield folder, files


def scene_name(file_name: str) -> str:
    """The scene folder of a photo: its own path without the extension."""
    path = PurePosixPath(file_name)
    return str(path.with_suffix(""))


def _image(entry: Any, source: str) -> TrackImage:
    try:
        name = _file_name(entry)
        size = (entry["width"], entry["height"])
        image_id = entry["id"]
    except (AttributeError, KeyError, TypeError) as error:
        raise CatalogError(
            f"the track {source} has an image that cannot be used",
            found=repr(entry)[:100],
            expected='{"id", "file_name" or "coco_url", "width", "height"}',
        ) from error
    parts = PurePosixPath(str(name)).parts
    if (
        type(image_id) is not int
        or not 0 <= image_id <= LARGEST_ID
        or any(type(x) is not int or x < 1 for x in size)
        or not isinstance(name, str)
        or ".." in parts
        or name.startswith("/")
        or not parts
    ):
        raise CatalogError(
            f"the track {source} has an image that cannot be used",
            found=f"id {image_id!r}, file_name {name!r}, size {size}",
            expected="an integer id of 0 to 2**53, a relative file_name, a width and height of at "
            "least 1",
        )
    return TrackImage(id=image_id, file_name=name, size_wh=size, scene=scene_name(name))


def _file_name(entry: dict[str, Any]) -> Any:
    """The photo's file name. LVIS names photos by their coco_url (v0.5's file_name is another)."""
    name = entry.get("file_name")
    if not entry.get("coco_url"):
        return entry["file_name"]
    by_url = PurePosixPath(entry["coco_url"]).name
    return name if name and PurePosixPath(name).name == by_url else by_url


def _refuse_annotations(document: dict[str, Any], entries: list[Any], source: str) -> None:
    private = [key for key in _PRIVATE_KEYS if key in document]
    private += [k for e in entries if isinstance(e, dict) for k in _PRIVATE_KEYS if k in e]
    if private:
        raise CatalogError(
            f"{source} holds annotations, and a track is public",
            found=f"key {private[0]!r}",
            expected="images and categories only",
            next_step="make the public half with `legoworld track make`",
        )


def _refuse_duplicates(images: list[TrackImage], source: str) -> None:
    for attribute in ("id", "file_name", "scene"):
        values = [getattr(image, attribute) for image in images]
        if twice := repeated(values):
            raise CatalogError(
                f"the track {source} lists an image twice",
                found=f"{attribute} {twice[0]!r}",
                expected=f"distinct {attribute}s",
            )
