"""Agent cards: those that ship are whole, and one that is not says what it lacks."""

from __future__ import annotations

import json
import sys
import tomllib
from dataclasses import replace

import pytest
from agents.tracks import make_track, server_or_skip
from msgspec import structs

from legoworld import cli
from legoworld.agents import mcp_server
from legoworld.agents.agent_cards import (
    PLACEHOLDERS,
    agent_cards,
    agent_problems,
    load_agent,
    read_agent_card,
)
from legoworld.agents.agent_process import build_command
from legoworld.agents.mcp_server import (
    RELAY,
    blender_server,
    plugin_relay,
    write_configuration,
)
from legoworld.agents.recorded_card import check_recordable, sent_to
from legoworld.agents.run_plan import plan_run
from legoworld.errors import CatalogError, InstallationError, UsageError
from legoworld.records.agents import AgentMcp

CARDS = agent_cards()


@pytest.mark.parametrize("card", CARDS, ids=lambda c: c.name)
def test_a_card_that_was_never_run_says_so(card):
    said = card.about.checked
    assert card.about.run is ("never run" not in said)
    assert card.name == "program" or "never" in said


@pytest.mark.parametrize(
    ("word", "found"),
    [('-c provider={name="own"}', 'name="own"'), ("{photo}", "{photo}"), ("{", "'{'")],
)
def test_a_word_with_another_name_or_a_brace_of_its_own_is_refused(tmp_path, word, found):
    path = tmp_path / "codex.toml"
    path.write_text(load_agent("codex").path.read_text().replace('"--json"', json.dumps(word)))
    with pytest.raises(CatalogError, match=r"cannot be filled in.*write \{\{ and \}\}") as caught:
        read_agent_card(path)
    assert found in str(caught.value)
    path.write_text(path.read_text().replace(json.dumps(word), '"-c={{a=1}}"'))
    words = dict.fromkeys(PLACEHOLDERS, "")
    assert "-c={a=1}" in build_command(read_agent_card(path), words, None, continues=False)


@pytest.mark.parametrize("card", [c for c in CARDS if c.name != "program"], ids=lambda c: c.name)
def test_a_recorded_agent_is_sent_to_the_recorder_and_what_else_its_card_says_stays(card):
    check_recordable(card)
    own = {"provider": {"anthropic": {"name": "x"}}, "security": 1}
    mcp = structs.replace(card.about.mcp, settings=own)
    mine = replace(card, about=structs.replace(card.about, mcp=mcp))
    sent = sent_to(mine, "http://127.0.0.1:7").about
    said = json.dumps([sent.mcp.settings, sent.variables])
    assert "http://127.0.0.1:7" in said
    assert "{api}" not in said
    assert sent.variables.items() >= card.about.variables.items()
    assert sent.mcp.settings["provider"]["anthropic"]["name"] == "x"


def test_a_card_that_does_not_say_where_its_api_is_is_not_recorded(tmp_path):
    server_or_skip()
    folder = tmp_path / "in"
    track = make_track(folder, ["one"])
    given = ["reconstruct", str(track), "--photos", str(folder / "photos"), "--agent", "program"]
    (folder / "programs").mkdir()
    given += ["--programs", str(folder / "programs"), "--record", "-o", str(tmp_path / "out")]
    assert cli.run(given) == 2
    with pytest.raises(UsageError, match=r"no \[record\] in program.toml"):
        check_recordable(load_agent("program"))


def test_recording_says_which_extra_it_needs(monkeypatch):
    monkeypatch.setitem(sys.modules, "httpx2", None)
    with pytest.raises(InstallationError, match="extra `record`"):
        check_recordable(load_agent("claude"))


def test_the_four_agents_and_the_one_that_plays_are_there():
    assert [c.name for c in CARDS] == ["claude", "codex", "gemini", "opencode", "program"]


def test_what_is_lacking_is_said_with_how_to_get_it(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("HOME", str(tmp_path))
    said = " ".join(agent_problems(load_agent("codex"), {}))
    assert "npm install -g @openai/codex" in said
    assert "CODEX_API_KEY" in said
    assert "~/.codex/auth.json" in said
    assert "no login" not in " ".join(agent_problems(load_agent("codex"), {"CODEX_API_KEY": "x"}))


@pytest.mark.parametrize("card", CARDS, ids=lambda c: c.name)
def test_a_model_is_named_where_the_card_has_words_for_it(card):
    words = {name: f"<{name}>" for name in PLACEHOLDERS}
    plain = build_command(card, words, None, continues=False)
    named = build_command(card, words, "m-1", continues=True)
    assert not any("model" in word for word in plain)
    added = len(card.about.model_arguments)
    assert [word for word in named if word not in plain] == ["--model", "m-1"][:added]
    assert ("{model_arguments}" in card.about.command) is bool(added)


def test_a_model_is_refused_where_the_agent_takes_none(tmp_path):
    server_or_skip()
    make_track(tmp_path, ["room"])
    (tmp_path / "programs").mkdir()
    with pytest.raises(UsageError, match="takes no --model"):
        plan_run(
            tmp_path / "track.json", photos=tmp_path / "photos", agent="program", task=None,
            programs=tmp_path / "programs", model="m-1", time_limit_s=None,
            memory_bytes=1 << 30, sandbox="auto",
        )  # fmt: skip


@pytest.mark.parametrize("both", [(True, False), (False, True), (False, False)])
def test_a_plan_is_what_was_asked_and_what_the_card_says(tmp_path, monkeypatch, both):
    agent, blender = both
    card = load_agent("codex")
    about = structs.replace(card.about, network=agent, blender_network=blender, time_limit_s=77.0)
    card = replace(card, about=about)
    held, shown, commissioned = [], [], []
    place = "legoworld.agents.run_plan"
    monkeypatch.setattr(f"{place}.load_agent", lambda _: card)
    monkeypatch.setattr(f"{place}.agent_problems", lambda _: [])
    monkeypatch.setattr(f"{place}.refuse_exposed", lambda *words: shown.append(words))
    monkeypatch.setattr(
        f"{place}.load_trial_setup", lambda *words: commissioned.append(words) or "work"
    )
    monkeypatch.setattr(f"{place}.version_in_sandbox", lambda *words: ("version", *words))
    monkeypatch.setattr(
        f"{place}.protections", lambda *words, **how: held.append((words, how)) or how["network"]
    )
    track, photos, output = (tmp_path / name for name in ("t.json", "photos", "out"))

    def made(**said):
        known = {
            "photos": photos,
            "agent": "codex",
            "task": "coco",
            "programs": None,
            "model": "m-1",
            "time_limit_s": None,
            "memory_bytes": 5,
            "sandbox": "limits",
        }
        return plan_run(track, **{**known, **said})

    plan = made()
    assert held == [(("limits",), {"network": agent}), (("limits",), {"network": blender})]
    assert (plan.agent_held, plan.blender_held) == (agent, blender)
    assert shown == [(card, [track, photos])]
    assert commissioned == [(track, photos, "coco", ())]
    assert plan.agent_version == ("version", card, agent)
    assert (plan.card, plan.work, plan.model) == (card, "work", "m-1")
    assert (plan.programs, plan.plugin) == (None, None)
    assert (plan.limits.time_s, plan.limits.memory_bytes) == (77.0, 5)
    assert plan.limits.output_bytes == 256 << 20
    assert made(time_limit_s=9.0, output=output).limits.time_s == 9.0
    assert shown[-1] == (card, [track, photos, output])
    with pytest.raises(UsageError, match="takes no --programs"):
        made(programs=tmp_path)
    monkeypatch.setattr(f"{place}.agent_problems", lambda _: ["not logged in", "no codex"])
    with pytest.raises(
        UsageError, match=r"cannot run here; found: not logged in; no codex; .*check"
    ):
        made()


def test_opencode_gets_its_prompt_before_its_files():
    """Its --file takes every word that follows."""
    command = load_agent("opencode").about.command
    assert command.index("{prompt}") < command.index("--file") == len(command) - 2


def test_a_card_that_lacks_something_is_refused_with_its_name(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('name = "mine"\n')
    with pytest.raises(CatalogError, match=r"mine\.toml"):
        read_agent_card(path)
    with pytest.raises(UsageError, match="codex"):
        load_agent("codx")


@pytest.mark.parametrize("kind", ["mcp_servers", "codex", "opencode"])
def test_each_configuration_file_says_the_same_server(tmp_path, kind):
    server_or_skip()
    servers = [blender_server(9900, tmp_path / "a 'b\" c"), plugin_relay(9901)]
    settings = {"model_providers": {"own": {"base_url": "http://127.0.0.1:1/v1", "n": 2}}}
    mcp = AgentMcp(format=kind, path="unused", settings=settings)
    write_configuration(tmp_path / "file", mcp, servers)
    text = (tmp_path / "file").read_text()
    whole_file = tomllib.loads(text) if kind == "codex" else json.loads(text)
    assert whole_file["model_providers"] == settings["model_providers"]
    if kind == "codex":
        found = tomllib.loads(text)["mcp_servers"]
    else:
        found = json.loads(text)["mcp" if kind == "opencode" else "mcpServers"]
    commands, environments = [], []
    for name in ("blender", "legoworld"):
        server = found[name]
        whole = kind == "opencode"
        commands.append(server["command"] if whole else [server["command"], *server["args"]])
        environments.append(server["environment" if whole else "env"])
    command, variables = commands[0], environments[0]
    assert commands[1][1:] == [str(RELAY), "127.0.0.1", "9901"]
    assert environments[1] == {}
    assert command[0].endswith("/mcp-for-blender")
    assert variables == {
        "BLENDER_HOST": "127.0.0.1",
        "BLENDER_PORT": "9900",
        "DISABLE_TELEMETRY": "1",
        "TMPDIR": str(tmp_path / "a 'b\" c"),
    }


def test_list_and_check_say_it(capsys, monkeypatch, tmp_path):
    assert cli.run(["agent", "list"]) == 0
    assert "never with an account" in " ".join(capsys.readouterr().out.split())
    monkeypatch.setenv("PATH", str(tmp_path))
    assert cli.run(["agent", "check", "claude", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["name"] == "claude"


def test_the_server_is_told_where_blender_is_and_keeps_to_itself(tmp_path, monkeypatch):
    monkeypatch.setattr(mcp_server, "server_python", lambda: tmp_path / "bin" / "python")
    server = blender_server(9900, tmp_path / "pictures")
    assert (server.name, server.arguments) == ("blender", ())
    assert server.command.startswith(str(tmp_path / "bin"))
    assert server.variables == {
        "BLENDER_HOST": "127.0.0.1", "BLENDER_PORT": "9900", "DISABLE_TELEMETRY": "1",
        "TMPDIR": str(tmp_path / "pictures"),
    }  # fmt: skip


def test_a_card_is_known_by_its_name_or_its_path(monkeypatch):
    monkeypatch.setattr("legoworld.agents.agent_cards.read_agent_card", lambda path: path)
    shipped = load_agent("codex")
    assert (shipped.name, load_agent(str(shipped))) == ("codex.toml", shipped)
    with pytest.raises(UsageError, match=r"expected: .*codex.* or the path of a card"):
        load_agent("codex.tom")
    with pytest.raises(UsageError):
        load_agent("none/codex.toml")
