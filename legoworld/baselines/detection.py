"""Boxes and masks of baselines."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from msgspec import structs

from legoworld.baselines.baseline_import import ImportRequest
from legoworld.baselines.detection_import import DetectionSource, import_detections
from legoworld.baselines.family import BaselineFamily, ImportListener, ImportOptions
from legoworld.baselines.labels import label_map
from legoworld.baselines.records import answered_detections
from legoworld.records.run_file import RunSummary
from legoworld.records.run_rows import RunRow
from legoworld.running.readout_run import RunResult


def _import(
    request: ImportRequest, source: Path, options: ImportOptions, telling: ImportListener
) -> RunResult:
    vocabulary = request.protocol.vocabulary
    assert vocabulary is not None
    answers = DetectionSource(
        path=source,
        box_format=options.get("box_format"),
        labels=label_map(options.get("label_map"), vocabulary, request.protocol.task.name),
        category_ids=options.get("category_ids"),
    )
    return import_detections(request, answers, notice=telling.notice)


def _sum_up(summary: RunSummary, ok: Sequence[RunRow]) -> RunSummary:
    made = [row.n_predictions or 0 for row in ok]
    return structs.replace(
        summary,
        coverage=structs.replace(summary.coverage, ok_empty=made.count(0)),
        predictions=sum(made),
        empty_masks_dropped=sum(row.empty_masks_dropped or 0 for row in ok),
    )


BASELINE: Final = BaselineFamily(
    of_folder=False,
    what="one results file",
    options=frozenset({"box_format", "label_map", "subset", "category_ids"}),
    import_answers=_import,
    sum_up=_sum_up,
    answered=answered_detections,
)
