"""Masks: run lengths, overlapped by our own function, as ratios of integers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.detection.grid import PICTURE
from legoworld.evaluation.detection.inputs.masks import (
    EncodedMask,
    Texts,
    bounding_box,
    compress_mask,
    covers,
    joined_texts,
    measure_masks,
    union,
)
from legoworld.evaluation.detection.inputs.prediction_checks import unusable_mask
from legoworld.evaluation.detection.inputs.prediction_columns import (
    GivenColumns,
    PredictionColumns,
    Sizes,
    mask_columns,
)
from legoworld.evaluation.detection.inputs.prediction_order import in_order, without_empty
from legoworld.evaluation.detection.inputs.truth_checks import check_masks
from legoworld.evaluation.detection.payloads.boxes import BOXES
from legoworld.evaluation.detection.payloads.payload import (
    Checking,
    Outline,
    Overlaps,
    Payload,
    Row,
)
from legoworld.evaluation.kernels.library import call
from legoworld.records.base import UnsetType
from legoworld.records.coco_file import Segmentation, TrueImage
from legoworld.records.predictions import MaskPrediction, Rle

if TYPE_CHECKING:
    from legoworld.evaluation.detection.matching.matches import Chunk

_UNCOMPRESSED: Final = "masks with uncompressed RLE, compressed before scoring"
#: Both evaluators would take the box's area for the mask's.
_BOXED: Final = "masks with a bbox, which was left out"


def _check_columns(given: GivenColumns, checking: Checking) -> tuple[PredictionColumns, int]:
    """The masks that are scored, and how many without a pixel were dropped."""
    _check_sizes(given, checking.sizes_wh)
    masks, warnings = in_order(given.columns, checking.order), checking.warnings
    warnings[_UNCOMPRESSED] = given.n_uncompressed
    warnings[_BOXED] = given.n_boxed
    empty = _areas(masks, checking.sizes_wh) == 0
    if not empty.any():
        return masks, 0
    protocol = checking.protocol
    if protocol.federated:
        kept = without_empty(masks, empty, protocol.per_image_cap, warnings)
        return kept, int(empty.sum())
    what = "masks without a pixel, scored as pycocotools does: they match nothing"
    warnings[what] = int(empty.sum())
    return masks, 0


def _check_sizes(given: GivenColumns, sizes_wh: Sizes) -> None:
    """PredictionsInvalidError for a mask of another size than its image."""
    columns = given.columns
    images, place = np.unique(columns.image_id, return_inverse=True)
    expected = np.array([sizes_wh[i][::-1] for i in images.tolist()], np.int64).reshape(-1, 2)
    wrong = np.flatnonzero((given.size_hw != expected[place]).any(axis=1))
    for index in wrong[:1].tolist():
        size, wanted = given.size_hw[index].tolist(), expected[place[index]].tolist()
        problem = f"size {size}, the image's [height, width] is {wanted}"
        raise unusable_mask(int(columns.image_id[index]), int(columns.category_id[index]), problem)


def _areas(entries: PredictionColumns, sizes_wh: Sizes) -> NDArray[np.float64]:
    """(n,) pixels of every mask, once its run lengths add up to its image.

    pycocotools does not check this, and reads beyond the end of invalid counts.
    """
    assert isinstance(entries.shape, Texts)
    covered, areas = measure_masks(entries.shape)
    images, place = np.unique(entries.image_id, return_inverse=True)
    sizes = [sizes_wh[i] for i in images.tolist()]
    pixels = np.array([width * height for width, height in sizes], np.int64)
    for index in np.flatnonzero(covered != pixels[place])[:1].tolist():
        problem = covers(int(covered[index]), sizes[place[index]])
        raise unusable_mask(int(entries.image_id[index]), int(entries.category_id[index]), problem)
    return areas


def _overlaps(chunk: Chunk) -> Overlaps:
    first_detection, first_truth = chunk.first_detection, chunk.first_truth
    iou = np.empty(int((np.diff(first_detection) * np.diff(first_truth)).sum()))
    height = np.array([h for h, _ in chunk.sizes_hw], np.int64)
    sizes_hw = [chunk.sizes_hw[i] for i in chunk.truths.image.tolist()]
    wanted = zip(chunk.true_shapes, sizes_hw, strict=True)
    true_texts = [compress_mask(mask, size_hw)["counts"] for mask, size_hw in wanted]
    texts, start = joined_texts([text.encode("ascii") for text in chunk.shapes])
    true_text, true_start = joined_texts(true_texts)
    crowd = np.ascontiguousarray(chunk.truths.crowd)
    call(
        "lw_overlap_masks", texts, start, true_text, true_start, first_detection, first_truth,
        height, len(height), crowd, iou,
    )  # fmt: skip
    _, area = measure_masks(chunk.shapes)
    return Overlaps(iou=iou, area=area)


def _shape(row: Row, size_hw: tuple[int, int]) -> EncodedMask:
    return compress_mask(as_lists(row.segmentation), size_hw)


def _outline(row: Row, image: TrueImage) -> Outline:
    """A mask's counts, or the polygons; a prediction's box is its mask's."""
    if not isinstance(row.segmentation, Rle):
        return Outline(box=row.bbox or (), polygons=row.segmentation or ())
    mask = _shape(row, (image.height, image.width))
    return Outline(box=row.bbox or bounding_box(mask), rle=mask["counts"].decode("ascii"))


def as_lists(segmentation: Segmentation | UnsetType) -> dict[str, Any] | list[list[float]]:
    """A mask or polygons as pycocotools takes them."""
    if not isinstance(segmentation, Rle):
        return [[*polygon] for polygon in segmentation or ()]
    counts = segmentation.counts
    kept = counts if isinstance(counts, str) else [*counts]
    return {"size": [*segmentation.size], "counts": kept}


MASKS: Final = Payload(
    name="masks",
    iou_type="segm",
    grid=PICTURE,
    record=MaskPrediction,
    field="segmentation",
    read_columns=mask_columns,
    check_columns=_check_columns,
    check_shapes=check_masks,
    pack_shapes=tuple,
    overlaps=_overlaps,
    shape=_shape,
    compare_shapes=BOXES.compare_shapes,
    enclose_shapes=union,
    outline=_outline,
)
