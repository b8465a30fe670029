"""Verification of an evaluation: its summary from its rows, its rows from the arrays."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final, cast

from legoworld.cards import load_card
from legoworld.errors import LegoWorldError
from legoworld.evaluation.checks import Check
from legoworld.evaluation.evidence import agreement, check_summary
from legoworld.evaluation.family import RecordedEvaluation
from legoworld.evaluation.pixels.family import Options, PixelFamily, Settings, TruthFile
from legoworld.evaluation.pixels.predictions import read_pixel_run
from legoworld.evaluation.pixels.rows import score_row
from legoworld.evaluation.pixels.summary import summarise
from legoworld.records.base import as_json
from legoworld.records.pixels import PixelRow
from legoworld.records.run_rows import RunImage

#: Number of images to re-score, spread evenly over the track: a full-size one takes seconds.
SCORED_AGAIN: Final = 10


def verify_pixels(family: PixelFamily, recorded: RecordedEvaluation) -> Iterator[Check]:
    """Compare the summary with that recomputed from the rows, and rows with those of the arrays."""
    summary: Any = recorded.summary
    options: Options = {name: getattr(summary.protocol, name) for name in family.options}
    recalled = family.again.recall(summary) if family.again else {}
    bootstrap = summary.bootstrap
    again = summarise(
        family,
        cast("Sequence[PixelRow]", recorded.rows),
        kind=str(summary.kind),
        partial=summary.partial,
        protocol=family.protocol(load_card(summary.task)),
        settings=Settings(
            options={**options, **recalled}, draws=bootstrap.draws, seed=bootstrap.seed
        ),
    )
    yield from check_summary(recorded, again)
    evidence: Any = recorded.evidence
    yield agreement("metrics in the evidence", evidence.metrics, summary.metrics)
    if recorded.inputs_hold:
        yield from _rescore_rows(family, recorded, options)


def _rescore_rows(
    family: PixelFamily, recorded: RecordedEvaluation, options: Options
) -> Iterator[Check]:
    """Re-score up to `SCORED_AGAIN` images from the available run and ground truth."""
    run = read_pixel_run(recorded.input("run").parent, family)
    files = _truth_files(recorded.input("truth"), [image.image for image in run.images], family)
    rows = {row.image_id: as_json(row) for row in recorded.rows}
    step = max(1, math.ceil(len(run.images) / SCORED_AGAIN))
    for image, file in list(zip(run.images, files, strict=True))[::step]:
        again = as_json(score_row(image, file, family, run.run.task, options).row)
        image_id = image.image.image_id
        yield agreement(f"row of image {image_id}", again, rows.get(image_id))


def _truth_files(
    first: Path, images: Sequence[RunImage], family: PixelFamily
) -> tuple[TruthFile, ...]:
    """The ground truth of every image, from the closest common parent folder."""
    refusal: LegoWorldError | None = None
    for folder in first.parents:
        try:
            files = family.find_truth(folder, images)
        except LegoWorldError as error:
            refusal = refusal or error
            continue
        if files[0].path == first:
            return files
    assert refusal is not None
    raise refusal
