"""`legoworld track`: the public half of a dataset's annotations, and a check of its photos.

Ground truth is read but never written: the output is built from a list of allowed keys.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np
from msgspec.structs import asdict

from legoworld.errors import LegoWorldError, UsageError, cause
from legoworld.files import atomic_path, names_a_file
from legoworld.pluralize import in_another_folder
from legoworld.records.base import UNSET, canonical, readable
from legoworld.records.track import ImageInfo, MadeTrack, TrackInfo
from legoworld.track_making.family import load_track_family
from legoworld.tracks.track import Source, TrackImage, load_track, photo_names, photo_scene_name
from legoworld.tracks.vocabulary import find_dataset

T = TypeVar("T")
_PHOTO_FOLDERS: Final = ("", "train2017", "val2017")


@dataclass(frozen=True)
class PhotoProblem:
    """An unusable photo of a track. status: missing, unreadable or size."""

    status: str
    image: TrackImage
    found: str


def make_track(
    task: str,
    truth: Path,
    output: Path,
    *,
    sample: int | None,
    seed: int,
    chosen: Sequence[str] | None = None,
    options: Mapping[str, Any] | None = None,
    notice: Callable[[str], None] = lambda _text: None,
) -> MadeTrack:
    """Write a track of all images, a seeded `sample`, or the `chosen` images of a ground truth.

    truth: COCO or LVIS JSON, or a folder of measured depth. Samples are drawn from all listed
    images, annotated or not. chosen: ids or file names; options: the family's own, such as
    those of a depth folder; notice:
    called with what is left out. Returns the document. Raises CatalogError for unusable ground
    truth, UsageError if it lacks the requested images.
    """
    source = load_track_family(task).source(task, truth, options or {})
    return write_track(task, source, output, sample=sample, seed=seed, chosen=chosen, notice=notice)


def write_track(
    task: str,
    source: Source,
    output: Path,
    *,
    sample: int | None = None,
    seed: int = 0,
    chosen: Sequence[str] | None = None,
    notice: Callable[[str], None] = lambda _text: None,
) -> MadeTrack:
    """`make_track` of a ground truth whose public half is known."""
    images = sorted(source.images, key=lambda image: image.id)
    if sample is not None:
        images = _draw_sample(images, sample, seed, source.name)
    if chosen is not None:
        images = _select_images(images, chosen, source.name)
    selected = _Selection(sample=sample, seed=seed, by_name=chosen is not None)
    return _write(task, source, images, selected, output, notice)


def make_tracks(
    truths: Mapping[str, Path],
    output: Path,
    *,
    sample: int | None,
    seed: int,
    chosen: Sequence[str] | None = None,
    every: bool = False,
    options: Mapping[str, Mapping[str, Any]] | None = None,
    notice: Callable[[str], None] = lambda _text: None,
) -> dict[str, MadeTrack]:
    """Write OUTPUT/<task>.json for each task, over the same photos.

    truths: by task. The photos are those that all truths list, with `every` those that any lists;
    two images are one photo where they name the same scene folder. sample and chosen select among
    the photos. options: by task. Raises as `make_track`; UsageError where no photo is left.
    """
    sources = {
        task: load_track_family(task).source(task, truth, (options or {}).get(task, {}))
        for task, truth in truths.items()
    }
    listed = {
        task: {photo_scene_name(image): image for image in source.images}
        for task, source in sources.items()
    }
    name = " and ".join(dict.fromkeys(source.name for source in sources.values()))
    photos = _list_photos([*listed.values()], name, every=every)
    if sample is not None:
        photos = _draw_sample(photos, sample, seed, name)
    if chosen is not None:
        images = [of[photo] for of in listed.values() for photo in photos if photo in of]
        wanted = {photo_scene_name(image) for image in _select_images(images, chosen, name)}
        photos = [photo for photo in photos if photo in wanted]
    selected = _Selection(sample=sample, seed=seed, by_name=chosen is not None)
    output.mkdir(parents=True, exist_ok=True)
    tracks = {}
    for task, source in sources.items():
        images = [listed[task][photo] for photo in photos if photo in listed[task]]
        images.sort(key=lambda image: image.id)
        tracks[task] = _write(task, source, images, selected, output / f"{task}.json", notice)
    return tracks


def _list_photos(listed: Sequence[Mapping[str, ImageInfo]], name: str, *, every: bool) -> list[str]:
    """The scene folders of the photos that all truths list, or any; sorted."""
    sets = [set(images) for images in listed]
    photos = sorted(set.union(*sets) if every else set.intersection(*sets))
    if not photos:
        raise UsageError(
            "the ground truths have no photo in common",
            found=", ".join(
                f"{min(images, default='none')} among {len(images)}" for images in sets
            ),
            expected=f"one photo that {name} list",
            next_step="pass truths over the same photos, or --any for the photos of any of them",
        )
    return photos


@dataclass(frozen=True, kw_only=True)
class _Selection:
    """How a track's images were selected. by_name: from a list of names."""

    sample: int | None
    seed: int
    by_name: bool


def _write(
    task: str,
    source: Source,
    images: Sequence[ImageInfo],
    selection: _Selection,
    output: Path,
    notice: Callable[[str], None],
) -> MadeTrack:
    info = TrackInfo(
        description=f"legoworld track: public half of {source.name}",
        task=find_dataset(task),
        dataset_version=source.version,
        source=source.name,
        source_sha256=source.sha256,
        source_images=len(source.images),
        sample=selection.sample,
        seed=None if selection.sample is None else selection.seed,
        chosen=selection.by_name,
        **asdict(source.part),
    )
    ids = {image.id for image in images}
    document = MadeTrack(
        info=info,
        images=tuple(images),
        categories=source.categories,
        questions=tuple(q for q in source.questions if q.image_id in ids) or UNSET,
    )
    with atomic_path(output) as unfinished:
        unfinished.write_text(_readable(document), encoding="utf-8")
        load_track(unfinished, name=f"of {source.name}")  # the same checks as in every later step
    for text in source.notices:
        notice(text)
    return document


def _draw_sample(items: Sequence[T], sample: int, seed: int, name: str) -> list[T]:
    """A seeded sample without repetition, in the order of the items."""
    if sample > len(items):
        raise UsageError(
            "--sample exceeds the number of images",
            found=f"--sample {sample}",
            expected=f"at most {len(items)}, the number of images in {name}",
        )
    drawn = np.random.default_rng(seed).choice(len(items), sample, replace=False)
    return [items[i] for i in sorted(drawn.tolist())]


def _select_images(
    images: Sequence[ImageInfo], chosen: Sequence[str], name: str
) -> list[ImageInfo]:
    """The images with these ids or file names, in the order of the ground truth."""
    by_name = {key: image for image in images for key in (str(image.id), *photo_names(image))}
    unknown = [text for text in chosen if text not in by_name]
    if unknown or not chosen:
        meant = in_another_folder(unknown[0], by_name) if unknown else None
        raise UsageError(
            "the ground truth has no such image",
            found=", ".join(map(repr, unknown[:5])) or "an empty list",
            expected=f"{meant!r}, as {name} has it in another folder"
            if meant
            else f"ids or file names of the {len(images)} images that {name} lists",
            next_step=f"if it is that photo, list that name or {by_name[meant].id}, its id"
            if meant
            else "correct the list: one id or file name per line",
        )
    ids = {by_name[text].id for text in chosen}
    return [image for image in images if image.id in ids]


def check_photos(
    images: Sequence[TrackImage],
    photos: Path,
    size_of: Callable[[Path], tuple[int, int]],
) -> list[PhotoProblem]:
    """The photos of a track that are missing, do not decode, or have the wrong size.

    size_of: a file's stored (width, height), without EXIF rotation; raises LegoWorldError.
    """
    problems = []
    for image in images:
        path = find_photo(photos, image)
        if path is None:
            problems.append(PhotoProblem("missing", image, "no such file"))
            continue
        try:
            size = size_of(path)
        except (LegoWorldError, OSError) as error:
            problems.append(PhotoProblem("unreadable", image, cause(error)))
            continue
        if image.size_wh is not None and size != image.size_wh:
            text = f"{size[0]}x{size[1]}, the track says {image.size_wh[0]}x{image.size_wh[1]}"
            problems.append(PhotoProblem("size", image, text))
    return problems


def find_photo(photos: Path, image: TrackImage) -> Path | None:
    """The path of a photo below PHOTOS or its train2017/ and val2017/."""
    for folder in _PHOTO_FOLDERS:
        candidate = photos / folder / image.file_name
        if names_a_file(candidate):
            return candidate
    return None


def _readable(document: MadeTrack) -> str:
    """JSON with one image, category or question per line."""
    info = readable(document.info).rstrip().replace("\n", "\n ")
    lists = [
        f'"{key}": [\n' + ",\n".join(map(canonical, entries)) + "\n]"
        for key, entries in (
            ("images", document.images),
            ("categories", document.categories),
            ("questions", document.questions),
        )
        if entries is not UNSET
    ]
    return "{\n" + ",\n".join([f'"info": {info}', *lists]) + "\n}\n"
