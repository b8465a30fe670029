"""The exported task folders and their reward, read by Harbor's own package.

Harbor needs Python 3.12, for which there is no bpy: it has an environment of its own, which `make
test-harbor` makes and LEGOWORLD_HARBOR_PYTHON names.
"""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import pytest
from evaluation.reconstruction.datasets import write_dataset, write_run

from legoworld import cli

pytestmark = pytest.mark.cluster

PYTHON = "LEGOWORLD_HARBOR_PYTHON"


def test_harbor_takes_the_tasks_and_the_reward(tmp_path: Path):
    python = os.environ.get(PYTHON)
    if not python:
        pytest.skip(f"{PYTHON} names no Python with Harbor: `make test-harbor` makes one")
    dataset = write_dataset(tmp_path / "bench")
    tasks, evaluation = tmp_path / "tasks", tmp_path / "eval"
    assert cli.run(["bench", "export", "--harbor", str(dataset.root), "-o", str(tasks)]) == 0
    run = write_run(tmp_path / "run", dataset)
    arguments = ["evaluate", str(run), "--truth", str(dataset.private), "-o", str(evaluation)]
    assert cli.run([*arguments, "--draws", "1", "-q"]) == 0
    first = (evaluation / "per_image.jsonl").read_text("utf-8").splitlines()[0]
    (evaluation / "per_image.jsonl").write_text(f"{first}\n", encoding="utf-8")
    reward = tmp_path / "reward.json"
    assert cli.run(["bench", "reward", str(evaluation), "-o", str(reward)]) == 0
    done = subprocess.run(
        [python, str(Path(__file__).with_name("harbor_check.py")), str(tasks), str(reward)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    found = json.loads(done.stdout)
    assert found["rewards"] == {"reward": 1.0, "V": 1.0, "R": 1.0, "A": 1.0, "S": 1.0}
    assert len(found["tasks"]) == len(dataset.cases) == 4
    for name, task in found["tasks"].items():
        assert task["valid"], name
        assert task["name"] == f"legoworld/{name}"
        assert task["schema_version"] == "1.4"
        # The verifier's image is its own, with tests/ in it: nothing of it is where an agent is.
        assert (task["verifier"], task["verifier_folder"]) == ("separate", "tests")
        assert task["bundled_tests"] is True
        # What the agent leaves, and the record of its calls, from which the verifier finalises.
        folders = ["workspace", "workspace.trajectory"]
        assert sorted(Path(path).name for path in task["artifacts"]) == folders
        assert "50.000000 degrees" in task["instruction"]
        assert (task["cpus"], task["memory_mb"]) == (2, 8192)
        assert (task["agent_timeout_s"], task["verifier_timeout_s"]) == (3600.0, 900.0)
