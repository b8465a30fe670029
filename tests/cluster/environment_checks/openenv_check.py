"""Run by a Python that has OpenEnv: its own validation of the package, and episodes, as JSON.

python openenv_check.py PACKAGE EMPTY_ROOM ORACLE_SCENE; dataset, command, root: LEGOWORLD_*.
"""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import time
import urllib.request
from importlib.metadata import version
from pathlib import Path
from typing import Any

from legoworld_environments.openenv import (  # pyright: ignore[reportMissingImports]
    PhotoToBlenderEnv,
    SceneAction,
)
from openenv.cli._validation import (  # pyright: ignore[reportMissingImports]
    validate_running_environment,
)
from openenv.validation import Level, run_validation  # pyright: ignore[reportMissingImports]
from openenv.validation.types import ProviderCapability  # pyright: ignore[reportMissingImports]


class Server:
    """The app in a process of its own: what OpenEnv calls a running subject."""

    def __init__(self, **settings: str) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        self.base_url = f"http://127.0.0.1:{port}"
        app = "legoworld_environments.openenv.server.app:app"
        self._process = subprocess.Popen(
            [sys.executable, "-m", "uvicorn", app, "--port", str(port), "--log-level", "warning"],
            env={**os.environ, **settings}, stdout=sys.stderr,
        )  # fmt: skip
        for _ in range(600):
            try:
                urllib.request.urlopen(f"{self.base_url}/health", timeout=5)
            except OSError:
                time.sleep(0.2)
            else:
                return
        raise RuntimeError("the server does not answer")

    def inspect(self) -> dict[str, Any]:
        return {}

    def stop(self) -> None:
        self._process.terminate()
        self._process.wait()


class WithoutContainers:
    """OpenEnv's provider of subjects, as a process: nothing here needs Docker."""

    name = "process"
    capabilities = frozenset({ProviderCapability.IMAGE_BUILD})
    supported_network_modes = frozenset({"public"})

    def build(self, root: Path, execution: Any) -> str:
        assert (root / execution.dockerfile).is_file()
        return "sha256:" + "0" * 64

    def start(self, _spec: Any) -> Server:
        return Server()


def episode(url: str, seed: int, *actions: SceneAction) -> list[dict[str, Any]]:
    """What each step of an episode gives."""
    with PhotoToBlenderEnv(base_url=url, message_timeout_s=600).sync() as client:
        begun = client.reset(seed=seed).observation
        told = [{"image_id": begun.image_id, "turns_left": begun.turns_left,
                 "picture": len(begun.picture_png_base64)}]  # fmt: skip
        for action in actions:
            done = client.step(action)
            told.append({"reward": done.reward, "done": done.done,
                         "turns_left": done.observation.turns_left,
                         "feedback": done.observation.feedback})  # fmt: skip
        return told


def main() -> None:
    package, room, oracle = Path(sys.argv[1]), Path(sys.argv[2]).read_text("utf-8"), sys.argv[3]
    floor, best = SceneAction(program=room), SceneAction(scene=oracle)
    report = run_validation(package, max_level=Level.RUNTIME, provider=WithoutContainers())
    found: dict[str, Any] = {
        "openenv": version("openenv"),
        "checks": {one.check_id: [one.status.value, *one.evidence] for one in report.results},
    }
    command = [str(Path(sys.executable).with_name("openenv")), "validate", str(package)]
    static = subprocess.run([*command, "--level", "static"], capture_output=True, check=False)
    found["static"] = static.returncode
    server = Server(LEGOWORLD_TURNS="2", LEGOWORLD_FEEDBACK="residuals")
    try:
        running = validate_running_environment(server.base_url)
        found["running"] = {one["id"]: one["passed"] for one in running["criteria"]}
        found["many_turns"] = episode(server.base_url, 0, floor, best)
    finally:
        server.stop()
    server = Server(LEGOWORLD_TURNS="2", LEGOWORLD_FEEDBACK="none")
    try:
        found["blind"] = episode(server.base_url, 0, best, best)
        ended = SceneAction(scene=oracle, final=True)
        found["ended"] = episode(server.base_url, 0, ended)
        outside = SceneAction(scene="../private", final=True)
        try:
            episode(server.base_url, 0, outside)
        except Exception as error:  # noqa: BLE001  whatever it is, it says why
            found["outside"] = str(error)
    finally:
        server.stop()
    print("\n" + json.dumps(found))


if __name__ == "__main__":
    main()
