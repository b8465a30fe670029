"""LEGO-Bench, from reference scenes to scores and tables."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

from legoworld.api import settings
from legoworld.api.arguments import check_arguments
from legoworld.api.listener import SILENT, Listener
from legoworld.bench.admission import HttpOptions, require_http
from legoworld.bench.archive import UnpackLimits
from legoworld.bench.dataset import MadeDataset, MakeRequest, make_dataset
from legoworld.bench.family import MakeOptions
from legoworld.bench.harbor import HarborOptions, export_harbor
from legoworld.bench.procedural import DrawRequest, draw_scenes
from legoworld.bench.score_worker import ServeOptions
from legoworld.bench.server import ScoreServer
from legoworld.cards import load_card
from legoworld.comparison.leaderboard import (
    case_scores,
    leaderboard,
    read_entries,
    write_leaderboard,
)
from legoworld.comparison.standings import with_standings
from legoworld.errors import UsageError
from legoworld.evaluation.reconstruction.dataset import read_dataset
from legoworld.evaluation.reconstruction.evaluate import second_card as second_half
from legoworld.evaluation.reconstruction.judge_pairs import (
    choose_pairs,
    pair_scores,
    read_trajectories,
)
from legoworld.evaluation.reconstruction.judges import judge_agreement
from legoworld.evaluation.reconstruction.protocol import bench_protocol
from legoworld.files import canonical_json, refuse_existing, sha256_of_file, write_text
from legoworld.records.base import readable, to_record
from legoworld.records.bench_dataset import PictureCard
from legoworld.records.bench_results import JudgesFile, Leaderboard, Parts, ServeAnswer
from legoworld.records.folders.read_evaluation import EVIDENCE
from legoworld.records.render_card import RenderCard
from legoworld.records.run_rows import RunRow
from legoworld.records.trajectories import TRAJECTORIES
from legoworld.running.submission import BenchRules, bench_rules
from legoworld.tasks.shipped import BENCH, BENCH_X
from legoworld.workers.engines import EngineName, engine_cores
from legoworld.workers.processors import usable_cores


@check_arguments
def bench_make(
    scenes: str | Path,
    output: str | Path,
    *,
    size_wh: tuple[int, int] = (1920, 1080),
    limit: int | None = None,
    samples: int = 128,
    denoised: bool = True,
    noise_seeds: int = 3,
    keep_scenes: str | Path | None = None,
    procedural: int | None = None,
    count: int = 8,
    assets: str | Path | None = None,
    require_frozen: bool = False,
    workers: int | None = None,
    engine: EngineName = "local",
    cache: settings.Cache = True,
    overwrite: bool = False,
    time_limit_s: float = settings.TIME_LIMIT_S,
    memory_limit_gib: float = settings.MEMORY_LIMIT_GIB,
    listener: Listener = SILENT,
) -> MadeDataset:
    """Make cases from reference scenes: output/public for agents, output/private for `evaluate`.

    size_wh, samples, denoised: of the pictures. noise_seeds: renders by the render card of which
    A's noise floor is measured. keep_scenes: also write each case there as a scene folder, the
    reference submitted as itself. procedural: a seed by which `count` scenes are first drawn into
    `scenes`, from KayKit's packs in `assets`. Other arguments: as in `readout`. A scene that cannot
    become cases is among the `refused_families`, with its reason.
    """
    card, top = load_card(BENCH), Path(output).absolute()
    if procedural is not None:
        drawn = DrawRequest(
            scenes=Path(scenes),
            seed=procedural,
            count=count,
            assets=Path(assets) if assets else None,
            workers=workers or usable_cores(),
        )
        draw_scenes(drawn, listener.notice)
    options = MakeOptions(
        output=top,
        size_wh=size_wh,
        picture=PictureCard(
            engine="CYCLES", device="CPU", samples=samples, seed=0, denoised=denoised
        ),
        card=to_record(RenderCard, card.value("render")),
        delta=card.value("scoring.delta"),
        noise_seeds=noise_seeds,
        scenes=Path(keep_scenes).absolute() if keep_scenes else None,
        cache=settings.snapshot_cache(cache),
        require_frozen=require_frozen,
        threads=1,
        notice=listener.notice if engine == "local" else None,
    )
    request = MakeRequest(
        scenes=Path(scenes),
        options=options,
        limits=settings.make_limits(time_limit_s, memory_limit_gib),
        engine=engine,
        workers=workers or engine_cores(engine),
        limit=limit,
        overwrite=overwrite,
    )
    return make_dataset(
        request,
        total=listener.total,
        progress=lambda made: listener.row(
            RunRow(image_id=0, file_name=made.family, status=made.status)
        ),
    )


@check_arguments
def bench_serve(
    dataset: str | Path,
    requests: BinaryIO,
    answer: Callable[[ServeAnswer], None],
    *,
    root: str | Path | None = None,
    render: bool = True,
    second_card: bool = False,
    diagnostics: bool = False,
    workers: int | None = None,
    cache: settings.Cache = True,
    time_limit_s: float = settings.TIME_LIMIT_S,
    memory_limit_gib: float = settings.MEMORY_LIMIT_GIB,
) -> None:
    """Score submissions from a stream of JSON lines; `answer` is called as each is done.

    dataset: with both halves. A line is {"scene": folder, "image_id": number} with an optional
    "id"; the folder is below `root`, by default the working folder. render: False for R alone;
    second_card: a line's "parts" may be "RX" or "RAX", for LEGO-Bench-X; BenchTruthError for a
    dataset without private/x.json;
    diagnostics: also the numbers beside R. Every line gets one answer, and an invalid one the
    status "refused".
    """
    serving, count = _serving(
        Path(dataset),
        Path(root or "."),
        render=render,
        second_card=second_card,
        diagnostics=diagnostics,
        workers=workers,
        cache=cache,
        time_limit_s=time_limit_s,
        memory_limit_gib=memory_limit_gib,
    )
    with ScoreServer(serving, count) as server:
        server.serve(requests, answer)


def serve_bench_http(
    dataset: Path,
    http: HttpOptions,
    say: Callable[[str], None],
    *,
    root: Path | None = None,
    **given: Any,
) -> None:
    """Score submissions over HTTP until a signal. given: as in `bench_serve`.

    root: None for only what is sent. say: told the address, and why a scoring failed.
    InstallationError without the extra `serve`.
    """
    require_http("bench serve --http")
    from legoworld.bench.http_server import serve_http

    serving, count = _serving(dataset, root, **given)
    unpacking = UnpackLimits(unpacked_bytes=http.unpacked_bytes)
    serve_http(replace(serving, unpacking=unpacking), http, count, say)


def _serving(
    dataset: Path,
    root: Path | None,
    *,
    render: bool,
    second_card: bool,
    diagnostics: bool,
    workers: int | None,
    cache: settings.Cache,
    time_limit_s: float,
    memory_limit_gib: float,
) -> tuple[ServeOptions, int]:
    """What all submissions share, and how many workers there are."""
    bench = bench_protocol(load_card(BENCH_X if second_card else BENCH))
    count, cases = workers or usable_cores(), read_dataset(dataset / "private")
    alone = bench_rules(bench.card, render=False, noise=False, facts=False)
    rendered = bench_rules(bench.card, render=True, noise=False)
    # The last one is given unasked: never the second card, of which every answer tells something.
    rules: dict[Parts, BenchRules] = {"RX": alone, "RAX": rendered, "R": alone, "RA": rendered}
    left_out = {part for part, offered in (("A", render), ("X", second_card)) if not offered}
    rules = {parts: rule for parts, rule in rules.items() if not left_out & set(parts)}
    options = ServeOptions(
        root=None if root is None else root.absolute(),
        dataset=cases,
        second=second_half(cases, bench),
        bench=bench,
        rules=rules,
        diagnostics=diagnostics,
        cache=settings.snapshot_cache(cache),
        limits=settings.make_limits(time_limit_s, memory_limit_gib),
        threads=max(1, usable_cores() // count),
    )
    return options, count


def bench_score(
    dataset: str | Path, submissions: Iterable[tuple[str | Path, int]], **options: Any
) -> list[ServeAnswer]:
    """The scores of (scene folder, image id) pairs, in their order. options: of `bench_serve`.

    `root` is "/" unless it is given. second_card: of each, too.
    """
    parts = "RAX" if options.get("render", True) else "RX"
    more = {"parts": parts} if options.get("second_card") else {}
    lines = [
        canonical_json(
            {"scene": str(Path(scene).absolute()), "image_id": image_id, "id": number, **more}
        )
        for number, (scene, image_id) in enumerate(submissions)
    ]
    answers: list[ServeAnswer] = []
    stream = BytesIO("\n".join(lines).encode())
    bench_serve(dataset, stream, answers.append, **{"root": "/", **options})
    return sorted(answers, key=lambda one: int(str(one.id)))


@check_arguments
def bench_export(dataset: str | Path, output: str | Path, **settings: Any) -> list[Path]:
    """Write each case as a task folder for Harbor; their paths. settings: `HarborOptions`."""
    cases = read_dataset(Path(dataset) / "private")
    return export_harbor(cases, Path(output), HarborOptions(**settings))


@check_arguments
def bench_table(
    evaluations: Sequence[str | Path],
    output: str | Path,
    *,
    draws: int = 10_000,
    seed: int = 0,
    overwrite: bool = False,
) -> Leaderboard:
    """Write one row for each agent and model of bench evaluations, in four forms."""
    sides = read_entries([Path(folder) for folder in evaluations])
    board = with_standings(leaderboard(sides, draws=draws, seed=seed), sides)
    write_leaderboard(Path(output), board, overwrite=overwrite)
    return board


@check_arguments
def bench_judges(
    judgements: str | Path,
    evaluations: Sequence[str | Path] = (),
    json_file: str | Path | None = None,
    *,
    trajectories: str | Path | None = None,
    seed: int = 0,
    overwrite: bool = False,
) -> JudgesFile:
    """How far recorded judgements agree with the scores; as JSON in a file where one is given.

    evaluations: those whose scores say which submission is better, instead of the judgements.
    trajectories: what `trajectory_score` wrote, of which `trajectory_pairs` chose the pairs by this
    seed. UsageError for a file that is there, unless `overwrite`, and for both.
    """
    if evaluations and trajectories:
        raise UsageError(
            "two sources of what is better",
            found="evaluations and --trajectories",
            expected="one of them",
            next_step="judge submissions and checkpoints in two calls",
        )
    if json_file is not None:
        refuse_existing(Path(json_file), overwrite=overwrite)
    if trajectories is not None:
        scored = read_trajectories(Path(trajectories))
        agreement = judge_agreement(
            Path(judgements),
            pair_scores(scored),
            {TRAJECTORIES: sha256_of_file(Path(trajectories) / TRAJECTORIES)},
            choose_pairs(scored, seed),
        )
    else:
        sides = read_entries([Path(folder) for folder in evaluations]) if evaluations else []
        agreement = judge_agreement(
            Path(judgements),
            {side.name: case_scores(side) for side in sides} if sides else None,
            {side.name: sha256_of_file(side.folder / EVIDENCE) for side in sides},
        )
    if json_file is not None:
        write_text(Path(json_file), readable(agreement))
    return agreement
