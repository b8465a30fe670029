"""Amodal masks: compared as masks are, with the visible part of each beside it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Final

from legoworld.evaluation.detection.inputs.amodal_truth import check_amodal, coco_document
from legoworld.evaluation.detection.inputs.masks import (
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
from legoworld.evaluation.detection.inputs.texts import TextBuilder
from legoworld.evaluation.detection.payloads.masks import MASKS, as_lists
from legoworld.evaluation.detection.payloads.payload import Checking, Outline, Row
from legoworld.records.evaluation_view import TrueImage
from legoworld.records.predictions import AmodalPrediction, Rle

_NOT_ALL: Final = "predictions scored by their amodal masks alone: not all have a visible_mask"


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
    columns, n_empty = MASKS.checked(given, checking)
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
    given=_make_columns,
    checked=_check_columns,
    check_shapes=check_amodal,
    outline=_outline,
    document=coco_document,
)
