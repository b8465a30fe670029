"""`trajectory_show`, `_score`, `_report` and `_pick`: what `import legoworld` offers of trials."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from legoworld.api.arguments import check_arguments, optional_path
from legoworld.api.listener import SILENT, Listener
from legoworld.evaluation.reconstruction.judge_pairs import choose_pairs, read_trajectories
from legoworld.files import write_text
from legoworld.pluralize import share
from legoworld.records.base import canonical
from legoworld.records.bench_results import JudgePair
from legoworld.records.trajectories import TrajectoryFile, TrajectoryScore
from legoworld.report.page_file import page_link
from legoworld.report.photos import find_photo
from legoworld.trajectories.folder import RecordedTrial, read_trial, recorded_trials
from legoworld.trajectories.page import find_score, read_scores, with_renders, write_page
from legoworld.trajectories.pick import By, Pick, PickPlan, pick
from legoworld.trajectories.score_checkpoints import ScoringPlan, score_trajectories
from legoworld.workers.protections import Confinement, protections
from legoworld.workers.sandbox import SandboxLimits

#: Of each Blender that exports or measures a checkpoint.
_LIMITS: Final = SandboxLimits(time_s=600.0, memory_bytes=8 << 30)


@check_arguments
def trajectory_show(
    scene: str | Path, *, scores: str | Path | None = None
) -> tuple[RecordedTrial, TrajectoryScore | None]:
    """A trial's calls and checkpoints, and its score in a folder of `trajectory_score`."""
    trial = read_trial(Path(scene))
    return trial, find_score(read_scores(optional_path(scores)), trial)


@check_arguments
def trajectory_score(
    scene_folders: Sequence[str | Path],
    output: str | Path,
    *,
    truth: str | Path,
    workers: int = 1,
    draws: int = 10_000,
    seed: int = 0,
    sandbox: Confinement = "auto",
    listener: Listener = SILENT,
) -> TrajectoryFile:
    """Score every checkpoint of every trial below folders of scenes; repeat the call to resume.

    truth: DATASET/private of the bench. workers: scenes read out at once. The result is private.
    """
    plan = ScoringPlan(
        private=Path(truth),
        output=Path(output),
        limits=_LIMITS,
        protections=protections(sandbox),
        workers=workers,
        draws=draws,
        seed=seed,
        notice=listener.notice,
    )
    return score_trajectories([Path(folder) for folder in scene_folders], plan)


@check_arguments
def trajectory_pairs(
    scene_folders: Sequence[str | Path], scores: str | Path, output: str | Path, *, seed: int = 0
) -> list[JudgePair]:
    """Choose pairs of checkpoints for judges by their gap; write them as lines, and return them.

    scores: what `trajectory_score` wrote of these folders.
    """
    trials = [trial for folder in scene_folders for trial in recorded_trials(Path(folder))]
    pairs = with_renders(choose_pairs(read_trajectories(Path(scores)), seed), trials, Path(scores))
    write_text(Path(output), "".join(canonical(pair) + "\n" for pair in pairs))
    return pairs


@check_arguments
def trajectory_report(
    scenes: str | Path,
    output: str | Path,
    *,
    photos: str | Path | None = None,
    scores: str | Path | None = None,
    report: str | Path | None = None,
    listener: Listener = SILENT,
) -> list[RecordedTrial]:
    """Write one HTML page to scrub through the trials below a folder; the trials.

    report: the page of `write_report` that each trial links to. Photos that are not found are told
    to the listener.
    """
    trials, folder = recorded_trials(Path(scenes)), optional_path(photos)
    link = page_link(optional_path(report), Path(output))
    write_page(trials, Path(output), photos=folder, scores=optional_path(scores), report=link)
    names = [trial.about.file_name for trial in trials]
    missing = [name for name in names if folder and find_photo(folder, name) is None]
    if missing:
        listener.notice(
            f"{share(len(missing), len(names), 'photo', 'photos')} not found in {folder}, "
            f"such as {missing[0]}"
        )
    return trials


@check_arguments
def trajectory_pick(
    scenes: str | Path,
    output: str | Path,
    *,
    by: By,
    evidence: str | Path | None = None,
    sandbox: Confinement = "auto",
    listener: Listener = SILENT,
) -> list[Pick]:
    """Choose each trial's submission again among its checkpoints, by public signals alone.

    by: "last", the open scene at the end, or "residuals", what the plugin measures against
    evidence/<scene>; "regions": among the runs over a photo, whichever fits its regions best, by
    evidence/<scene> or the runs' own. Each choice becomes a frozen scene folder below `output`.
    """
    plan = PickPlan(
        by=by,
        evidence=optional_path(evidence),
        limits=_LIMITS,
        protections=protections(sandbox),
        notice=listener.notice,
    )
    return pick(Path(scenes), Path(output), plan)
