"""Amodal masks: compared as masks are, with the visible part of each beside it.

Ground truth is our own, or a file of KINS, D2SA, COCOA-cls or COCOA. All are brought to COCO's form
with the amodal mask as `segmentation` and a `visible_mask` in each annotation.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, cast

from legoworld.errors import cause
from legoworld.evaluation.detection.inputs.masks import (
    TextBuilder,
    compress_mask,
    covers,
    difference,
    measure_masks,
)
from legoworld.evaluation.detection.inputs.prediction_checks import compressed_counts, unusable_mask
from legoworld.evaluation.detection.inputs.prediction_columns import (
    GivenColumns,
    PredictionColumns,
    Sizes,
    mask_columns,
)
from legoworld.evaluation.detection.inputs.truth_checks import (
    Foreign,
    TruthInvalidError,
    check_masks,
)
from legoworld.evaluation.detection.payloads.masks import MASKS, as_lists
from legoworld.evaluation.detection.payloads.payload import Checking, Outline, Row
from legoworld.files import Json
from legoworld.records.coco_file import TrueImage
from legoworld.records.predictions import AmodalPrediction, Rle

#: What the visible mask is called: in D2SA, COCOA and ours; in KINS; in KINS as it was first given.
_VISIBLE: Final = ("visible_mask", "inmodal_seg", "i_segm")
#: The categories of COCOA, whose regions have names in free text.
_COCOA: Final[list[Json]] = [{"id": 1, "name": "object"}, {"id": 2, "name": "stuff"}]
_NOT_ALL: Final = "predictions scored by their amodal masks alone: not all have a visible_mask"


def coco_document(document: Json, name: str) -> Any:
    """A truth file's content in our form. TruthInvalidError without a visible mask in it."""
    given = document.get("annotations") if isinstance(document, dict) else None
    if not isinstance(document, dict) or not isinstance(given, list):
        return document  # refused by who reads it
    annotations = [a for a in given if isinstance(a, dict)]
    if len(annotations) < len(given):
        return document
    if annotations and all("regions" in a for a in annotations):
        annotations = _cocoa_annotations(annotations, name)
        document = {**document, "categories": _COCOA}
    if annotations and not any(key in a for a in annotations for key in _VISIBLE):
        raise TruthInvalidError(
            f"{name} is no amodal ground truth",
            found="no visible_mask in any annotation",
            expected="COCO JSON with segmentation (amodal) and visible_mask or inmodal_seg",
            next_step="`legoworld export RUN --format kins` writes one from a run of amodal",
        )
    return {**document, "annotations": [_with_visible(a) for a in annotations]}


def _with_visible(annotation: Foreign) -> Foreign:
    """What nothing hides may come without a visible mask: it is the amodal one."""
    for key in _VISIBLE:
        if annotation.get(key) is not None:
            return {**annotation, "visible_mask": annotation[key]}
    if annotation.get("occlude_rate"):
        return annotation
    return {**annotation, "visible_mask": annotation.get("segmentation")}


def _cocoa_annotations(annotations: Sequence[Foreign], name: str) -> list[Foreign]:
    images = {str(a.get("image_id")) for a in annotations}
    if len(images) < len(annotations):
        raise TruthInvalidError(
            f"images of {name} are annotated more than once",
            found=f"{len(annotations)} annotations of {len(images)} images",
            expected="one annotator's regions for each image",
            next_step="keep one annotation of each image",
        )
    try:
        regions = [(a["image_id"], r) for a in annotations for r in cast("Any", a["regions"])]
        return [_region(k, *one) for k, one in enumerate(regions, start=1)]
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise TruthInvalidError(
            f"{name} has regions that cannot be used",
            found=cause(error),
            expected='COCOA\'s "regions": [{"segmentation": [x, y, ...], "area", "visible_mask"}]',
        ) from error


def _region(number: int, image_id: Json, region: dict[str, Any]) -> Foreign:
    """An annotation of one of COCOA's regions. KeyError, TypeError, ValueError."""
    corners = region["segmentation"]
    x, y = corners[0::2], corners[1::2]
    return {
        **{key: region[key] for key in (*_VISIBLE, "occlude_rate") if key in region},
        "id": number,
        "image_id": image_id,
        "category_id": 2 if region.get("isStuff") else 1,
        "segmentation": [corners],
        "bbox": [min(x), min(y), max(x) - min(x), max(y) - min(y)],
        "area": region["area"],
        "iscrowd": 0,
    }


def check_amodal(name: str, own: Sequence[Foreign], images: Mapping[int, Foreign]) -> None:
    """Both masks of each annotation. An empty list is the visible mask of what is hidden."""
    check_masks(name, own, images)
    for entry in own:
        image = images[cast("int", entry["image_id"])]
        if entry.get("visible_mask") == []:
            width, height = cast("int", image["width"]), cast("int", image["height"])
            entry["visible_mask"] = {"size": [height, width], "counts": [width * height]}
    visible = [{**entry, "segmentation": entry.get("visible_mask")} for entry in own]
    check_masks(f"{name} (visible_mask)", visible, images)
    for entry, checked in zip(own, visible, strict=True):
        entry["visible_mask"] = checked["segmentation"]


def _make_columns(batches: Iterable[Sequence[AmodalPrediction]], sizes_wh: Sizes) -> GivenColumns:
    visible = TextBuilder()

    def with_visible() -> Iterator[Sequence[AmodalPrediction]]:
        for batch in batches:
            visible.add([_counts(p, p.visible_mask) for p in batch if p.visible_mask])
            yield batch

    given = mask_columns(with_visible(), sizes_wh)
    texts = visible.texts()
    whole = len(texts) == len(given.columns)
    columns = replace(given.columns, visible=texts) if whole else given.columns
    return replace(given, columns=columns, n_boxed=0)  # a bbox is part of the format


def _counts(prediction: AmodalPrediction, mask: Rle) -> str:
    if mask.size != prediction.segmentation.size:
        problem = f"visible_mask of size {[*mask.size]}, segmentation of another"
        raise unusable_mask(prediction.image_id, prediction.category_id, problem)
    return mask.counts if isinstance(mask.counts, str) else compressed_counts(prediction, mask)


def _check_columns(given: GivenColumns, checking: Checking) -> tuple[PredictionColumns, int]:
    columns, n_empty = MASKS.check_columns(given, checking)
    if columns.visible is None:
        checking.warnings[_NOT_ALL] = len(columns)
        return columns, n_empty
    covered, _ = measure_masks(columns.visible)
    ids = columns.image_id.tolist(), columns.category_id.tolist()
    for image_id, category_id, pixels in zip(*ids, covered.tolist(), strict=True):
        width, height = size_wh = checking.sizes_wh[image_id]
        if pixels != width * height:
            raise unusable_mask(image_id, category_id, f"visible_mask: {covers(pixels, size_wh)}")
    return columns, n_empty


def _outline(row: Row, image: TrueImage) -> Outline:
    outline, size_hw = MASKS.outline(row, image), (image.height, image.width)
    if not row.visible_mask:
        return outline
    visible = compress_mask(as_lists(row.visible_mask), size_hw)
    hidden = difference(MASKS.shape(row, size_hw), visible)
    return replace(outline, hidden=hidden["counts"].decode("ascii"))


AMODAL: Final = replace(
    MASKS,
    name="amodal",
    record=AmodalPrediction,
    read_columns=_make_columns,
    check_columns=_check_columns,
    check_shapes=check_amodal,
    outline=_outline,
    document=coco_document,
)
