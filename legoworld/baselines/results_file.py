"""Anyone's detection results: their format and label names to a run's own, or a refusal."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from legoworld.baselines.box_formats import BoxFormat, with_xywh
from legoworld.baselines.labels import Matcher
from legoworld.evaluation.predictions import PredictionsInvalidError

_LISTS: Final = ("annotations", "predictions", "results")
_NAME_KEYS: Final = ("category_name", "category", "label")

Entry = dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class ResultsFile:
    """Entries as the file has them, and the category names the file itself gives to its ids."""

    entries: tuple[Any, ...]
    names: Mapping[int, str]


def read_results(path: Path) -> ResultsFile:
    """A COCO or LVIS results list, or an object with such a list and perhaps "categories".

    PredictionsInvalidError when the file is neither.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise PredictionsInvalidError(
            f"{path.name} cannot be read", found=str(error), expected="results as JSON"
        ) from error
    if isinstance(document, list):
        return ResultsFile(entries=tuple(document), names={})
    lists = [k for k in _LISTS if isinstance(document, dict) and isinstance(document.get(k), list)]
    if len(lists) != 1:
        keys = sorted(document)[:6] if isinstance(document, dict) else type(document).__name__
        raise PredictionsInvalidError(
            f"{path.name} holds no results",
            found=f"{keys}",
            expected='a list of {"image_id", "category_id", "bbox" or "segmentation", "score"}, or '
            f"an object with one of {', '.join(_LISTS)}",
        )
    return ResultsFile(entries=tuple(document[lists[0]]), names=_names(document, path))


def ours(
    found: ResultsFile, matcher: Matcher, box_format: BoxFormat
) -> tuple[list[Entry], dict[str, int]]:
    """Entries with our category ids and x, y, width, height; labels left out, with counts.

    A category is taken by its name where the file has one, or the label map has its id; by its id
    otherwise. LabelsUnmatchedError for names that are nowhere; whatever else is wrong is left for
    the check that follows.
    """
    entries = []
    for entry in found.entries:
        converted = _with_our_category(entry, found.names, matcher)
        if converted is not None:
            entries.append(with_xywh(converted, box_format))
    matcher.refuse_unmatched()
    return entries, dict(sorted(matcher.left_out.items()))


def _with_our_category(entry: Any, names: Mapping[int, str], matcher: Matcher) -> Any:
    """The entry under our category id; None when its label is left out or not found."""
    if not isinstance(entry, dict):
        return entry
    label = _label(entry, names, matcher)
    if label is None:
        return entry
    category = matcher.match(label)
    if category is None:
        return None
    return {**entry, "category_id": category.id}


def _label(entry: Entry, names: Mapping[int, str], matcher: Matcher) -> str | None:
    for key in _NAME_KEYS:
        if isinstance(entry.get(key), str):
            return str(entry[key])
    category_id = entry.get("category_id")
    if isinstance(category_id, int) and matcher.knows(str(category_id)):
        return str(category_id)
    if isinstance(category_id, int) and names:
        return names.get(category_id, f"category id {category_id}")
    return None


def _names(document: Entry, path: Path) -> dict[int, str]:
    categories = document.get("categories") or []
    try:
        return {int(c["id"]): str(c["name"]) for c in categories}
    except (KeyError, TypeError, ValueError) as error:
        raise PredictionsInvalidError(
            f"{path.name} has categories that cannot be used",
            found=f"{type(error).__name__}: {error}",
            expected='"categories": [{"id", "name"}]',
        ) from error


def by_image(entries: Sequence[Entry]) -> dict[Any, list[Entry]]:
    """Entries by image id, in their order."""
    groups: dict[Any, list[Entry]] = {}
    for entry in entries:
        groups.setdefault(entry["image_id"], []).append(entry)
    return groups
