"""Third-party detection results: conversion of their format and label names, or refusal."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, cast

from legoworld.baselines.box_formats import BoxFormat
from legoworld.baselines.foreign_results import (
    RESULTS,
    Entry,
    next_step_for,
    output_entries,
    per_image_outputs,
    refuse_other_documents,
)
from legoworld.baselines.labels import Matcher
from legoworld.errors import one_line
from legoworld.evaluation.detection.inputs.masks import compress_mask
from legoworld.evaluation.detection.inputs.prediction_checks import PredictionsInvalidError
from legoworld.files import Json, utf8_text
from legoworld.pluralize import share, word_for
from legoworld.readouts.masks import are_near
from legoworld.records.base import RecordError, read_json
from legoworld.records.predictions import Prediction

_EXACT: Final = 2**53  # from here on a float names several integers
_IDS: Final = ("image_id", "category_id")
_LISTS: Final = ("annotations", "predictions", "results")
#: Only a result, or an image's results, has one of these beside what names them.
_OF_ONE: Final = ("bbox", "boxes", "segmentation")
_NAME_KEYS: Final = ("category_name", "category", "label")


@dataclass(frozen=True, kw_only=True)
class ResultsFile:
    """Entries as in the file, and the file's own information about its ids.

    names: its category names by id; images: its image entries by id; box_format: None where its
    kind does not say; n_float_ids: entries with an id written as 139.0, read as 139.
    """

    entries: tuple[Entry, ...]
    names: Mapping[int, str]
    images: Mapping[Hashable, Entry]
    box_format: BoxFormat | None = None
    n_float_ids: int = 0

    @property
    def of_torchvision(self) -> bool:
        """True for torchvision outputs, whose labels are COCO's category ids."""
        return self.box_format is not None


@dataclass(frozen=True, kw_only=True)
class NamedEntries:
    """Entries with category ids of the vocabulary if they had a name.

    by_id: those that have an id and no name, counted by it; left_out: labels the map drops.
    """

    entries: list[Entry]
    by_id: Counter[int]
    left_out: dict[str, int]


def read_results(path: Path) -> ResultsFile:
    """Detection results of any supported kind, with category, location and score.

    A COCO or LVIS results list; an object with such a list, optionally with its own "images" and
    "categories" (a complete COCO JSON); one such object per line; or torchvision outputs, one
    {"boxes", "labels", "scores"} per image. PredictionsInvalidError for anything else.
    """
    results = _read_entries(path)
    written = [
        entry
        for entry in results.entries  # not by a loop over _IDS: there are millions
        if type(entry.get("image_id")) is float or type(entry.get("category_id")) is float
    ]
    if not written:
        return results
    entries = tuple(_with_whole_ids(entry, path) for entry in results.entries)
    return replace(results, entries=entries, n_float_ids=len(written))


def _with_whole_ids(entry: Entry, path: Path) -> Entry:
    """An entry with integers for ids that pandas, say, has written as 139.0."""
    ids = {key: value for key in _IDS if isinstance(value := entry.get(key), float)}
    for key, value in ids.items():
        if not value.is_integer() or abs(value) >= _EXACT:  # NaN and infinity are none either
            raise PredictionsInvalidError(
                f"{path.name} has a result whose {key} is not an integer",
                found=f"{value!r}",
                expected="an integer",
                next_step="write the dataset's ids into the results",
            )
    return {**entry, **{key: int(value) for key, value in ids.items()}} if ids else entry


def _read_entries(path: Path) -> ResultsFile:
    """The file's entries as they are."""
    document = _as_list(_read(path))
    refuse_other_documents(document, path)
    outputs = per_image_outputs(document)
    if outputs is not None:
        entries = tuple(output_entries(outputs, path))
        return ResultsFile(entries=entries, names={}, images={}, box_format="xyxy")
    if isinstance(document, list):
        return ResultsFile(entries=_objects(document), names={}, images={})
    lists = [k for k in _LISTS if isinstance(document, dict) and isinstance(document.get(k), list)]
    if len(lists) != 1:
        keys = sorted(document)[:6] if isinstance(document, dict) else type(document).__name__
        raise PredictionsInvalidError(
            f"{path} contains no results",
            found=f"{keys}",
            expected=f"{RESULTS}, or an object with one of {', '.join(_LISTS)}",
        )
    return ResultsFile(
        entries=_objects(document[lists[0]]),
        names=_names(document, path),
        images=_images(document, path),
    )


def _objects(values: list[Json]) -> tuple[Entry, ...]:
    strangers = [value for value in values if not isinstance(value, dict)]
    if strangers:
        raise PredictionsInvalidError(
            f"{share(len(strangers), len(values), 'prediction', 'predictions')} "
            f"{word_for(len(strangers), 'is no JSON object', 'are not JSON objects')}",
            found=one_line(json.dumps(strangers[0]), 60),
            expected='{"image_id", ...}',
        )
    return cast("tuple[Entry, ...]", tuple(values))


def _read(path: Path) -> Any:
    """The file's JSON; for JSON lines, their list."""
    try:
        data = path.read_bytes()
        try:
            return read_json(data)
        except RecordError:
            lines = [line for line in utf8_text(data).encode().split(b"\n") if line.strip()]
            if len(lines) < 2 or not lines[0].lstrip().startswith(b"{"):
                raise
            return [read_json(line) for line in lines]
    except (OSError, ValueError) as error:
        raise PredictionsInvalidError(
            f"{path} cannot be read",
            found=str(error),
            expected="results as JSON",
            next_step=next_step_for(path),
        ) from error


def _as_list(document: Json) -> Any:
    """A one-line file is both JSON and JSON lines: a single result becomes a list."""
    if not isinstance(document, dict) or any(isinstance(document.get(k), list) for k in _LISTS):
        return document
    return [document] if any(key in document for key in _OF_ONE) else document


def with_our_categories(
    results: ResultsFile,
    entries: Sequence[Entry],
    matcher: Matcher,
    numbering: Mapping[int, int] | None,
) -> NamedEntries:
    """Entries with the vocabulary's category ids, if they or the file's categories name one.

    A category is matched by name if the file has one or the label map has its id, otherwise by id
    in the given numbering (theirs to ours). LabelsUnmatchedError for unknown names; all other
    errors are left to the next check.
    """
    kept: list[Entry] = []
    by_id: Counter[int] = Counter()
    for entry in entries:
        label = _label(entry, results.names, matcher)
        if label is None:
            kept.append(_with_our_id(entry, by_id, numbering or {}))
            continue
        category = matcher.match(label)
        if category is not None:
            kept.append({**entry, "category_id": category.id})
    matcher.refuse_unmatched()
    return NamedEntries(entries=kept, by_id=by_id, left_out=dict(sorted(matcher.left_out.items())))


def _with_our_id(entry: Entry, by_id: Counter[int], numbering: Mapping[int, int]) -> Entry:
    category_id = entry.get("category_id")
    if type(category_id) is not int:
        return entry
    by_id[category_id] += 1
    return {**entry, "category_id": numbering.get(category_id, category_id)}


def with_masks(
    entries: Sequence[Entry], sizes_wh: Mapping[int, tuple[int, int]], key: str = "segmentation"
) -> tuple[list[Entry], int]:
    """Entries with polygons filled as pycocotools fills those of ground truth, and their number.

    key: where an entry has its mask. Anything but a polygon list is left to the next check.
    """
    filled, count = [], 0
    for entry in entries:
        mask, image_id = entry.get(key), entry.get("image_id")
        size = sizes_wh.get(image_id) if mask and type(image_id) is int else None
        if size is not None and _are_polygons(mask):
            rle = compress_mask(mask, (size[1], size[0]))
            text: Entry = {"size": [size[1], size[0]], "counts": rle["counts"].decode("ascii")}
            entry, count = {**entry, key: text}, count + 1
        filled.append(entry)
    return filled, count


def _are_polygons(mask: Json) -> bool:
    if not isinstance(mask, list):
        return False
    if not all(isinstance(p, list) and len(p) >= 6 and len(p) % 2 == 0 for p in mask):
        return False
    polygons = cast("list[list[float]]", mask)
    return all(type(v) in (int, float) for p in polygons for v in p) and are_near(
        v for p in polygons for v in p
    )


def _label(entry: Entry, names: Mapping[int, str], matcher: Matcher) -> str | None:
    for key in _NAME_KEYS:
        if isinstance(entry.get(key), str):
            return str(entry[key])
    category_id = entry.get("category_id")
    if isinstance(category_id, str):
        return category_id
    if isinstance(category_id, int) and matcher.knows(str(category_id)):
        return str(category_id)
    if isinstance(category_id, int) and names:
        return names.get(category_id, f"category id {category_id}")
    return None


def _names(document: Entry, path: Path) -> dict[int, str]:
    categories: Any = document.get("categories") or []
    try:
        return {int(c["id"]): str(c["name"]) for c in categories}
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise PredictionsInvalidError(
            f"{path} has categories that cannot be used",
            found=f"{type(error).__name__}: {error}",
            expected='"categories": [{"id", "name"}]',
        ) from error


def _images(document: Entry, path: Path) -> dict[Hashable, Entry]:
    images: Any = document.get("images") or []
    usable = isinstance(images, list) and all(
        isinstance(i, dict) and isinstance(i.get("id"), Hashable) for i in images
    )
    by_id = {i.get("id"): i for i in images} if usable else {}
    if not usable or len(by_id) != len(images) or None in by_id:
        raise PredictionsInvalidError(
            f"{path} has images that cannot be used",
            found=f"{len(images)} entries, {len(by_id)} ids" if usable else repr(images)[:60],
            expected='"images": [{"id", "file_name"}], ids distinct',
        )
    return by_id


def by_image(predictions: Iterable[Prediction]) -> dict[int, list[Prediction]]:
    """Predictions by image id, in their order."""
    groups: dict[int, list[Prediction]] = {}
    for prediction in predictions:
        groups.setdefault(prediction.image_id, []).append(prediction)
    return groups
