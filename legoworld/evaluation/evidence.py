"""Verification of an evaluation folder: all hashes, and the numbers from the matches."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from legoworld.evaluation.checks import Check, check_equal, check_files, check_inputs, until_damage
from legoworld.evaluation.depth.verification import depth_checks, depth_rows
from legoworld.evaluation.detection.verification import detection_checks
from legoworld.evaluation.reconstruction.verification import bench_checks, bench_rows
from legoworld.records.evaluation_rows import DepthRow, ImageRow
from legoworld.records.evaluation_summary import DepthSummary, DetectionSummary, Summary
from legoworld.records.evidence import (
    BenchEvidence,
    DepthEvidence,
    DetectionEvidence,
)
from legoworld.records.folders.evaluation_reading import (
    read_evaluation_evidence,
    read_evidence,
    read_image_rows,
    read_summary,
)
from legoworld.records.reconstruction_rows import ReconstructionRow
from legoworld.records.reconstruction_summary import ReconstructionSummary


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
    if isinstance(evidence, DetectionEvidence) and isinstance(summary, DetectionSummary):
        yield from detection_checks(folder, evidence, summary)
    elif isinstance(evidence, DepthEvidence) and isinstance(summary, DepthSummary):
        scored = [row for row in rows if isinstance(row, DepthRow)]
        yield from depth_checks(folder, evidence, summary, scored)
        if inputs_hold:
            yield from depth_rows(folder, evidence, summary, scored, root)
    elif isinstance(evidence, BenchEvidence) and isinstance(summary, ReconstructionSummary):
        cases = [row for row in rows if isinstance(row, ReconstructionRow)]
        yield from bench_checks(folder, evidence, summary, cases)
        if inputs_hold:
            yield from bench_rows(folder, evidence, cases, root)
    else:
        yield check_equal("task", summary.task, evidence.task)


def _coverage(summary: Summary, rows: Sequence[ImageRow]) -> Iterator[Check]:
    coverage = summary.coverage
    statuses = dict(sorted(Counter(row.status for row in rows).items()))
    yield check_equal("images attempted", len(rows), coverage.attempted)
    yield check_equal("images by status", statuses, coverage.by_status)
