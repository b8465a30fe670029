"""The evaluation of relations: questions of the truth, answered by a run.

Numbers are ratios of sums over rows, with intervals over images.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from legoworld.cards import load_card
from legoworld.evaluation.bootstrap import check_draws, interval, resample_counts, weighted_sums
from legoworld.evaluation.checks import Check
from legoworld.evaluation.evidence import agreement, check_summary
from legoworld.evaluation.family import (
    EvaluationFamily,
    EvaluationRequest,
    RecordedEvaluation,
    make_configuration,
    prepare_inputs,
)
from legoworld.evaluation.metrics import (
    MetricPart,
    MetricRow,
    bounds,
    describe_evaluator,
    fraction,
    image_counts,
    number_cell,
)
from legoworld.evaluation.relations.rows import scored_images
from legoworld.evaluation.relations.truth import read_truth
from legoworld.evaluation.run import Run, count_images, read_family_run, read_rows, run_view
from legoworld.pluralize import plural
from legoworld.records.base import UNSET, as_json, number
from legoworld.records.evaluation import Evaluator, ScoreConfiguration
from legoworld.records.folders.evaluation_folder import Evaluation, make_evidence, write_evaluation
from legoworld.records.folders.read_run import ROWS, RUN
from legoworld.records.relations import (
    Metric,
    RelationsEvidence,
    RelationsRow,
    RelationsSummary,
    Sums,
)
from legoworld.tasks.shipped import RELATIONS

Floats = NDArray[np.float64]

#: Metrics in display order, and whether a guess and the prior have a value of it.
METRICS: Final = {
    "accuracy": True,
    "chance_adjusted": True,
    "accuracy_answered": True,
    "answered": False,
    "count_exact": True,
    "count_error": False,
    "mra": True,
    "refer_50": True,
}
POLICIES: Final = ("answers", "chance", "blind")
_NOTHING: Final = Sums(n=0, score=0.0, chance=0.0, blind=0.0)


def metric_sums(name: str, rows: Sequence[RelationsRow]) -> list[Sums]:
    """A metric's sums of each row; of a relation, those of its accuracy."""
    known = "accuracy" if name == "chance_adjusted" else name
    return [row.sums.get(known) or row.by_relation.get(known, _NOTHING) for row in rows]


def ratios(name: str, of_rows: Sequence[Sums], sum_up: Callable[[Floats], Floats]) -> Floats:
    """(3, ...) a metric of the answers, a guess and the prior; NaN where nothing is asked.

    sum_up: sums over rows, (rows,), or over resampled rows.
    """
    columns = np.array([(s.n, s.score, s.chance, s.blind) for s in of_rows], np.float64)
    n, *sums = (sum_up(column) for column in columns.reshape(-1, 4).T)
    with np.errstate(invalid="ignore", divide="ignore"):
        shares = np.stack(sums) / n
        if name == "chance_adjusted":  # how much of what a guess leaves is gained
            shares = (shares - shares[1]) / (1 - shares[1])
    return np.asarray(shares)


def values(name: str, of_rows: Sequence[Sums]) -> Floats:
    """(3,) a metric over all rows."""
    return ratios(name, of_rows, lambda column: column.sum(keepdims=True))[:, 0]


def metrics(
    names: Sequence[str], rows: Sequence[RelationsRow], draws: int, seed: int
) -> dict[str, Metric]:
    """The metrics, or relations, of which something was asked."""
    counts = resample_counts(len(rows), draws, seed) if len(rows) > 1 else None
    found = {}
    for name in names:
        of_rows = metric_sums(name, rows)
        answers, chance, blind = map(number, values(name, of_rows).tolist())
        guessed, n = METRICS.get(name, True), sum(s.n for s in of_rows)
        if not n:
            continue
        around = None
        if counts is not None:
            drawn = ratios(name, of_rows, lambda column: weighted_sums(counts, column))[0]
            around = interval(drawn, unit="image")
        found[name] = Metric(
            n=n,
            answers=answers,
            chance=chance if guessed else None,
            blind=blind if guessed else None,
            interval=around,
        )
    return found


def _read_run(path: Path) -> Run:
    return read_family_run(path, RELATIONS, "a run of relations")


def _summary(
    rows: Sequence[RelationsRow],
    task: str,
    kind: str | None,
    *,
    partial: bool,
    draws: int,
    seed: int,
) -> RelationsSummary:
    card = load_card(task)
    return RelationsSummary(
        task=task,
        kind=kind,
        partial=partial,
        evaluator=Evaluator(name="legoworld", version=card.value("scoring.evaluator_version")),
        coverage=count_images(rows),
        metrics=metrics([*METRICS], rows, draws, seed),
        relations=metrics(
            sorted({name for r in rows for name in r.by_relation}), rows, draws, seed
        ),
        unanswered=dict(sorted(sum((Counter(row.why) for row in rows), Counter()).items())),
        contradictory=sum(row.contradictory for row in rows),
    )


def _evaluate(request: EvaluationRequest) -> RelationsSummary:
    run = request.run
    truth = read_truth(request.truth, run.task)
    check_draws(request.draws, request.seed)
    configuration = make_configuration(request, load_card(run.task), ScoreConfiguration)
    files = [("run", run.folder / RUN), ("per_image", run.folder / ROWS), *truth.files]
    files += [
        ("answers", run.folder / row.answer.file)
        for row in read_rows(run)
        if row.answer is not UNSET
    ]
    inputs = prepare_inputs(request, files, configuration)
    rows: list[RelationsRow] = []
    views: dict[str, Any] = {"run.json": run_view(run)}
    for image in scored_images(run, truth):
        rows.append(image.row)
        views[f"{image.row.image_id}.json"] = image.view
        request.progress(image.row)
    summary = _summary(
        rows,
        run.task,
        run.configuration.kind or None,
        partial=run.partial,
        draws=request.draws,
        seed=request.seed,
    )
    evidence = make_evidence(RelationsEvidence, summary, configuration)
    evaluation = Evaluation(
        summary=summary, evidence=evidence, inputs=inputs, per_image=rows, view=views
    )
    write_evaluation(request.output, evaluation, overwrite=request.overwrite)
    return summary


def _verify(recorded: RecordedEvaluation) -> Iterator[Check]:
    """The summary from the rows, and the rows from the run and the truth where they are here."""
    summary = cast("RelationsSummary", recorded.summary)
    settings = recorded.evidence.configuration
    again = _summary(
        cast("Sequence[RelationsRow]", recorded.rows),
        summary.task,
        summary.kind,
        partial=summary.partial,
        draws=settings.draws,
        seed=settings.seed,
    )
    yield from check_summary(recorded, again)
    evidence = cast("RelationsEvidence", recorded.evidence)
    yield agreement("metrics in the evidence", as_json(evidence.metrics), as_json(again.metrics))
    if recorded.inputs_hold:
        run, truth = _read_run(recorded.input("run").parent), recorded.input("truth")
        of_scenes = any(entry.role == "truth_facts" for entry in recorded.evidence.inputs)
        source = read_truth(truth.parent if of_scenes else truth, summary.task)
        rows = [image.row for image in scored_images(run, source)]
        yield agreement("rows from the answers", as_json(rows), as_json(list(recorded.rows)))


def _short(summary: RelationsSummary) -> str:
    lines = [f"{describe_evaluator(summary)}: {image_counts(summary.coverage)}"]
    for name, metric in summary.metrics.items():
        guesses = (
            ""
            if metric.chance is None
            else (f"; chance {fraction(metric.chance)}, blind {fraction(metric.blind)}")
        )
        lines.append(
            f"{name} {fraction(metric.answers)}{bounds(metric.interval)} "
            f"over {plural(metric.n, 'question', 'questions')}{guesses}"
        )
    return "\n".join(lines)


def _metrics(summary: RelationsSummary) -> list[MetricPart]:
    """Every metric, and the accuracy of each relation; a guess and the prior below the answers."""
    parts = {"Every metric": summary.metrics, "Accuracy by relation": summary.relations}
    return [
        MetricPart(
            title=title,
            rows=[
                MetricRow(
                    name=name,
                    policy=policy,
                    number=number_cell(value, metric.interval if policy == "answers" else None),
                    over=plural(metric.n, "question", "questions"),
                )
                for name, metric in found.items()
                for policy, value in zip(
                    POLICIES, (metric.answers, metric.chance, metric.blind), strict=True
                )
                if policy == "answers" or value is not None
            ],
        )
        for title, found in parts.items()
        if found
    ]


def _notes(summary: RelationsSummary) -> list[str]:
    notes = []
    if summary.unanswered:
        reasons = ", ".join(f"{why} {n}" for why, n in summary.unanswered.items())
        notes.append(f"Unanswered questions count as wrong: {reasons}.")
    if summary.contradictory:
        statements = plural(summary.contradictory, "statement is", "statements are")
        notes.append(f"{statements} labelled both true and false and left out of every number.")
    return notes


EVALUATION: Final = EvaluationFamily(
    evaluate=_evaluate,
    verify=_verify,
    short=_short,
    metrics=_metrics,
    notes=_notes,
    truth_is_file=False,
)
