"""`legoworld reconstruct`: a trial for every photo of a track, resumed where it was killed."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from legoworld.agents.recorded_steps import may_continue
from legoworld.agents.stop import Stop
from legoworld.agents.trial import run_trial
from legoworld.agents.trial_plan import TrialPlan
from legoworld.agents.unfinished_trial import (
    begun_before,
    mark_finished,
    remove_finished,
    unfinished_trial,
)
from legoworld.api.listener import Listener
from legoworld.errors import LegoWorldError, UsageError, cause
from legoworld.locks import held_folder
from legoworld.records.agents import BegunTrial, Budget, Outcome, ReconstructionFile, TrialRow
from legoworld.records.base import RecordError, as_json, decode
from legoworld.records.plugin_install import PluginUsed
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.tracks.track import TrackImage
from legoworld.trajectories.folder import RECONSTRUCTION
from legoworld.workers.engines import ENGINES, EngineName, Job, machine_lost

#: A trial that says nothing of its photo is made again by the next run.
_AGAIN: Final[tuple[Outcome, ...]] = ("agent_failed",)


@dataclass(frozen=True, kw_only=True)
class TrialItem:
    """One trial to make. scenes: the folder of its run's scenes."""

    image: TrackImage
    run: int
    scenes: Path


def make_trials(
    plan: TrialPlan,
    output: Path,
    *,
    images: Sequence[TrackImage],
    repeat: int,
    workers: int,
    engine: EngineName,
    listener: Listener,
) -> list[TrialRow]:
    """Make the trials that are not made yet; a row for every one, by image and run.

    A scene folder appears whole, with its reconstruction.json, or not at all. UsageError while
    another run makes trials there: it would build the same scenes, and delete the first's.
    """
    refused = UsageError(
        f"another run makes trials in {output}",
        found="its folder is locked",
        expected="one run at a time in a folder of scenes",
        next_step="wait for the other run, end it, or pass another -o",
    )
    with held_folder(output, refused):
        top = output.resolve()  # sandboxes and agents name files from other working folders
        items = [
            TrialItem(image=image, run=run, scenes=_scenes(top, run, repeat))
            for run in range(1, repeat + 1)
            for image in images
        ]
        kept = [row for item in items if (row := _existing_row(item, plan)) is not None]
        done = {(row.run, row.image_id) for row in kept}
        todo = [item for item in items if (item.run, item.image.id) not in done]
        listener.total(len(items))
        for row in kept:
            listener.trial(row)
        job = Job(make=partial(_Trials, plan), lost_result=_lost_row)
        rows = list(kept)
        if todo:
            with closing(ENGINES[engine](job, todo, workers)) as made:
                for row in made:
                    rows.append(row)
                    listener.trial(row)
        return sorted(rows, key=lambda row: (row.run, row.image_id))


class _Trials:
    """Makes trial after trial, with one process that checks and renders what they leave."""

    def __init__(self, plan: TrialPlan) -> None:
        self._plan = plan
        self._stop = Stop()
        self._blender = BlenderProcess(Limits(memory_bytes=plan.limits.memory_bytes))

    def do(self, item: TrialItem) -> TrialRow:
        try:
            return self._run_trial(item)
        except LegoWorldError as error:
            status: Outcome = "no_photo" if error.code == "no_photo" else "failed"
            return _row(item, status, str(error))
        except OSError as error:
            return _row(item, "failed", cause(error))

    def _run_trial(self, item: TrialItem) -> TrialRow:
        target = item.scenes / item.image.scene
        stays = may_continue(self._plan, item.image)
        with unfinished_trial(item.scenes, item.image, stays=stays) as unfinished:
            self._stop.check()
            result = run_trial(self._plan, item.image, unfinished, self._blender, self._stop)
            if target.exists():  # of an agent that failed, which is tried again
                shutil.rmtree(target)
            target.parent.mkdir(parents=True, exist_ok=True)
            unfinished.scene_folder.rename(target)
            mark_finished(unfinished)
        return trial_row(result, item.run)

    def abort(self) -> None:
        self._stop.now()
        self._blender.abort()

    def close(self) -> None:
        self._blender.close()


def trial_row(result: ReconstructionFile, run: int, *, kept: bool = False) -> TrialRow:
    """The row of a trial that left its reconstruction.json."""
    return TrialRow(
        image_id=result.image_id,
        scene=result.scene,
        run=run,
        status=result.status,
        reason=result.reason,
        seconds=result.seconds,
        calls=result.calls,
        checkpoints=result.checkpoints,
        usage=result.usage,
        kept=kept,
        content=result.content,
    )


def _scenes(output: Path, run: int, repeat: int) -> Path:
    return output if repeat == 1 else output / f"run_{run}"


def _existing_row(item: TrialItem, plan: TrialPlan) -> TrialRow | None:
    """The row of a trial that is there; None for one to make.

    UsageError for a scene folder that no trial made, and for a trial of another campaign: agent,
    prompt, time limit, plugin and budget are the same for all scenes of a folder.
    """
    target = item.scenes / item.image.scene
    if not target.exists():
        begun = begun_before(item.scenes, item.image)
        if begun is not None:
            _refuse_other_campaign(begun, plan, target)
        return None
    path = target / RECONSTRUCTION
    try:
        finished = decode(ReconstructionFile, path.read_bytes())
    except (OSError, RecordError) as error:
        raise UsageError(
            f"{target} exists and was not made by a trial",
            found=cause(error),
            expected=f"a new folder of scenes, or one with a {RECONSTRUCTION} in each",
            next_step="pass another -o",
        ) from error
    _refuse_other_campaign(finished, plan, target)
    if finished.status in _AGAIN:
        return None
    remove_finished(item.scenes, item.image)
    return trial_row(finished, item.run, kept=True)


def _refuse_other_campaign(
    recorded: ReconstructionFile | BegunTrial, plan: TrialPlan, target: Path
) -> None:
    used = plan.plugin.provenance if plan.plugin else None
    theirs_used = recorded.plugin if isinstance(recorded, ReconstructionFile) else None
    # A record that has a part of a trial alone would count that part alone.
    counted = recorded.record if isinstance(recorded, BegunTrial) else plan.record
    ours = (
        plan.card.sha256, plan.work.prompt_sha256, plan.limits.time_s, used, plan.budget,
        plan.record,
    )  # fmt: skip
    theirs = (
        recorded.card_sha256, recorded.prompt_sha256, recorded.time_limit_s, theirs_used,
        recorded.budget, counted,
    )  # fmt: skip
    if ours != theirs:
        raise UsageError(
            f"{target} is of another campaign",
            found=f"{recorded.agent}, {theirs[2]:g} s, prompt {theirs[1][:8]}, "
            f"plugin {_modules(theirs_used)}, budget {_limits(recorded.budget)}"
            f"{', recorded' if counted else ''}",
            expected=f"{plan.card.name}, {ours[2]:g} s, prompt {ours[1][:8]}, "
            f"plugin {_modules(used)}, budget {_limits(plan.budget)}"
            f"{', recorded' if plan.record else ''}",
            next_step="pass another -o: an agent, its prompt and its limits are one campaign's",
        )


def _modules(used: PluginUsed | None) -> str:
    return "off" if used is None else f"{used.version} ({', '.join(used.modules)})"


def _limits(budget: Budget) -> str:
    given = {key: value for key, value in as_json(budget).items() if value is not None}
    return ", ".join(f"{key} {value}" for key, value in given.items()) or "none"


def _row(item: TrialItem, status: Outcome, reason: str) -> TrialRow:
    return TrialRow(
        image_id=item.image.id, scene=item.image.scene, run=item.run, status=status, reason=reason
    )


def _lost_row(item: TrialItem, what: str) -> TrialRow:
    return _row(item, "failed", str(machine_lost(what)))
