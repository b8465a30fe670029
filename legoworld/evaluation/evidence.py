"""Verification of an evaluation folder: all hashes, and what its family makes again.

`agreement` holds what was made again to what is on record: the same but for rounding.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final, TypeVar

from legoworld.evaluation.checks import Check, check_equal, check_files, check_inputs, until_damage
from legoworld.evaluation.family import RecordedEvaluation, load_evaluation_family
from legoworld.files import Json
from legoworld.records.base import as_json
from legoworld.records.evaluation import EvaluationRow, ImageRow, Summary
from legoworld.records.folders.read_evaluation import (
    SUMMARY,
    read_evaluation_evidence,
    read_evidence,
    read_image_rows,
    read_summary,
)

#: Logarithms differ in the last bits between machines.
_RELATIVE: Final = 1e-9
_LISTS: Final = (tuple, list)
#: Images that are scored again: a full-size one takes seconds.
SCORED_AGAIN: Final = 10

T = TypeVar("T")


def agreement(what: str, found: Json, recorded: Json) -> Check:
    """A check that two JSON values are the same."""
    place = _first_difference(found, recorded, "")
    if place is None:
        return Check("ok", what, "the same")
    return Check("DIFFERS", what, place[:100])


def check_summary(recorded: RecordedEvaluation, again: Summary) -> Iterator[Check]:
    """Every key of summary.json against one made again: a key that no reader knows differs, too."""
    made, written = as_json(again), json.loads((recorded.folder / SUMMARY).read_bytes())
    for key in sorted({*made, *written}):
        yield agreement(f"{key} from the rows", made.get(key), written.get(key))


def check_rows(recorded: RecordedEvaluation, again: Iterable[EvaluationRow]) -> Iterator[Check]:
    """Rows made again against those on record."""
    stored = {row.image_id: as_json(row) for row in recorded.rows}
    for row in again:
        yield agreement(f"row of image {row.image_id}", as_json(row), stored.get(row.image_id))


def spread_evenly(items: Sequence[T]) -> Sequence[T]:
    """Up to `SCORED_AGAIN` of the images or cases, which is what verification has time for."""
    return items[:: max(1, math.ceil(len(items) / SCORED_AGAIN))]


def _first_difference(found: Json, recorded: Json, place: str) -> str | None:
    """Where two JSON values differ by more than rounding, with both; None where they do not."""
    if isinstance(found, Mapping) and isinstance(recorded, Mapping):
        if found.keys() != recorded.keys():
            return f"{place} keys {sorted(found.keys() ^ recorded.keys())}"
        pairs = [(found[k], recorded[k], f"{place} {k}") for k in sorted(found)]
    elif isinstance(found, _LISTS) and isinstance(recorded, _LISTS) and len(found) == len(recorded):
        pairs = [
            (a, b, f"{place} {i}") for i, (a, b) in enumerate(zip(found, recorded, strict=True))
        ]
    elif isinstance(found, float) and isinstance(recorded, float | int):
        same = math.isclose(found, recorded, rel_tol=_RELATIVE, abs_tol=1e-12)
        return None if same else f"{place} {found!r}, on record {recorded!r}".strip()
    else:
        return None if found == recorded else f"{place} {found!r}, on record {recorded!r}".strip()
    return next((d for d in (_first_difference(*pair) for pair in pairs) if d is not None), None)


def verify(folder: Path, root: Path | None) -> list[Check]:
    """Every check of an evaluation folder; inputs are looked for below `root` if given."""
    evidence = read_evidence(folder)
    checks = [*check_files(folder, evidence), *check_inputs(folder, evidence, root)]
    if any(c.status != "ok" for c in checks if c.what.startswith("file ")):
        return checks  # numbers of altered files prove nothing
    inputs_hold = all(c.status == "ok" for c in checks if c.what.startswith("input "))
    return [*checks, *until_damage(_remake(folder, root, inputs_hold=inputs_hold))]


def _remake(folder: Path, root: Path | None, *, inputs_hold: bool) -> Iterator[Check]:
    evidence, summary = read_evaluation_evidence(folder), read_summary(folder)
    rows = read_image_rows(folder, summary)
    yield from _coverage(summary, rows)
    if summary.task != evidence.task:
        yield check_equal("task", summary.task, evidence.task)
        return
    yield from load_evaluation_family(summary.task).verify(
        RecordedEvaluation(
            folder=folder,
            evidence=evidence,
            summary=summary,
            rows=rows,
            root=root,
            inputs_hold=inputs_hold,
        )
    )


def _coverage(summary: Summary, rows: Sequence[ImageRow]) -> Iterator[Check]:
    coverage = summary.coverage
    statuses = dict(sorted(Counter(row.status for row in rows).items()))
    yield check_equal("images attempted", len(rows), coverage.attempted)
    yield check_equal("images by status", statuses, coverage.by_status)
