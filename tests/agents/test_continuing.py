"""A run killed at any moment: the same command continues the trial that was half built."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Literal

import pytest
from agents.tracks import SMALL, make_track, plan, run, server_or_skip, steps_file

from legoworld import cli
from legoworld.agents import trial, unfinished_trial
from legoworld.agents.recorded_steps import steps_left
from legoworld.agents.workspaces import make_workspace
from legoworld.endpoint.session import Session
from legoworld.endpoint.trial_record import TrialRecord
from legoworld.errors import UsageError
from legoworld.records.agents import RecordedStep
from legoworld.records.endpoint import Call
from legoworld.trajectories.folder import TRIAL, RecordedTrial, read_trial
from legoworld.workers.sandbox import Ending

ROOT = Path(__file__).parents[2]
WITHIN_S = 300
#: Each step leaves an object of its name, and says all there are.
ADD = f"""import bpy, os, time
{SMALL}
"""
ADD += """\
bpy.context.scene.collection.objects.link(bpy.data.objects.new("step {n}", None))
print(*sorted(o.name for o in bpy.data.objects if o.name.startswith("step")), sep=", ")
"""
#: The first time that it is run, it leaves a mark and does not come back.
HANGS_ONCE = """if not os.path.exists("mark"):
    open("mark", "w").close()
    time.sleep(1000)
"""
SAVE = "bpy.ops.wm.save_as_mainfile(filepath=os.getcwd() + '/scene.blend')\n"
#: An agent that continues from what it kept below its home, and waits after its second call.
AGENT = """
import json, os, pathlib, socket, sys, time
config, home = sys.argv[1:]
env = json.load(open(config))["mcpServers"]["blender"]["env"]
line = socket.create_connection(("127.0.0.1", int(env["BLENDER_PORT"])))
kept = pathlib.Path(home, "memory/of/it/done")
done = int(kept.read_text()) if kept.exists() else 0
plan = pathlib.Path("plan.md")
if plan.exists():
    print(json.dumps({"type": "message", "role": "assistant", "content": plan.read_text()}))
plan.write_text("plan: walls, then chairs")
for n, code in enumerate(json.loads(os.environ["STEPS"])[done:], start=done + 1):
    line.sendall(json.dumps({"type": "execute_code", "params": {"code": code}}).encode())
    said = line.recv(1 << 16).decode()
    kept.write_text(str(n))
    said = "call %d: %s" % (n, said)
    print(json.dumps({"type": "message", "role": "assistant", "content": said}))
    sys.stdout.flush()
    if n == 2:
        open("mark", "w").close()
        time.sleep(1000)
"""
CARD = """name = "waiting"
title = "An agent of the tests"
version = "1"
documentation = "none"
run = true
checked = "by this test"
command = [{python}, "-c", {script}, "{{mcp_config}}", "{{home}}"]
continue_command = [{python}, "-c", {script}, "{{mcp_config}}", "{{home}}"]
session_folders = ["memory/of/it"]
resume = "continue"
network = true
time_limit_s = 600.0

[mcp]
format = "mcp_servers"
path = "{{home}}/mcp.json"

[transcript]
format = "gemini"

[needs]
install = "nothing"

[variables]
STEPS = {steps}
"""


def command(folder: Path, agent: str) -> list[str]:
    programs = ["--programs", str(folder / "programs")] if agent == "program" else []
    return [
        *(sys.executable, "-m", "legoworld", "reconstruct", str(folder / "track.json")),
        *("--photos", str(folder / "photos"), "--agent", agent, "--task", "bench", *programs),
        *("-o", str(folder / "scenes")),
    ]


def killed_at(folder: Path, agent: str, event: Path) -> None:
    """Run the command until a file is there, and kill it."""
    run = subprocess.Popen(command(folder, agent), cwd=ROOT, start_new_session=True)
    end = time.monotonic() + WITHIN_S
    while not event.exists():
        assert run.poll() is None, "it ended before it could be killed"
        assert time.monotonic() < end
        time.sleep(0.01)
    run.send_signal(signal.SIGKILL)
    run.wait()


def finish_trial(folder: Path, agent: str) -> RecordedTrial:
    """Run the same command to its end; the trial it left."""
    done = subprocess.run(
        command(folder, agent), cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert [path.name for path in (folder / "scenes").iterdir()] == ["room"]
    return read_trial(folder / "scenes" / "room")


def codes(*, hangs: int = 0, last: int = 4) -> list[str]:
    """Steps of code; the last one saves."""
    return [
        ADD.format(n=n) + HANGS_ONCE * (n == hangs) + SAVE * (n == last) for n in range(1, last + 1)
    ]


def said_last(trial: RecordedTrial) -> str:
    return trial.calls[-1].said.partition(" Info")[0]


@pytest.fixture
def track(tmp_path: Path) -> Path:
    server_or_skip()
    make_track(tmp_path, ["room"], task="bench")
    return tmp_path


@pytest.mark.blender
def test_killed_in_a_call_that_call_is_made_again_and_none_before_it(track: Path):
    steps_file(track / "programs" / "room.steps.jsonl", codes(hangs=3))
    killed_at(track, "program", track / "scenes" / ".unfinished-1" / "workspace" / "mark")
    trial = finish_trial(track, "program")
    assert trial.about.continued == 1
    assert said_last(trial) == "step 1, step 2, step 3, step 4"
    assert [call.code for call in trial.calls if call.code] == codes(hangs=3)
    assert [call.number for call in trial.calls] == list(range(1, len(trial.calls) + 1))
    times = [call.at_s for call in trial.calls]
    assert times == sorted(times)
    assert trial.about.agent_seconds >= times[-1]
    # The killed part may have seen its call fail, and the next; their steps made no call.
    made = [s for s in trial.trajectory.steps if s.extra and "legoworld" in s.extra]
    played = [call.arguments["code"] for s in made for call in (s.tool_calls or [])]
    assert played == codes(hangs=3)
    assert any("part 2 begins" in str(step.message) for step in trial.trajectory.steps)


@pytest.mark.blender
def test_folders_may_be_named_from_where_the_command_is_run(track: Path, monkeypatch):
    steps_file(track / "programs" / "room.steps.jsonl", codes(last=1))
    monkeypatch.chdir(track)
    words = ["reconstruct", "track.json", "--photos", "photos", "--agent", "program"]
    words += ["--task", "bench", "--programs", "programs", "-o", "scenes", "-q"]
    assert cli.run(words) == 0
    assert read_trial(Path("scenes") / "room").about.status == "ok"


@pytest.mark.blender
def test_killed_while_it_is_finalised_no_call_is_made_again(track: Path):
    """Should the kill be too late, the trial is there already, and is the same."""
    steps_file(track / "programs" / "room.steps.jsonl", codes(last=2))
    killed_at(track, "program", track / "scenes" / ".unfinished-1" / "ended.json")
    trial = finish_trial(track, "program")
    assert trial.about.continued == 0
    assert [call.code for call in trial.calls if call.code] == codes(last=2)
    assert trial.about.finalisation.source == "saved"
    assert (trial.folder / "frozen.json").is_file()


@pytest.mark.blender
def test_killed_between_calls_an_agent_continues_from_what_it_kept(track: Path):
    script, steps = json.dumps(AGENT.replace("{", "{{").replace("}", "}}")), json.dumps(codes())
    card = track / "waiting.toml"
    steps = json.dumps(steps.replace("{", "{{").replace("}", "}}"))
    card.write_text(CARD.format(python=json.dumps(sys.executable), script=script, steps=steps))
    killed_at(track, str(card), track / "scenes" / ".unfinished-1" / "workspace" / "mark")
    trial = finish_trial(track, str(card))
    assert trial.about.continued == 1
    assert said_last(trial) == "step 1, step 2, step 3, step 4"
    assert [call.code for call in trial.calls if call.code] == codes()
    said = [str(s.message) for s in trial.trajectory.steps if s.source == "agent"]
    calls = [f"call {n}" for n in range(1, 5)]
    assert [text.partition(":")[0] for text in said] == [*calls[:2], "plan", *calls[2:]]
    assert "plan: walls, then chairs" in said, "what it wrote into its workspace is there still"
    assert (trial.folder / "trial" / "transcript-1").is_file()


def test_a_half_built_trial_of_another_campaign_is_not_taken_up(track: Path):
    steps_file(track / "programs" / "room.steps.jsonl", codes(last=1))
    made = plan(track)
    (image,) = made.work.track.images
    with unfinished_trial.unfinished_trial(track / "scenes", image, stays=True) as begun:
        begun.note_begun(unfinished_trial.identity(plan(track, time_limit_s=61.0), image, (0,)))
    with pytest.raises(UsageError, match="another campaign"):
        run(made, track / "scenes")
    assert unfinished_trial.begun_before(track / "scenes", image) is not None


def test_a_trial_is_built_by_one_run_at_a_time(track: Path, monkeypatch):
    steps_file(track / "programs" / "room.steps.jsonl", codes(last=1))
    made = plan(track)
    monkeypatch.setattr(unfinished_trial, "_FREE_WITHIN_S", 0.2)
    (image,) = made.work.track.images
    with unfinished_trial.unfinished_trial(track / "scenes", image, stays=True):
        (row,) = run(made, track / "scenes")
    assert row.status == "failed"
    assert "another run builds room" in row.reason
    assert list((track / "scenes").iterdir()) == []


def test_a_trial_whose_run_is_just_ending_is_waited_for(track: Path, monkeypatch):
    free = iter([False, False, True])
    monkeypatch.setattr(unfinished_trial, "take", lambda *_, **__: next(free))
    monkeypatch.setattr(unfinished_trial, "_LOOK_EVERY_S", 0.0)
    (image,) = plan(track).work.track.images
    with unfinished_trial.unfinished_trial(track / "scenes", image, stays=True):
        pass
    assert list(free) == []


@pytest.mark.parametrize(("used_s", "left_s"), [(100, [200.0]), (300, [])])
def test_a_continued_trial_has_what_is_left_of_its_time(track: Path, monkeypatch, used_s, left_s):
    steps_file(track / "programs" / "room.steps.jsonl", codes(last=1))
    made, orders = plan(track), []
    (image,) = made.work.track.images
    with unfinished_trial.unfinished_trial(track / "scenes", image, stays=True) as begun:
        begun.clear()
        make_workspace(made.work, image, begun.workspace, time_limit_s=300.0)
        begun.note_begun(unfinished_trial.identity(made, image, (0,)))
        TrialRecord(begun.scene_folder / TRIAL).note(call(used_s - 1, None))

    def run_agent(order, _stop):
        orders.append(order)
        return Ending(code=0, over=None, first_output="", last_output="")

    monkeypatch.setattr(trial, "run_agent", run_agent)
    monkeypatch.setattr(Session, "start", lambda _: None)
    (row,) = run(made, track / "scenes")
    assert row.status == ("no_scene" if left_s else "agent_failed")
    assert [order.limits.time_s for order in orders] == left_s
    about = read_trial(track / "scenes" / "room").about
    assert (about.ended, about.continued) == ("itself" if left_s else "time", 1)
    assert about.agent_seconds >= used_s


def call(
    number: int,
    code: str | None,
    status: Literal["success", "error"] = "success",
    by: Literal["agent", "plugin"] = "agent",
) -> Call:
    return Call(
        number=number, command="execute_code", code=code, at_s=number, seconds=1, said="",
        status=status, checkpoint=None, by=by,
    )  # fmt: skip


def step(code: str | None, *, must: bool = False) -> RecordedStep:
    given = {} if code is None else {"code": code}
    return RecordedStep(tool="t", arguments=given, must_succeed=must)


def test_steps_after_the_last_answered_one_are_left():
    steps = [step("a"), step(None), step("b"), step("a", must=True), step("c")]
    assert steps_left(steps, []) == steps
    assert steps_left(steps, [call(1, None), call(2, "a")]) == steps[1:]
    assert steps_left(steps, [call(1, "a"), call(2, "other"), call(3, "b")]) == steps[3:]
    by_plugin = [call(1, "a"), call(2, "b", by="plugin")]
    assert steps_left(steps, by_plugin) == steps[1:], "the plugin's code is no step's"
    played = [call(1, "a"), call(2, "b"), call(3, "a", "error")]
    assert steps_left(steps, played) == [], "nothing follows a step that had to succeed"
    assert steps_left(steps, [*played[:2], call(3, "a")]) == steps[4:]


def test_the_scene_after_a_call_without_an_answer_is_forgotten_and_a_save_is_not(tmp_path: Path):
    record = TrialRecord(tmp_path)
    taken: list[tuple[int, Literal["live", "saved"]]] = [(1, "live"), (2, "saved"), (2, "live")]
    for number, kind in taken:
        file = tmp_path / "incoming"
        file.write_text(f"{number} {kind}")
        record.take(file, f"{number}-{kind}", kind=kind, call=number, at_s=number)
    record.note(call(1, "a"))
    again = TrialRecord(tmp_path)
    again.drop_unanswered()
    for found in (again, TrialRecord(tmp_path)):
        assert [(c.ordinal, c.call, c.kind) for c in found.checkpoints] == [
            (1, 1, "live"),
            (2, 2, "saved"),
        ]
