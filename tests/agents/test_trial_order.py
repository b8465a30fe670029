"""One trial from its workspace to its result, begun and continued; agent and Blender stand in."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest
from msgspec.structs import replace as with_fields

from legoworld.agents import trial
from legoworld.agents.stop import Stop, TrialStoppedError
from legoworld.agents.trial import NoPhotoError, run_trial
from legoworld.agents.unfinished_trial import UnfinishedTrial
from legoworld.agents.workspaces import Workspace
from legoworld.endpoint.trial_record import TrialRecord
from legoworld.records.agents import BegunTrial, Budget, EndedAgent
from legoworld.records.endpoint import Call
from legoworld.trajectories.folder import TRIAL
from legoworld.workers.sandbox import SandboxLimits

IMAGE = SimpleNamespace(id=7, scene="room", file_name="room.jpg")
BEGUN = BegunTrial(
    scene="room", agent="own", card_sha256="c", prompt_sha256="p", time_limit_s=100.0, parts=(0,)
)


def call(number, at_s):
    return Call(
        number=number, command="execute_code", code=None, at_s=at_s, seconds=10.0,
        status="success", said="", checkpoint=None,
    )  # fmt: skip


class Trial:
    """What each part of a trial was given, and what they answer."""

    def __init__(self, folder: Path, monkeypatch):
        self.unfinished = UnfinishedTrial(folder=folder, stays=True, lease=9)
        self.log, self.photo, self.calls = [], True, 2
        about = SimpleNamespace(
            transcript=SimpleNamespace(format="codex", path=None), version="1.0", record=None
        )
        self.plan = SimpleNamespace(
            card=SimpleNamespace(name="own", sha256="c", about=about), agent_version=None,
            work=SimpleNamespace(prompt_sha256="p", photos=Path("photos")), model="m",
            limits=SandboxLimits(time_s=100.0, memory_bytes=5), agent_held="agent's",
            blender_held="blender's", programs=None, plugin=None, prices=None, budget=Budget(),
            record=False,
        )  # fmt: skip
        self.stop = Stop()
        for name in (
            "make_workspace", "plan_workspace", "finalise", "read_transcript", "add_calls",
            "join_trajectories", "write_result", "remaining_steps", "Session", "EndpointServer",
            "run_agent", "find_photo", "served_plugin",
        ):  # fmt: skip
            monkeypatch.setattr(trial, name, getattr(self, name))

    def run(self):
        return run_trial(self.plan, IMAGE, self.unfinished, "the blender", self.stop)

    def said(self, name):
        return [words for what, *words in self.log if what == name]

    def make_workspace(self, work, image, folder, *, time_limit_s):
        self.log.append(("make", work, image, folder, time_limit_s))
        return Workspace(folder=folder, image=folder / "i", prompt="do") if self.photo else None

    def plan_workspace(self, work, image, folder, *, time_limit_s):
        self.log.append(("of", work, image, folder, time_limit_s))
        return Workspace(folder=folder, image=folder / "i", prompt="do") if self.photo else None

    def Session(self, settings):  # noqa: N802
        self.log.append(("session", settings))
        record = TrialRecord(settings.record)
        log = self.log
        return SimpleNamespace(
            record=record,
            start=lambda: log.append(("start",)),
            restart_clock=lambda used: log.append(("clock", used)),
            keep_last_save=lambda: log.append(("keep",)),
            close=lambda: log.append(("close",)),
        )

    @contextmanager
    def EndpointServer(self, session, port):  # noqa: N802
        assert port == 0
        self.record = session.record
        yield SimpleNamespace(port=4321)

    def remaining_steps(self, plan, image, workspace, calls):
        self.log.append(("steps", plan, image, workspace.folder, len(calls)))

    def run_agent(self, order, stop):
        self.log.append(("agent", order, stop))
        for number in range(self.calls):
            self.record.note(call(len(self.record.calls) + 1, 20.0 * number))
        return SimpleNamespace(code=3, over="disk", last_output="a" * 5000 + "z")

    def finalise(self, record, made, **how):
        self.log.append(("finalise", record.folder, len(record.calls), made, how))
        return "finalised"

    def read_transcript(self, path, kind, **how):
        self.log.append(("transcript", path.name, kind, how))
        return path.name

    def add_calls(self, part, calls):
        return part, [c.number for c in calls]

    def join_trajectories(self, parts):
        return parts

    def write_result(self, plan, image, made, outcome, blender):
        self.log.append(("result", plan, image, made, blender))
        return outcome

    def find_photo(self, photos, image):
        return photos / image.file_name if self.photo else None

    @contextmanager
    def served_plugin(self, plugin, image, photo, _session, record):
        self.log.append(("plugin", plugin, image, photo, record))
        yield SimpleNamespace(port=8765)


@pytest.fixture
def made(tmp_path, monkeypatch):
    (tmp_path / "trial").mkdir()
    return Trial(tmp_path / "trial", monkeypatch)


def test_a_trial_is_begun_run_finalised_and_told(made):
    outcome = made.run()
    here = made.unfinished
    assert made.said("make") == [[made.plan.work, IMAGE, here.workspace, 100.0]]
    assert here.read_begun() == BEGUN
    ((settings,),) = made.said("session")
    assert (settings.workspace, settings.record) == (here.workspace, here.scene_folder / TRIAL)
    assert (settings.limits, settings.protections, settings.lease) == (
        made.plan.limits,
        "blender's",
        9,
    )
    assert made.said("steps") == [[made.plan, IMAGE, here.workspace, 0]]
    ((order, stop),) = made.said("agent")
    assert stop is made.stop
    assert (order.card, order.model, order.protections) == (made.plan.card, "m", "agent's")
    assert (order.port, order.plugin_port, order.steps) == (4321, None, None)
    assert (order.limits.time_s, order.limits.memory_bytes) == (100.0, 5)
    assert (order.continues, order.trial) == (False, here)
    assert order.workspace.prompt == "do"
    names = [what for what, *_ in made.log]
    assert names == [
        "make", "session", "steps", "start", "clock", "agent", "keep", "close", "finalise",
        "transcript", "result",
    ]  # fmt: skip
    assert made.said("clock") == [[0.0]]
    how = {"workspace": here.workspace, "limits": made.plan.limits, "protections": "blender's",
           "blender": "the blender"}  # fmt: skip
    assert made.said("finalise") == [[here.scene_folder / TRIAL, 2, here.scene_folder, how]]
    about = {"agent": "own", "version": "1.0", "prompt": "do", "scene_folder": here.scene_folder}
    assert made.said("transcript") == [["transcript", "codex", about]]
    assert made.said("result") == [[made.plan, IMAGE, here.scene_folder, "the blender"]]
    ended = outcome.ended_agent
    assert (ended.code, ended.over, ended.last_output) == (3, "disk", "a" * 4095 + "z")
    assert 0 <= ended.seconds < 60
    assert here.read_ended() == ended
    assert (outcome.finalisation, outcome.continued) == ("finalised", 0)
    assert outcome.trajectory == [("transcript", [1, 2])]
    assert 0 <= outcome.seconds < 60


def test_a_killed_agent_continues_in_what_is_left_of_its_time(made):
    made.run()
    here = made.unfinished
    (here.folder / "ended.json").unlink()
    (here.scene_folder / "scene.blend").write_text("half made")
    made.log.clear()
    made.plan.agent_version = "2.0"
    outcome = made.run()
    assert made.said("make") == []
    assert made.said("of") == [[made.plan.work, IMAGE, here.workspace, 100.0]]
    assert here.read_begun() == with_fields(BEGUN, parts=(0, 2))
    assert not (here.scene_folder / "scene.blend").exists()
    assert made.said("steps")[0][-1] == 2
    ((order, _),) = made.said("agent")
    assert (order.continues, order.limits.time_s) == (True, 70.0)
    assert made.said("clock") == [[30.0]]
    assert 30 <= outcome.ended_agent.seconds < 90
    assert outcome.continued == 1
    assert [name for name, *_ in made.said("transcript")] == ["transcript-1", "transcript"]
    assert made.said("transcript")[0][2]["version"] == "2.0"
    assert outcome.trajectory == [("transcript-1", [1, 2]), ("transcript", [3, 4])]


def test_an_agent_that_has_ended_is_finalised_again_alone(made):
    first = made.run()
    made.log.clear()
    outcome = made.run()
    assert [what for what, *_ in made.log] == ["of", "finalise", "transcript", "result"]
    assert (outcome.ended_agent, outcome.continued) == (first.ended_agent, 0)
    assert len(outcome.record.calls) == 2


def test_without_time_left_the_agent_is_not_started_again(made):
    made.calls = 6
    made.run()
    (made.unfinished.folder / "ended.json").unlink()
    made.log.clear()
    outcome = made.run()
    assert made.said("agent") == made.said("start") == []
    assert outcome.ended_agent == EndedAgent(code=None, over="time", last_output="", seconds=110.0)


def test_the_plugin_s_port_is_the_agent_s_and_it_has_the_track_s_photo(made):
    made.plan.plugin = "the plugin"
    made.run()
    record = made.unfinished.scene_folder / TRIAL / "plugin"
    assert made.said("plugin") == [["the plugin", IMAGE, Path("photos/room.jpg"), record]]
    assert made.said("agent")[0][0].plugin_port == 8765


def test_without_its_photo_a_trial_does_not_begin(made):
    made.photo = False
    with pytest.raises(NoPhotoError) as refused:
        made.run()
    assert "the photo room.jpg was not found" in str(refused.value)
    assert "nothing of that name below photos" in str(refused.value)
    assert made.unfinished.read_begun() is None
    made.photo = True
    made.run()
    (made.unfinished.folder / "ended.json").unlink()
    made.photo = False
    with pytest.raises(NoPhotoError):
        made.run()


def test_a_run_that_is_stopped_leaves_what_a_later_one_continues(made):
    made.stop.now()
    with pytest.raises(TrialStoppedError):
        made.run()
    assert made.unfinished.read_begun() == BEGUN
    assert made.unfinished.read_ended() is None
    assert made.said("finalise") == []


def test_a_run_that_is_stopped_while_it_finalises_writes_no_scene(made, monkeypatch):
    monkeypatch.setattr(trial, "finalise", lambda *_, **__: made.stop.now())
    with pytest.raises(TrialStoppedError):
        made.run()
    assert made.unfinished.read_ended() is not None
    assert made.said("result") == []
