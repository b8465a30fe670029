"""`legoworld plugin install`: the MCP server, the hooks and the skill in a project's settings.

Settings are changed as text: what is there keeps every byte, and undoing takes out what was put in.
A file beside them records that, by fragments.
"""

from __future__ import annotations

import json
import shlex
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, cast

from legoworld.errors import LegoWorldError, cause
from legoworld.files import Json, write_text
from legoworld.plugin.hooks import EDITING, EDITING_STARTS, MOST_BLOCKS, Dialect
from legoworld.plugin.json_text import add_value, remove_fragments
from legoworld.records.base import RecordError, decode, readable
from legoworld.records.plugin_install import InstalledFile, SettingsChange

RECORD: Final = "legoworld-plugin.json"
_FOLDER: Final[dict[Dialect, str]] = {
    "claude": ".claude", "codex": ".codex", "cursor": ".cursor",
}  # fmt: skip
_SKILL: Final[dict[Dialect, str]] = {
    "claude": ".claude/skills/legoworld/SKILL.md",
    "codex": ".agents/skills/legoworld/SKILL.md",
    "cursor": ".cursor/skills/legoworld/SKILL.md",
}
_TIMEOUT_S: Final = 30
_NAME: Final = "legoworld"
#: Keys from the root of a file, and what is added there.
_Addition = tuple[tuple[str, ...], Json]


class SettingsError(LegoWorldError):
    """A harness's settings cannot be changed safely; nothing was."""

    code = "settings"


@dataclass(frozen=True, kw_only=True)
class InstallPlan:
    """What is installed. project: the folder of the settings; serve: words after `plugin serve`."""

    dialect: Dialect
    project: Path
    ledger: Path
    serve: tuple[str, ...]
    require_transaction: bool


@dataclass(frozen=True, kw_only=True)
class SettingsFile:
    """A settings file: its path in the project, and its text before and after; None: no file."""

    path: str
    before: str | None
    after: str | None


def install(plan: InstallPlan) -> list[SettingsFile]:
    """Plan an installation without writing; an existing one is replaced.

    SettingsError for settings that are broken, or have another server of this name.
    """
    texts = {w.path: w.after for w in uninstall(plan.dialect, plan.project)}
    files = []
    for path, skeleton, additions in _contents(plan):
        known = texts[path] if path in texts else _text(plan.project / path)
        text = skeleton if known is None else known
        fragments: list[str] = []
        for where, value in additions:
            text, more = _add_setting(path, text, where, value)
            fragments += more
        files.append(
            SettingsChange(path=path, skeleton=skeleton if known is None else None,
                  fragments=tuple(fragments))
        )  # fmt: skip
        texts[path] = text
    texts[_record(plan.dialect)] = readable(InstalledFile(files=tuple(files)))
    return [_settings_file(plan.project, path, text) for path, text in texts.items()]


def uninstall(dialect: Dialect, project: Path) -> list[SettingsFile]:
    """Plan an uninstallation without writing; empty if nothing is installed.

    SettingsError where what was added has been edited since.
    """
    record = _text(project / _record(dialect))
    if record is None:
        return []
    try:
        installed = decode(InstalledFile, record)
    except RecordError as error:
        raise _settings_error(_record(dialect), str(error)) from error
    changed = [_settings_file(project, f.path, _restore_text(project, f)) for f in installed.files]
    return [*changed, _settings_file(project, _record(dialect), None)]


def write(project: Path, changes: Sequence[SettingsFile]) -> None:
    """Write what `install` or `uninstall` said; folders that become empty go."""
    for change in changes:
        path = (project / change.path).resolve()
        if change.after is not None:
            if change.after != change.before:
                write_text(path, change.after)
        elif path.exists():
            path.unlink()
            folder = path.parent
            while folder != project.resolve() and not any(folder.iterdir()):
                folder.rmdir()
                folder = folder.parent


def _contents(plan: InstallPlan) -> Iterator[tuple[str, str, list[_Addition]]]:
    """Each file: its path, its text where there is none yet, and what is added to it."""
    server = {"command": sys.executable, "args": ["-m", "legoworld", "plugin", "serve",
                                                  *plan.serve]}  # fmt: skip
    mcp: list[_Addition] = [(("mcpServers", _NAME), server)]
    folder = _FOLDER[plan.dialect]
    if plan.dialect == "claude":
        yield ".mcp.json", "{}\n", mcp
        yield f"{folder}/settings.json", "{}\n", list(_matched_hooks(plan))
    elif plan.dialect == "codex":
        yield f"{folder}/config.toml", "", [((), server)]
        yield f"{folder}/hooks.json", "{}\n", list(_matched_hooks(plan))
    else:
        yield f"{folder}/mcp.json", "{}\n", mcp
        yield f"{folder}/hooks.json", '{\n  "version": 1\n}\n', list(_cursor_hooks(plan))
    yield (
        _SKILL[plan.dialect],
        "",
        [((), (Path(__file__).with_name("SKILL.md")).read_text("utf-8"))],
    )


def _matched_hooks(plan: InstallPlan) -> Iterator[_Addition]:
    """Claude Code's form, which Codex shares."""
    names = "|".join([*EDITING, *(f"{start}.*" for start in EDITING_STARTS)])
    run: Json = {"type": "command", "command": hook_command(plan), "timeout": _TIMEOUT_S}
    for event in ("PreToolUse", "PostToolUse"):
        yield ("hooks", event), [{"matcher": f"mcp__.*__({names})", "hooks": [run]}]
    yield ("hooks", "Stop"), [{"hooks": [run]}]


def _cursor_hooks(plan: InstallPlan) -> Iterator[_Addition]:
    run: dict[str, Json] = {"command": hook_command(plan)}
    yield ("hooks", "beforeMCPExecution"), [{**run, "failClosed": True}]
    yield ("hooks", "afterMCPExecution"), [run]
    yield ("hooks", "stop"), [{**run, "loop_limit": MOST_BLOCKS}]


def hook_command(plan: InstallPlan) -> str:
    """The hook as a shell runs it: whatever ends it, a program that is gone included, blocks.

    The harnesses let a call pass when its hook ends with any code but 0 and 2.
    """
    words = [sys.executable, "-m", "legoworld", "plugin", "hook", "--dialect", plan.dialect,
             "--ledger", str(plan.ledger)]  # fmt: skip
    if plan.require_transaction:
        words.append("--require-transaction")
    return f"{shlex.join(words)} || exit 2"


def _add_setting(
    path: str, text: str, where: tuple[str, ...], value: Json
) -> tuple[str, list[str]]:
    if path.endswith(".json"):
        try:
            document = json.loads(text)
        except ValueError as error:
            raise _settings_error(path, f"not JSON: {error}") from error
        version = document.get("version") if isinstance(document, dict) else 1
        if path.endswith("cursor/hooks.json") and version != 1:
            raise _settings_error(path, f"version {version!r}, not 1")
        try:
            return add_value(text, where, value)
        except ValueError as error:
            raise _settings_error(path, str(error)) from error
    if path.endswith(".toml"):
        return _add_table(path, text, cast("Mapping[str, Json]", value))
    if text and text != value:
        raise _settings_error(path, "another file of that name")
    return str(value), [] if text else [str(value)]


def _add_table(path: str, text: str, server: Mapping[str, Json]) -> tuple[str, list[str]]:
    try:
        servers = tomllib.loads(text).get("mcp_servers", {})
    except tomllib.TOMLDecodeError as error:
        raise _settings_error(path, f"not TOML: {error}") from error
    if _NAME in servers:
        raise _settings_error(path, f"mcp_servers.{_NAME} is there already")
    gap = "" if not text else "\n" if text.endswith("\n") else "\n\n"
    # JSON's strings and lists of strings are TOML's, too.
    table = f"{gap}[mcp_servers.{_NAME}]\n" + "".join(
        f"{key} = {json.dumps(value)}\n" for key, value in server.items()
    )
    try:
        tomllib.loads(text + table)
    except tomllib.TOMLDecodeError as error:
        raise _settings_error(path, f"a table cannot be added: {error}") from error
    return text + table, [table]


def _restore_text(project: Path, file: SettingsChange) -> str | None:
    """A file's text without what was put in; None where it then is as it was made."""
    text = _text(project / file.path)
    if text is None:
        return None
    if file.path.endswith(".json"):
        try:
            text = remove_fragments(text, list(file.fragments))
        except ValueError as error:
            raise _edited_error(file.path) from error
    else:
        for fragment in file.fragments:
            if text.count(fragment) != 1:
                raise _edited_error(file.path)
            text = text.replace(fragment, "")
    return None if text == file.skeleton else text


def _text(path: Path) -> str | None:
    """A file's text, line ends as they are; None where there is none."""
    try:
        return path.read_bytes().decode("utf-8")
    except FileNotFoundError:
        return None
    except (UnicodeDecodeError, OSError) as error:
        raise _settings_error(path.name, cause(error)) from error


def _settings_file(project: Path, path: str, after: str | None) -> SettingsFile:
    return SettingsFile(path=path, before=_text(project / path), after=after)


def _record(dialect: Dialect) -> str:
    return f"{_FOLDER[dialect]}/{RECORD}"


def _settings_error(path: str, found: str) -> SettingsError:
    return SettingsError(
        f"{path} cannot be changed",
        found=found,
        expected="settings that the harness itself can read",
        next_step="correct the file, or add the printed settings by hand",
    )


def _edited_error(path: str) -> SettingsError:
    return SettingsError(
        f"the lines that legoworld added to {path} were edited",
        found="lines that differ from those added",
        expected=f"the lines that {RECORD} names",
        next_step=f"remove legoworld's lines by hand, then delete {RECORD}",
    )
