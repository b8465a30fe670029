"""The evaluation of relations: questions of the truth, answered by a run."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final, cast

from legoworld.cards import load_card
from legoworld.evaluation.bootstrap import check_draws
from legoworld.evaluation.checks import Check, find_input
from legoworld.evaluation.evidence import agreement
from legoworld.evaluation.family import EvaluationFamily, EvaluationRequest, RecordedEvaluation
from legoworld.evaluation.metrics import MetricPart, MetricRow, number
from legoworld.evaluation.prepare_inputs import prepared_inputs
from legoworld.evaluation.relations.rows import scored_images
from legoworld.evaluation.relations.summary import METRICS, POLICIES, metrics
from legoworld.evaluation.relations.truth import read_truth
from legoworld.evaluation.run import Run, count_images, read_family_run, read_rows, run_view
from legoworld.evaluation.short_text import bounds, describe_evaluator, fraction, image_counts
from legoworld.pluralize import plural
from legoworld.records.base import UNSET, as_json
from legoworld.records.evaluation_summary import Evaluator
from legoworld.records.evidence import ScoreConfiguration
from legoworld.records.folders.evaluation_folder import Evaluation, make_evidence, write_evaluation
from legoworld.records.folders.read_evaluation import SUMMARY
from legoworld.records.folders.read_run import ROWS, RUN
from legoworld.records.relations import RelationsEvidence, RelationsRow, RelationsSummary
from legoworld.tasks.shipped import RELATIONS


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
    run = _read_run(request.run)
    truth = read_truth(request.truth, run.task)
    check_draws(request.draws, request.seed)
    configuration = ScoreConfiguration(
        task=run.task,
        card_sha256=load_card(run.task).sha256,
        draws=request.draws,
        seed=request.seed,
    )
    files = [("run", run.folder / RUN), ("per_image", run.folder / ROWS), *truth.files]
    files += [
        ("answers", run.folder / row.answer.file)
        for row in read_rows(run)
        if row.answer is not UNSET
    ]
    inputs = prepared_inputs(
        request.output,
        files,
        configuration,
        run=run.folder,
        origins=request.origins,
        overwrite=request.overwrite,
    )
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
    made, written = as_json(again), json.loads((recorded.folder / SUMMARY).read_bytes())
    for key in sorted({*made, *written}):
        yield agreement(f"{key} from the rows", made.get(key), written.get(key))
    evidence = cast("RelationsEvidence", recorded.evidence)
    yield agreement("metrics in the evidence", as_json(evidence.metrics), made["metrics"])
    if recorded.inputs_hold:
        found = {
            entry.role: find_input(recorded.folder, entry.path, recorded.root)
            for entry in reversed(recorded.evidence.inputs)
        }
        run, truth = found["run"], found["truth"]
        assert run is not None
        assert truth is not None
        source = truth.parent if "truth_facts" in found else truth
        rows = [
            image.row
            for image in scored_images(_read_run(run.parent), read_truth(source, summary.task))
        ]
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
                    number=number(value, metric.interval if policy == "answers" else None),
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
