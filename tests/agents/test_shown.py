"""What an agent's sandbox shows of its installation: enough to start, and nothing beside it."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from workers.confinements import bubblewrap_or_skip

from legoworld import cli
from legoworld.agents import handshake
from legoworld.agents.agent_cards import AgentCard, read_agent_card
from legoworld.agents.exposed_paths import (
    AgentNotStartedError,
    exposed_paths,
    refuse_exposed,
    version_in_sandbox,
)
from legoworld.agents.mcp_server import McpServer
from legoworld.errors import UsageError
from legoworld.workers.protections import protections

SERVER = McpServer(name="blender", command="none", arguments=(), variables={})
CARD = """
name = "own"
title = "Mine"
version = "1.0.0"
documentation = "none"
run = false
checked = "never"
command = [{program!r}]
version_command = [{program!r}, "--version"]
shown = [{shown}]
network = false
time_limit_s = 60.0
mcp = {{format = "mcp_servers", path = "{{home}}/mcp.json"}}
transcript = {{format = "atif"}}
needs = {{install = "none"}}
"""


def card(folder: Path, program: Path, *shown: str) -> AgentCard:
    (folder / "own.toml").write_text(
        CARD.format(program=str(program), shown=", ".join(map(repr, shown)))
    )
    return read_agent_card(folder / "own.toml")


def script(path: Path, text: str, interpreter: str = "/bin/sh") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!{interpreter}\n{text}\n")
    path.chmod(0o755)
    return path


@pytest.fixture
def held():
    bubblewrap_or_skip()
    return protections("bubblewrap")


def test_an_agent_is_not_shown_what_lies_beside_its_program(tmp_path, held):
    """The folder of its command was shown as a whole: an agent beside gt.json read it."""
    (tmp_path / "gt.json").write_text("truth")
    program = script(tmp_path / "my-agent", f"cat {tmp_path}/gt.json 2>/dev/null || echo 1.0")
    assert version_in_sandbox(card(tmp_path, program), held) == "1.0"


def test_a_package_and_its_node_are_shown_wherever_npm_put_them(tmp_path, held, monkeypatch):
    """`npm install -g` below a home: the command is a link into the package beside it."""
    node = tmp_path / "versions" / "bin" / "own-node"
    node.parent.mkdir(parents=True)
    shutil.copyfile("/bin/sh", node)
    node.chmod(0o755)
    package = tmp_path / "prefix" / "lib" / "node_modules" / "@scope" / "tool"
    read = 'cat "$(dirname "$(readlink -f "$0")")/../lib/version"'
    program = script(package / "bin" / "tool.js", read, "/usr/bin/env own-node")
    (package / "lib").mkdir()
    (package / "lib" / "version").write_text("tool 7.1")
    command = tmp_path / "prefix" / "bin" / "tool"
    command.parent.mkdir()
    command.symlink_to(f"../lib/node_modules/@scope/tool/bin/{program.name}")
    monkeypatch.setenv("PATH", f"{command.parent}:{node.parent}", prepend=":")
    own = card(tmp_path, Path("tool"))
    assert version_in_sandbox(own, held) == "tool 7.1"
    places = {path for path in exposed_paths(own) if path.is_relative_to(tmp_path)}
    assert places == {command, program, package, node}


@pytest.mark.parametrize(
    ("inside", "package"),
    [
        ("node_modules/tool/bin/x.js", "node_modules/tool"),
        ("node_modules/@s/tool/bin/x.js", "node_modules/@s/tool"),
        ("node_modules/outer/node_modules/inner/x.js", "node_modules/outer/node_modules/inner"),
        ("lib/node_modules/a/node_modules/@s/b/c/x.js", "lib/node_modules/a/node_modules/@s/b"),
        ("modules/tool/x.js", None),
    ],
)
def test_the_package_of_a_program_is_the_innermost(tmp_path, inside, package):
    program = script(tmp_path / inside, "true")
    places = {
        path for path in exposed_paths(card(tmp_path, program)) if path.is_relative_to(tmp_path)
    }
    assert places == {program, *([tmp_path / package] if package else [])}


def test_words_of_env_are_not_the_interpreter(tmp_path, monkeypatch):
    node = script(tmp_path / "bin" / "own-node", "true")
    program = script(tmp_path / "tool", "", "/usr/bin/env -S own-node -x")
    monkeypatch.setenv("PATH", str(node.parent), prepend=":")
    assert {program, node} <= {*exposed_paths(card(tmp_path, program))}


def test_check_says_that_an_agent_does_not_start_with_what_it_is_shown(tmp_path, held, capsys):
    program = script(tmp_path / "bin" / "my-agent", f"cat {tmp_path}/share/version")
    (tmp_path / "share").mkdir()
    (tmp_path / "share" / "version").write_text("mine 2.0")
    own = card(tmp_path, program)
    with pytest.raises(AgentNotStartedError, match="No such file"):
        version_in_sandbox(own, held)
    assert cli.run(["agent", "check", str(own.path)]) == 1
    assert "does not start in the agent's sandbox" in capsys.readouterr().out
    card(tmp_path, program, "share")
    cli.run(["agent", "check", str(own.path)])
    said = capsys.readouterr().out
    assert "mine 2.0" in said
    assert "does not start" not in said


@pytest.mark.parametrize(
    ("shown", "kept"),
    [
        ("data", "data/track.json"),  # the truth is usually beside the track
        ("data", "data/photos/val"),
        ("data/photos/val/tools", "data/photos"),
        ("data", "data"),
        ("~", "data"),
        ("/", "data"),
    ],
)
def test_no_card_shows_what_an_agent_may_not_see(tmp_path, monkeypatch, shown, kept):
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    for name in ("home", "data/photos/val/tools", "agents"):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / "data" / "track.json").write_text("{}")
    program = script(tmp_path / "agents" / "my-agent", "true")
    refuse_exposed(card(tmp_path, program, "agents"), [tmp_path / kept])
    with pytest.raises(UsageError, match="would be shown"):
        refuse_exposed(card(tmp_path, program, shown), [tmp_path / kept])


def test_what_every_program_is_shown_holds_no_photos(tmp_path):
    own = card(tmp_path, script(tmp_path / "my-agent", "true"))
    with pytest.raises(UsageError, match="would be shown /usr"):
        refuse_exposed(own, [Path("/usr/share/photos")])


def test_a_card_that_shows_what_is_not_there_says_so(tmp_path):
    own = card(tmp_path, script(tmp_path / "my-agent", "true"), "lib")
    with pytest.raises(UsageError, match="not there"):
        exposed_paths(own)


def test_a_server_that_does_not_answer_in_the_sandbox_is_said_in_one_line(
    tmp_path, held, monkeypatch
):
    python = script(tmp_path / "python", "echo no module named mcp; exit 3")
    monkeypatch.setattr(handshake, "server_python", lambda: python)
    monkeypatch.setattr(handshake, "blender_server", lambda *_: SERVER)
    own = card(tmp_path, script(tmp_path / "my-agent", "true"), "python")
    with pytest.raises(AgentNotStartedError) as raised:
        handshake.offered_tools(own, held)
    said = str(raised.value)
    assert "exit code 3; no module named mcp" in said
    assert "\n" not in said
    script(tmp_path / "python", "true")
    with pytest.raises(AgentNotStartedError, match="exit code 0"):
        handshake.offered_tools(own, held)
