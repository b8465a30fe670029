"""Trials of agents that behave badly, and what a killed run leaves: never a loss, always a row."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from agents.tracks import make_track, plan, run, server_or_skip, steps_file

from legoworld.errors import UsageError
from legoworld.trajectories.folder import read_trial

pytestmark = pytest.mark.blender

CUBE = "bpy.ops.mesh.primitive_cube_add(location=(0, 3, 0))"
HERE = "__import__('os').getcwd()"
SAVE = f"bpy.ops.wm.save_as_mainfile(filepath={HERE} + '/scene.blend')"


@pytest.fixture(scope="module")
def trials(tmp_path_factory):
    """One run, four at once, over agents that each do something else wrong."""
    server_or_skip()
    folder = tmp_path_factory.mktemp("trials")
    agents = {
        "good": [CUBE, SAVE],
        "never-saves": [CUBE, "bpy.data.objects['Cube'].location.x = 1"],
        "saves-elsewhere": [CUBE, f"bpy.ops.wm.save_as_mainfile(filepath={HERE} + '/my.blend')"],
        "no-camera": ["bpy.data.objects.remove(bpy.data.objects['Camera'])", CUBE, SAVE],
        "fills-the-disk": [
            CUBE, SAVE,
            "n = 0\nwhile True:\n n += 1\n open(str(n), 'wb').write(bytes(64 << 20))",
        ],
        "forks": [CUBE, "import os\nfor _ in range(10): os.fork()", SAVE],
        "sleeps": [CUBE, SAVE, "import time; time.sleep(3600)"],
        "prints-secrets": [CUBE, "import os; print(dict(os.environ), os.listdir('/root'))", SAVE],
        "many-objects": [
            "m = bpy.data.meshes.new('m')\nm.from_pydata([(0,0,0),(1,0,0),(0,1,0)],[],[(0,1,2)])\n"
            "c = bpy.context.scene.collection.objects\n"
            "for n in range(100_000): c.link(bpy.data.objects.new(f'o{n}', m))",
        ],
        "ends-at-once": [],
        "spoils-its-save": [CUBE, SAVE, f"open({HERE} + '/scene.blend', 'w').write('spoiled')"],
        "links-its-save": [CUBE, f"import os; os.symlink('/etc/passwd', {HERE} + '/scene.blend')"],
        "crashes": [CUBE, "import os; os.kill(os.getpid(), 11)", "print(len(bpy.data.objects))"],
    }  # fmt: skip
    for name, codes in agents.items():
        steps_file(folder / "programs" / f"{name}.steps.jsonl", codes)
    make_track(folder, sorted(agents), task="bench")
    made = plan(folder, time_limit_s=90.0)
    os.environ["LEGOWORLD_TEST_SECRET"] = "very-secret"
    try:
        rows = run(made, folder / "scenes", workers=4)
    finally:
        del os.environ["LEGOWORLD_TEST_SECRET"]
    return folder, {row.scene: row for row in rows}


def trial_of(trials, name):
    return read_trial(trials[0] / "scenes" / name)


def frozen(trials, name):
    return json.loads((trials[0] / "scenes" / name / "frozen.json").read_text())


@pytest.mark.parametrize(
    ("name", "source"),
    [
        ("good", "saved"),
        ("never-saves", "checkpoint"),
        ("saves-elsewhere", "checkpoint"),
        ("fills-the-disk", "saved"),
        ("sleeps", "saved"),
        ("prints-secrets", "saved"),
        ("links-its-save", "checkpoint"),
        ("crashes", "checkpoint"),
    ],
)
def test_what_was_built_is_frozen_and_where_it_came_from_is_recorded(trials, name, source):
    trial = trial_of(trials, name)
    assert trials[1][name].status == "ok", trials[1][name]
    assert trial.about.finalisation.source == source
    record = frozen(trials, name)
    assert record["status"] == "ok", record
    for file in ("scene.blend", "scene.glb", "final.png", "provenance.json", "trajectory.json"):
        assert (trial.folder / file).is_file(), file


def test_a_scene_without_a_camera_is_delivered_and_invalid(trials):
    assert trials[1]["no-camera"].status == "ok"
    assert frozen(trials, "no-camera")["checks"]["scene.blend"]["code"] == "no_camera"


def test_an_agent_that_ends_at_once_has_no_scene_and_says_so(trials):
    row = trials[1]["ends-at-once"]
    assert (row.status, row.calls) == ("no_scene", 1)  # the server asks what the endpoint is
    assert not (trials[0] / "scenes" / "ends-at-once" / "scene.blend").exists()


def test_a_spoilt_save_is_refused_and_the_open_scene_taken(trials):
    about = trial_of(trials, "spoils-its-save").about
    assert about.finalisation.source == "checkpoint"
    assert len(about.finalisation.refused) == 1


def test_time_s_end_is_the_runtime_s_and_recorded(trials):
    """Blender's time and the agent's are over together; which is noticed first may be either."""
    trial = trial_of(trials, "sleeps")
    assert trial.about.ended == "time" or trial.calls[-1].status == "timeout"
    assert trial.about.agent_seconds > 80


def test_secrets_reach_neither_the_code_nor_a_file(trials):
    for path in (trials[0] / "scenes" / "prints-secrets").rglob("*"):
        assert not path.is_file() or b"very-secret" not in path.read_bytes(), path


def test_an_agent_that_forks_is_a_row_and_its_scene_survives(trials):
    """How far the forks get before the limit is met is the machine's speed: both ends are named."""
    row = trials[1]["forks"]
    assert row.status in ("ok", "no_scene"), row
    assert row.checkpoints >= 1
    if row.status == "ok":
        assert trial_of(trials, "forks").about.finalisation.source in ("saved", "checkpoint")
    else:
        assert "no scene could be exported" in row.reason


def test_a_hundred_thousand_objects_are_a_scene_or_more_than_the_time_allows(trials):
    row = trials[1]["many-objects"]
    assert row.status in ("ok", "no_scene"), row
    if row.checkpoints == 0:
        assert "no call changed the scene" in row.reason
    else:
        assert row.checkpoints == 1


def test_one_trial_does_not_see_the_workspace_of_another(trials):
    """Eight files are what a workspace begins with and an agent saves."""
    listed = {path.name for path in (trials[0] / "scenes").iterdir()}
    assert listed == set(trials[1])
    assert not [name for name in listed if name.startswith(".")]


def test_the_transcript_s_steps_name_their_calls(trials):
    steps = trial_of(trials, "good").trajectory.steps
    calls = [
        step.extra["legoworld"]["calls"] for step in steps if "legoworld" in (step.extra or {})
    ]
    assert len(calls) == 2
    assert calls == sorted(calls)


def test_times_are_within_the_agent_s_own(trials):
    trial = trial_of(trials, "good")
    times = [checkpoint.at_s for checkpoint in trial.checkpoints]
    assert times == sorted(times)
    assert times[0] > 0
    assert times[-1] <= trial.about.agent_seconds


def test_a_second_run_makes_nothing_again(trials):
    begun = time.monotonic()
    rows = run(plan(trials[0], time_limit_s=90.0), trials[0] / "scenes")
    assert all(row.kept for row in rows)
    assert time.monotonic() - begun < 5


def test_another_campaign_does_not_mix_with_it(trials):
    with pytest.raises(UsageError, match="another campaign"):
        run(plan(trials[0], time_limit_s=91.0), trials[0] / "scenes")


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
    names = ["a", "b", "c"]
    make_track(tmp_path, names, task="bench")
    for name in names:
        slow = "import time; time.sleep(2)"
        steps_file(tmp_path / "programs" / f"{name}.steps.jsonl", [CUBE, SAVE, slow])
    command = [
        *(sys.executable, "-m", "legoworld", "reconstruct", str(tmp_path / "track.json")),
        *("--photos", str(tmp_path / "photos"), "--agent", "program", "--task", "bench"),
        *("--programs", str(tmp_path / "programs"), "-o", str(tmp_path / "scenes")),
    ]
    root = Path(__file__).parents[2]
    first = subprocess.Popen(command, cwd=root, start_new_session=True, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 120
    while not (tmp_path / "scenes" / "a").exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    time.sleep(2)
    first.send_signal(signal.SIGKILL)
    first.wait()
    kept = (tmp_path / "scenes" / "a" / "reconstruction.json").read_bytes()
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "scenes" / "a" / "reconstruction.json").read_bytes() == kept
    assert sorted(p.name for p in (tmp_path / "scenes").iterdir()) == names
    assert "3 of 3 trials" in done.stdout
