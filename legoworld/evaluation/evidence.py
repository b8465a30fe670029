"""Verification of an evaluation folder: all hashes, and the numbers from the matches."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from legoworld.evaluation.checks import Check, check_equal, check_files, check_inputs, until_damage
from legoworld.evaluation.family import RecordedEvaluation, load_evaluation_family
from legoworld.records.evaluation_rows import ImageRow
from legoworld.records.evaluation_summary import Summary
from legoworld.records.folders.read_evaluation import (
    read_evaluation_evidence,
    read_evidence,
    read_image_rows,
    read_summary,
)


def verify(folder: Path, root: Path | None) -> list[Check]:
    """Every check of an evaluation folder; inputs are looked for below `root` if given."""
    evidence = read_evidence(folder)
    checks = [*check_files(folder, evidence), *check_inputs(folder, evidence, root)]
    if any(c.status != "ok" for c in checks if c.what.startswith("file ")):
        return checks  # numbers of altered files prove nothing
    inputs_hold = all(c.status == "ok" for c in checks if c.what.startswith("input "))
    return [*checks, *until_damage(_made_again(folder, root, inputs_hold=inputs_hold))]


def _made_again(folder: Path, root: Path | None, *, inputs_hold: bool) -> Iterator[Check]:
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
