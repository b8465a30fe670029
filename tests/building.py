"""Scenes built by one Blender for many tests; run as a program, that Blender.

The program reads lines of JSON, {"program", "folder"}, and answers each with one: the traceback of
the program, or null. Each program begins with Blender's factory settings.
"""

from __future__ import annotations

import json
import os
import sys
import traceback
from pathlib import Path
from typing import IO

from asked import AskedProgram, EndedError


class SceneBuilder:
    """Runs bpy programs; their process is started with the first. log: what Blender prints."""

    def __init__(self, log: IO[bytes]) -> None:
        self._log = log
        self._blender: AskedProgram | None = None

    def run(self, program: str, folder: Path) -> None:
        """Run a program whose last argument is the folder; AssertionError with what went wrong."""
        self._blender = self._blender or AskedProgram(Path(__file__), self._log)
        try:
            wrong = self._blender.ask({"program": program, "folder": str(folder)})
        except EndedError as ended:
            self.close()
            self._log.seek(0)
            said = self._log.read().decode("utf-8", "replace")
            wrong = f"{said}\n{ended}" if ended.exit_code else None  # some programs leave by _exit
        assert wrong is None, wrong[-3000:]

    def close(self) -> None:
        """End Blender."""
        if self._blender is not None:
            self._blender.close()
            self._blender = None


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
