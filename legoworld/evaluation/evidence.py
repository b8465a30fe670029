"""Re-checking an evaluation folder: hashes of everything, and the numbers from the matches."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

import numpy as np

from legoworld.conventions import EQUAL_CONFIDENCE
from legoworld.errors import LegoWorldError, one_line
from legoworld.evaluation.detection.inputs.prediction_columns import columns_of, score_column
from legoworld.evaluation.detection.inputs.prediction_order import in_order
from legoworld.evaluation.detection.inputs.predictions import sha256_of_entries
from legoworld.evaluation.detection.matching import matches_file
from legoworld.evaluation.detection.matching.matched_metrics import matched_document
from legoworld.evaluation.detection.protocols import detection_protocol
from legoworld.evaluation.detection.ranking.accumulation import accumulate, metric_value
from legoworld.evaluation.detection.scoring import AGREEMENT
from legoworld.records.base import as_json, decode
from legoworld.records.evaluation_rows import DepthRow, ImageRow
from legoworld.records.evaluation_summary import DepthSummary, DetectionSummary, Summary
from legoworld.records.evaluation_view import TruthCategories
from legoworld.records.evidence import (
    AnyEvidence,
    BenchEvidence,
    DepthEvidence,
    DetectionEvidence,
)
from legoworld.records.folders.evaluation_reading import (
    EVIDENCE,
    MATCHES,
    VIEW,
    read_evaluation_evidence,
    read_evidence,
    read_image_rows,
    read_summary,
)
from legoworld.records.folders.input_hash import hash_and_size, without_of
from legoworld.records.predictions import Prediction
from legoworld.records.reconstruction_rows import ReconstructionRow
from legoworld.records.reconstruction_summary import ReconstructionSummary


@dataclass(frozen=True)
class Check:
    """One thing looked at. status: ok, CHANGED, MISSING, UNLISTED or DIFFERS."""

    status: str
    what: str
    found: str


def verify(folder: Path, root: Path | None) -> list[Check]:
    """Every check of an evaluation folder; inputs are looked for below `root` where given."""
    evidence = read_evidence(folder)
    checks = [*check_files(folder, evidence), *check_inputs(folder, evidence, root)]
    if any(c.status != "ok" for c in checks if c.what.startswith("file ")):
        return checks  # numbers of altered files prove nothing
    inputs_hold = all(c.status == "ok" for c in checks if c.what.startswith("input "))
    return [*checks, *until_damage(_made_again(folder, root, inputs_hold=inputs_hold))]


def until_damage(checks: Iterator[Check]) -> Iterator[Check]:
    """Checks of numbers; what is not even numbers ends them as a difference."""
    try:
        yield from checks
    except LegoWorldError as error:
        yield Check("DIFFERS", "the numbers made again", one_line(str(error), 100))
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        problem = one_line(f"{type(error).__name__}: {error}", 100)
        yield Check("DIFFERS", EVIDENCE, f"the numbers cannot be made again: {problem}")


def _made_again(folder: Path, root: Path | None, *, inputs_hold: bool) -> Iterator[Check]:
    evidence, summary = read_evaluation_evidence(folder), read_summary(folder)
    rows = read_image_rows(folder, summary)
    yield from _coverage(summary, rows)
    if isinstance(evidence, DetectionEvidence) and isinstance(summary, DetectionSummary):
        yield from _numbers(folder, evidence, summary)
    elif isinstance(evidence, DepthEvidence) and isinstance(summary, DepthSummary):
        from legoworld.evaluation.depth.verification import depth_checks, depth_rows

        scored = [row for row in rows if isinstance(row, DepthRow)]
        yield from depth_checks(folder, evidence, summary, scored)
        if inputs_hold:
            yield from depth_rows(folder, evidence, summary, scored, root)
    elif isinstance(evidence, BenchEvidence) and isinstance(summary, ReconstructionSummary):
        from legoworld.evaluation.reconstruction.verification import bench_checks, bench_rows

        cases = [row for row in rows if isinstance(row, ReconstructionRow)]
        yield from bench_checks(folder, evidence, summary, cases)
        if inputs_hold:
            yield from bench_rows(folder, evidence, cases, root)
    else:
        yield check_equal("task", summary.task, evidence.task)


def check_files(folder: Path, evidence: AnyEvidence) -> Iterator[Check]:
    """Every file of a folder against the hashes in its evidence."""
    for name, sha256 in evidence.files.items():
        yield _hashed(f"file {name}", folder / name, sha256)
    present = {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()}
    for name in sorted(present - set(evidence.files) - {EVIDENCE}):
        yield Check("UNLISTED", f"file {name}", f"not in {EVIDENCE}")


def check_inputs(folder: Path, evidence: AnyEvidence, root: Path | None) -> Iterator[Check]:
    """Every input against its hash; looked for below `root` where given."""
    for entry in evidence.inputs:
        what, without = f"input {entry.role} {entry.path}", entry.without or ()
        allowed = without_of(entry.role)
        # Evidence of before the time was left out leaves nothing out.
        if without in ((), allowed):
            yield _hashed(what, located(folder, entry.path, root), entry.sha256, without)
        else:
            may = ", ".join(allowed) or "nothing"
            yield Check("DIFFERS", what, f"its hash leaves out {[*without]!r:.60}; may: {may}")


def located(folder: Path, recorded: str, root: Path | None) -> Path | None:
    """An input's path: as recorded, or the longest ending of it that lies below root."""
    if root is None:
        return folder / recorded
    parts = [part for part in PurePosixPath(recorded).parts if part != ".."]
    for start in range(len(parts)):
        candidate = root.joinpath(*parts[start:])
        if candidate.is_file():
            return candidate
    return None


def _hashed(what: str, path: Path | None, sha256: str, without: Sequence[str] = ()) -> Check:
    if path is None or not path.is_file():
        return Check("MISSING", what, "no such file")
    try:
        found, _ = hash_and_size(path, without)
    except (ValueError, RecursionError):
        return Check("CHANGED", what, f"not JSON, on record {sha256[:12]}")
    if found != sha256:
        return Check("CHANGED", what, f"{found[:12]}, on record {sha256[:12]}")
    return Check("ok", what, found[:12])


def _coverage(summary: Summary, rows: Sequence[ImageRow]) -> Iterator[Check]:
    coverage = summary.coverage
    statuses = dict(sorted(Counter(row.status for row in rows).items()))
    yield check_equal("images attempted", len(rows), coverage.attempted)
    yield check_equal("images by status", statuses, coverage.by_status)


def _numbers(
    folder: Path, evidence: DetectionEvidence, summary: DetectionSummary
) -> Iterator[Check]:
    """The evaluator's raw numbers against those that follow from matches.npz, and the exports."""
    protocol = detection_protocol(summary.task)
    with np.load(folder / MATCHES) as stored:
        arrays = dict(stored)
    truth = decode(TruthCategories, (folder / VIEW / "truth.json").read_bytes())
    letters = {c.id: c.frequency or "" for c in truth.categories}
    frequencies = np.array([letters[int(i)] for i in arrays["category_ids"]])
    raw = evidence.raw.official, evidence.equal_confidence.official
    shown = summary.official, summary.equal_confidence.official
    for policy, name, official, again in zip(
        (matches_file.OWN, matches_file.EQUAL),
        ("own scores", "equal confidence"),
        raw,
        shown,
        strict=True,
    ):
        curves = accumulate(matches_file.table_from(arrays, policy), protocol)
        ours = np.array([metric_value(m, curves, frequencies) for m in protocol.metrics])
        worst = float(np.abs(ours - official).max())
        status = "ok" if worst <= AGREEMENT else "DIFFERS"
        yield Check(status, f"metrics from matches, {name}", f"largest difference {worst:.1e}")
        yield check_equal(f"summary against raw metrics, {name}", list(again), list(official))
    for kind, aware in (("class_aware", True), ("class_agnostic", False)):
        counts = matches_file.counts_from(arrays, class_aware=aware)
        document = as_json(matched_document(counts, class_aware=aware))
        yield check_equal(f"matched IoU, {kind}", document, as_json(getattr(summary.matched, kind)))
    predictions = decode(list[Prediction], (folder / VIEW / "predictions.json").read_bytes())
    recorded = evidence.raw.canonical_predictions_sha256
    yield check_equal("predictions", _export_sha256(predictions, equal=False), recorded)
    recorded = evidence.equal_confidence.predictions_sha256
    yield check_equal("equal-confidence export", _export_sha256(predictions, equal=True), recorded)


def _export_sha256(predictions: list[Prediction], *, equal: bool) -> str:
    """Hash of the results that view/predictions.json shows, as `Predictions.sha256` makes it."""
    entries = columns_of(predictions)
    if equal:
        entries = replace(entries, score=score_column([EQUAL_CONFIDENCE] * len(entries)))
        entries = in_order(entries, "canonical")
    return sha256_of_entries(entries)


def check_equal(what: str, found: object, recorded: object) -> Check:
    """What was found against what is on record."""
    if found == recorded:
        return Check("ok", what, str(found)[:60])
    return Check("DIFFERS", what, f"{str(found)[:60]}, on record {str(recorded)[:60]}")
