"""The trainers' adapters against the packages they are for, each in an environment of its own.

`make test-environments` makes them and names their folder by LEGOWORLD_ENVIRONMENTS. None of these
packages is in legoworld's environment, and legoworld in none of theirs: it is asked as a program.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from bench.conftest import REFERENCE

from legoworld import cli

pytestmark = [pytest.mark.cluster, pytest.mark.blender]

FOLDER = "LEGOWORLD_ENVIRONMENTS"
PACKAGE = Path(__file__).parents[2] / "examples/environments/legoworld_environments"
ROOM = """import bpy
from mathutils import Matrix

for thing in list(bpy.data.objects):
    if thing.type == "MESH":
        bpy.data.objects.remove(thing)
bpy.ops.mesh.primitive_plane_add(size=16)
bpy.context.scene.render.resolution_x, bpy.context.scene.render.resolution_y = 64, 36
camera = bpy.context.scene.camera
camera.location, camera.rotation_euler = (0.0, -6.0, 3.0), (1.18682, 0.0, 0.0)
"""


@pytest.fixture(scope="module")
def made(build_scenes, tmp_path_factory):
    folder = tmp_path_factory.mktemp("environments")
    build_scenes(REFERENCE, folder / "references")
    quick = ["--size", "96x54", "--samples", "2", "--noise-seeds", "0", "-q"]
    place = ["-o", str(folder / "bench"), "--keep-scenes", str(folder / "itself")]
    assert cli.run(["bench", "make", str(folder / "references"), *place, *quick]) == 0
    (folder / "room.py").write_text(ROOM, encoding="utf-8")
    return folder


def asked(name: str, made: Path, *arguments: object, **more: str) -> dict[str, Any]:
    """What the check program prints in the environment of that name."""
    environments = os.environ.get(FOLDER)
    if not environments:
        pytest.skip(f"{FOLDER} names no folder: `make test-environments` makes one")
    told = {
        "LEGOWORLD_DATASET": str(made / "bench"),
        "LEGOWORLD_COMMAND": f"{sys.executable} -m legoworld",
        **more,
    }
    # Not this test's PYTHONPATH: the packages of this environment are not theirs.
    kept = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    program = Path(__file__).parent / "environment_checks" / f"{name}_check.py"
    python = Path(environments) / name / "bin" / "python"
    done = subprocess.run(
        [python, program, *map(str, arguments)],
        env=kept | told, capture_output=True, text=True, check=False, cwd=made,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    return dict(json.loads(done.stdout.splitlines()[-1]))


def test_inspect_evaluates_the_task_by_its_entry_point(made, tmp_path):
    found = asked("inspect", made, made / "room.py", tmp_path)
    assert found["entry_points"] == ["legoworld_environments.inspect_task"]
    assert (found["status"], found["error"]) == ("success", "None")
    room, none = found["samples"]
    assert room["content"] == ["text", "image"]
    assert room["id"] == "den__easy__view_00"
    assert room["V"] == 1
    assert 0 <= room["R"] == room["S"] < 0.7
    assert "SyntaxError" in none["why"]  # what has no block of code is a program as it is
    assert none["R"] < 0.3
    assert found["metrics"]["S"]["mean"] == pytest.approx((room["S"] + none["S"]) / 2)
    assert set(found["metrics"]) == {"S", "V", "R", "A"}


def test_openenv_validates_the_package_and_plays_episodes(made):
    root = {"LEGOWORLD_ROOT": str(made / "itself"), "LEGOWORLD_RENDER": "0"}
    oracle = "den__easy__view_00"
    found = asked("openenv", made, PACKAGE / "openenv", made / "room.py", oracle, **root)
    assert found["static"] == 0
    done = {name: one for name, one in found["checks"].items() if one[0] != "skip"}
    runtime = ("startup", "state_contract", "reward_well_formed", "observation_schema")
    assert set(done) == {"static.manifest", *(f"runtime.{name}" for name in runtime)}
    assert {one[0] for one in done.values()} == {"pass"}, done
    assert all(found["running"].values()), found["running"]
    begun, floor, best = found["many_turns"]
    assert (begun["image_id"], begun["turns_left"]) == (1, 2)
    assert begun["picture"] > 1000
    assert floor["reward"] < 0.7
    assert (floor["done"], best["done"], best["turns_left"]) == (False, True, 0)
    assert best["reward"] == 1.0  # the oracle: the reference itself
    assert [one["f1"] for one in best["feedback"]["objects"]] == [1.0]
    _, first, last = found["blind"]
    assert (first["reward"], last["reward"]) == (None, 1.0)
    assert set(first["feedback"]) == {"status", "program_error"}
    assert [one["done"] for one in found["ended"][1:]] == [True]
    assert "refused" in found["outside"]


def test_trl_and_verl_call_the_reward(made, tmp_path):
    found = asked("trainers", made, made / "room.py", tmp_path, CUDA_VISIBLE_DEVICES="")
    (of_group, logged) = found["grpo"]
    # Two words make no scene: zeros with a reason, and no missing reward.
    assert len(of_group) == 2
    assert all(0 <= one < 0.5 for one in of_group)
    assert logged == [pytest.approx(sum(of_group) / 2)]
    assert 0 <= found["ppo"]["score"] == found["ppo"]["R"] < 0.7
    assert (found["ppo"]["V"], found["ppo"]["why"]) == (1, "")


def test_verifiers_takes_prebuilt_tasks_and_refuses_the_others(made, tmp_path):
    export = ["bench", "export", "--harbor", str(made / "bench"), "-o"]
    image = "registry.example/legoworld:1.0.0"
    assert cli.run([*export, str(tmp_path / "tasks"), "--prebuilt", image]) == 0
    found = asked("verifiers", made, tmp_path / "tasks")
    assert len(found["tasks"]) == 6
    for name, task in found["tasks"].items():
        assert task["image"] == image, name
        # environment/ goes into the agent's folder, tests/ into a second container of the image.
        assert (task["upload_environment"], task["workdir"]) == (True, "/workspace")
        assert (task["separate"], task["verifier_image"]) == (True, None)
        assert task["mcp"] == ["blender"]
        assert task["artifacts"] == ["/workspace", "/workspace.trajectory"]
        shown = [path.name for path in (tmp_path / "tasks" / name / "environment").iterdir()]
        assert shown == ["image.png"]
    assert cli.run([*export, str(tmp_path / "built")]) == 0
    with pytest.raises(AssertionError, match="needs a pullable docker_image"):
        asked("verifiers", made, tmp_path / "built")
