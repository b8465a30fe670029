"""Counts held to the annotations of COCO-style truth."""

import json
from collections import Counter

import numpy as np

from legoworld.cards import load_card
from legoworld.errors import CatalogError
from legoworld.evaluation.bootstrap import interval, resample_counts, resampled_means
from legoworld.evaluation.checks import check_equal
from legoworld.evaluation.family import EvaluationFamily, prepare_inputs
from legoworld.evaluation.metrics import bounds, describe_evaluator, fraction, image_counts
from legoworld.evaluation.run import read_rows, run_view
from legoworld.records.evaluation import Coverage, Evaluator, ScoreConfiguration
from legoworld.records.folders.evaluation_folder import (
    Evaluation,
    installed_versions,
    write_evaluation,
)
from legoworld.records.folders.read_run import ROWS, RUN
from legoworld_counts.records import CountsEvidence, CountsRow, CountsSummary, Mae


def _truth(path):
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        counts = {image["id"]: Counter() for image in document["images"]}
        for annotation in document["annotations"]:
            if not annotation.get("iscrowd"):
                counts[annotation["image_id"]][annotation["category_id"]] += 1
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise CatalogError(
            f"{path.name} is no truth of counts",
            found=f"{type(error).__name__}: {error}",
            expected="COCO annotations",
        ) from error
    return counts


def error_of(counts, truth):
    """The mean absolute error over the categories that either has; 0 where neither has one."""
    categories = {*counts, *truth}
    return sum(abs(counts[c] - truth[c]) for c in categories) / max(1, len(categories))


def _row(run, row, truth):
    error = None
    if row.status == "ok":
        stored = json.loads((run.folder / row.answer.file).read_text(encoding="utf-8"))
        error = error_of(Counter({int(k): n for k, n in stored.items()}), truth)
    return CountsRow(
        image_id=row.image_id,
        file_name=row.file_name,
        status=row.status,
        n_truth=sum(truth.values()),
        error=error,
    )


def _mae(rows, draws, seed):
    errors = np.array([row.error for row in rows if row.has_score])
    if not len(errors):
        return Mae(value=None, interval=None)
    found = None
    if len(errors) > 1:
        drawn = resample_counts(len(errors), draws, seed)
        samples = resampled_means(errors, np.arange(len(errors)), drawn)
        found = interval(samples, unit="image")
    return Mae(value=float(errors.mean()), interval=found)


def _coverage(rows):
    return Coverage(
        attempted=len(rows),
        scored=sum(row.has_score for row in rows),
        with_truth=sum(row.has_truth for row in rows),
        by_status=dict(sorted(Counter(row.status for row in rows).items())),
    )


def _evaluate(request):
    run, truth = request.run, _truth(request.truth)
    card = load_card(run.task)
    configuration = ScoreConfiguration(
        task=run.task, card_sha256=card.sha256, draws=request.draws, seed=request.seed
    )
    stored = read_rows(run)
    files = [("truth", request.truth), ("run", run.folder / RUN), ("per_image", run.folder / ROWS)]
    files += [("counts", run.folder / row.answer.file) for row in stored if row.answer]
    inputs = prepare_inputs(request, files, configuration)
    rows = [_row(run, row, truth.get(row.image_id, Counter())) for row in stored]
    for row in rows:
        request.progress(row)
    summary = CountsSummary(
        task=run.task,
        kind=run.configuration.kind,
        partial=run.partial,
        evaluator=Evaluator(name="counts", version=card.value("scoring.evaluator_version")),
        coverage=_coverage(rows),
        mae=_mae(rows, request.draws, request.seed),
    )
    evidence = CountsEvidence(
        versions=installed_versions(),
        inputs=(),
        files={},
        task=summary.task,
        evaluator=summary.evaluator,
        coverage=summary.coverage,
        configuration=configuration,
        mae=summary.mae.value,
    )
    evaluation = Evaluation(
        summary=summary,
        evidence=evidence,
        inputs=inputs,
        per_image=rows,
        view={"run.json": run_view(run)},
    )
    write_evaluation(request.output, evaluation, overwrite=request.overwrite)
    return summary


def _verify(recorded):
    chosen = recorded.evidence.configuration
    again = _mae(recorded.rows, chosen.draws, chosen.seed)
    yield check_equal("mae", again.value, recorded.summary.mae.value)
    yield check_equal("mae on record", recorded.evidence.mae, recorded.summary.mae.value)


def _short(summary):
    found = summary.mae
    return (
        f"{describe_evaluator(summary)}: {image_counts(summary.coverage)}\n"
        f"mean absolute error {fraction(found.value)}{bounds(found.interval)} "
        f"over {summary.coverage.scored} images"
    )


EVALUATION = EvaluationFamily(evaluate=_evaluate, verify=_verify, short=_short)
