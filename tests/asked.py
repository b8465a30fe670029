"""A Python program that is started once and asked one line of JSON after another."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import IO, Any


class EndedError(Exception):
    """The program ended without an answer. exit_code: negative for a signal."""

    def __init__(self, exit_code: int) -> None:
        self.exit_code = exit_code
        super().__init__(f"it ended without an answer: exit code {exit_code}")


class AskedProgram:
    """A running program. log: where what it prints besides its answers goes."""

    def __init__(self, program: Path, log: IO[bytes]) -> None:
        # A killed Blender leaves its folder for temporary files behind.
        self._temporary = tempfile.TemporaryDirectory(prefix="asked-")
        self._process = subprocess.Popen(
            [sys.executable, str(program)],
            env={**os.environ, "TMPDIR": self._temporary.name},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=log,
            text=True,
            encoding="utf-8",
        )

    def ask(self, request: dict[str, Any]) -> Any:
        """The answer, a JSON value. EndedError where there is none."""
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            process.stdin.write(json.dumps(request) + "\n")
            process.stdin.flush()
        except BrokenPipeError as error:
            raise EndedError(process.wait()) from error
        line = process.stdout.readline()
        if not line:
            raise EndedError(process.wait())
        return json.loads(line)

    def close(self) -> None:
        """End the program."""
        self._process.kill()
        self._process.communicate()
        self._temporary.cleanup()
