"""One trial: an agent, a Blender, a photo; from an empty workspace to a frozen scene folder."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from msgspec.structs import replace

from legoworld import __version__
from legoworld.agents.agent_cards import AgentCard
from legoworld.agents.agent_process import Order, run_agent
from legoworld.agents.cutting import cut_program, saving_step
from legoworld.agents.trial_plugin import PLUGIN, PluginPlan, calls_of, served_plugin
from legoworld.agents.workspaces import Commission, Workspace, make_workspace
from legoworld.conventions import SCHEMA_VERSION
from legoworld.endpoint.finalisation import finalise
from legoworld.endpoint.server import EndpointServer
from legoworld.endpoint.session import Session, Trial
from legoworld.endpoint.trial_record import TrialRecord
from legoworld.errors import LegoWorldError, one_line
from legoworld.files import write_text
from legoworld.records.agents import Finalisation, Outcome, ReconstructionFile
from legoworld.records.atif import AtifTrajectory
from legoworld.records.base import canonical, readable
from legoworld.running.freeze_run import freeze_scene
from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.folder import PROVENANCE, SceneFolder
from legoworld.tracks.track import TrackImage
from legoworld.trajectories.folder import RECONSTRUCTION, TRAJECTORY, TRIAL
from legoworld.trajectories.matching import with_calls
from legoworld.trajectories.transcripts import read_transcript, usage_of
from legoworld.workers.sandbox import Ending, Protections, SandboxLimits

_TRANSCRIPT: Final = "transcript"
_SAID_AT_END: Final = 200


class NoPhotoError(LegoWorldError):
    """The photo of an image is not below --photos."""

    code = "no_photo"
    status = "no_photo"


@dataclass(frozen=True, kw_only=True)
class TrialPlan:
    """What all trials of a run share.

    limits: of a trial's Blender and of its agent each; agent_held, blender_held: their sandboxes;
    programs: the folder `program` finds its programs in, else None; model: None for the agent's
    own; plugin: None for trials without it.
    """

    card: AgentCard
    agent_version: str | None
    work: Commission
    limits: SandboxLimits
    agent_held: Protections
    blender_held: Protections
    programs: Path | None
    model: str | None
    plugin: PluginPlan | None = None


def run_trial(
    plan: TrialPlan, image: TrackImage, made: Path, scratch: Path, blender: BlenderProcess
) -> ReconstructionFile:
    """Build one image's scene folder in `made`; its reconstruction.json, written there as well.

    scratch: an empty folder. LegoWorldError where the trial could not begin.
    """
    begun = time.monotonic()
    (scratch / "workspace").mkdir()
    time_limit_s = plan.limits.time_s
    workspace = make_workspace(plan.work, image, scratch / "workspace", time_limit_s=time_limit_s)
    if workspace is None:
        raise NoPhotoError(
            f"the photo {image.file_name} was not found",
            found=f"nothing of that name below {plan.work.photos}",
            expected="every photo of the track below --photos",
        )
    steps = _steps(plan, image, workspace)
    trial = Trial(
        workspace=workspace.folder,
        record=made / TRIAL,
        limits=plan.limits,
        held=plan.blender_held,
    )
    transcript = made / TRIAL / _TRANSCRIPT
    with (
        closing(Session(trial)) as session,
        EndpointServer(session, 0) as server,
        _plugin(plan, image, workspace, session, made) as plugin_port,
    ):
        session.start()
        (scratch / "agent").mkdir()
        order = Order(
            card=plan.card,
            workspace=workspace,
            port=server.port,
            plugin_port=plugin_port,
            steps=steps,
            model=plan.model,
            held=plan.agent_held,
            limits=plan.limits,
        )
        session.restart_clock()  # the budget is the agent's: Blender's start is not part of it
        started = time.monotonic()
        ending = run_agent(order, scratch / "agent", transcript)
        agent_seconds = time.monotonic() - started
        session.keep_last_save()
        record = session.record
    finalised = finalise(
        record,
        made,
        workspace=workspace.folder,
        limits=plan.limits,
        held=plan.blender_held,
        blender=blender,
    )
    read = read_transcript(
        transcript,
        plan.card.about.transcript.format,
        agent=plan.card.name,
        version=plan.agent_version or plan.card.about.version,
        prompt=workspace.prompt,
    )
    trajectory = with_calls(read, record.calls)
    seconds = time.monotonic() - begun
    result = _result(plan, image, ending, record, finalised, trajectory, (seconds, agent_seconds))
    if plan.plugin is not None:
        used = calls_of(made / TRIAL / PLUGIN)
        result = replace(result, plugin=plan.plugin.used, plugin_calls=used)
    _write(plan, made, result, trajectory, blender)
    return result


@contextmanager
def _plugin(
    plan: TrialPlan, image: TrackImage, workspace: Workspace, session: Session, made: Path
) -> Iterator[int | None]:
    """The port of the trial's plugin; None without it."""
    if plan.plugin is None:
        yield None
        return
    record = made / TRIAL / PLUGIN
    with served_plugin(plan.plugin, image, workspace, session, record) as host:
        yield host.port


def _steps(plan: TrialPlan, image: TrackImage, workspace: Workspace) -> str | None:
    if plan.programs is None:
        return None
    recorded = plan.programs / f"{image.scene}.steps.jsonl"
    if recorded.is_file():
        text = recorded.read_text(encoding="utf-8")
        return text.replace("{workspace}", str(workspace.folder))
    program = plan.programs / image.scene / "scene.py"
    if not program.is_file():
        raise LegoWorldError(
            "there is no program to play for this image",
            found=f"no {image.scene}/scene.py and no {image.scene}.steps.jsonl",
            expected="one of them below --programs",
        )
    steps = [*cut_program(program), saving_step(workspace.folder)]
    return "".join(canonical(step) + "\n" for step in steps)


def _result(
    plan: TrialPlan,
    image: TrackImage,
    ending: Ending,
    record: TrialRecord,
    finalised: Finalisation,
    trajectory: AtifTrajectory,
    seconds: tuple[float, float],
) -> ReconstructionFile:
    status, reason = _outcome(ending, record, finalised)
    calls = [call for call in record.calls if call.by == "agent"]
    return ReconstructionFile(
        schema_version=SCHEMA_VERSION,
        legoworld=__version__,
        image_id=image.id,
        file_name=image.file_name,
        scene=image.scene,
        agent=plan.card.name,
        agent_version=plan.agent_version,
        card_sha256=plan.card.sha256,
        model=plan.model or _model(trajectory),
        prompt_sha256=plan.work.prompt_sha256,
        status=status,
        reason=reason,
        ended=ending.over or "itself",
        exit_code=ending.code,
        time_limit_s=plan.limits.time_s,
        seconds=round(seconds[0], 3),
        agent_seconds=round(seconds[1], 3),
        calls=len(calls),
        failed_calls=sum(call.status != "success" for call in calls),
        checkpoints=len(record.checkpoints),
        usage=usage_of(trajectory),
        finalisation=finalised,
        agent_sandbox=plan.agent_held.record(),
        blender_sandbox=plan.blender_held.record(),
    )


def _outcome(ending: Ending, record: TrialRecord, finalised: Finalisation) -> tuple[Outcome, str]:
    """The status of a trial: a scene counts, however its agent ended."""
    how = f"exit code {ending.code}" if ending.over is None else f"ended at its {ending.over} limit"
    last = one_line(ending.last_output[-_SAID_AT_END:], _SAID_AT_END)
    if finalised.source != "none":
        return "ok", "" if ending.code == 0 else f"the agent: {how}"
    if not record.calls and ending.over is None and ending.code != 0:
        return "agent_failed", f"it called Blender never and ended with {how}; {last}"
    if not record.checkpoints:
        return "no_scene", f"no call changed the scene; the agent: {how}"
    return "no_scene", f"no scene could be exported: {'; '.join(finalised.refused)}"


def _model(trajectory: AtifTrajectory) -> str | None:
    name = trajectory.agent.model_name
    return name if isinstance(name, str) else None


def _write(
    plan: TrialPlan,
    made: Path,
    result: ReconstructionFile,
    trajectory: AtifTrajectory,
    blender: BlenderProcess,
) -> None:
    """The files of a scene folder that say how it came to be; frozen last."""
    write_text(made / TRAJECTORY, readable(trajectory))
    provenance = {
        "agent": result.agent,
        "agent_version": result.agent_version,
        "model": result.model,
        "plugin": result.plugin,
        "prompt_sha256": result.prompt_sha256,
        "task": plan.work.task,
        "vocabulary_sha256": plan.work.vocabulary_sha256,
        "camera_given": _camera_given(plan.work.entries[result.image_id].get("hfov_deg")),
        "metric_feedback": False,
        "limits": {"time_s": result.time_limit_s, "memory_bytes": plan.limits.memory_bytes},
        "ended": result.ended,
        "usage": result.usage,
        "finalisation": result.finalisation.source,
    }
    write_text(made / PROVENANCE, readable(provenance))
    write_text(made / RECONSTRUCTION, readable(result))
    if result.finalisation.source != "none":
        freeze_scene(SceneFolder(path=made, name=result.scene), blender=blender, cache=None)


def _camera_given(hfov_deg: object) -> dict[str, object] | None:
    return None if hfov_deg is None else {"hfov_deg": hfov_deg}
