"""`legoworld evaluate` of label maps: writes an evaluation folder; and verification of one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, cast

import numpy as np

from legoworld.cards import load_card
from legoworld.evaluation.bootstrap import centred_interval, check_draws, resample_counts
from legoworld.evaluation.checks import Check, find_closest, refuse_unseen
from legoworld.evaluation.evidence import agreement, check_rows, spread_evenly
from legoworld.evaluation.family import (
    EvaluationRequest,
    RecordedEvaluation,
    make_configuration,
    prepare_inputs,
)
from legoworld.evaluation.label_maps.family import (
    MapFamily,
    MapInvalidError,
    MapItem,
    MapTruth,
    MapTruthError,
    MapUnseenError,
    present_categories,
    resample_values,
    total_sums,
)
from legoworld.evaluation.run import Run, count_images, read_family_run, read_rows, run_view
from legoworld.files import sha256_of_file
from legoworld.pluralize import share
from legoworld.records.base import number
from legoworld.records.evaluation import Evaluator, ScoreConfiguration
from legoworld.records.folders.evaluation_folder import Evaluation, make_evidence, write_evaluation
from legoworld.records.folders.read_run import ROWS, RUN
from legoworld.records.label_maps import (
    LabelMapEvidence,
    LabelMapRow,
    LabelMapSummary,
    LabelMapView,
    MapBootstrap,
    MapCategory,
)
from legoworld.tracks.vocabulary import Vocabulary, dataset_version
from legoworld.workers.tasks import map_items

#: Images whose measuring takes as long as other processes take to start.
_FEW: Final = 32


@dataclass(frozen=True, kw_only=True)
class _Task:
    """One image, and the sizes of its files as the command sees them."""

    family: MapFamily
    item: MapItem
    sizes_bytes: dict[Path, int]


def evaluate_maps(family: MapFamily, request: EvaluationRequest) -> LabelMapSummary:
    """Score a run and write the evaluation folder; return its summary.

    Every error of ground truth, run or output is raised before anything is written, except of a
    true PNG that is found damaged when its image is measured; an unusable answer is its row, and
    counts as an answer that is all VOID.
    """
    run = request.run.absolute()
    card = load_card(run.task)
    check_draws(request.draws, request.seed)
    configuration = make_configuration(request, card, ScoreConfiguration)
    items, truth = _items(family, run, request.truth.absolute())
    answers = [("answer", item.path) for item in items if item.path and item.path.is_file()]
    files = [("run", run.folder / RUN), ("run_rows", run.folder / ROWS), *answers, *truth.inputs]
    inputs = prepare_inputs(request, files, configuration)
    rows: list[LabelMapRow] = []
    views: dict[str, Any] = {"run.json": run_view(run)}
    pool = request.pool.for_work(worth_a_process=len(items) > _FEW)
    tasks = [_task(family, item) for item in items]
    for row, view in map_items(_measure_task, tasks, pool):
        rows.append(row)
        views[f"{row.image_id}.json"] = view
        request.progress(row)
    summary = summarise(family, rows, run, truth.vocabulary, configuration)
    evidence = make_evidence(LabelMapEvidence, summary, configuration, "pillow")
    evaluation = Evaluation(
        summary=summary, evidence=evidence, inputs=inputs, per_image=rows, view=views
    )
    write_evaluation(request.output, evaluation, overwrite=request.overwrite)
    return summary


def _items(family: MapFamily, run: Run, path: Path) -> tuple[list[MapItem], MapTruth]:
    """What is measured of each image. MapTruthError where run and truth do not fit together."""
    truth = family.find_truth(path, run, load_card(run.task))
    rows = read_rows(run)
    absent = [row for row in rows if row.image_id not in truth.images]
    if absent:
        raise MapTruthError(
            f"{share(len(absent), len(rows), 'image', 'images')} of the run have no ground truth",
            found=f"nothing for {absent[0].file_name}",
            expected=f"every image of the track in {path.name}",
            next_step="pass the truth the track was made from",
        )
    if truth.vocabulary.sha256 != run.configuration.vocabulary_sha256:
        raise MapTruthError(
            "run and truth have different categories",
            found=f"{len(truth.vocabulary.categories)} categories in the truth, "
            f"{truth.vocabulary.sha256[:12]}",
            expected=f"the run's vocabulary, {str(run.configuration.vocabulary_sha256)[:12]}",
            next_step="make the track from this truth with `legoworld track make` and run with it",
        )
    ids = tuple(c.id for c in truth.vocabulary.categories)
    return [
        MapItem(
            row=row,
            path=run.folder / row.answer.file if row.status == "ok" and row.answer else None,
            truth=truth.images[row.image_id],
            rules=truth.rules,
            category_ids=ids,
        )
        for row in rows
    ], truth


def _task(family: MapFamily, item: MapItem) -> _Task:
    paths = [item.path] if item.path and item.path.is_file() else []
    return _Task(family=family, item=item, sizes_bytes={p: p.stat().st_size for p in paths})


def _measure_task(task: _Task) -> tuple[LabelMapRow, LabelMapView]:
    """An image's row and view; an answer that cannot be scored is measured as VOID."""
    item, row = task.item, task.item.row
    what = f"the {task.family.noun} of {row.file_name}"
    refuse_unseen(task.sizes_bytes, what, MapUnseenError)
    status, reason = row.status, row.reason
    try:
        _refuse_altered(item)
        found = task.family.measure(item)
    except MapInvalidError as error:
        status, reason = error.status, str(error)
        found = task.family.measure(replace(item, path=None))
    made = LabelMapRow(
        image_id=row.image_id,
        file_name=row.file_name,
        status=status,
        reason=reason,
        n_truth=found.n_truth,
        counts={str(number): counts for number, counts in sorted(found.counts.items())},
        matched=found.matched,
    )
    return made, found.view


def _refuse_altered(item: MapItem) -> None:
    """MapInvalidError for a PNG that is gone, or is not the one that the run wrote."""
    if item.path is None or not item.row.answer:
        return
    expected = item.row.answer.sha256
    if not item.path.is_file() or sha256_of_file(item.path) != expected:
        raise MapInvalidError(
            f"{item.row.answer.file} is not the file that the run wrote",
            found="another sha256" if item.path.is_file() else "nothing",
            expected=expected,
            next_step="run its command again",
        )


def summarise(
    family: MapFamily,
    rows: Sequence[LabelMapRow],
    run: Run,
    vocabulary: Vocabulary,
    configuration: ScoreConfiguration,
) -> LabelMapSummary:
    """summary.json of the rows of every attempted image, ascending id."""
    known = {category.id: category for category in vocabulary.categories}
    ids = present_categories(rows)
    things = np.array([known[number].isthing for number in ids], bool)
    sums = total_sums(rows, ids)
    metrics = {name: number(float(v)) for name, v in family.values(sums, things).items()}
    intervals = {}
    if len(rows) > 1 and ids:
        counts = resample_counts(len(rows), configuration.draws, configuration.seed)
        for name, samples in resample_values(family, rows, ids, things, counts).items():
            value = metrics[name]
            intervals[name] = centred_interval(
                samples, np.nan if value is None else value, unit="image"
            )
    columns = family.category_values(sums)
    card = load_card(run.task)
    unanswered = [row for row in rows if not row.has_score]
    return LabelMapSummary(
        task=run.task,
        kind=str(run.configuration.kind or None),
        partial=run.partial,
        evaluator=Evaluator(
            name=card.value("scoring.evaluator"), version=card.value("scoring.evaluator_version")
        ),
        coverage=count_images(rows),
        dataset_version=dataset_version(vocabulary, run.task),
        metrics=metrics,
        intervals=intervals,
        bootstrap=MapBootstrap(draws=configuration.draws, seed=configuration.seed),
        categories=tuple(
            MapCategory(
                id=n,
                name=known[n].name,
                isthing=known[n].isthing,
                counts=(int(sums[k, 1]), int(sums[k, 2]), int(sums[k, 3])),
                values={name: number(float(values[k])) for name, values in columns.items()},
            )
            for k, n in enumerate(ids)
        ),
        missed=sum(row.has_truth for row in unanswered),
        not_answered=tuple(f"{r.status}: {r.file_name}: {r.reason}" for r in unanswered),
    )


def verify_maps(family: MapFamily, recorded: RecordedEvaluation) -> Iterator[Check]:
    """The summary's numbers from the rows, and rows from run and truth where these are here."""
    summary = cast("LabelMapSummary", recorded.summary)
    rows = cast("Sequence[LabelMapRow]", recorded.rows)
    ids = [category.id for category in summary.categories]
    things = np.array([category.isthing for category in summary.categories], bool)
    values = family.values(total_sums(rows, ids), things)
    again = {name: number(float(value)) for name, value in values.items()}
    yield agreement("metrics from the rows", again, summary.metrics)
    evidence = cast("LabelMapEvidence", recorded.evidence)
    yield agreement("metrics in the evidence", evidence.metrics, summary.metrics)
    if not recorded.inputs_hold:
        return
    run_file, truth_file = recorded.input("run"), recorded.input("truth")
    run = read_family_run(run_file.parent, family.family, f"a run of {family.noun}")
    # The truth is its first file, or the closest folder that has every image's.
    places = (truth_file, *truth_file.parents)
    items = find_closest(places, lambda place: _items(family, run, place)[0])
    measured = (_measure_task(_task(family, item))[0] for item in spread_evenly(items))
    yield from check_rows(recorded, measured)
