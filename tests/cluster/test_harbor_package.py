"""The exported task folders, their reward and trajectories, read by Harbor's own package.

Harbor needs Python 3.12, for which there is no bpy: it has an environment of its own, which `make
test-harbor` makes and LEGOWORLD_HARBOR_PYTHON names.
"""

from __future__ import annotations

import base64
import json
import subprocess
from pathlib import Path

import pytest
from evaluation.reconstruction.datasets import write_dataset, write_run
from trajectories.harbor import harbor_python, refusal_of_harbor

from legoworld import cli
from legoworld.records.base import readable
from legoworld.trajectories.transcripts import read_transcript

pytestmark = pytest.mark.cluster


def test_harbor_takes_the_tasks_and_the_reward(tmp_path: Path):
    python = harbor_python()
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


PNG = base64.b64encode(b"\x89PNG\r\n\x1a\n" + bytes(200)).decode()
#: A picture that a tool came back with, at the end of a transcript of each kind that keeps one.
PICTURES = {
    "claude": [
        {"type": "assistant", "message": {"id": "m", "content": [
            {"type": "tool_use", "id": "c", "name": "look", "input": {}}]}},
        {"type": "user", "message": {"content": [{"type": "tool_result", "tool_use_id": "c",
            "content": [{"type": "image", "source": {"type": "base64", "data": PNG}}]}]}},
    ],
    "codex": [
        {"type": "item.completed", "item": {"id": "i", "type": "mcp_tool_call", "tool": "look",
            "result": {"content": [{"type": "image", "data": PNG, "mimeType": "image/png"}]}}},
    ],
}  # fmt: skip


@pytest.mark.parametrize("kind", ["claude", "codex", "gemini", "opencode"])
def test_harbor_s_validator_takes_the_trajectory_of_each_agent(tmp_path: Path, kind: str):
    recorded = Path(__file__).parents[1] / "trajectories" / "transcripts" / f"{kind}.jsonl"
    lines = [json.dumps(line) for line in PICTURES.get(kind, ())]
    (tmp_path / "transcript").write_text(recorded.read_text("utf-8") + "\n".join(lines), "utf-8")
    found = read_transcript(
        tmp_path / "transcript", kind, agent=kind, version="1", prompt="p", scene_folder=tmp_path
    )
    (tmp_path / "trajectory.json").write_text(readable(found), encoding="utf-8")
    assert refusal_of_harbor(tmp_path / "trajectory.json") == ""
    for picture in (tmp_path / "trial" / "pictures").glob("*"):
        picture.unlink()
        assert "does not exist" in refusal_of_harbor(tmp_path / "trajectory.json")
        break
    else:
        assert kind not in PICTURES
