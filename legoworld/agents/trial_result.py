"""What a trial was, in its scene folder's files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from msgspec.structs import replace

from legoworld.agents.budget import unheld
from legoworld.agents.prices import compute_usage, recorded_usage, with_usage
from legoworld.agents.scene_content import scene_content
from legoworld.agents.trial_plan import TrialPlan
from legoworld.agents.trial_plugin import PLUGIN, read_plugin_calls
from legoworld.conventions import SCHEMA_VERSION
from legoworld.endpoint.trial_record import TrialRecord, read_rows
from legoworld.errors import one_line
from legoworld.files import Json, write_text
from legoworld.records.agents import (
    ApiRequest,
    EndedAgent,
    Finalisation,
    Outcome,
    ReconstructionFile,
)
from legoworld.records.atif import AtifFinalMetrics, AtifTrajectory
from legoworld.records.base import Storable, readable
from legoworld.running.freeze_run import freeze_scene
from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.folder import PROVENANCE, SceneFolder
from legoworld.tracks.track import TrackImage
from legoworld.trajectories.folder import RECONSTRUCTION, TRAJECTORY, TRIAL
from legoworld.version import __version__

REQUESTS: Final = "requests.jsonl"
_SAID_AT_END: Final = 200


@dataclass(frozen=True, kw_only=True)
class TrialOutcome:
    """The outcome of a trial. seconds: wall time of this part; continued: after how many kills."""

    ended_agent: EndedAgent
    record: TrialRecord
    finalisation: Finalisation
    trajectory: AtifTrajectory
    seconds: float
    continued: int


def write_result(
    plan: TrialPlan, image: TrackImage, made: Path, outcome: TrialOutcome, blender: BlenderProcess
) -> ReconstructionFile:
    """Write the provenance files of a scene folder, then freeze it."""
    requests = read_rows(made / TRIAL / REQUESTS, ApiRequest) if plan.record else None
    result = _result(plan, image, outcome, requests)
    if plan.plugin is not None:
        calls = read_plugin_calls(made / TRIAL / PLUGIN)
        result = replace(result, plugin=plan.plugin.provenance, plugin_calls=calls)
    write_text(made / TRAJECTORY, readable(with_usage(outcome.trajectory, result.usage)))
    write_text(made / PROVENANCE, readable(_provenance(plan, result)))
    if result.finalisation.source != "none":
        folder = SceneFolder(path=made, name=result.scene)
        freeze_scene(folder, blender=blender, cache=None)
        result = replace(result, content=scene_content(folder, plan.work.protocol, blender))
    write_text(made / RECONSTRUCTION, readable(result))
    return result


def _result(
    plan: TrialPlan,
    image: TrackImage,
    outcome: TrialOutcome,
    requests: Sequence[ApiRequest] | None,
) -> ReconstructionFile:
    ended, record, trajectory = outcome.ended_agent, outcome.record, outcome.trajectory
    status, reason = _status(outcome, requests)
    models = Counter(r.model for r in requests or () if r.model is not None)
    model = _model(trajectory) or plan.model or next(iter(dict(models.most_common(1))), None)
    usage = compute_usage(trajectory, model, plan.prices)
    if requests is not None:
        usage = recorded_usage(requests, plan.prices, usage)
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
        model=model,
        prompt_sha256=plan.work.prompt_sha256,
        status=status,
        reason=reason,
        ended=ended.over or "itself",
        exit_code=ended.code,
        time_limit_s=plan.limits.time_s,
        budget=plan.budget,
        seconds=round(outcome.seconds, 3),
        agent_seconds=round(ended.seconds, 3),
        calls=len(calls),
        failed_calls=sum(call.status != "success" for call in calls),
        checkpoints=len(record.checkpoints),
        usage=usage,
        finalisation=outcome.finalisation,
        agent_sandbox=plan.agent_held.record(),
        blender_sandbox=plan.blender_held.record(),
        continued=outcome.continued,
        warnings=unheld(plan.budget, usage),
    )


def _status(outcome: TrialOutcome, requests: Sequence[ApiRequest] | None) -> tuple[Outcome, str]:
    """The status of a trial: a scene counts, however its agent ended."""
    ending, record, finalised = outcome.ended_agent, outcome.record, outcome.finalisation
    how = f"exit code {ending.code}" if ending.over is None else f"ended at its {ending.over} limit"
    last = one_line(ending.last_output[-_SAID_AT_END:], _SAID_AT_END)
    if finalised.source != "none":
        return "ok", "" if ending.code == 0 else f"the agent: {how}"
    if not record.calls and ending.over is None and ending.code != 0:
        return "agent_failed", f"it called Blender never and ended with {how}; {last}"
    failed = ending.over is not None or ending.code != 0
    if failed and not _model_answered(outcome.trajectory, requests):
        return "agent_failed", f"its model never answered: {how}; {last}"
    if not record.checkpoints:
        return "no_scene", f"no call changed the scene; the agent: {how}"
    return "no_scene", f"no scene could be exported: {'; '.join(finalised.refused)}"


def _model_answered(trajectory: AtifTrajectory, requests: Sequence[ApiRequest] | None) -> bool:
    """Whether a request was answered; else a step of the transcript cost tokens, or may have."""
    if requests is not None:
        return any(row.prompt_tokens is not None for row in requests)
    totals = trajectory.final_metrics
    free = isinstance(totals, AtifFinalMetrics) and totals.total_completion_tokens == 0
    return not free and any(step.source == "agent" for step in trajectory.steps)


def _model(trajectory: AtifTrajectory) -> str | None:
    name = trajectory.agent.model_name
    return name if isinstance(name, str) else None


def _provenance(plan: TrialPlan, result: ReconstructionFile) -> dict[str, Storable]:
    return {
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
        "continued": result.continued,
    }


def _camera_given(hfov_deg: Json) -> dict[str, Json] | None:
    return None if hfov_deg is None else {"hfov_deg": hfov_deg}
