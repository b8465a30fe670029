"""Tracks from panoptic ground truth, from COCO's instances, and from folders of class PNGs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from legoworld.cards import load_card
from legoworld.errors import UsageError
from legoworld.evaluation.label_maps.family import MapTruthError
from legoworld.evaluation.label_maps.png import read_values
from legoworld.evaluation.panoptic.truth import read_truth
from legoworld.evaluation.semantic.truth import find_png
from legoworld.files import sha256_of_file
from legoworld.readouts.label_maps import BACKGROUND
from legoworld.records.base import read_json
from legoworld.records.run_rows import RunImage
from legoworld.records.track import ImageInfo
from legoworld.shipped import catalog
from legoworld.track_making.annotations import annotation_source
from legoworld.track_making.family import TrackFamily
from legoworld.track_making.pixel_folders import Arrays, pixel_folder_source
from legoworld.tracks.track import Source
from legoworld.tracks.vocabulary import categories_in, dataset_version, make_vocabulary


def panoptic_source(task: str, path: Path, _options: Mapping[str, object]) -> Source:
    """The public half of panoptic ground truth: photos and categories."""
    document = read_truth(path)
    images = tuple(
        ImageInfo(
            id=image.id,
            width=image.width,
            height=image.height,
            file_name=image.file_name,
            coco_url=image.coco_url,
        )
        for image in document.images
    )
    vocabulary = make_vocabulary(document.categories, str(path))
    return Source(
        name=path.name,
        version=dataset_version(vocabulary, task),
        sha256=sha256_of_file(path),
        images=images,
        categories=document.categories,
    )


def semantic_source(task: str, path: Path, options: Mapping[str, Any]) -> Source:
    """The public half of classes of pixels, with the task's own categories."""
    file = catalog.folder("datasets") / load_card(task).value("vocabulary.file")
    categories = categories_in(read_json(file.read_bytes()), str(file))
    version = dataset_version(make_vocabulary(categories, str(file)), task)
    if path.is_dir():
        source = _folder_source(task, path, options)
    elif any(category.name == BACKGROUND for category in categories):
        source = annotation_source(task, path)
    else:
        return panoptic_source(task, path, options)
    return replace(source, version=version, categories=categories)


def _folder_source(task: str, folder: Path, options: Mapping[str, Any]) -> Source:
    photos = options.get("photos")
    if photos is None:
        raise UsageError(
            f"a folder of PNGs of {task} needs the photos",
            found=f"{folder.name} without --photos",
            expected="--truth FOLDER --photos PHOTOS",
        )

    def size_wh(path: Path) -> tuple[int, int]:
        high, wide = read_values(path, MapTruthError).shape
        return wide, high

    def find(name: str) -> list[Path]:
        file = find_png(folder, RunImage(image_id=0, file_name=name, status="ok"))
        return [file] if file else []

    arrays = Arrays(noun="classes", read=size_wh, size_wh=size_wh, find=find)
    return pixel_folder_source(folder, photos, dataset=options.get("dataset"), arrays=arrays)


PANOPTIC: Final = TrackFamily(source=panoptic_source)
SEMANTIC: Final = TrackFamily(source=semantic_source, options=frozenset({"dataset", "photos"}))
