"""One trial: an agent, a Blender, a photo; from an empty workspace to a frozen scene folder."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Final

from legoworld.agents.agent_cards import AgentCard
from legoworld.agents.agent_process import Order, output_name, run_agent
from legoworld.agents.budget import BudgetWatch, read_usage, recorded_so_far
from legoworld.agents.recorded_card import sent_to
from legoworld.agents.recorded_steps import encode_steps, remaining_steps
from legoworld.agents.stop import Stop
from legoworld.agents.trial_plan import TrialPlan
from legoworld.agents.trial_plugin import PLUGIN, served_plugin
from legoworld.agents.trial_result import REQUESTS, TrialOutcome, write_result
from legoworld.agents.unfinished_trial import UnfinishedTrial, identity
from legoworld.agents.workspaces import Workspace, make_workspace, plan_workspace
from legoworld.endpoint.finalisation import finalise
from legoworld.endpoint.server import EndpointServer
from legoworld.endpoint.session import Session, Trial
from legoworld.endpoint.trial_record import TrialRecord, read_rows
from legoworld.errors import LegoWorldError
from legoworld.records.agents import (
    ApiRequest,
    EndedAgent,
    ReconstructionFile,
    RecordedStep,
    Usage,
)
from legoworld.records.atif import AtifTrajectory
from legoworld.scene.blender_process import BlenderProcess
from legoworld.track_making.make_track import find_photo
from legoworld.tracks.track import TrackImage
from legoworld.trajectories.call_steps import add_calls
from legoworld.trajectories.folder import TRIAL
from legoworld.trajectories.transcripts import join_trajectories, read_transcript

_KEPT_OUTPUT: Final = 4096


class NoPhotoError(LegoWorldError):
    """The photo of an image is not below --photos."""

    code = "no_photo"
    status = "no_photo"


def run_trial(
    plan: TrialPlan,
    image: TrackImage,
    trial: UnfinishedTrial,
    blender: BlenderProcess,
    stop: Stop,
) -> ReconstructionFile:
    """Build one image's scene folder in `unfinished.scene_folder`, or continue a killed trial.

    LegoWorldError where the trial cannot begin, and where it is stopped.
    """
    begun = time.monotonic()
    workspace, parts = _open_workspace(plan, image, trial)
    ended, record = trial.read_ended(), TrialRecord(trial.scene_folder / TRIAL)
    if ended is None:
        ended, record = _agent_part(plan, image, trial, workspace, len(parts) > 1, stop)
        stop.check()
        trial.note_ended(ended)
    finalised = finalise(
        record,
        trial.scene_folder,
        workspace=workspace.folder,
        limits=plan.limits,
        protections=plan.blender_held,
        blender=blender,
    )
    outcome = TrialOutcome(
        ended_agent=ended,
        record=record,
        finalisation=finalised,
        trajectory=_trajectory(plan, trial, workspace, record, parts),
        seconds=time.monotonic() - begun,
        continued=len(parts) - 1,
    )
    stop.check()
    return write_result(plan, image, trial.scene_folder, outcome, blender)


def _open_workspace(
    plan: TrialPlan, image: TrackImage, trial: UnfinishedTrial
) -> tuple[Workspace, tuple[int, ...]]:
    """The new or resumed workspace, and the numbers of the trial's parts, this one last."""
    before, limit_s = trial.read_begun(), plan.limits.time_s
    if before is None or not trial.scene_folder.is_dir():
        trial.clear()
        made = make_workspace(plan.work, image, trial.workspace, time_limit_s=limit_s)
        if made is None:
            raise _no_photo(plan, image)
        trial.note_begun(identity(plan, image, (0,)))
        return made, (0,)
    trial.keep_trial_alone()
    parts = before.parts
    if trial.read_ended() is None:
        trial.put_part_aside(output_name(plan.card))
        parts = (*parts, len(TrialRecord(trial.scene_folder / TRIAL).calls))
        trial.note_begun(identity(plan, image, parts))
    workspace = plan_workspace(plan.work, image, trial.workspace, time_limit_s=limit_s)
    if workspace is None:
        raise _no_photo(plan, image)
    return workspace, parts


def _no_photo(plan: TrialPlan, image: TrackImage) -> NoPhotoError:
    return NoPhotoError(
        f"the photo {image.file_name} was not found",
        found=f"nothing of that name below {plan.work.photos}",
        expected="every photo of the track below --photos",
    )


def _agent_part(
    plan: TrialPlan,
    image: TrackImage,
    unfinished_trial: UnfinishedTrial,
    workspace: Workspace,
    continues: bool,
    stop: Stop,
) -> tuple[EndedAgent, TrialRecord]:
    """Run the agent for the rest of the trial's time; return how it ended and its output."""
    steps: list[RecordedStep] | None = None
    trial = Trial(
        workspace=workspace.folder,
        record=unfinished_trial.scene_folder / TRIAL,
        limits=plan.limits,
        protections=plan.blender_held,
        lease=unfinished_trial.lease,
        calls=plan.budget.calls,
    )
    with (
        closing(Session(trial)) as session,
        EndpointServer(session, 0) as server,
        _plugin(plan, image, session, unfinished_trial.scene_folder) as plugin_port,
    ):
        record = session.record
        record.drop_unanswered()
        steps = remaining_steps(plan, image, workspace, record.calls)
        used_s = max((call.at_s + call.seconds for call in record.calls), default=0.0)
        left_s = plan.limits.time_s - used_s
        if left_s <= 0:
            return EndedAgent(code=None, over="time", last_output="", seconds=used_s), record
        session.start()
        unfinished_trial.agent.mkdir()
        watch = BudgetWatch(
            plan.budget,
            refused=lambda: session.over_calls,
            usage=lambda: _usage_so_far(plan, unfinished_trial),
        )
        session.restart_clock(used_s)  # Blender's start is not in the agent's budget
        started = time.monotonic()
        with _recorder_card(plan, unfinished_trial, used_s) as card:
            order = Order(
                card=card,
                workspace=workspace,
                port=server.port,
                plugin_port=plugin_port,
                steps=None if steps is None else encode_steps(steps),
                model=plan.model,
                protections=plan.agent_held,
                limits=replace(plan.limits, time_s=left_s),
                continues=continues,
                trial=unfinished_trial,
                watch=watch,
            )
            ending = run_agent(order, stop)
        seconds = used_s + time.monotonic() - started
        session.keep_last_save()
    said, over = ending.last_output[-_KEPT_OUTPUT:], ending.over or watch.over
    code = None if watch.over else ending.code
    return EndedAgent(code=code, over=over, last_output=said, seconds=seconds), record


def _usage_so_far(plan: TrialPlan, trial: UnfinishedTrial) -> Usage:
    """What the agent has used, by its recorded requests or its transcript, as far as there are."""
    trial.take_transcript(output_name(plan.card))
    kind = plan.card.about.transcript.format
    stated = read_usage(trial.transcripts(), kind, plan.model, plan.prices)
    if not plan.record:
        return stated
    rows = read_rows(trial.scene_folder / TRIAL / REQUESTS, ApiRequest)
    return recorded_so_far(rows, stated, plan.prices)


@contextmanager
def _plugin(
    plan: TrialPlan, image: TrackImage, session: Session, made: Path
) -> Iterator[int | None]:
    """The port of the trial's plugin; None without it."""
    if plan.plugin is None:
        yield None
        return
    record, photo = made / TRIAL / PLUGIN, find_photo(plan.work.photos, image)
    if photo is None:
        raise _no_photo(plan, image)
    with served_plugin(plan.plugin, image, photo, session, record) as host:
        yield host.port


@contextmanager
def _recorder_card(plan: TrialPlan, trial: UnfinishedTrial, used_s: float) -> Iterator[AgentCard]:
    """The card whose agent is sent to the trial's recorder; as it is without one."""
    api = plan.card.about.record
    if not plan.record or api is None:
        yield plan.card
        return
    from legoworld.agents.api_recorder import ApiRecorder  # an extra

    rows = trial.scene_folder / TRIAL / REQUESTS
    with ApiRecorder(api.api, rows, used_s=used_s) as recorder:
        yield sent_to(plan.card, recorder.url)


def _trajectory(
    plan: TrialPlan,
    trial: UnfinishedTrial,
    workspace: Workspace,
    record: TrialRecord,
    parts: tuple[int, ...],
) -> AtifTrajectory:
    """The transcripts of the agent's parts as one document, with the calls that its steps made."""
    read = []
    bounds = itertools.pairwise((*parts, len(record.calls)))
    for path, (begin, end) in zip(trial.transcripts(), bounds, strict=True):
        part = read_transcript(
            path,
            plan.card.about.transcript.format,
            agent=plan.card.name,
            version=plan.agent_version or plan.card.about.version,
            prompt=workspace.prompt,
            scene_folder=trial.scene_folder,
        )
        read.append(add_calls(part, record.calls[begin:end]))
    return join_trajectories(read)
