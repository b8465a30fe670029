"""Classes of pixels from ground truth: PNGs of ids, panoptic segments, or COCO's instances."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as _mask

from legoworld.cards import Card
from legoworld.errors import cause
from legoworld.evaluation.detection.inputs.masks import areas_px, compress_mask
from legoworld.evaluation.label_maps.family import MapTruth, MapTruthError
from legoworld.evaluation.label_maps.png import read_ids, read_values
from legoworld.evaluation.panoptic.family import places
from legoworld.evaluation.panoptic.truth import TrueSegments, pictures, read_truth, true_segments
from legoworld.evaluation.run import Run
from legoworld.files import names_a_file
from legoworld.readouts.family import protocol
from legoworld.readouts.label_maps import BACKGROUND, NO_CLASS
from legoworld.records.base import RecordError, read_json
from legoworld.records.run_rows import RunImage
from legoworld.tracks.vocabulary import Vocabulary, from_json, make_vocabulary

#: What the names of ground truth have in place of the photo's ending: Cityscapes' own.
_ENDINGS: Final = (("", ""), ("_leftImg8bit", "_gtFine_labelIds"))
_API: Any = _mask


@dataclass(frozen=True, kw_only=True)
class Painted:
    """One image's masks, in the order in which they are laid over the background.

    masks: (category id or `NO_CLASS`, segmentation of COCO).
    """

    masks: tuple[tuple[int, Any], ...]
    size_wh: tuple[int, int]
    background: int


TrueClasses = Path | Painted | TrueSegments
"""What is needed to load the classes of one image."""


def find_classes(path: Path, run: Run, card: Card) -> MapTruth:
    """The ground truth of a run's images: a folder of PNGs, or a JSON file. MapTruthError."""
    ignore = tuple(card.value("truth.ignore"))
    vocabulary = protocol(run.task, None).vocabulary
    assert vocabulary is not None
    if path.is_dir():
        named = [(image.image_id, find_png(path, image)) for image in run.images]
        files = {number: file for number, file in named if file is not None}
        inputs = [("truth", file) for file in files.values()]
        return MapTruth(vocabulary=vocabulary, images=files, inputs=inputs, rules=ignore)
    document = _document(path)
    if any("segments_info" in entry for entry in document["annotations"][:1]):
        listed = read_truth(path)
        return MapTruth(
            vocabulary=make_vocabulary(listed.categories, str(path)),
            images=true_segments(path, listed, run.images),
            inputs=[("truth", path), *pictures(path, listed, run.images)],
            rules=ignore,
        )
    painted = painted_instances(document, path, vocabulary, run.images)
    inputs = [("truth", path)]
    return MapTruth(vocabulary=vocabulary, images=painted, inputs=inputs, rules=ignore)


def find_png(folder: Path, image: RunImage) -> Path | None:
    """The PNG that is named like a photo, by its own path or by its name alone."""
    stem = PurePosixPath(image.file_name).with_suffix("")
    for ending, other in _ENDINGS:
        if stem.name.endswith(ending):
            name = f"{stem.name.removesuffix(ending) if ending else stem.name}{other}.png"
            for place in (folder / stem.parent / name, folder / name):
                if names_a_file(place):
                    return place
    return None


def painted_instances(
    document: Mapping[str, Any], path: Path, vocabulary: Vocabulary, images: Sequence[RunImage]
) -> dict[int, Painted]:
    """COCO's instances as classes of a vocabulary with a background.

    Categories are matched by name or synonym; the smaller mask lies on top. A crowd lies below all
    instances: of a matched category it is of that class, of another one it is not scored. Instances
    of other categories are background. MapTruthError for a vocabulary without a background.
    """
    background = vocabulary.match(BACKGROUND)
    if background is None:
        raise MapTruthError(
            f"{path.name} has masks of instances, and the vocabulary no background",
            found="annotations without segments_info",
            expected="a folder of PNGs, or panoptic ground truth",
        )
    theirs = from_json(document["categories"], str(path)).categories
    names = {category.id: vocabulary.match(category.name) for category in theirs}
    by_image: dict[int, list[Mapping[str, Any]]] = {}
    for entry in document["annotations"]:
        by_image.setdefault(entry["image_id"], []).append(entry)
    sizes = {entry["id"]: (entry["width"], entry["height"]) for entry in document["images"]}
    painted = {}
    for image in images:
        if image.image_id not in sizes:
            continue
        size_wh, masks = sizes[image.image_id], []
        for entry in by_image.get(image.image_id, ()):
            category, crowd = names.get(entry["category_id"]), bool(entry.get("iscrowd"))
            if category is not None or crowd:
                mask = compress_mask(entry["segmentation"], size_wh[::-1])
                order = (not crowd, -float(areas_px([mask])[0]), entry["id"])
                masks.append((order, NO_CLASS if category is None else category.id, mask))
        painted[image.image_id] = Painted(
            masks=tuple((number, mask) for _, number, mask in sorted(masks, key=lambda m: m[0])),
            size_wh=size_wh,
            background=background.id,
        )
    return painted


def load_classes(
    truth: TrueClasses, ignore: Sequence[int], category_ids: Sequence[int]
) -> NDArray[Any]:
    """(H, W) uint8 category ids, `NO_CLASS` where nothing is scored. MapTruthError for others."""
    if isinstance(truth, Painted):
        values = np.full(truth.size_wh[::-1], truth.background, np.uint8)
        for number, mask in truth.masks:
            values[_API.decode(mask) > 0] = number
        return values
    if isinstance(truth, TrueSegments):
        ids = read_ids(truth.path, MapTruthError)
        place = places(ids, truth.segments, truth.path.name, MapTruthError)
        ordered = sorted(truth.segments, key=lambda segment: segment.id)
        return np.array([NO_CLASS, *(s.category_id for s in ordered)], np.uint8)[place]
    values = read_values(truth, MapTruthError)
    seen = np.flatnonzero(np.bincount(values.ravel(), minlength=256)).tolist()
    strange = sorted({*seen} - {*category_ids, *ignore})
    if strange:
        raise MapTruthError(
            f"{truth.name} has values that are no category",
            found=f"{strange[0]}",
            expected=f"ids of the vocabulary, or one of {', '.join(map(str, ignore))}, not scored",
        )
    return values


def _document(path: Path) -> dict[str, Any]:
    try:
        document = read_json(path.read_bytes())
    except (OSError, RecordError) as error:
        raise MapTruthError(
            f"{path.name} cannot be read",
            found=cause(error),
            expected="a folder of PNGs, panoptic JSON, or COCO instances",
        ) from error
    keys = ("images", "annotations", "categories")
    if not isinstance(document, dict) or not all(isinstance(document.get(k), list) for k in keys):
        raise MapTruthError(
            f"{path.name} is no ground truth", expected=f"JSON with {', '.join(keys)}"
        )
    return document
