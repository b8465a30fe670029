"""`legoworld trajectory score`: every checkpoint of every trial as a submission of its own.

The n-th checkpoints of a folder's trials are one bench run, read out and scored as any other; the
submissions are the last one. What exists already is not made again.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from legoworld.api.evaluation import evaluate
from legoworld.api.readout import readout
from legoworld.conventions import SCHEMA_VERSION
from legoworld.endpoint.blender import BlenderEndedError
from legoworld.endpoint.finalisation import export_submission
from legoworld.errors import SceneInvalidError, UsageError
from legoworld.evaluation.reconstruction.dataset import BenchDataset, read_dataset
from legoworld.files import readable_json, sha256_of_text, write_text
from legoworld.records.atif import AtifTrajectory
from legoworld.records.base import UNSET, canonical, decode_lines, readable
from legoworld.records.endpoint import Checkpoint
from legoworld.records.reconstruction import ReconstructionRow
from legoworld.records.submission import BenchRow
from legoworld.records.trajectories import (
    TRAJECTORIES,
    Moment,
    ScoredScene,
    TrajectoryFile,
    TrajectoryScore,
)
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.folder import BLEND, GLB, PICTURE
from legoworld.tasks.shipped import BENCH
from legoworld.trajectories.curves import Trajectory, moments, score_trajectory
from legoworld.trajectories.folder import RecordedTrial, recorded_trials
from legoworld.trajectories.tables import SHARES, agent_tables, common_images
from legoworld.version import __version__
from legoworld.workers.protections import Protections
from legoworld.workers.sandbox import SandboxLimits
from legoworld.workers.scratch import scratch_folder

_ROWS: Final = "per_image.jsonl"
_FINAL: Final = "final"


@dataclass(frozen=True, kw_only=True)
class ScoringPlan:
    """Settings for exporting and scoring checkpoints."""

    private: Path
    output: Path
    limits: SandboxLimits
    protections: Protections
    workers: int
    draws: int
    seed: int
    notice: Callable[[str], None]


@dataclass(frozen=True, kw_only=True)
class Group:
    """The trials of one agent's run: no two of them are of one image."""

    name: str
    agent: str
    run: int
    trials: tuple[RecordedTrial, ...]


def score_trajectories(scenes: Sequence[Path], plan: ScoringPlan) -> TrajectoryFile:
    """Score folders of trials against a bench's private half; writes trajectories.json.

    UsageError for trials of images that the bench does not have.
    """
    dataset = read_dataset(plan.private)
    groups = [group for folder in scenes for group in _groups(folder)]
    for group in groups:
        _refuse_strangers(group, dataset)
    scored = [score for group in groups for score in _score_group(group, dataset, plan)]
    trials = tuple(sorted(scored, key=lambda t: (t.agent, t.run, t.image_id)))
    common = common_images(trials)
    several = len({trial.agent for trial in trials}) > 1
    document = TrajectoryFile(
        schema_version=SCHEMA_VERSION,
        legoworld=__version__,
        evaluator={"name": "legoworld-bench", "version": __version__},
        draws=plan.draws,
        seed=plan.seed,
        shares=SHARES,
        trials=trials,
        agents=agent_tables(trials, draws=plan.draws, seed=plan.seed),
        common=agent_tables(
            [t for t in trials if t.image_id in common], draws=plan.draws, seed=plan.seed
        )
        if several
        else None,
        common_images=common,
    )
    write_text(plan.output / TRAJECTORIES, readable(document))
    return document


def _groups(folder: Path) -> list[Group]:
    """A folder's trials by run: of --repeat each has a folder run_K."""
    by_run: dict[int, list[RecordedTrial]] = {}
    for trial in recorded_trials(folder):
        first = trial.folder.relative_to(folder).parts[0]
        number = first.removeprefix("run_")
        run = int(number) if number != first and number.isdecimal() else 1
        by_run.setdefault(run, []).append(trial)
    return [
        Group(
            name=_group_name(folder, run),
            agent=trials[0].about.agent,
            run=run,
            trials=tuple(trials),
        )
        for run, trials in sorted(by_run.items())
    ]


def slot_folder(output: Path, trial: RecordedTrial, number: int | None) -> Path:
    """The scenes of the slot that a trial's checkpoint was scored in; None: its submission."""
    depth = len(Path(trial.about.scene).parts)
    top = trial.folder.parents[depth - 1]
    run = 1
    if top.name.startswith("run_") and top.name[4:].isdecimal():
        run, top = int(top.name[4:]), top.parent
    slot = _FINAL if number is None else f"{number + 1:03}"
    return output / _group_name(top, run) / slot / "scenes"


def _group_name(folder: Path, run: int) -> str:
    return f"{sha256_of_text(str(folder.resolve()))[:8]}-{run}"


def _refuse_strangers(group: Group, dataset: BenchDataset) -> None:
    for trial in group.trials:
        case = dataset.cases.get(trial.about.image_id)
        if case is None or case.file_name != trial.about.file_name:
            raise UsageError(
                f"the trial of {trial.about.scene} is not of this bench",
                found=f"image {trial.about.image_id}, {trial.about.file_name}",
                expected="trials of the bench's own track",
                next_step="pass the private half of the dataset that `reconstruct` was given",
            )


def _score_group(
    group: Group, dataset: BenchDataset, plan: ScoringPlan
) -> Iterator[TrajectoryScore]:
    longest = max(len(trial.live) for trial in group.trials)
    slots: list[dict[int, ScoredScene]] = []
    for number in range(longest):
        taking = [t for t in group.trials if len(t.live) > number]
        plan.notice(f"{group.agent}, run {group.run}: checkpoint {number + 1} of {longest}")
        slots.append(_slot(group, f"{number + 1:03}", taking, number, dataset, plan))
    final = _slot(group, _FINAL, list(group.trials), None, dataset, plan)
    for trial in group.trials:
        image = trial.about.image_id
        yield score_trajectory(
            Trajectory(
                image_id=image,
                scene=trial.about.scene,
                family=dataset.cases[image].image.family,
                agent=group.agent,
                run=group.run,
                seconds=trial.about.agent_seconds,
                checkpoints=[slot[image] for slot in slots if image in slot],
                final=final[image],
            )
        )


def _slot(
    group: Group,
    name: str,
    trials: Sequence[RecordedTrial],
    number: int | None,
    dataset: BenchDataset,
    plan: ScoringPlan,
) -> dict[int, ScoredScene]:
    """The scores of one checkpoint of each trial, or of their submissions, by image id."""
    top = plan.output / group.name / name
    scenes, refused = top / "scenes", top / "refused.json"
    if not refused.is_file():
        why = _deliver(scenes, trials, number, plan)
        write_text(refused, readable_json(why))
    ids = [trial.about.image_id for trial in trials]
    run = readout(
        scenes,
        top / "run",
        task=BENCH,
        track=dataset.folders.track,
        image_ids=ids,
        workers=plan.workers,
    )
    evaluation = evaluate(
        run.folder, top / "eval", truth=plan.private, diagnostics=False, draws=1, overwrite=True
    )
    read = {r.image_id: r for r in decode_lines(BenchRow, (top / "run" / _ROWS).read_bytes())}
    rows = decode_lines(ReconstructionRow, (Path(evaluation.folder) / _ROWS).read_bytes())
    scored = {row.image_id: row for row in rows}
    whens = {t.about.image_id: _checkpoint_moment(t, number) for t in trials}
    return {
        trial.about.image_id: _scored_scene(
            None if number is None else trial.live[number],
            whens[trial.about.image_id],
            read[trial.about.image_id],
            scored[trial.about.image_id],
        )
        for trial in trials
    }


def _deliver(
    scenes: Path, trials: Sequence[RecordedTrial], number: int | None, plan: ScoringPlan
) -> dict[str, str]:
    """Export each trial's checkpoint as a submission; why, where it cannot be, by scene."""
    refused = {}
    scenes.mkdir(parents=True, exist_ok=True)
    with BlenderProcess(Limits(memory_bytes=plan.limits.memory_bytes)) as blender:
        for trial in trials:
            target = scenes / trial.about.scene
            target.mkdir(parents=True, exist_ok=True)
            if number is None:
                for name in (BLEND, GLB, PICTURE):
                    if (trial.folder / name).is_file():
                        shutil.copyfile(trial.folder / name, target / name)
                continue
            try:
                with _workspace(plan.output) as workspace:
                    export_submission(
                        trial.blend(trial.live[number]),
                        target,
                        workspace=workspace,
                        limits=plan.limits,
                        protections=plan.protections,
                        blender=blender,
                    )
            except (BlenderEndedError, SceneInvalidError) as error:
                refused[trial.about.scene] = str(error)
    return refused


@contextmanager
def _workspace(output: Path) -> Iterator[Path]:
    with scratch_folder(".exporting-", output) as scratch:
        (scratch / "workspace").mkdir()
        yield scratch / "workspace"


def _scored_scene(
    checkpoint: Checkpoint | None, when: Moment, read: BenchRow, row: ReconstructionRow
) -> ScoredScene:
    compared = row.status == "ok" and row.valid
    r, a = (row.R, row.A) if compared else (None, None)
    eligible = r is not None and a is not None
    reason = "" if eligible else (row.reason or _invalid(row) or row.status)
    camera = None if read.camera is UNSET else sha256_of_text(canonical(read.camera))
    return ScoredScene(
        ordinal=None if checkpoint is None else checkpoint.ordinal,
        call=0 if checkpoint is None else checkpoint.call,
        when=when,
        R=r if eligible else None,
        A=a if eligible else None,
        Q=None if r is None or a is None else (r + a) / 2,
        reason=reason,
        camera_sha256=camera,
        snapshot_sha256=None if read.snapshot_sha256 is UNSET else read.snapshot_sha256,
    )


def _invalid(row: ReconstructionRow) -> str:
    checks = row.validity or {}
    return "; ".join(f"{name}: {check.found}" for name, check in checks.items() if not check.ok)


def _checkpoint_moment(trial: RecordedTrial, number: int | None) -> Moment:
    about = trial.about
    if number is None:
        at_s, call = about.agent_seconds, about.calls
    else:
        at_s, call = trial.live[number].at_s, trial.live[number].call
    return moments(
        [at_s],
        [call],
        seconds=about.agent_seconds,
        n_calls=about.calls,
        tokens=tokens_until(trial.trajectory),
    )[0]


def tokens_until(trajectory: AtifTrajectory) -> list[tuple[int, int]]:
    """(call, output tokens when it had been made), in order; empty where steps do not count them.

    The last has the trial's total: what followed its last call is part of the budget.
    """
    until, used, any_counted = [], 0, False
    last = 0
    for step in trajectory.steps:
        counted = step.metrics.completion_tokens if step.metrics else None
        if isinstance(counted, int):
            used, any_counted = used + counted, True
        own = step.extra.get("legoworld") if isinstance(step.extra, dict) else None
        if isinstance(own, dict):
            last = int(own["calls"][-1])
            until.append((last, used))
    return [*until, (last + 1, used)] if any_counted else []
