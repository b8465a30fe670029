"""What an agent's process is given, and what is kept of what it printed; no Blender is asked."""

from __future__ import annotations

import json

import pytest
from agents.tracks import make_track, server_or_skip

from legoworld.agents.agent_cards import read_agent_card
from legoworld.agents.agent_process import Order, run_agent
from legoworld.agents.budget import BudgetWatch
from legoworld.agents.stop import Stop
from legoworld.agents.unfinished_trial import UnfinishedTrial
from legoworld.agents.workspaces import load_trial_setup, make_workspace
from legoworld.records.agents import UNLIMITED, Usage
from legoworld.trajectories.folder import TRIAL
from legoworld.workers.protections import protections
from legoworld.workers.sandbox import SandboxLimits

CARD = """
name = "own"
title = "Mine"
version = "1"
documentation = "none"
run = true
checked = "by this test"
command = ["/bin/sh", "-c",
  'cat "$1" "$2" "$3" "$4" "$5"; echo more > "$6/more"; echo "$KEY_OF_MINE"; ls -d "$7"',
  "sh", "{home}/.own/login", "{mcp_config}", "{prompt_file}", "{steps}", "{home}/.own/kept/before",
  "{home}/.own/kept", "{home}/.other/deep/kept"]
session_folders = [".own/kept", ".other/deep/kept"]
network = false
time_limit_s = 60.0
mcp = {format = "mcp_servers", path = "{home}/mcp.json"}
transcript = {format = "atif"}
needs.install = "none"
needs.variables = ["KEY_OF_MINE", "NONE_OF_MINE"]
needs.credentials = [".own/login", ".own/none"]
"""


@pytest.fixture
def order(tmp_path, monkeypatch):
    server_or_skip()
    make_track(tmp_path, ["room"], task="bench")
    (tmp_path / "own.toml").write_text(CARD)
    (tmp_path / "home" / ".own").mkdir(parents=True)
    (tmp_path / "home" / ".own" / "login").write_text("my login\n")
    unfinished = UnfinishedTrial(folder=tmp_path / "trial", stays=True)
    for folder in (unfinished.workspace, unfinished.scene_folder / TRIAL, unfinished.agent):
        folder.mkdir(parents=True)
    unfinished.session.mkdir()
    (unfinished.session / ".own" / "kept").mkdir(parents=True)
    (unfinished.session / ".own" / "kept" / "before").write_text("what it kept\n")
    work = load_trial_setup(tmp_path / "track.json", tmp_path / "photos", "bench")
    (image,) = work.track.images
    workspace = make_workspace(work, image, unfinished.workspace, time_limit_s=60.0)
    assert workspace is not None
    monkeypatch.setenv("KEY_OF_MINE", "my key")
    monkeypatch.setattr("legoworld.agents.agent_process.home_folder", lambda: tmp_path / "home")
    return Order(
        card=read_agent_card(tmp_path / "own.toml"), workspace=workspace, port=9900,
        plugin_port=9901, steps="the steps\n", model=None, protections=protections("limits"),
        limits=SandboxLimits(time_s=600.0, memory_bytes=1 << 30), continues=True,
        trial=unfinished, watch=BudgetWatch(UNLIMITED, lambda: False, Usage),
    )  # fmt: skip


def test_an_agent_finds_its_login_its_servers_its_prompt_and_what_it_kept(order):
    ending = run_agent(order, Stop())
    assert (ending.code, ending.over) == (0, None), ending.last_output
    (transcript,) = order.trial.transcripts()
    login, said = transcript.read_text().split("\n", 1)
    servers, end = json.JSONDecoder().raw_decode(said)
    assert login == "my login"
    assert [*servers["mcpServers"]] == ["blender", "legoworld"]
    *rest, key, other = said[end:].strip().splitlines()
    assert "\n".join(rest) == f"{order.workspace.prompt}the steps\nwhat it kept"
    assert key == "my key"
    assert other.endswith("/.other/deep/kept")
    kept = order.trial.agent / "sandbox" / "output" / "session" / ".own" / "kept"
    assert {path.name for path in kept.iterdir()} == {"before", "more"}


def test_a_photo_is_the_workspace_s_reference(order):
    assert order.workspace.image.name == "reference.png"
    assert "reference.png" in order.workspace.prompt
    public = json.loads((order.workspace.folder / "task.json").read_text())
    assert public["image"]["file_name"] == "reference.png"
