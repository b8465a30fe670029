"""`legoworld bench export --harbor`: a task's script scores, the agent's part tells nothing."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from legoworld import cli
from legoworld.files import sha256_of_file


@pytest.fixture(scope="module")
def exported(references, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("exported")
    options = ["--size", "96x54", "--samples", "2", "--noise-seeds", "0", "-q"]
    place = ["-o", str(folder / "bench"), "--keep-scenes", str(folder / "itself")]
    assert cli.run(["bench", "make", str(references), *place, *options]) == 0
    export = ["bench", "export", "--harbor", str(folder / "bench"), "-o", str(folder / "tasks")]
    (folder / "tasks").mkdir()  # an empty folder is as good as none
    assert cli.run(export) == 0
    assert cli.run(export) == 2  # never over what is there
    return folder


def test_a_task_is_what_harbor_reads(exported):
    tasks = sorted(p.name for p in (exported / "tasks").iterdir())
    assert len(tasks) == 6
    task = exported / "tasks" / "den__hard__view_00"
    document = tomllib.loads((task / "task.toml").read_text("utf-8"))
    assert document["schema_version"] == "1.4"
    assert document["verifier"]["environment_mode"] == "separate"
    assert document["artifacts"] == ["/workspace", "/workspace.trajectory"]
    (server,) = document["environment"]["mcp_servers"]
    assert (server["transport"], server["command"]) == ("stdio", "legoworld")
    with pytest.raises(SystemExit) as helped:  # what the agent's harness starts is a command
        cli.main([*server["args"], "--help"])
    assert not helped.value.code
    assert "61.92" in (task / "instruction.md").read_text("utf-8")
    assert os.access(task / "tests" / "test.sh", os.X_OK)


def test_a_prebuilt_image_is_named_and_nothing_is_built(exported, tmp_path):
    export = ["bench", "export", "--harbor", str(exported / "bench"), "-o", str(tmp_path)]
    assert cli.run([*export, "--prebuilt", "registry.example/legoworld:1.0.0"]) == 0
    task = tmp_path / "den__hard__view_00"
    assert [path.name for path in (task / "environment").iterdir()] == ["image.png"]
    assert not (task / "tests" / "Dockerfile").exists()
    document = tomllib.loads((task / "task.toml").read_text("utf-8"))
    built = exported / "tasks" / "den__hard__view_00" / "task.toml"
    expected = tomllib.loads(built.read_text("utf-8"))
    # The verifier's container is the agent's image afresh: Harbor's rule without a section.
    del expected["verifier"]["environment"]
    place = {"docker_image": "registry.example/legoworld:1.0.0", "workdir": "/workspace"}
    expected["environment"] |= place
    assert document == expected


def test_the_agent_s_part_holds_nothing_private(exported):
    for task in (exported / "tasks").iterdir():
        private = {sha256_of_file(p) for p in (task / "tests" / "bench" / "private").rglob("*.*")}
        shown = [task / "instruction.md", task / "task.toml", *(task / "environment").iterdir()]
        assert {p.name for p in (task / "environment").iterdir()} == {"Dockerfile", "image.png"}
        for path in shown:
            assert sha256_of_file(path) not in private
            if path.suffix != ".png":
                text = path.read_text("utf-8")
                assert "Red" not in text
                assert "truth" not in text
                assert not [digest for digest in private if digest in text]


def test_the_verifier_s_part_is_a_dataset_of_one_case(exported):
    stem = "den__medium__view_01"
    bench = exported / "tasks" / stem / "tests" / "bench"
    assert {p.relative_to(bench).as_posix() for p in bench.rglob("*") if p.is_file()} == {
        "public/track.json", f"public/images/{stem}.png", "private/truth.json",
        *(f"private/{kind}/{stem}.npz" for kind in ("depth", "instances", "raster")),
    }  # fmt: skip


@pytest.mark.parametrize("left", ["all", "nothing"])
def test_its_script_writes_a_reward_whatever_the_agent_left(exported, tmp_path, left):
    """The script itself, with its container's paths put below a folder of this test."""
    task = exported / "tasks" / "den__easy__view_00"
    shutil.copytree(task / "tests", tmp_path / "tests")
    (tmp_path / "workspace").mkdir()
    if left == "all":
        for path in (exported / "itself" / "den__easy__view_00").iterdir():
            shutil.copyfile(path, tmp_path / "workspace" / path.name)
    script = tmp_path / "tests" / "test.sh"
    text = script.read_text("utf-8")
    for place in ("/tmp/", "/workspace", "/logs"):  # /tmp/ first: it may be where this test is
        text = text.replace(place, str(tmp_path) + place)
    script.write_text(text.replace("legoworld ", f"{sys.executable} -m legoworld "), "utf-8")
    (tmp_path / "tmp").mkdir()
    subprocess.run(["sh", str(script)], check=False, capture_output=True)
    reward = json.loads((tmp_path / "logs" / "verifier" / "reward.json").read_text("utf-8"))
    assert all(isinstance(v, float) and 0 <= v <= 1 for v in reward.values())
    if left == "all":
        assert (reward["V"], reward["R"]) == (1.0, 1.0)
        assert reward["reward"] == pytest.approx((1 + reward["A"]) / 2)
        assert reward["A"] > 0.9
    else:
        assert reward["reward"] == 0.0
