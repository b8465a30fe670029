"""Settings of three harnesses: added to and restored byte for byte, or left alone."""

from __future__ import annotations

import json
import subprocess
import tomllib

import pytest

from legoworld.cli import run
from legoworld.plugin.install import InstallPlan, SettingsError, hook_command, install
from legoworld.plugin.json_text import add_value, remove_fragments

HOOKS = {"claude": ".claude/settings.json", "codex": ".codex/hooks.json",
         "cursor": ".cursor/hooks.json"}  # fmt: skip
SERVERS = {"claude": ".mcp.json", "codex": ".codex/config.toml", "cursor": ".cursor/mcp.json"}
STOP = {"claude": "Stop", "codex": "Stop", "cursor": "stop"}
OURS = {"hooks": [{"type": "command", "command": "mine", "timeout": 5}]}

#: Settings as people keep them.
JSON_TEXTS = [
    "{}",
    "{\n}\n",
    '{"version":1,"permissions":{"allow":["Bash(ls:*)"],"deny":[]}}',
    '{\n\t"version": 1,\r\n\t"hooks": {}\n}',
    '{\n  "version": 1,\n  "hooks": {\n    "Stop": [],\n    "stop": []\n  }\n}\n',
    json.dumps({"version": 1, "hooks": {"Stop": [OURS], "stop": [{"command": "x"}]}}, indent=4),
    '{"version": 1, "mcpServers": {"blender": {"command": "uvx", "args": ["é{[,", "\\"}"]}}}  \n\n',
]


def do(*words):
    return run(["plugin", "install", *map(str, words)])


def project_with(folder, files):
    for path, text in files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_bytes(text.encode())
    return folder


def contents(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.mark.parametrize("dialect", HOOKS)
def test_an_empty_project_gets_server_hooks_and_skill_and_loses_them_again(tmp_path, dialect):
    words = ("--for", dialect, "--project", tmp_path, "--ledger", tmp_path / "case")
    assert do(*words, "--write") == 0
    first = contents(tmp_path)
    settings = json.loads(first[HOOKS[dialect]])
    assert "plugin hook --dialect " + dialect in json.dumps(settings["hooks"][STOP[dialect]])
    server = first[SERVERS[dialect]].decode()
    known = tomllib.loads(server)["mcp_servers"] if dialect == "codex" else (
        json.loads(server)["mcpServers"])  # fmt: skip
    assert known["legoworld"]["args"][:4] == ["-m", "legoworld", "plugin", "serve"]
    assert any(path.endswith("skills/legoworld/SKILL.md") for path in first)
    assert do(*words, "--write") == 0
    assert contents(tmp_path) == first
    assert do("--for", dialect, "--project", tmp_path, "--undo") == 0
    assert list(tmp_path.iterdir()) == []
    assert do("--for", dialect, "--project", tmp_path, "--undo") == 0


@pytest.mark.parametrize("text", JSON_TEXTS)
@pytest.mark.parametrize("dialect", HOOKS)
def test_other_settings_keep_every_byte(tmp_path, dialect, text):
    if dialect == "cursor" and "version" not in text:
        text = text.replace("{", '{"version": 1', 1)
    files = {HOOKS[dialect]: text}
    if dialect == "codex":
        files[SERVERS[dialect]] = 'model = "x" # mine\n[mcp_servers.blender]\ncommand = "uvx"'
    else:
        files[SERVERS[dialect]] = text
    before = contents(project_with(tmp_path, files))
    for ledger in ("one", "two"):  # the second replaces the first
        assert do("--for", dialect, "--project", tmp_path, "--ledger", ledger, "--write") == 0
    installed = json.loads((tmp_path / HOOKS[dialect]).read_bytes())
    hooks = installed.pop("hooks")
    old = json.loads(text)
    for event, entries in old.pop("hooks", {}).items():
        assert hooks[event][: len(entries)] == entries
    assert installed.pop("mcpServers", None) == old.pop("mcpServers", None) or dialect == "claude"
    assert installed == old
    assert sum("plugin hook" in json.dumps(h) for h in hooks[STOP[dialect]]) == 1
    assert do("--for", dialect, "--project", tmp_path, "--undo") == 0
    assert contents(tmp_path) == before


def test_what_a_user_adds_beside_it_stays(tmp_path):
    """Behind our entry, in a list that was made for it."""
    words = ("--for", "claude", "--project", tmp_path)
    do(*words, "--write")
    path = tmp_path / ".claude" / "settings.json"
    settings = json.loads(path.read_text())
    text = path.read_text()
    end = text.rindex("]")
    path.write_text(text[:end].rstrip() + ",\n" + json.dumps(OURS) + "\n" + text[end:])
    assert len(json.loads(path.read_text())["hooks"]["Stop"]) == len(settings["hooks"]["Stop"]) + 1
    assert do(*words, "--undo") == 0
    assert json.loads(path.read_text())["hooks"]["Stop"] == [OURS]


@pytest.mark.parametrize(
    ("dialect", "path", "text", "why"),
    [
        ("claude", ".claude/settings.json", '{"hooks": }', "not JSON"),
        ("claude", ".claude/settings.json", "// mine\n{}", "not JSON"),
        ("claude", ".claude/settings.json", "[]", "not an object"),
        ("claude", ".claude/settings.json", '{"hooks": []}', "hooks is not an object"),
        ("claude", ".claude/settings.json", '{"hooks": {"Stop": {}}}', "is there already"),
        ("claude", ".mcp.json", '{"mcpServers": {"legoworld": {}}}', "is there already"),
        ("codex", ".codex/config.toml", "model = ", "not TOML"),
        ("codex", ".codex/config.toml", "[mcp_servers.legoworld]\n", "is there already"),
        ("codex", ".codex/config.toml", "mcp_servers = {a = {}}\n", "cannot be added"),
        ("cursor", ".cursor/hooks.json", '{"version": 2}', "version 2"),
        ("cursor", ".cursor/hooks.json", "\ud800".encode("utf-8", "surrogatepass"), "utf-8"),
        ("cursor", ".cursor/skills/legoworld/SKILL.md", "mine", "another file"),
    ],
)
def test_broken_settings_are_refused_in_one_line_and_nothing_changes(
    tmp_path, capsys, dialect, path, text, why
):
    (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / path).write_bytes(text if isinstance(text, bytes) else text.encode())
    before = contents(tmp_path)
    assert do("--for", dialect, "--project", tmp_path, "--write") == 2
    said = capsys.readouterr().err
    assert why in said
    assert contents(tmp_path) == before


def test_what_was_edited_is_not_undone_by_guessing(tmp_path, capsys):
    words = ("--for", "claude", "--project", tmp_path)
    do(*words, "--write")
    path = tmp_path / ".claude" / "settings.json"
    path.write_text(path.read_text().replace("--dialect claude", "--dialect codex"))
    before = contents(tmp_path)
    assert do(*words, "--undo") == 2
    assert "were edited" in capsys.readouterr().err
    assert contents(tmp_path) == before


def test_without_write_the_settings_are_printed(tmp_path, capsys):
    assert do("--for", "cursor", "--project", tmp_path) == 0
    said = capsys.readouterr().out
    assert "# .cursor/hooks.json" in said
    assert "failClosed" in said
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("gone", [False, True])
def test_the_command_blocks_when_its_program_fails_or_is_gone(tmp_path, gone):
    """As a shell of the harness runs it: a code other than 0 or 2 would let the call pass."""
    wanted = InstallPlan(dialect="claude", project=tmp_path, ledger=tmp_path / "case's", serve=(),
                    require_transaction=False)  # fmt: skip
    command = hook_command(wanted)
    if gone:
        command = command.replace("python", "no-such-python")
    done = subprocess.run(["/bin/sh", "-c", command], input=b"{}", capture_output=True, check=False)
    assert done.returncode == 2
    assert done.stderr.strip()


def test_settings_are_linked_files_too(tmp_path):
    real = tmp_path / "dotfiles.json"
    real.write_text("{}")
    project = tmp_path / "project"
    (project / ".claude").mkdir(parents=True)
    (project / ".claude" / "settings.json").symlink_to(real)
    words = ("--for", "claude", "--project", project)
    do(*words, "--write")
    assert (project / ".claude" / "settings.json").is_symlink()
    assert "hooks" in json.loads(real.read_text())
    do(*words, "--undo")
    assert real.read_text() == "{}"


def test_one_file_that_cannot_be_changed_leaves_all_alone(tmp_path):
    project_with(tmp_path, {".claude/settings.json": "[", ".mcp.json": "{}"})
    wanted = InstallPlan(dialect="claude", project=tmp_path, ledger=tmp_path, serve=(),
                    require_transaction=True)  # fmt: skip
    with pytest.raises(SettingsError):
        install(wanted)


@pytest.mark.parametrize("text", JSON_TEXTS)
def test_adding_and_removing_are_inverse(text):
    paths = [(("hooks", "A"), [{"x": [1, "]"]}]), (("hooks", "Stop"), [1, {"y": None}]),
             (("deep", "er", "est"), {"z": True})]  # fmt: skip
    after, fragments = text, []
    for path, value in paths:
        after, more = add_value(after, path, value)
        fragments += more
    document = json.loads(after)
    assert document["hooks"]["A"] == [{"x": [1, "]"]}]
    assert document["hooks"]["Stop"][-2:] == [1, {"y": None}]
    assert document["deep"] == {"er": {"est": {"z": True}}}
    assert remove_fragments(after, fragments) == text


@pytest.mark.parametrize("dialect", HOOKS)
def test_the_hooks_of_each_harness_are_these(tmp_path, dialect):
    """What blocks a call where the hook does not end well is part of them."""
    words = ("--for", dialect, "--project", tmp_path, "--ledger", tmp_path / "case")
    assert do(*words, "--require-transaction", "--write") == 0
    hooks = json.loads((tmp_path / HOOKS[dialect]).read_bytes())["hooks"]
    plan = InstallPlan(
        dialect=dialect, project=tmp_path, serve=(), ledger=tmp_path / "case",
        require_transaction=True,
    )  # fmt: skip
    command = hook_command(plan)
    assert command.endswith("--require-transaction || exit 2")
    if dialect == "cursor":
        assert hooks == {
            "beforeMCPExecution": [{"command": command, "failClosed": True}],
            "afterMCPExecution": [{"command": command}],
            "stop": [{"command": command, "loop_limit": 8}],
        }
        return
    timeout = hooks["Stop"][0]["hooks"][0]["timeout"]
    assert timeout >= 10
    run = [{"type": "command", "command": command, "timeout": timeout}]
    names = "execute_blender_code|execute_code|set_texture|download_.*|import_.*|generate_.*"
    matched = [{"matcher": f"mcp__.*__({names})", "hooks": run}]
    assert hooks == {"PreToolUse": matched, "PostToolUse": matched, "Stop": [{"hooks": run}]}
