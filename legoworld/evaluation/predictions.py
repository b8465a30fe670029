"""Predictions checked entry by entry and put into their order before anything scores them."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.conventions import EQUAL_CONFIDENCE
from legoworld.errors import LegoWorldError, one_line
from legoworld.evaluation.box_formats import check_box_format, finite_floats, is_finite
from legoworld.evaluation.caps import without_empty
from legoworld.evaluation.masks import compressed, covers, measured, rle_problem
from legoworld.evaluation.prediction_columns import PredictionColumns
from legoworld.evaluation.prediction_order import (
    PredictionOrder,
    in_order,
    order_of,
    places_in_order,
)
from legoworld.evaluation.protocols import DetectionProtocol
from legoworld.evaluation.run import Run
from legoworld.evaluation.truth import Truth
from legoworld.files import canonical_json
from legoworld.vocabulary import Vocabulary

CheckBoxes = Callable[[Sequence[dict[str, Any]], Mapping[int, tuple[int, int]]], Mapping[str, int]]


#: What to do where a key is missing that a results list must have and ground truth has not.
_ADD: Final = {
    "score": "add each detection's confidence; ground truth has none and is not imported",
}


class PredictionsInvalidError(LegoWorldError):
    """A results list holds something that would make a wrong number."""

    code = "predictions_invalid"


@dataclass(frozen=True, kw_only=True)
class Predictions:
    """Checked results by ascending image id, and inside an image in their `order`.

    entries: {"image_id", "category_id", "score"} and "bbox" or "segmentation", nothing else.
    warnings: counted repairs. n_dropped_empty: masks without a pixel, dropped as lvis does.
    """

    entries: PredictionColumns
    warnings: tuple[str, ...]
    n_dropped_empty: int
    order: PredictionOrder = "canonical"

    @property
    def sha256(self) -> str:
        """Hash of the entries as JSON, one line each."""
        return sha256_of_entries(self.entries)

    @property
    def sha256_equally_confident(self) -> str:
        """The same of `with_equal_confidence`."""
        return sha256_of_entries(with_equal_confidence(self).entries)

    @property
    def equally_confident(self) -> bool:
        """Whether no entry is ranked above another, and their order is canonical."""
        if len(set(self.entries.score)) > 1:
            return False
        places = places_in_order(self.entries, "canonical")
        return self.order == "canonical" or bool((np.diff(places) == 1).all())


def check_predictions(
    entries: Sequence[Any],
    *,
    run: Run,
    truth: Truth,
    protocol: DetectionProtocol,
) -> Predictions:
    """Check a results list against the run's images and the truth's categories.

    PredictionsInvalidError names the first offender and how many there are.
    """
    return check_results(
        entries,
        status_by_image={i.id: i.status for i in run.images},
        sizes_wh={i["id"]: (i["width"], i["height"]) for i in truth.images},
        vocabulary=truth.vocabulary,
        protocol=protocol,
        order=order_of(run.configuration),
    )


def check_results(
    entries: Sequence[Any],
    *,
    status_by_image: Mapping[int, str],
    sizes_wh: Mapping[int, tuple[int, int]],
    vocabulary: Vocabulary,
    protocol: DetectionProtocol,
    order: PredictionOrder = "canonical",
    check_boxes: CheckBoxes = check_box_format,
) -> Predictions:
    """Check a results list against the images of a run and a vocabulary; needs no truth.

    order: what the predictions are put into. check_boxes: `check_box_values` for a part of a run,
    where too few boxes tell their format.
    PredictionsInvalidError names the first offender and how many there are.
    """
    payload = "bbox" if protocol.iou_type == "bbox" else "segmentation"
    if not _sound(entries, payload):
        _check_keys(entries, payload)
    _check_ids(entries, status_by_image, vocabulary)
    warnings: Counter[str] = Counter()
    if payload == "bbox":
        warnings.update(check_boxes(entries, sizes_wh))
        shape = [e["bbox"] for e in entries]
    else:
        shape = [_counts(e, sizes_wh[e["image_id"]], warnings) for e in entries]
    kept = in_order(
        PredictionColumns(
            image_id=np.array([e["image_id"] for e in entries], np.int64),
            category_id=np.array([e["category_id"] for e in entries], np.int64),
            score=tuple(e["score"] for e in entries),
            shape=tuple(shape),
            sizes_wh=None if payload == "bbox" else sizes_wh,
        ),
        order,
    )
    n_empty = 0
    if payload != "bbox":
        empty = _areas(kept, sizes_wh) == 0
        boxed = sum("bbox" in e for e in entries)
        if boxed:  # both evaluators would take the box's area for the mask's
            warnings["masks with a bbox, which was left out"] = boxed
        if empty.any() and protocol.federated:
            n_empty = int(empty.sum())
            kept = without_empty(kept, empty, protocol.per_image_cap, warnings)
        elif empty.any():
            what = "masks without a pixel, scored as pycocotools does: they match nothing"
            warnings[what] = int(empty.sum())
    return Predictions(
        entries=kept,
        warnings=tuple(f"{count} {what}" for what, count in sorted(warnings.items())),
        n_dropped_empty=n_empty,
        order=order,
    )


def sha256_of_entries(entries: Iterable[dict[str, Any]]) -> str:
    """Hash of entries as JSON, one line each; their text is never in memory as a whole."""
    digest = hashlib.sha256()
    for entry in entries:
        digest.update(f"{canonical_json(entry)}\n".encode())
    return digest.hexdigest()


def with_equal_confidence(predictions: Predictions) -> Predictions:
    """The same predictions, none ranked above another, in canonical order.

    Files mostly list higher scores first: in their own order the ranking would still be there.
    """
    score = (EQUAL_CONFIDENCE,) * len(predictions.entries)
    entries = replace(predictions.entries, score=score)
    if predictions.order != "canonical":
        entries = in_order(entries, "canonical")
    return replace(predictions, entries=entries, order="canonical")


def _refuse(
    bad: Sequence[Any], of: int, what: str, found: str, expected: str, next_step: str = ""
) -> None:
    if bad:
        raise PredictionsInvalidError(
            f"{len(bad)} of {of} predictions {what}",
            found=found,
            expected=expected,
            next_step=next_step,
        )


def _sound(entries: Sequence[Any], payload: str) -> bool:
    """Whether `_check_keys` surely finds nothing, without a call for each entry."""
    keys = {"image_id", "category_id", "score", payload}
    if not set(map(type, entries)) <= {dict} or not all(map(keys.issubset, entries)):
        return False
    ids = {type(e[key]) for key in ("image_id", "category_id") for e in entries}
    return ids <= {int} and finite_floats([e["score"] for e in entries]) is not None


def _check_keys(entries: Sequence[Any], payload: str) -> None:
    strangers = [e for e in entries if not isinstance(e, dict)]
    _refuse(
        strangers,
        len(entries),
        "are not JSON objects",
        f"{one_line(json.dumps(strangers[0]), 60)}" if strangers else "",
        '{"image_id", ...}',
    )
    for key in ("image_id", "category_id", "score", payload):
        bad = [e for e in entries if key not in e]
        _refuse(
            bad,
            len(entries),
            f"have no {key}",
            f"the first of them has {_keys(bad[0])}" if bad else "",
            f"{key} in every prediction",
            _ADD.get(key, ""),
        )
    for key in ("image_id", "category_id"):
        bad = [e for e in entries if type(e[key]) is not int]
        _refuse(
            bad,
            len(entries),
            f"have no integer as their {key}",
            repr(bad[0][key]) if bad else "",
            "an int",
        )
    bad = [e for e in entries if not is_finite(e["score"])]
    _refuse(
        bad,
        len(entries),
        "have no usable score",
        repr(bad[0]["score"]) if bad else "",
        "a finite number",
    )


def _keys(entry: dict[str, Any]) -> str:
    """The keys of an entry in words."""
    *others, last = map(str, entry) if entry else ("no keys",)
    return one_line(f"{', '.join(others)} and {last}" if others else last, 120)


def _check_ids(
    entries: Sequence[dict[str, Any]], status: Mapping[int, str], vocabulary: Vocabulary
) -> None:
    bad = [e for e in entries if e["image_id"] not in status]
    _refuse(
        bad,
        len(entries),
        "are of images the run does not have",
        f"image {bad[0]['image_id']}" if bad else "",
        f"one of the run's {len(status)} images, such as {min(status)}",
    )
    bad = [e for e in entries if status[e["image_id"]] != "ok"]
    _refuse(
        bad,
        len(entries),
        "are of images the run calls unread",
        f"image {bad[0]['image_id']}: {status[bad[0]['image_id']]}" if bad else "",
        "predictions of images with status ok alone",
    )
    known = {c.id for c in vocabulary.categories}
    bad = [e for e in entries if e["category_id"] not in known]
    found = {e["category_id"] for e in entries}
    _refuse(
        bad,
        len(entries),
        "are of categories the vocabulary does not have",
        f"category ids {sorted({e['category_id'] for e in bad})[:8]}",
        f"one of {len(known)} ids between {min(known)} and {max(known)}",
        _mapping_hint(found, known),
    )


def _mapping_hint(found: set[int], known: set[int]) -> str:
    """What unknown ids look like: positions in the list of categories instead of its ids."""
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


def _counts(entry: dict[str, Any], size_wh: tuple[int, int], warnings: Counter[str]) -> str:
    """The compressed counts of an entry's mask."""
    mask = entry["segmentation"]
    problem = rle_problem(mask, size_wh)
    if problem:
        raise _unusable_mask(entry, problem)
    counts: str | list[int] = mask["counts"]
    if isinstance(counts, str):
        return counts
    warnings["masks with uncompressed RLE, compressed before scoring"] += 1
    text: str = compressed(mask, (size_wh[1], size_wh[0]))["counts"].decode("ascii")
    return text


def _areas(
    entries: PredictionColumns, sizes_wh: Mapping[int, tuple[int, int]]
) -> NDArray[np.float64]:
    """(n,) pixels of every mask, once its run lengths add up to its image.

    pycocotools never asks, and reads on behind the end of counts that do not.
    """
    covered, areas = measured(entries.shape)
    pixels = {image_id: width * height for image_id, (width, height) in sizes_wh.items()}
    for index in np.flatnonzero(covered != [pixels[i] for i in entries.image_id.tolist()])[:1]:
        entry = entries[int(index)]
        raise _unusable_mask(entry, covers(int(covered[index]), sizes_wh[entry["image_id"]]))
    return areas


def _unusable_mask(entry: dict[str, Any], problem: str) -> PredictionsInvalidError:
    return PredictionsInvalidError(
        f"a mask of image {entry['image_id']}, category {entry['category_id']} is unusable",
        found=problem,
        expected='{"size": [height, width] of the image, "counts": compressed RLE}',
    )
