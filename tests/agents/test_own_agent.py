"""The agent of one file in examples/, by the card that docs/agents.md shows, and nothing else."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from agent_programs.model_server import ModelServer, Turn
from agents.tracks import SMALL, make_track, server_or_skip

from legoworld import cli
from legoworld.agents.campaign import reconstruct
from legoworld.files import sha256_of_file
from legoworld.records.atif import AtifTrajectory
from legoworld.records.base import decode
from legoworld.trajectories.transcripts import total_usage

ROOT = Path(__file__).parents[2]
AGENT = ROOT / "examples" / "own-agent" / "agent.py"
KEY = "sk-a-secret-of-2718"
SAVE = "bpy.ops.wm.save_as_mainfile(filepath=__import__('os').getcwd() + '/scene.blend')"


def code(says: str, text: str) -> Turn:
    arguments = {"code": f"import bpy\n{text}", "user_prompt": "Rebuild the photo."}
    return Turn(says=says, tool="execute_blender_code", arguments=arguments)


@pytest.fixture
def card(tmp_path, monkeypatch) -> Path:
    """The page's card, with the file where the reader would have put it."""
    server_or_skip()
    text = (ROOT / "docs" / "agents.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```toml\n(name = .*?)```", text, re.S)
    (tmp_path / "own.toml").write_text(block.replace("/home/me/own-agent/agent.py", str(AGENT)))
    monkeypatch.setenv("OPENAI_API_KEY", KEY)
    return tmp_path / "own.toml"


def test_the_agent_is_as_short_as_the_page_says():
    body = AGENT.read_text(encoding="utf-8").split('"""', 2)[2]
    assert len([line for line in body.splitlines() if line.strip()]) <= 80


@pytest.mark.blender
def test_it_is_ready_and_leaves_a_scene_with_its_tokens(card, tmp_path, capsys):
    assert cli.run(["agent", "check", str(card), "--json"]) == 0
    assert "execute_blender_code" in json.loads(capsys.readouterr().out)["tools"]
    script = [
        code("I build.", SMALL),
        code("This fails.", "bpy.data.objects['nothing here'].location.x = 1"),
        code("I save.", SAVE),
        Turn(says="Done."),
    ]
    make_track(tmp_path, ["one"], task="bench")
    with ModelServer(script).serving() as server:
        card.write_text(card.read_text().replace('api = "https://api.openai.com"',
                                                 f'api = "{server.url}"'))  # fmt: skip
        (row,) = reconstruct(
            tmp_path / "track.json", tmp_path / "scenes", photos=tmp_path / "photos",
            agent=str(card), model="scripted", record=True,
        )  # fmt: skip
    assert (row.status, row.reason) == ("ok", "")
    assert row.usage.tokens_source == "recorded"
    used = (row.usage.prompt_tokens, row.usage.cached_tokens, row.usage.completion_tokens)
    assert used == server.tokens
    scene = tmp_path / "scenes" / "one"
    found = decode(AtifTrajectory, (scene / "trajectory.json").read_bytes())
    assert [str(s.message) for s in found.steps[1:]] == [turn.says for turn in script]
    told = decode(AtifTrajectory, (scene / "trial" / "transcript").read_bytes())
    assert total_usage(told).completion_tokens == server.tokens[2]
    photo = sha256_of_file(tmp_path / "photos" / "one.png")
    assert all(photo in asked.pictures for asked in server.asked)
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert [path for path in files if KEY.encode() in path.read_bytes()] == []
