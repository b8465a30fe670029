"""Boxes and masks in memory, scored by the official evaluator as a file of them would be."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Final

from legoworld.errors import UsageError
from legoworld.evaluation.detection.evaluate import default_evaluator
from legoworld.evaluation.detection.evaluators import run_evaluator
from legoworld.evaluation.detection.inputs.box_formats import check_box_values
from legoworld.evaluation.detection.inputs.prediction_checks import as_predictions
from legoworld.evaluation.detection.inputs.predictions import check_results, prediction_type
from legoworld.evaluation.detection.inputs.truth import Truth, images_of_truth, read_whole_truth
from legoworld.evaluation.detection.protocols import detection_protocol
from legoworld.evaluation.detection.scoring import named_metrics
from legoworld.evaluation.family import LiveAnswers, LiveFamily, LiveTruth, Scores


def _open(task: str, truth: LiveTruth) -> Truth:
    if not isinstance(truth, str | Path):
        raise UsageError(
            "boxes and masks are scored against a file",
            found=type(truth).__name__,
            expected="the dataset's own annotations, COCO or LVIS JSON",
        )
    return read_whole_truth(Path(truth), detection_protocol(task))


def _score(
    task: str, truth: Truth, results: LiveAnswers, image_ids: Collection[int] | None
) -> Scores:
    """results: predictions as in a results file, in which equal confidences keep their order."""
    protocol = detection_protocol(task)
    if isinstance(results, Mapping):
        raise UsageError("boxes and masks are scored as results", found="arrays by image id")
    of_images = truth if image_ids is None else images_of_truth(truth, image_ids)
    entries = as_predictions(results, prediction_type(protocol))
    sizes_wh = of_images.sizes_wh
    predictions = check_results(
        [entries],
        status_by_image=dict.fromkeys(sizes_wh, "ok"),
        sizes_wh=sizes_wh,
        vocabulary=truth.vocabulary,
        protocol=protocol,
        order="given",
        check_boxes=check_box_values,
    )
    kind = default_evaluator(protocol, lambda _text: None)
    scores = run_evaluator(of_images, predictions, protocol, kind)
    return Scores(
        task=task,
        evaluator=f"{scores.name} {scores.version}",
        n_images=len(sizes_wh),
        metrics=named_metrics(protocol, scores.official),
    )


LIVE: Final = LiveFamily(open=_open, sizes_wh=lambda truth: truth.sizes_wh, score=_score)
