"""Category ids of results without names: the dataset's own, or positions in its category list.

A results file does not say which. Where several fit, the user is asked, and shown what each means.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Final, Literal, get_args

from legoworld.baselines.foreign_results import Entry
from legoworld.errors import UsageError
from legoworld.evaluation.detection.inputs.prediction_checks import PredictionsInvalidError
from legoworld.pluralize import plural, share, word_for
from legoworld.shipped import catalog
from legoworld.tasks.shipped import COCO, LVIS
from legoworld.tracks.vocabulary import Vocabulary, dataset_version, find_dataset, normal_name

CategoryIds = Literal["dataset", "coco80-0", "coco80-1", "lvis-0"]
CATEGORY_IDS: Final[tuple[CategoryIds, ...]] = get_args(CategoryIds)

#: Contiguous numberings: their dataset, and the number of its first category.
_CONTIGUOUS: Final[Mapping[CategoryIds, tuple[str, int]]] = {
    "coco80-0": (COCO.name, 0),
    "coco80-1": (COCO.name, 1),
    "lvis-0": (LVIS.name, 0),
}
_SHOWN_CATEGORIES: Final = 8
_SHOWN_IN_A_READING: Final = 3


def numberings(vocabulary: Vocabulary, task: str) -> dict[CategoryIds, dict[int, int]]:
    """Every numbering applicable to this vocabulary, as a map to the vocabulary's ids."""
    own = [category.id for category in vocabulary.categories]
    by_numbering: dict[CategoryIds, dict[int, int]] = {"dataset": {i: i for i in own}}
    dataset = find_dataset(task)
    if dataset_version(vocabulary, task) == "custom":
        return by_numbering
    for name, (of, first) in _CONTIGUOUS.items():
        if of == dataset:
            by_numbering[name] = dict(enumerate(own, start=first))
    return by_numbering


def map_category_ids(
    category_ids: CategoryIds, vocabulary: Vocabulary, task: str
) -> dict[int, int]:
    """The map from the declared numbering to the vocabulary's ids. UsageError if inapplicable."""
    known = numberings(vocabulary, task)
    if category_ids not in known:
        raise UsageError(
            f"--category-ids {category_ids} does not fit this track's categories",
            found=f"{len(vocabulary.categories)} categories of --task {task}",
            expected=" or ".join(known),
            next_step="map other ids with --label-map FILE",
        )
    return known[category_ids]


def readings(ids: Counter[int], vocabulary: Vocabulary, task: str) -> dict[CategoryIds, str]:
    """The numberings that have all of these ids, and the most frequent categories under each.

    ids: with their counts. Of numberings that mean the same, the first.
    """
    known = numberings(vocabulary, task)
    fits: dict[CategoryIds, dict[int, int]] = {
        name: ours for name, ours in known.items() if ids.keys() <= ours.keys()
    }
    meant = {name: tuple(ours[i] for i in ids) for name, ours in fits.items()}
    return {
        name: _list_categories(
            {ours[i]: n for i, n in ids.items()}, vocabulary, _SHOWN_IN_A_READING
        )
        for name, ours in fits.items()
        if next(other for other, what in meant.items() if what == meant[name]) == name
    }


def as_options(meant: Mapping[CategoryIds, str]) -> str:
    """Options that declare these readings, each with what it means."""
    return " or ".join(
        f"--category-ids {name} ({categories})" for name, categories in meant.items()
    )


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


def refuse_doubtful(ids: Counter[int], vocabulary: Vocabulary, task: str) -> None:
    """Raise PredictionsInvalidError where undeclared ids may mean two things, and ask which.

    ids: all of the file's, with their counts: each narrows down what they can be.
    """
    meant = readings(ids, vocabulary, task)
    # The first of COCO's list is the person, in most photos the most frequent of all. (LVIS's ids
    # have no gaps that tell; its frequent categories do.)
    person = bool(ids) and ids[1] == max(ids.values())
    for name, unlikely in (
        ("coco80-0", 0 not in ids and person),
        ("lvis-0", not _fits_better_shifted(ids, vocabulary)),
    ):
        if name in meant and unlikely:
            del meant[name]
    if meant and [*meant] != ["dataset"]:
        raise PredictionsInvalidError(
            "the file does not say what numbering its category ids are of",
            found=" or ".join(f"{name} ({what})" for name, what in meant.items()),
            expected="one numbering, declared",
            next_step="pass " + " or ".join(f"--category-ids {name}" for name in meant),
        )


def other_readings(
    category_ids: CategoryIds, ids: Counter[int], vocabulary: Vocabulary, task: str
) -> str | None:
    """What declared ids would be in other numberings that have them; None if in no other."""
    own = numberings(vocabulary, task)[category_ids]
    mine = _list_categories({own[i]: n for i, n in ids.items()}, vocabulary, _SHOWN_IN_A_READING)
    others: dict[CategoryIds, str] = {
        name: what for name, what in readings(ids, vocabulary, task).items() if what != mine
    }
    if not others:
        return None
    return f"category ids as {category_ids}: {mine}; they would fit {as_options(others)} as well"


def most_frequent(category_ids: Iterable[int], vocabulary: Vocabulary) -> str:
    """The most frequent category names with their counts, as text."""
    counts = Counter(category_ids)
    in_all = plural(len(counts), "category", "categories")
    return f"{in_all}: {_list_categories(counts, vocabulary, _SHOWN_CATEGORIES)}"


def _list_categories(counts: Mapping[int, int], vocabulary: Vocabulary, most: int) -> str:
    shown = sorted(counts.items(), key=lambda item: (-item[1], item[0]))[:most]
    names = ", ".join(f"{vocabulary.category_name(i)} {count:,}" for i, count in shown)
    return names + (", ..." if len(counts) > len(shown) else "")


def plain_ids(entries: Iterable[Entry]) -> Counter[int]:
    """The category ids among entries, with their counts."""
    return Counter(i for e in entries if type(i := e.get("category_id")) is int)


def _fits_better_shifted(ids: Counter[int], vocabulary: Vocabulary) -> bool:
    """Whether ids + 1 name LVIS's frequent categories more often than the ids do."""
    path = catalog.folder("datasets") / LVIS.name / "categories.json"
    frequent = {
        normal_name(c["name"])
        for c in json.loads(path.read_text(encoding="utf-8"))
        if c["frequency"] == "f"
    }
    own = {c.id for c in vocabulary.categories if normal_name(c.name) in frequent}
    as_given = sum(count for i, count in ids.items() if i in own)
    shifted = sum(count for i, count in ids.items() if i + 1 in own)
    return shifted > as_given
