"""Asking the judge: the Cycles process, started once and asked for one scene after another."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from types import TracebackType
from typing import IO, Self

from agreement.comparison import ObjectPicture, read_judgement


class JudgeError(Exception):
    """Cycles could not render the scene, or its process ended."""


class Judge:
    """A running `cycles_pass.py`; a context manager. log: where Blender's own output goes."""

    def __init__(self, log: IO[bytes]) -> None:
        # A killed Blender leaves its folder for temporary files behind.
        self._temporary = tempfile.TemporaryDirectory(prefix="judge-")
        self._process = subprocess.Popen(
            [sys.executable, str(Path(__file__).with_name("cycles_pass.py"))],
            env={**os.environ, "TMPDIR": self._temporary.name},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=log,
            text=True,
            encoding="utf-8",
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._process.kill()
        self._process.communicate()
        self._temporary.cleanup()

    def picture_of(self, blend: Path, size_wh: tuple[int, int], output: Path) -> ObjectPicture:
        """Cycles' picture of a .blend; `output` (.npz) keeps it. Raises JudgeError."""
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        request = {"blend": str(blend.resolve()), "size_wh": size_wh, "output": str(output)}
        try:
            process.stdin.write(json.dumps(request) + "\n")
            process.stdin.flush()
        except BrokenPipeError as error:
            raise JudgeError("the Cycles process has ended") from error
        line = process.stdout.readline()
        if not line:
            raise JudgeError(f"the Cycles process ended over {blend.name}")
        answer = json.loads(line)
        if not answer["ok"]:
            raise JudgeError(answer["error"])
        return read_judgement(output)
