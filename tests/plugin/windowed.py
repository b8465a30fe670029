"""A Blender with a window, on a display of its own, and mcp-for-blender's own add-on in it."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import pytest
from waiting import PATIENCE_S, until

from legoworld.agents.mcp_server import server_folder, server_problems

#: Whatever becomes of the tests, their programs end after it.
_HARD_END_S = 1800

#: Run in Blender: the add-on as it comes, on a port that is free; it says which once it listens.
_START = """
import bpy, importlib.util, json, os, sys
addon, said = sys.argv[sys.argv.index("--") + 1:]

def say(**words):
    with open(said + ".part", "w", encoding="utf-8") as stream:
        json.dump(words, stream)
    os.replace(said + ".part", said)

def listening():
    server = bpy.types.blendermcp_server
    if server.socket is None:
        say(error="the add-on's server does not listen")
    else:
        say(port=server.socket.getsockname()[1], version=list(bpy.app.version[:2]),
            windows=0 if bpy.app.background else len(bpy.context.window_manager.windows))

try:
    spec = importlib.util.spec_from_file_location("blender_mcp_addon", addon)
    module = sys.modules["blender_mcp_addon"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.register()
    bpy.types.blendermcp_server = module.BlenderMCPServer(host="127.0.0.1", port=0)
    bpy.types.blendermcp_server.start()
    bpy.app.timers.register(listening)  # run once there is a window
except Exception as error:
    say(error=f"{type(error).__name__}: {error}")
"""


@dataclass(frozen=True, kw_only=True)
class Windowed:
    """A windowed Blender. version: (major, minor); folder: where it was started; log: its words."""

    port: int
    version: tuple[int, int]
    windows: int
    folder: Path
    log: Path


def _needs() -> tuple[str, str, Path]:
    """Blender, Xvfb and the add-on; skips where one is not there."""
    blender, xvfb = shutil.which("blender"), shutil.which("Xvfb")
    if blender is None or xvfb is None:
        pytest.skip("no Blender with a window here: apt-get install blender xvfb python3-requests")
    if problems := server_problems():
        pytest.skip("; ".join(problems))
    found = sorted(server_folder().glob("lib/python*/site-packages/blender_mcp/bundled/addon.py"))
    assert found, f"mcp-for-blender in {server_folder()} has no add-on"
    return blender, xvfb, found[0]


@contextmanager
def windowed_blender(folder: Path) -> Iterator[Windowed]:
    """Start it in a folder, and end it with everything it started. Skips where it cannot be had."""
    blender, xvfb, addon = _needs()
    started, said = folder / "start.py", folder / "said.json"
    started.write_text(_START, encoding="utf-8")
    work = folder / "work"
    work.mkdir()
    with contextlib.ExitStack() as ending:
        environment = _own_environment(folder) | {"DISPLAY": _display(xvfb, folder, ending)}
        log = ending.enter_context((folder / "blender.log").open("wb"))
        command = [blender, "--factory-startup", "--disable-autoexec", "--python-exit-code", "3"]
        command += ["--window-geometry", "0", "0", "640", "480", "--python", str(started)]
        process = _group(
            [*command, "--", str(addon), str(said)], log, ending, env=environment, cwd=work
        )
        until(lambda: said.exists() or process.poll() is not None, "Blender's window")
        words = _words(said, Path(log.name))
        yield Windowed(
            port=words["port"],
            version=(words["version"][0], words["version"][1]),
            windows=words["windows"],
            folder=work,
            log=Path(log.name),
        )


def _words(said: Path, log: Path) -> dict[str, Any]:
    """What the start in Blender said; skips where Blender has no display or lacks a package."""
    if not said.exists():
        last = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()[-1:]
        pytest.skip(f"Blender opens no window here: {''.join(last)[:200]}")
    words: dict[str, Any] = json.loads(said.read_text(encoding="utf-8"))
    error = str(words.get("error", ""))
    if error.startswith("ModuleNotFoundError"):
        pytest.skip(f"Blender's Python lacks what the add-on imports: {error}")
    assert not error, error
    return words


def _display(xvfb: str, folder: Path, ending: contextlib.ExitStack) -> str:
    """A display of its own, by the number that the server chose."""
    read, write = os.pipe()
    log = ending.enter_context((folder / "xvfb.log").open("wb"))
    arguments = ["-displayfd", str(write), "-screen", "0", "640x480x24", "-nolisten", "tcp"]
    process = _group([xvfb, *arguments], log, ending, pass_fds=(write,))
    os.close(write)
    with os.fdopen(read) as stream:
        number = stream.readline().strip()
    if not number:
        process.wait(PATIENCE_S)
        pytest.skip(f"Xvfb does not start here: exit code {process.returncode}")
    return f":{number}"


def _own_environment(folder: Path) -> dict[str, str]:
    """No settings of the user's, OpenGL by the processor, and no look for a newer add-on."""
    own = {"HOME": folder / "home", "XDG_RUNTIME_DIR": folder / "run"}
    own |= {f"BLENDER_USER_{kind}": folder / kind.lower() for kind in ("CONFIG", "SCRIPTS")}
    for path in own.values():
        path.mkdir(mode=0o700)
    kept = {k: v for k, v in os.environ.items() if k in ("PATH", "LANG", "LC_ALL", "TMPDIR")}
    said = {"LIBGL_ALWAYS_SOFTWARE": "1", "BLENDERMCP_NO_UPDATE_CHECK": "1"}
    return kept | {k: str(v) for k, v in own.items()} | said


def _group(
    command: list[str], log: IO[bytes], ending: contextlib.ExitStack, **settings: Any
) -> subprocess.Popen[bytes]:
    """A program in a group of its own, which ends with the block and, without it, by the clock."""
    if timeout := shutil.which("timeout"):
        command = [timeout, "--kill-after=10", str(_HARD_END_S), *command]
    process = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True,
        **settings,
    )  # fmt: skip

    def end() -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait(PATIENCE_S)

    ending.callback(end)
    return process
