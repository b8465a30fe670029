"""What every entry of a results list must have, before anything of it is scored."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, Final

from legoworld.errors import LegoWorldError, one_line
from legoworld.evaluation.detection.inputs.box_formats import finite_floats, is_finite
from legoworld.pluralize import counted, share, word_for
from legoworld.tracks.vocabulary import Vocabulary

#: What to do where a key is missing that a results list must have and ground truth has not.
_ADD: Final = {
    "score": "add each detection's confidence; ground truth has none and is not imported",
}


class PredictionsInvalidError(LegoWorldError):
    """A results list holds something that would make a wrong number."""

    code = "predictions_invalid"


def _refuse(
    bad: Sequence[object], of: int, what: str, found: str, expected: str, next_step: str = ""
) -> None:
    """what: of several predictions, beginning with "are" or "have"."""
    if bad:
        verb, _, rest = what.partition(" ")
        one = {"are": "is", "have": "has"}[verb]
        raise PredictionsInvalidError(
            f"{share(len(bad), of, 'prediction', 'predictions')} "
            f"{word_for(len(bad), one, verb)} {rest}",
            found=found,
            expected=expected,
            next_step=next_step,
        )


def sound_keys(entries: Sequence[Any], payload: str) -> bool:
    """Whether `check_keys` surely finds nothing, without a call for each entry."""
    keys = {"image_id", "category_id", "score", payload}
    if not set(map(type, entries)) <= {dict} or not all(map(keys.issubset, entries)):
        return False
    ids = {type(e[key]) for key in ("image_id", "category_id") for e in entries}
    return ids <= {int} and finite_floats([e["score"] for e in entries]) is not None


def check_keys(entries: Sequence[Any], payload: str) -> None:
    """PredictionsInvalidError for entries without what scoring reads."""
    strangers = [e for e in entries if not isinstance(e, dict)]
    _refuse(
        strangers,
        len(entries),
        "are something else than a JSON object",
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


def check_ids(
    entries: Sequence[dict[str, Any]], status: Mapping[int, str], vocabulary: Vocabulary
) -> None:
    """PredictionsInvalidError for ids that the run or the vocabulary does not have."""
    bad = [e for e in entries if e["image_id"] not in status]
    _refuse(
        bad,
        len(entries),
        "are of images the run does not have",
        f"image {bad[0]['image_id']}" if bad else "",
        f"one of the run's {counted(len(status), 'image', 'images')}, such as {min(status)}",
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
