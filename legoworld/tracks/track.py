"""Tracks: the images of a result and the vocabulary; public, never with annotations."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from legoworld.errors import CatalogError, cause, name_on_line
from legoworld.files import sha256_of_file
from legoworld.records.base import UNSET, RecordError, decode, find_repeated
from legoworld.records.folders.read_run import describe_other_folder
from legoworld.records.track import (
    PRIVATE_KEYS,
    CategoryInfo,
    ImageInfo,
    Part,
    Probe,
    Question,
    TrackFile,
)
from legoworld.remote import Place, folders_holding
from legoworld.tracks.vocabulary import Vocabulary, find_dataset, make_vocabulary

_SCENE_FILES = ("scene.blend", "scene.glb")
_BESIDE_A_SCENE = ("final.png", "scene.py", "labels.json", "provenance.json", "frozen.json",
                   "execution.json")  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class TrackImage:
    """One photo of a track. scene: its scene folder's path below SCENES, "/"-separated.

    hfov_deg: horizontal field of view, where the track tells it; probe: of a private track.
    """

    id: int
    file_name: str
    size_wh: tuple[int, int] | None  # None: the scene's own render size
    scene: str
    hfov_deg: float | None = None
    probe: Probe | None = None


@dataclass(frozen=True, kw_only=True)
class Track:
    """Images in ascending id, and the track's vocabulary (None if it has none).

    made_for: the task the track was made for, None if not recorded; questions: about its images.
    """

    images: tuple[TrackImage, ...]
    vocabulary: Vocabulary | None
    sha256: str | None
    made_for: str | None
    questions: tuple[Question, ...] = ()


def load_track(path: Path, name: str | None = None) -> Track:
    """Read a track file (COCO "image info" JSON). Raises CatalogError for an unusable file.

    name: the name to use in messages instead of the file's own.
    """
    source = name or str(path)
    try:
        file = decode(TrackFile, path.read_bytes())
    except (OSError, RecordError) as error:
        raise CatalogError(
            f"the track {source} cannot be read",
            found=cause(error),
            expected='COCO image-info JSON: {"info", "images": [{"id", "file_name" or "coco_url", '
            '"width", "height"}], "categories": [{"id", "name"}]}',
            next_step="make one with `legoworld track make`",
        ) from error
    _refuse_annotations(file, source)
    images = sorted((_image(info, source) for info in file.images), key=lambda i: i.id)
    _refuse_duplicates(images, source)
    made_for = (file.info or {}).get("task")
    return Track(
        images=tuple(images),
        vocabulary=make_vocabulary(file.categories, source) if file.categories else None,
        sha256=sha256_of_file(path),
        made_for=None if made_for is None else str(made_for),
        questions=file.questions,
    )


def serves(track: Track, task: str) -> bool:
    """Whether a track belongs to a task's dataset; COCO boxes and masks share one."""
    return track.made_for is None or find_dataset(track.made_for) == find_dataset(task)


def make_folder_track(scenes: Place) -> Track:
    """Every folder below SCENES with a scene file is an image, in order. CatalogError if none."""
    if isinstance(scenes, str):
        top = PurePosixPath(scenes).name
        folders = folders_holding(scenes, _SCENE_FILES)
    else:
        top = scenes.resolve().name
        folders = sorted(
            Path(folder).relative_to(scenes).as_posix()
            for folder, files in _visible_folders(scenes)
            if any(name in files for name in _SCENE_FILES)
        )
    if not folders:
        raise CatalogError(
            describe_other_folder(Path(scenes), "a folder of scenes") or "no scene to read",
            found=f"no scene.blend or scene.glb below {scenes}",
            expected="SCENES/<photo name without extension>/scene.blend",
            next_step="pass the folder that contains the scene folders",
        )
    images = tuple(
        TrackImage(id=i, file_name=top if name == "." else name, size_wh=None, scene=name)
        for i, name in enumerate(folders, start=1)
    )
    return Track(images=images, vocabulary=None, sha256=None, made_for=None)


def folders_without_scene(scenes: Path) -> list[str]:
    """Folders below SCENES with other files of a scene folder, or a folder named as the scene."""
    return sorted(
        Path(folder).relative_to(scenes).as_posix()
        for folder, files in _visible_folders(scenes)
        if Path(folder) != scenes
        and not any(name in files for name in _SCENE_FILES)
        and (
            any(name in files for name in _BESIDE_A_SCENE)
            or any(os.path.isdir(f"{folder}/{name}") for name in _SCENE_FILES)  # noqa: PTH112
        )
    )


def _visible_folders(top: Path) -> Iterator[tuple[str, list[str]]]:
    """Folders below a folder with their file names; links are followed, hidden folders skipped."""
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
    """The scene folder of a photo: its path without the extension."""
    path = PurePosixPath(file_name)
    return str(path.with_suffix(""))


def _image(info: ImageInfo, source: str) -> TrackImage:
    name = _file_name(info)
    parts = PurePosixPath(name).parts
    if ".." in parts or name.startswith("/") or not parts or name_on_line(name) != name:
        raise CatalogError(
            f"the track {source} has an image that cannot be used",
            found=f"id {info.id}, file_name {name!r}",
            expected="a path below the photos' folder, as file_name or at the end of coco_url, "
            "without control characters",
        )
    return TrackImage(
        id=info.id,
        file_name=name,
        size_wh=(info.width, info.height),
        scene=scene_name(name),
        hfov_deg=None if info.hfov_deg is UNSET else info.hfov_deg,
        probe=None if info.probe is UNSET else info.probe,
    )


def photo_scene_name(info: ImageInfo) -> str:
    """The scene folder of an image's photo; a photo in several datasets has one."""
    return scene_name(_file_name(info))


def _file_name(info: ImageInfo) -> str:
    """The photo's file name: the URL's where there is none, or where it is LVIS v0.5's.

    LVIS v0.5 calls 000000000042.jpg COCO_val2014_000000000042.jpg, and only its URL says the name.
    A copy of a photo has the URL of the first and a name of its own.
    """
    name, by_url = info.file_name or "", _name_by_url(info)
    return by_url if by_url and (not name or name.endswith(f"_{by_url}")) else name


def photo_names(info: ImageInfo) -> list[str]:
    """The names of an image's photo: its file name, and the last part of its URL."""
    return [name for name in (info.file_name, _name_by_url(info)) if name]


def _name_by_url(info: ImageInfo) -> str:
    return PurePosixPath(info.coco_url or "").name


def _refuse_annotations(file: TrackFile, source: str) -> None:
    for part in (file, *file.images):
        private = [key for key in PRIVATE_KEYS if getattr(part, key) is not UNSET]
        if private:
            raise CatalogError(
                f"{source} contains annotations, but a track is public",
                found=f"key {private[0]!r}",
                expected="images and categories only",
                next_step="write the public half with `legoworld track make`",
            )


def _refuse_duplicates(images: list[TrackImage], source: str) -> None:
    for attribute in ("id", "file_name", "scene"):
        values = [getattr(image, attribute) for image in images]
        if twice := find_repeated(values):
            raise CatalogError(
                f"the track {source} lists an image twice",
                found=f"{attribute} {twice[0]!r}",
                expected=f"distinct {attribute}s",
            )


@dataclass(frozen=True, kw_only=True)
class Source:
    """The public half of a whole dataset.

    name: of the file or folder; version: of the dataset, "custom" for a user's own; sha256: of the
    files that images and categories were read from; part: the part of the dataset that is present,
    if known; questions: about the images, where there are any; notices: messages for the user.
    """

    name: str
    version: str
    sha256: str
    images: tuple[ImageInfo, ...]
    categories: tuple[CategoryInfo, ...] = ()
    questions: tuple[Question, ...] = ()
    part: Part = field(default_factory=Part)
    notices: tuple[str, ...] = ()
