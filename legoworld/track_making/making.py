"""`legoworld track`: the public half of a dataset's annotations, and a check of its photos.

Ground truth is read but never written: the output is built from a list of allowed keys.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from msgspec.structs import asdict

from legoworld.errors import CatalogError, LegoWorldError, UsageError, cause
from legoworld.evaluation.detection.inputs.truth_checks import (
    check_annotations,
    check_image_values,
    check_images,
)
from legoworld.files import atomic_path, names_a_file, sha256_of_file
from legoworld.pluralize import in_another_folder
from legoworld.records.base import RecordError, canonical, read_json, readable, to_record
from legoworld.records.track import PRIVATE_KEYS, ImageInfo, MadeTrack, TrackInfo
from legoworld.track_making.depth_folders import depth_folder_source
from legoworld.track_making.eth3d import eth3d_source
from legoworld.tracks.dataset_versions import dataset_of, dataset_version
from legoworld.tracks.source import Source
from legoworld.tracks.track import TrackImage, load_track, photo_names
from legoworld.tracks.vocabulary import categories_in, vocabulary_of

#: The allowed keys of an image. LVIS's lists of verified categories count as annotations.
_PUBLIC_KEYS: Final = tuple(key for key in ImageInfo.__struct_fields__ if key not in PRIVATE_KEYS)
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
    depth: DepthChoice | None = None,
    notice: Callable[[str], None] = lambda _text: None,
) -> MadeTrack:
    """Write a track of all images, a seeded `sample`, or the `chosen` images of a ground truth.

    truth: COCO or LVIS JSON, or a folder of measured depth. Samples are drawn from all listed
    images, annotated or not. chosen: ids or file names; depth: options for a depth folder; notice:
    called with what is left out. Returns the document. Raises CatalogError for unusable ground
    truth, UsageError if it lacks the requested images.
    """
    if task == "eth3d":
        source = depth_source(truth, depth or DepthChoice())
    else:
        source = annotation_source(task, truth)
    images = sorted(source.images, key=lambda image: image.id)
    if sample is not None:
        if sample > len(images):
            raise UsageError(
                "--sample exceeds the number of images",
                found=f"--sample {sample}",
                expected=f"at most {len(images)}, the number of images in {source.name}",
            )
        drawn = np.random.default_rng(seed).choice(len(images), sample, replace=False)
        images = [images[i] for i in sorted(drawn.tolist())]
    if chosen is not None:
        images = _chosen(images, chosen, source.name)
    info = TrackInfo(
        description=f"legoworld track: public half of {source.name}",
        task=dataset_of(task),  # a track of coco serves coco-masks
        dataset_version=source.version,
        source=source.name,
        source_sha256=source.sha256,
        source_images=len(source.images),
        sample=sample,
        seed=None if sample is None else seed,
        chosen=chosen is not None,
        **asdict(source.part),
    )
    document = MadeTrack(info=info, images=tuple(images), categories=source.categories)
    with atomic_path(output) as unfinished:
        unfinished.write_text(_readable(document), encoding="utf-8")
        load_track(unfinished, called=f"of {source.name}")  # the same checks as in every later step
    for text in source.notices:
        notice(text)
    return document


def _chosen(images: Sequence[ImageInfo], chosen: Sequence[str], name: str) -> list[ImageInfo]:
    """The images with these ids or file names, in the order of the ground truth."""
    by_name = {key: image for image in images for key in _names_of(image)}
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


def _names_of(image: ImageInfo) -> list[str]:
    """The accepted names of an image: its id and its file names."""
    return [str(image.id), *photo_names(image)]


@dataclass(frozen=True, kw_only=True)
class DepthChoice:
    """Options for a folder of measured depth.

    scenes: the scenes to take in ETH3D's layout, None for all; dataset: the name of a dataset other
    than ETH3D; photos: the photos of a folder of depth files, None in ETH3D's layout.
    """

    scenes: Sequence[str] | None = None
    dataset: str | None = None
    photos: Path | None = None


def depth_source(folder: Path, choice: DepthChoice) -> Source:
    """The public half of a folder of measured depth: ETH3D's layout, or files named like photos."""
    if not folder.is_dir():
        raise UsageError(
            "the ground truth of depth is a folder",
            found=folder.name,
            expected="a folder of depth files",
        )
    if choice.photos is None:
        return eth3d_source(folder, scenes=choice.scenes, dataset=choice.dataset)
    if choice.scenes is not None:
        raise UsageError(
            "--scenes and --photos cannot be combined",
            found="both",
            expected="--scenes for ETH3D's layout, --photos for depth files named like the photos",
        )
    return depth_folder_source(folder, choice.photos, dataset=choice.dataset)


def annotation_source(task: str, path: Path) -> Source:
    """The public half of a COCO-style annotation file.

    Its annotations, if any, get the same checks as in scoring: TruthInvalidError.
    """
    if path.is_dir():
        raise UsageError(
            "the ground truth is a folder",
            found=str(path),
            expected="a COCO or LVIS annotation file",
        )
    try:
        document = read_json(path.read_bytes())
        entries, _ = document["images"], document["categories"]
    except (OSError, RecordError, KeyError, TypeError) as error:
        raise CatalogError(
            f"{path} cannot be read",
            found=cause(error)
            if isinstance(error, RecordError)
            else f"{type(error).__name__}: {error}",
            expected="COCO or LVIS JSON with images and categories",
        ) from error
    categories = categories_in(document["categories"], str(path))
    vocabulary = vocabulary_of(categories, str(path))
    if not isinstance(entries, list):
        raise CatalogError(
            f"{path} lists no images", found=type(entries).__name__, expected="a list"
        )
    images = check_images(str(path), entries, Counter())
    _check_dataset(task, path, list(images.values()))
    annotations = document.get("annotations")
    if isinstance(annotations, list):
        check_image_values(str(path), list(images.values()), federated=task == "lvis")
        check_annotations(
            str(path),
            annotations,
            images=images,
            wanted=images,
            category_ids=(c.id for c in categories),
            masks=task != "coco",  # boxes are scored without
            repairs=Counter(),
        )
    public = [{key: e[key] for key in _PUBLIC_KEYS if key in e} for e in images.values()]
    try:
        infos = to_record(tuple[ImageInfo, ...], public)
    except RecordError as error:
        raise CatalogError(
            f"{path} has images that cannot be used",
            found=str(error),
            expected='"images": [{"id", "file_name" or "coco_url", "width", "height"}]',
        ) from error
    return Source(
        name=path.name,
        version=dataset_version(vocabulary, task),
        sha256=sha256_of_file(path),
        images=infos,
        categories=categories,
    )


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
            found = size_of(path)
        except (LegoWorldError, OSError) as error:
            problems.append(PhotoProblem("unreadable", image, cause(error)))
            continue
        if image.size_wh is not None and found != image.size_wh:
            text = f"{found[0]}x{found[1]}, the track says {image.size_wh[0]}x{image.size_wh[1]}"
            problems.append(PhotoProblem("size", image, text))
    return problems


def find_photo(photos: Path, image: TrackImage) -> Path | None:
    """The path of a photo below PHOTOS or its train2017/ and val2017/."""
    for folder in _PHOTO_FOLDERS:
        candidate = photos / folder / image.file_name
        if names_a_file(candidate):
            return candidate
    return None


def _check_dataset(task: str, path: Path, entries: Sequence[Mapping[str, Any]]) -> None:
    """LVIS lists verified categories on every image, COCO on none."""
    federated = [e for e in entries if "neg_category_ids" in e]
    if len(federated) != (len(entries) if task == "lvis" else 0):
        raise CatalogError(
            f"{path} is not ground truth of {task}",
            found=f"{len(federated)} of {len(entries)} images have neg_category_ids",
            expected="all of them in LVIS, none in COCO",
            next_step="pass the --task this file belongs to",
        )


def _readable(document: MadeTrack) -> str:
    """JSON with one image or category per line."""
    info = readable(document.info).rstrip().replace("\n", "\n ")
    lists = [
        f'"{key}": [\n' + ",\n".join(map(canonical, entries)) + "\n]"
        for key, entries in (("images", document.images), ("categories", document.categories))
    ]
    return "{\n" + ",\n".join([f'"info": {info}', *lists]) + "\n}\n"
