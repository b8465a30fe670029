"""Category ids of results without names: the dataset's own, or positions in its category list.

A results file does not say which, and on few photos both fit, so the assumption is reported.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Final, Literal, get_args

from legoworld.baselines.foreign_results import Entry
from legoworld.errors import UsageError
from legoworld.evaluation.detection.inputs.prediction_checks import PredictionsInvalidError
from legoworld.pluralize import counted, share, word_for
from legoworld.shipped import catalog
from legoworld.tracks.dataset_versions import dataset_of, dataset_version
from legoworld.tracks.vocabulary import Vocabulary, normal_name

CategoryIds = Literal["dataset", "coco80-0", "coco80-1", "lvis-0"]
CATEGORY_IDS: Final[tuple[CategoryIds, ...]] = get_args(CategoryIds)

#: Contiguous numberings: their dataset, and the number of its first category.
_CONTIGUOUS: Final[Mapping[CategoryIds, tuple[str, int]]] = {
    "coco80-0": ("coco", 0),
    "coco80-1": ("coco", 1),
    "lvis-0": ("lvis", 0),
}
_SHOWN_CATEGORIES: Final = 8


def numberings(vocabulary: Vocabulary, task: str) -> dict[CategoryIds, dict[int, int]]:
    """Every numbering applicable to this vocabulary, as a map to the vocabulary's ids."""
    own = [category.id for category in vocabulary.categories]
    by_numbering: dict[CategoryIds, dict[int, int]] = {"dataset": {i: i for i in own}}
    dataset = dataset_of(task)
    if dataset_version(vocabulary, task) == "custom":
        return by_numbering
    for name, (of, first) in _CONTIGUOUS.items():
        if of == dataset:
            by_numbering[name] = dict(enumerate(own, start=first))
    return by_numbering


def numbering(declared: CategoryIds, vocabulary: Vocabulary, task: str) -> dict[int, int]:
    """The map from the declared numbering to the vocabulary's ids. UsageError if inapplicable."""
    known = numberings(vocabulary, task)
    if declared not in known:
        raise UsageError(
            f"--category-ids {declared} does not fit this track's categories",
            found=f"{len(vocabulary.categories)} categories of --task {task}",
            expected=" or ".join(known),
            next_step="map other ids with --label-map FILE",
        )
    return known[declared]


def fitting(ids: Iterable[int], vocabulary: Vocabulary, task: str) -> list[CategoryIds]:
    """The numberings that contain all of these ids."""
    wanted = set(ids)
    return [n for n, known in numberings(vocabulary, task).items() if wanted <= known.keys()]


def check_numbering(by_id: Counter[int], known: Mapping[int, int], declared: str) -> None:
    """Raise PredictionsInvalidError for category ids outside the declared numbering."""
    bad = {i: count for i, count in by_id.items() if i not in known}
    if bad:
        raise PredictionsInvalidError(
            f"{share(sum(bad.values()), by_id.total(), 'prediction', 'predictions')} "
            f"{word_for(sum(bad.values()), 'has', 'have')} no category id of {declared}",
            found=f"category ids {sorted(bad)[:8]}",
            expected=f"{min(known)} to {max(known)}",
            next_step="declare another --category-ids, or map categories with --label-map FILE",
        )


def doubt(ids: Counter[int], vocabulary: Vocabulary, task: str) -> str | None:
    """Why ids of the dataset may still be positions in its list; None if nothing suggests it.

    ids: undeclared category ids with their counts.
    """
    fits = fitting(ids, vocabulary, task)
    if "dataset" not in fits:
        return None
    if "coco80-1" in fits and any(numberings(vocabulary, task)["coco80-1"][i] != i for i in ids):
        return (
            "the category ids fit the dataset's own and the contiguous 1..80 alike, and were taken "
            "for the dataset's: if the names above are wrong, pass --category-ids coco80-1; "
            "if they are right, --category-ids dataset"
        )
    if "lvis-0" in fits and _fits_better_shifted(ids, vocabulary):
        return (
            "the category ids name rarer categories than they would as places from 0, and were "
            "taken for the dataset's: if the names above are wrong, pass --category-ids lvis-0; "
            "if they are right, --category-ids dataset"
        )
    return None


def most_frequent(category_ids: Iterable[int], vocabulary: Vocabulary) -> str:
    """The most frequent category names with their counts, as text."""
    counts = Counter(category_ids)
    shown = sorted(counts.items(), key=lambda item: (-item[1], item[0]))[:_SHOWN_CATEGORIES]
    names = ", ".join(f"{vocabulary.name_of(i)} {count:,}" for i, count in shown)
    in_all = counted(len(counts), "category", "categories")
    return f"{in_all}: {names}" + (", ..." if len(counts) > len(shown) else "")


def plain_ids(entries: Iterable[Entry]) -> set[int]:
    """The category ids among entries."""
    return {e["category_id"] for e in entries if type(e.get("category_id")) is int}


def _fits_better_shifted(ids: Counter[int], vocabulary: Vocabulary) -> bool:
    """Whether ids + 1 name LVIS's frequent categories more often than the ids do."""
    path = catalog.folder("datasets") / "lvis" / "categories.json"
    frequent = {
        normal_name(c["name"])
        for c in json.loads(path.read_text(encoding="utf-8"))
        if c["frequency"] == "f"
    }
    own = {c.id for c in vocabulary.categories if normal_name(c.name) in frequent}
    as_given = sum(count for i, count in ids.items() if i in own)
    shifted = sum(count for i, count in ids.items() if i + 1 in own)
    return shifted > as_given
