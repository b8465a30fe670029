"""`legoworld evaluate` of a bench run: its files and the private half in, an evaluation out."""

from __future__ import annotations

from pathlib import Path

from legoworld.cards import load_card
from legoworld.evaluation.bootstrap import check_draws
from legoworld.evaluation.family import EvaluationRequest, make_configuration, prepare_inputs
from legoworld.evaluation.reconstruction.case import CaseTask
from legoworld.evaluation.reconstruction.case_tasks import scored_cases, seen_tasks
from legoworld.evaluation.reconstruction.dataset import (
    TRUTH,
    BenchDataset,
    check_run,
    read_dataset,
)
from legoworld.evaluation.reconstruction.protocol import BenchProtocol, Choices, bench_protocol
from legoworld.evaluation.reconstruction.reference import check_sampling
from legoworld.evaluation.reconstruction.second_card import SecondCard, X, read_second_card
from legoworld.evaluation.reconstruction.submission import BenchRun, bench_run, list_files
from legoworld.evaluation.reconstruction.summary import Settings, summarise
from legoworld.evaluation.run import run_view
from legoworld.records.folders.evaluation_folder import (
    Evaluation,
    make_evidence,
    write_evaluation,
)
from legoworld.records.folders.read_run import ROWS, RUN
from legoworld.records.reconstruction import (
    BenchConfiguration,
    BenchEvidence,
    ReconstructionRow,
    ReconstructionSummary,
)


def evaluate_bench(request: EvaluationRequest) -> ReconstructionSummary:
    """Score a bench run and write the evaluation folder; returns its summary.

    truth: DATASET/private, beside DATASET/public. Options: reference_sampling and diagnostics, see
    `Choices`. Raises before scoring when run, dataset, options and output do not go together; what
    is wrong with one submission is that case's row.
    """
    choices = Choices(
        sampling=request.options.get("reference_sampling", "raster"),
        diagnostics=request.options.get("diagnostics", True),
    )
    draws, seed = request.draws, request.seed
    check_sampling(choices.sampling)
    check_draws(draws, seed)
    dataset, run = read_dataset(request.truth.absolute()), bench_run(request.run.absolute())
    protocol = bench_protocol(load_card(run.run.task))
    second = second_card(dataset, protocol)
    ids = [row.image_id for row in run.rows]
    track_sha256 = run.run.configuration.track_sha256 or None
    check_run(dataset, run.run.folder.name, track_sha256, ids, second.sha256 if second else None)
    configuration = make_configuration(
        request,
        protocol.card,
        BenchConfiguration,
        card_version=protocol.card.version,
        reference_sampling=choices.sampling,
        diagnostics=choices.diagnostics,
    )
    files = [*_inputs(run, dataset, choices), *_second_inputs(run, dataset, second)]
    inputs = prepare_inputs(request, files, configuration)
    rows: list[ReconstructionRow] = []
    tasks = case_tasks(run, dataset, protocol, choices, second)
    for row in scored_cases(seen_tasks(tasks), request.pool):
        rows.append(row)
        request.progress(row)
    summary = summarise(
        rows,
        kind=run.kind,
        partial=run.run.partial,
        protocol=protocol,
        settings=Settings(
            choices=choices,
            sampled=all(dataset.cases[i].truth.sha256.raster is not None for i in ids),
            draws=draws,
            seed=seed,
        ),
    )
    metrics = {name: mean.value for name, mean in summary.metrics.items()}
    evidence = make_evidence(BenchEvidence, summary, configuration, "pillow", metrics=metrics)
    evaluation = Evaluation(
        summary=summary,
        evidence=evidence,
        inputs=inputs,
        per_image=rows,
        view={"run.json": run_view(run.run)},
    )
    write_evaluation(request.output, evaluation, overwrite=request.overwrite)
    return summary


def second_card(dataset: BenchDataset, protocol: BenchProtocol) -> SecondCard | None:
    """The second card's half of a dataset, None where the protocol has none. BenchTruthError."""
    if protocol.x is None:
        return None
    return read_second_card(dataset.folders, dataset.track_sha256)


def case_tasks(
    run: BenchRun,
    dataset: BenchDataset,
    protocol: BenchProtocol,
    choices: Choices,
    second: SecondCard | None,
) -> list[CaseTask]:
    """One task for each case of the run, ascending image id."""
    return [
        CaseTask(
            run=run.run.folder,
            row=row,
            case=dataset.cases[row.image_id],
            folders=dataset.folders,
            protocol=protocol,
            choices=choices,
            x=second.images[row.image_id] if second else None,
        )
        for row in run.rows
    ]


def _second_inputs(
    run: BenchRun, dataset: BenchDataset, second: SecondCard | None
) -> list[tuple[str, Path]]:
    if second is None:
        return []
    folders = dataset.folders
    paths = [("truth", folders.private / X)]
    for row in run.rows:
        paths += [("truth_arrays", folders.arrays("x", dataset.cases[row.image_id]))]
        if picture := second.images[row.image_id].x.picture:
            paths += [("reference", folders.private.parent / picture)]
    return list(dict.fromkeys((role, path) for role, path in paths if path.is_file()))


def _inputs(run: BenchRun, dataset: BenchDataset, choices: Choices) -> list[tuple[str, Path]]:
    """Role and path of every file that the scores depend on."""
    folder, folders = run.run.folder, dataset.folders
    cases = [dataset.cases[row.image_id] for row in run.rows]
    paths: list[tuple[str, Path]] = [("run", folder / RUN), ("run_rows", folder / ROWS)]
    paths += [("submission", path) for path in list_files(folder, run.rows)]
    paths += [("truth", folders.private / TRUTH), ("track", folders.track)]
    for case in cases:
        kinds = ["raster"] if case.truth.sha256.raster is not None else ["depth", "instances"]
        kinds += ["depth", "instances"] if choices.sampling != "raster" else []
        wanted = [folders.arrays(kind, case) for kind in dict.fromkeys(kinds)]
        paths += [("truth_arrays", path) for path in wanted if path.is_file()]
        picture = folders.reference(case)
        paths += [("reference", picture)] if picture.is_file() else []
    return list(dict.fromkeys(paths))
