"""Verification of a depth evaluation: its summary from its rows, its rows from the arrays."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from legoworld.cards import load_card
from legoworld.errors import LegoWorldError
from legoworld.evaluation.agreement import agreement
from legoworld.evaluation.checks import Check, located
from legoworld.evaluation.depth.predictions import read_depth_run
from legoworld.evaluation.depth.protocol import depth_protocol
from legoworld.evaluation.depth.rows import score_row
from legoworld.evaluation.depth.summary import Settings, summarise
from legoworld.evaluation.depth.truth import TruthFile, find_truth
from legoworld.records.base import as_json
from legoworld.records.depth import DepthEvidence
from legoworld.records.evaluation_rows import DepthRow
from legoworld.records.evaluation_summary import DepthSummary
from legoworld.records.folders.evaluation_reading import SUMMARY
from legoworld.records.run_rows import RunImage

#: Number of images to re-score, spread evenly over the track: a full-size one takes seconds.
SCORED_AGAIN: Final = 10


def depth_checks(
    folder: Path, evidence: DepthEvidence, summary: DepthSummary, rows: Sequence[DepthRow]
) -> Iterator[Check]:
    """Compare means, intervals and counts of the summary with those recomputed from the rows."""
    again = summarise(
        rows,
        kind=str(summary.kind),
        partial=summary.partial,
        protocol=depth_protocol(load_card(summary.task)),
        settings=_settings(summary),
    )
    # All that the file says: a key that no reader knows follows from no row.
    recomputed, recorded = as_json(again), json.loads((folder / SUMMARY).read_bytes())
    for key in sorted({*recomputed, *recorded}):
        yield agreement(f"{key} from the rows", recomputed.get(key), recorded.get(key))
    yield agreement("metrics in the evidence", evidence.metrics, summary.metrics)


def depth_rows(
    folder: Path,
    evidence: DepthEvidence,
    summary: DepthSummary,
    rows: Sequence[DepthRow],
    root: Path | None,
) -> Iterator[Check]:
    """Re-score up to `SCORED_AGAIN` images from the available run and ground truth."""
    paths = {
        role: [located(folder, i.path, root) for i in evidence.inputs if i.role == role]
        for role in ("run", "truth")
    }
    protocol, warped = (
        depth_protocol(load_card(summary.task)),
        summary.protocol.camera_model == "dataset",
    )
    run = read_depth_run(_known(paths["run"][0]).parent)
    files = _truth_files(_known(paths["truth"][0]), [image.image for image in run.images])
    recorded = {row.image_id: as_json(row) for row in rows}
    step = max(1, math.ceil(len(run.images) / SCORED_AGAIN))
    for image, file in list(zip(run.images, files, strict=True))[::step]:
        row = score_row(image, file, file.camera if warped else None, protocol).row
        again = as_json(row)
        yield agreement(
            f"row of image {image.image.image_id}", again, recorded.get(image.image.image_id)
        )


def _settings(summary: DepthSummary) -> Settings:
    return Settings(
        camera_model=summary.protocol.camera_model,
        draws=summary.bootstrap.draws,
        seed=summary.bootstrap.seed,
    )


def _truth_files(first: Path, images: Sequence[RunImage]) -> tuple[TruthFile, ...]:
    """The ground truth of every image, from the closest common parent folder."""
    refusal: LegoWorldError | None = None
    for folder in first.parents:
        try:
            files = find_truth(folder, images)
        except LegoWorldError as error:
            refusal = refusal or error
            continue
        if files[0].path == first:
            return files
    assert refusal is not None
    raise refusal


def _known(path: Path | None) -> Path:
    assert path is not None
    return path
