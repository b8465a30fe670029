"""Trials of agents that behave badly, and what a killed run leaves: never a loss, always a row."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from agents.tracks import SMALL, make_track, plan, run, server_or_skip, steps_file
from waiting import until

from legoworld.errors import UsageError
from legoworld.records.agents import TrialRow
from legoworld.trajectories.folder import read_trial

pytestmark = pytest.mark.blender

CUBE = f"{SMALL}\nbpy.ops.mesh.primitive_cube_add(location=(0, 3, 0))"
HERE = "__import__('os').getcwd()"
SAVE = f"bpy.ops.wm.save_as_mainfile(filepath={HERE} + '/scene.blend')"
#: For what ends by itself: never the reason that it ends.
PATIENTLY_S = 900.0


@dataclass(frozen=True, kw_only=True)
class TrialFolders:
    """A trial's row, the folder of all scenes and its own."""

    row: TrialRow
    scenes: Path

    @property
    def folder(self) -> Path:
        return self.scenes / self.row.scene

    @property
    def trial(self):
        return read_trial(self.folder)

    @property
    def frozen(self):
        return json.loads((self.folder / "frozen.json").read_text())


def run_codes(folder: Path, codes: list[str], *, time_limit_s: float = PATIENTLY_S) -> TrialFolders:
    """One trial of an agent that sends these codes; its disk and its processes are few."""
    server_or_skip()
    make_track(folder, ["one"], task="bench")
    steps_file(folder / "programs" / "one.steps.jsonl", codes)
    made = plan(folder, time_limit_s=time_limit_s)
    made = replace(made, limits=replace(made.limits, disk_bytes=100 << 20, processes=100))
    (row,) = run(made, folder / "scenes")
    return TrialFolders(row=row, scenes=folder / "scenes")


#: What an agent does, and where its scene then comes from. A link and a save elsewhere are not
#: what it delivers; nor is what it had not saved when it crashed.
BUILT = {
    "saves elsewhere": (
        [CUBE, f"bpy.ops.wm.save_as_mainfile(filepath={HERE} + '/my.blend')"], "checkpoint"),
    "links its save": (
        [CUBE, f"import os; os.symlink('/etc/passwd', {HERE} + '/scene.blend')"], "checkpoint"),
    "crashes": (
        [CUBE, "import os; os.kill(os.getpid(), 11)", "print(len(bpy.data.objects))"],
        "checkpoint"),
    "fills the disk": (
        [CUBE, SAVE, "import os\nn = 0\n"
         "while True:\n n += 1\n open(str(n), 'wb').write(os.urandom(16 << 20))"], "saved"),
}  # fmt: skip


@pytest.mark.parametrize("name", BUILT)
def test_what_was_built_is_frozen_and_where_it_came_from_is_recorded(name, tmp_path):
    codes, source = BUILT[name]
    done = run_codes(tmp_path, codes)
    assert done.row.status == "ok", done.row
    assert done.trial.about.finalisation.source == source
    assert done.frozen["status"] == "ok", done.frozen
    for file in ("scene.blend", "scene.glb", "final.png", "provenance.json", "trajectory.json"):
        assert (done.folder / file).is_file(), file


def test_a_scene_without_a_camera_is_delivered_and_invalid(tmp_path):
    done = run_codes(tmp_path, ["bpy.data.objects.remove(bpy.data.objects['Camera'])", CUBE, SAVE])
    assert done.row.status == "ok"
    assert done.frozen["checks"]["scene.blend"]["code"] == "no_camera"


def test_an_agent_that_ends_at_once_has_no_scene_and_says_so(tmp_path):
    done = run_codes(tmp_path, [])
    # The server asks what the endpoint is.
    assert (done.row.status, done.row.calls) == ("no_scene", 1)
    assert not (done.folder / "scene.blend").exists()


def test_a_spoilt_save_is_refused_and_the_one_before_taken(tmp_path):
    spoil = f"open({HERE} + '/scene.blend', 'w').write('spoiled')"
    about = run_codes(tmp_path, [CUBE, SAVE, spoil]).trial.about
    assert about.finalisation.source == "saved"
    (refused,) = about.finalisation.refused
    assert "it begins with b'spoiled'" in refused


def test_time_s_end_is_the_runtime_s_and_recorded(tmp_path):
    """Blender's time and the agent's are over together; which is noticed first may be either."""
    for time_limit_s in (15.0, 60.0, 240.0):  # a slow machine has built nothing after the first
        folder = tmp_path / f"{time_limit_s:g}"
        folder.mkdir()
        codes = [CUBE, SAVE, "import time; time.sleep(3600)"]
        done = run_codes(folder, codes, time_limit_s=time_limit_s)
        trial = done.trial
        assert trial.about.ended == "time" or trial.calls[-1].status == "timeout"
        assert trial.about.agent_seconds > 0.8 * time_limit_s
        if trial.about.finalisation.source == "saved":
            break
    assert done.row.status == "ok"
    assert trial.about.finalisation.source == "saved"


def test_an_agent_that_forks_is_a_row_and_its_scene_survives(tmp_path):
    """How far the forks get before the limit is met is the machine's speed: both ends are named."""
    fork = "import os\nfor _ in range(7):\n try: os.fork()\n except OSError: pass"
    done = run_codes(tmp_path, [CUBE, fork, SAVE])
    assert done.row.status in ("ok", "no_scene"), done.row
    assert done.row.checkpoints >= 1
    if done.row.status == "ok":
        assert done.trial.about.finalisation.source in ("saved", "checkpoint")
    else:
        assert "no scene could be exported" in done.row.reason


def test_thousands_of_objects_are_a_scene(tmp_path):
    code = (
        f"{SMALL}\n"
        "m = bpy.data.meshes.new('m')\nm.from_pydata([(0,0,0),(1,0,0),(0,1,0)],[],[(0,1,2)])\n"
        "c = bpy.context.scene.collection.objects\n"
        "for n in range(3_000): c.link(bpy.data.objects.new(f'o{n}', m))"
    )
    done = run_codes(tmp_path, [code])
    assert (done.row.status, done.row.checkpoints) == ("ok", 1), done.row


@pytest.fixture(scope="module")
def two(tmp_path_factory):
    """Two trials at once, one of an agent that prints its surroundings, in one folder."""
    server_or_skip()
    folder = tmp_path_factory.mktemp("trials")
    curious = "import os; print(dict(os.environ), os.listdir('/root'), os.listdir('..'))"
    steps_file(folder / "programs" / "good.steps.jsonl", [CUBE, SAVE])
    steps_file(folder / "programs" / "curious.steps.jsonl", [CUBE, curious])
    make_track(folder, ["curious", "good"], task="bench")
    os.environ["LEGOWORLD_TEST_SECRET"] = "very-secret"
    try:
        rows = run(plan(folder, time_limit_s=PATIENTLY_S), folder / "scenes", workers=2)
    finally:
        del os.environ["LEGOWORLD_TEST_SECRET"]
    assert [row.status for row in rows] == ["ok", "ok"]
    return {row.scene: TrialFolders(row=row, scenes=folder / "scenes") for row in rows}


def test_a_save_is_what_is_delivered_and_otherwise_the_open_scene(two):
    assert two["good"].trial.about.finalisation.source == "saved"
    assert two["curious"].trial.about.finalisation.source == "checkpoint"
    assert {done.frozen["status"] for done in two.values()} == {"ok"}


def test_secrets_reach_neither_the_code_nor_a_file(two):
    for path in two["curious"].folder.rglob("*"):
        assert not path.is_file() or b"very-secret" not in path.read_bytes(), path


def test_one_trial_does_not_see_the_workspace_of_another(two):
    """Eight files are what a workspace begins with and an agent saves."""
    listed = {path.name for path in two["good"].scenes.iterdir()}
    assert listed == set(two)
    assert not [name for name in listed if name.startswith(".")]


def test_the_transcript_s_steps_name_their_calls(two):
    steps = two["good"].trial.trajectory.steps
    calls = [
        step.extra["legoworld"]["calls"] for step in steps if "legoworld" in (step.extra or {})
    ]
    assert len(calls) == 2
    assert calls == sorted(calls)


def test_times_are_within_the_agent_s_own(two):
    trial = two["good"].trial
    times = [checkpoint.at_s for checkpoint in trial.checkpoints]
    assert times == sorted(times)
    assert times[0] > 0
    assert times[-1] <= trial.about.agent_seconds


def test_a_second_run_makes_nothing_again_and_another_campaign_does_not_mix(two, monkeypatch):
    scenes = two["good"].scenes
    with pytest.raises(UsageError, match="another campaign"):
        run(plan(scenes.parent, time_limit_s=91.0), scenes)
    monkeypatch.setattr("legoworld.agents.reconstruct.run_trial", None)
    rows = run(plan(scenes.parent, time_limit_s=PATIENTLY_S), scenes)
    assert all(row.kept for row in rows)


def test_a_missing_photo_and_a_missing_program_are_rows(tmp_path):
    server_or_skip()
    make_track(tmp_path, ["here", "gone"], task="bench")
    (tmp_path / "photos" / "gone.png").unlink()
    (tmp_path / "programs").mkdir()
    rows = run(plan(tmp_path), tmp_path / "scenes")
    assert [row.status for row in rows] == ["failed", "no_photo"]
    assert [p.name for p in (tmp_path / "scenes").iterdir()] == []


def test_runs_have_folders_of_their_own(tmp_path):
    server_or_skip()
    make_track(tmp_path, ["one"], task="bench")
    steps_file(tmp_path / "programs" / "one.steps.jsonl", [CUBE, SAVE])
    rows = run(plan(tmp_path), tmp_path / "scenes", repeat=2, workers=2)
    assert [(row.run, row.status) for row in rows] == [(1, "ok"), (2, "ok")]
    assert (tmp_path / "scenes" / "run_2" / "one" / "frozen.json").is_file()


def test_killed_at_any_moment_the_same_command_makes_the_rest(tmp_path):
    server_or_skip()
    names = ["a", "b"]
    make_track(tmp_path, names, task="bench")
    endless = "open('begun', 'w').close()\nimport time; time.sleep(3600)"
    steps_file(tmp_path / "programs" / "a.steps.jsonl", [CUBE, SAVE])
    steps_file(tmp_path / "programs" / "b.steps.jsonl", [CUBE, SAVE, endless])
    command = [
        *(sys.executable, "-m", "legoworld", "reconstruct", str(tmp_path / "track.json")),
        *("--photos", str(tmp_path / "photos"), "--agent", "program", "--task", "bench"),
        *("--programs", str(tmp_path / "programs"), "-o", str(tmp_path / "scenes")),
    ]
    root = Path(__file__).parents[2]
    first = subprocess.Popen(command, cwd=root, start_new_session=True, stderr=subprocess.DEVNULL)
    scenes = tmp_path / "scenes"
    # os.walk: folders of the first trial go while they are looked at.
    until(lambda: any("begun" in n for *_, n in os.walk(scenes)), "the second trial's last call")
    first.send_signal(signal.SIGKILL)
    first.wait()
    kept = (tmp_path / "scenes" / "a" / "reconstruction.json").read_bytes()
    assert not (tmp_path / "scenes" / "b").exists()
    steps_file(tmp_path / "programs" / "b.steps.jsonl", [CUBE, SAVE])
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "scenes" / "a" / "reconstruction.json").read_bytes() == kept
    assert sorted(p.name for p in (tmp_path / "scenes").iterdir()) == names
    assert "2 of 2 trials" in done.stdout
