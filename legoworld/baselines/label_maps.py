"""Masks that a baseline's process gives of an image, checked and decoded."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray
from pycocotools import mask as _mask

from legoworld.baselines.records import AnswerInvalidError, AnswerRules
from legoworld.evaluation.detection.inputs.masks import (
    compress_mask,
    covers,
    measure_masks,
    rle_problem,
)
from legoworld.readouts.label_maps import write_map
from legoworld.records.base import UNSET, UnsetType
from legoworld.records.baseline_messages import Message
from legoworld.records.run_file import ImageRecord, ImageSource
from legoworld.records.run_rows import Segment
from legoworld.running.image_record import initial_row
from legoworld.tracks.track import TrackImage

_API: Any = _mask


def answered_masks(
    image: TrackImage, answer: Message, rules: AnswerRules
) -> Iterator[tuple[int, NDArray[np.bool_]]]:
    """Category id and (H, W) bool of each mask with a pixel, in the process's order.

    AnswerInvalidError for what cannot be used.
    """
    if answer.predictions is None or rules.vocabulary is None or image.size_wh is None:
        raise AnswerInvalidError(
            "the baseline gave no masks",
            found="an answer without them",
            expected='"predictions", a list of category_id and segmentation',
        )
    known = {category.id for category in rules.vocabulary.categories}
    width, height = image.size_wh
    for entry in answer.predictions:
        mask, category_id = entry.get("segmentation"), entry.get("category_id")
        problem = rle_problem(mask, image.size_wh)
        if problem is None and category_id not in known:
            problem = f"category_id {category_id!r}"
        if problem is not None:
            raise AnswerInvalidError("a mask of the baseline cannot be used", found=problem)
        made = compress_mask(mask, (height, width))
        covered = int(measure_masks([made["counts"].decode("ascii")])[0][0])
        if covered != width * height:
            found = covers(covered, image.size_wh)
            raise AnswerInvalidError("a mask of the baseline cannot be used", found=found)
        pixels = _API.decode(made) > 0
        if pixels.any():
            yield int(str(category_id)), pixels


def map_record(
    image: TrackImage,
    run: Path,
    pixels: NDArray[np.uint8],
    source: ImageSource,
    segments: tuple[Segment, ...] | UnsetType = UNSET,
) -> ImageRecord:
    """The record of an image whose PNG is written here. pixels: (H, W) grey or (H, W, 3) RGB."""
    height, width = pixels.shape[:2]
    row = replace(
        initial_row(image),
        rendered_wh=(width, height),
        answer=write_map(run, image.scene, pixels),
        segments=segments,
    )
    return ImageRecord(row=row, scene=source)
