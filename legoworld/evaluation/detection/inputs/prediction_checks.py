"""Checks of the entries of a results list before scoring."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, TypeVar

import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from legoworld.errors import LegoWorldError, one_line
from legoworld.evaluation.detection.inputs.box_formats import is_finite
from legoworld.evaluation.detection.inputs.masks import compress_mask, rle_problem
from legoworld.files import Json
from legoworld.pluralize import plural, share, word_for
from legoworld.records.base import RecordError, to_record
from legoworld.records.folders.prediction_files import LIKE
from legoworld.records.predictions import MaskPrediction, Rle, Scored
from legoworld.tracks.vocabulary import Vocabulary

_P = TypeVar("_P", bound=Scored)

Ints = NDArray[np.int64]
#: Advice for a missing key that a results list needs and ground truth lacks.
_ADD: Final = {
    "score": "add each detection's confidence; ground truth has none and is not imported"
}


class PredictionsInvalidError(LegoWorldError):
    """A results list has content that would give a wrong number."""

    code = "predictions_invalid"


def as_predictions(entries: Sequence[Mapping[str, Json]], kind: type[_P]) -> list[_P]:
    """External results as a kind of prediction.

    PredictionsInvalidError names the place of the first that is none.
    """
    try:
        return to_record(list[kind], entries)  # type: ignore[valid-type]
    except RecordError as error:
        for key in (field.encode_name for field in structs.fields(kind) if field.required):
            without = [entry for entry in entries if key not in entry]
            _refuse(
                len(without),
                len(entries),
                f"have no {key}",
                f"the first of them has {_keys(without[0])}" if without else "",
                f"{key} in every prediction",
                _ADD.get(key, ""),
            )
        raise PredictionsInvalidError(
            "a prediction cannot be used", found=str(error), expected=LIKE
        ) from error


def _keys(entry: Mapping[str, Json]) -> str:
    """The keys of an entry as text."""
    *others, last = map(str, entry) if entry else ("no keys",)
    return one_line(f"{', '.join(others)} and {last}" if others else last, 120)


def check_ids(
    image_id: Ints, category_id: Ints, status: Mapping[int, str], vocabulary: Vocabulary
) -> None:
    """PredictionsInvalidError for (n,) ids unknown to the run or the vocabulary."""
    images = np.unique(image_id).tolist()
    if unknown := [i for i in images if i not in status]:
        _refuse(
            int(np.isin(image_id, unknown).sum()),
            len(image_id),
            "are of images the run does not have",
            f"image {unknown[0]}",
            f"one of the run's {plural(len(status), 'image', 'images')}, such as {min(status)}",
        )
    if unread := [i for i in images if status[i] != "ok"]:
        _refuse(
            int(np.isin(image_id, unread).sum()),
            len(image_id),
            "are of images the run calls unread",
            f"image {unread[0]}: {status[unread[0]]}",
            "predictions of images with status ok alone",
        )
    known = {c.id for c in vocabulary.categories}
    ids = set(np.unique(category_id).tolist())
    if unknown := sorted(ids - known):
        _refuse(
            int(np.isin(category_id, unknown).sum()),
            len(image_id),
            "are of categories the vocabulary does not have",
            f"category ids {unknown[:8]}",
            f"one of {len(known)} ids between {min(known)} and {max(known)}",
            _mapping_hint(ids, known),
        )


def check_scores(score: NDArray[Any]) -> None:
    """PredictionsInvalidError if one of (n,) scores is not a finite number."""
    if score.dtype == np.float64 and np.isfinite(score).all():
        return
    if bad := [value for value in score.tolist() if not is_finite(value)]:
        _refuse(len(bad), len(score), "have no usable score", repr(bad[0])[:60], "a finite number")


def compressed_counts(prediction: MaskPrediction, mask: Rle | None = None) -> str:
    """pycocotools' counts of a mask of plain run lengths. mask: None for its segmentation.

    PredictionsInvalidError where they do not add up to the mask's size.
    """
    mask = mask or prediction.segmentation
    height, width = mask.size
    rle = {"size": [height, width], "counts": [*mask.counts]}
    problem = rle_problem(rle, (width, height))
    if problem:
        raise unusable_mask(prediction.image_id, prediction.category_id, problem)
    counts: bytes = compress_mask(rle, (height, width))["counts"]
    return counts.decode("ascii")


def unusable_mask(image_id: int, category_id: int, problem: str) -> PredictionsInvalidError:
    """What to raise for a mask that cannot be scored."""
    return PredictionsInvalidError(
        f"a mask of image {image_id}, category {category_id} is unusable",
        found=problem,
        expected='{"size": [height, width] of the image, "counts": compressed RLE}',
    )


def _refuse(n: int, of: int, what: str, found: str, expected: str, next_step: str = "") -> None:
    """what: of several predictions, beginning with "are" or "have"."""
    if n:
        verb, _, rest = what.partition(" ")
        one = {"are": "is", "have": "has"}[verb]
        raise PredictionsInvalidError(
            f"{share(n, of, 'prediction', 'predictions')} {word_for(n, one, verb)} {rest}",
            found=found,
            expected=expected,
            next_step=next_step,
        )


def _mapping_hint(found: set[int], known: set[int]) -> str:
    """A hint if unknown ids look like positions in the list of categories."""
    n = len(known)
    positions = [
        f"{first}..{first + n - 1}"
        for first in (0, 1)
        if found <= set(range(first, first + n)) and known != set(range(first, first + n))
    ]
    if not positions:
        return "map categories by name"
    return (
        f"these look like positions {' or '.join(positions)}, not the dataset's ids "
        f"{min(known)}..{max(known)}: map categories by name"
    )
