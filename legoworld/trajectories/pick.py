"""Choose another submission from a trial's checkpoints or runs, using public data only."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from msgspec import field

from legoworld.endpoint.blender import BlenderEndedError
from legoworld.endpoint.finalisation import export_submission
from legoworld.errors import LegoWorldError, SceneInvalidError, UsageError, cause
from legoworld.files import write_text
from legoworld.plugin.acceptance import clearly_closest
from legoworld.plugin.evidence import EVIDENCE, read_evidence
from legoworld.plugin.measure import measure
from legoworld.plugin.region_fit import region_fit
from legoworld.plugin.state import read_live
from legoworld.records.base import Record, RecordError, decode, readable
from legoworld.records.endpoint import Checkpoint
from legoworld.records.plugin_requirements import Report, Requirement
from legoworld.running.freeze_run import freeze_scene
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.folder import BLEND, PROVENANCE, SceneFolder
from legoworld.trajectories.folder import (
    RECONSTRUCTION,
    TRAJECTORY,
    TRIAL,
    RecordedTrial,
    recorded_trials,
)
from legoworld.workers.protections import Protections
from legoworld.workers.sandbox import SandboxLimits
from legoworld.workers.scratch import scratch_folder

#: Of a trial with the plugin: what it measured against.
_OWN_EVIDENCE: Final = f"{TRIAL}/plugin/evidence"
#: By region, its IoU with the object that is matched to it.
Fit = dict[str, float]
PICKED: Final = "picked.json"
REQUIREMENTS: Final = "requirements.json"


def best_run(
    runs: Sequence[RecordedTrial],
    evidence: Path | None,
    blender: BlenderProcess,
    notice: Callable[[str], None],
) -> tuple[RecordedTrial, list[Fit]]:
    """The run whose submission has the largest mean IoU, of equals the first; each run's fit.

    evidence: a folder of evidence.json, None for the runs' own. What shows nothing fits nowhere.
    UsageError without regions.
    """
    known = read_evidence(evidence or runs[0].folder / _OWN_EVIDENCE)
    if not known.file.regions:
        raise UsageError(
            f"no checkpoint of {runs[0].about.scene} can be chosen by its residuals",
            found=f"no regions in its {EVIDENCE}",
            expected="the photo's regions",
            next_step="make them with `legoworld plugin evidence --regions`",
        )
    fits: list[Fit] = []
    for run in runs:
        try:
            fits.append(region_fit(read_live(run.folder / BLEND, blender), known))
        except LegoWorldError as error:
            notice(f"{run.folder.name} of {run.folder.parent.name}: {error}")
            fits.append({})
    best = max(range(len(runs)), key=lambda k: sum(fits[k].values()))
    return runs[best], fits


By = Literal["last", "residuals", "regions"]


class Pick(Record, frozen=True, kw_only=True):
    """picked.json of a scene folder: which checkpoint or run was taken, and the public reason.

    ordinal: null where no checkpoint opens; passed, failed, unknown: of the requirements, by
    checkpoint, empty for `last`. run: the folder of the run that was taken among several; fits: by
    run, the IoU of each region with the object that is matched to it.
    """

    by: By
    scene: str
    ordinal: int | None
    sha256: str | None
    submitted: int | None
    passed: dict[str, tuple[int, int, int]]
    run: str | None = None
    fits: dict[str, Fit] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class PickPlan:
    """Settings of a pick. evidence: a folder with <scene>/requirements.json and its evidence."""

    by: By
    evidence: Path | None
    limits: SandboxLimits
    protections: Protections
    notice: Callable[[str], None]


def pick(scenes: Path, output: Path, plan: PickPlan) -> list[Pick]:
    """Write each trial's chosen checkpoint as a frozen scene folder into `output`.

    By regions: each photo's chosen run. UsageError for residuals without evidence.
    """
    if plan.by == "residuals" and plan.evidence is None:
        raise UsageError(
            "residuals need something to measure against",
            found="no --evidence",
            expected="a folder with <scene>/requirements.json and the scene's public evidence",
            next_step="make it with `legoworld plugin evidence`",
        )
    picks = []
    with BlenderProcess(Limits(memory_bytes=plan.limits.memory_bytes)) as blender:
        if plan.by == "regions":
            return _pick_runs(scenes, output, plan, blender)
        for trial in recorded_trials(scenes):
            chosen, counts = _choose_checkpoint(trial, plan, blender)
            target = output / trial.folder.relative_to(scenes)
            picks.append(_deliver(trial, chosen, counts, target, plan, blender))
            plan.notice(f"{trial.about.scene}: checkpoint {picks[-1].ordinal}")
    return picks


def _pick_runs(scenes: Path, output: Path, plan: PickPlan, blender: BlenderProcess) -> list[Pick]:
    """Copy the run of each scene that fits its regions best."""
    by_scene: dict[str, list[RecordedTrial]] = {}
    for trial in recorded_trials(scenes):
        by_scene.setdefault(trial.about.scene, []).append(trial)
    picks = []
    for scene, runs in by_scene.items():
        evidence = None if plan.evidence is None else plan.evidence / scene
        best, fits = best_run(runs, evidence, blender, plan.notice)
        names = [str(run.folder.relative_to(scenes)) for run in runs]
        record = Pick(
            by=plan.by,
            scene=scene,
            ordinal=None,
            sha256=None,
            submitted=best.about.finalisation.checkpoint,
            passed={},
            run=str(best.folder.relative_to(scenes)),
            fits=dict(zip(names, fits, strict=True)),
        )
        target = _new_folder(output / scene)
        with scratch_folder(".picking-", target.parent) as scratch:
            shutil.copytree(best.folder, scratch / "made")
            write_text(scratch / "made" / PICKED, readable(record))
            (scratch / "made").rename(target)
        picks.append(record)
        plan.notice(f"{scene}: {record.run}")
    return picks


def _new_folder(target: Path) -> Path:
    """A scene folder to make, below a folder that is there. UsageError where it exists."""
    if target.exists():
        raise UsageError(
            f"{target} is there already", found="a folder", expected="a new folder of scenes"
        )
    target.parent.mkdir(parents=True, exist_ok=True)
    return target


def _choose_checkpoint(
    trial: RecordedTrial, plan: PickPlan, blender: BlenderProcess
) -> tuple[Checkpoint | None, dict[str, tuple[int, int, int]]]:
    """The checkpoint to take: the last, or one that fits the photo clearly better."""
    if not trial.live:
        return None, {}
    if plan.by == "last":
        return trial.live[-1], {}
    assert plan.evidence is not None
    folder = plan.evidence / trial.about.scene
    try:
        requirements = decode(list[Requirement], (folder / REQUIREMENTS).read_bytes())
    except (OSError, RecordError) as error:
        raise UsageError(
            f"the requirements of {trial.about.scene} cannot be read",
            found=cause(error),
            expected=f"{REQUIREMENTS}: a list of the plugin's requirements",
        ) from error
    evidence = read_evidence(folder) if (folder / "evidence.json").is_file() else None
    reports: dict[Checkpoint, Report] = {}
    for checkpoint in trial.live:
        try:
            scene = read_live(trial.blend(checkpoint), blender)
            reports[checkpoint] = measure(scene, requirements, evidence)
        except LegoWorldError as error:
            plan.notice(f"{trial.about.scene}, checkpoint {checkpoint.ordinal}: {error}")
    counts = {str(c.ordinal): _count_verdicts(report) for c, report in reports.items()}
    if not reports:
        return trial.live[-1], counts
    best = clearly_closest([report.results for report in reports.values()])
    return list(reports)[best], counts


def _count_verdicts(report: Report) -> tuple[int, int, int]:
    verdicts = [result.verdict for result in report.results]
    return verdicts.count("pass"), verdicts.count("fail"), verdicts.count("unknown")


def _deliver(
    trial: RecordedTrial,
    chosen: Checkpoint | None,
    counts: Mapping[str, tuple[int, int, int]],
    target: Path,
    plan: PickPlan,
    blender: BlenderProcess,
) -> Pick:
    """Export the chosen checkpoint, with the trial's records beside it, and freeze it."""
    _new_folder(target)
    record = Pick(
        by=plan.by,
        scene=trial.about.scene,
        ordinal=None if chosen is None else chosen.ordinal,
        sha256=None if chosen is None else chosen.sha256,
        submitted=trial.about.finalisation.checkpoint,
        passed=dict(counts),
    )
    with scratch_folder(".picking-", target.parent) as scratch:
        made = scratch / "made"
        made.mkdir()
        (scratch / "workspace").mkdir()
        for name in (PROVENANCE, RECONSTRUCTION, TRAJECTORY):
            shutil.copyfile(trial.folder / name, made / name)
        write_text(made / PICKED, readable(record))
        if chosen is not None:
            _export(trial, chosen, made, scratch / "workspace", plan, blender)
            freeze_scene(
                SceneFolder(path=made, name=trial.about.scene), blender=blender, cache=None
            )
        made.rename(target)
    return record


def _export(
    trial: RecordedTrial,
    chosen: Checkpoint,
    made: Path,
    workspace: Path,
    plan: PickPlan,
    blender: BlenderProcess,
) -> None:
    try:
        export_submission(
            trial.blend(chosen),
            made,
            workspace=workspace,
            limits=plan.limits,
            protections=plan.protections,
            blender=blender,
        )
    except (BlenderEndedError, SceneInvalidError) as error:
        plan.notice(f"{trial.about.scene}: checkpoint {chosen.ordinal} is not exported: {error}")


def saved_regret(
    picks: Sequence[Pick], q_of: Callable[[str, int | None], float | None]
) -> tuple[float, int] | None:
    """Mean regret that the picks save over the scored scenes, and the number of those scenes.

    q_of: Q of a scene's checkpoint, and of its submission for None.
    """
    saved = [
        q - submitted
        for pick in picks
        if pick.ordinal is not None
        and (q := q_of(pick.scene, pick.ordinal)) is not None
        and (submitted := q_of(pick.scene, None)) is not None
    ]
    return (sum(saved) / len(saved), len(saved)) if saved else None
