"""Scenes built by one Blender for many tests; run as a program, that Blender.

The program reads lines of JSON, {"program", "folder"}, and answers each with one: the traceback of
the program, or null. Each program begins with Blender's factory settings.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import traceback
from pathlib import Path
from types import TracebackType
from typing import Self


class SceneBuilder:
    """Runs bpy programs; their process is started with the first. A context manager."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[str] | None = None
        # A Blender that is killed leaves its folder for temporary files behind.
        self._temporary = tempfile.TemporaryDirectory(prefix="builder-")
        self._log = Path(self._temporary.name, "log")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._end()
        self._temporary.cleanup()

    def run(self, program: str, folder: Path) -> None:
        """Run a program whose last argument is the folder; AssertionError with what went wrong."""
        process = self._process = self._process or self._started()
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(json.dumps({"program": program, "folder": str(folder)}) + "\n")
        process.stdin.flush()
        answer = process.stdout.readline()
        if not answer:
            self._end()
            raise AssertionError(self._log.read_text("utf-8", "replace")[-3000:])
        wrong = json.loads(answer)
        assert wrong is None, wrong[-3000:]

    def _started(self) -> subprocess.Popen[str]:
        with self._log.open("wb") as log:
            return subprocess.Popen(
                [sys.executable, __file__],
                env={**os.environ, "TMPDIR": self._temporary.name},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                text=True,
                encoding="utf-8",
            )

    def _end(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None


def main() -> None:
    """Build what is asked for until the input ends."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    import bpy

    for line in sys.stdin:
        request = json.loads(line)
        bpy.ops.wm.read_factory_settings()
        sys.argv = ["-c", request["folder"]]
        try:
            exec(compile(request["program"], "<program>", "exec"), {"__name__": "__main__"})
            wrong = None
        except Exception:  # noqa: BLE001  it is the test's to say
            wrong = traceback.format_exc()
        answers.write(json.dumps(wrong) + "\n")
        answers.flush()
    os._exit(0)


if __name__ == "__main__":
    main()
