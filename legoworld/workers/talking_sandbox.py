"""An interactive program in the sandbox: its input, output and log are pipes."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from legoworld.workers.sandbox import Sandbox, parse_exit_code


@dataclass(frozen=True, kw_only=True)
class Pipes:
    """The three pipes of a program. They are their owner's to close, once it has ended."""

    stdin: IO[bytes]
    stdout: IO[bytes]
    stderr: IO[bytes]


class TalkingSandbox(Sandbox):
    """A `Sandbox` whose program can use the GPUs and is limited only in file size."""

    _code: int | None = None

    def converse(
        self,
        argv: Sequence[str],
        environment: Mapping[str, str],
        *,
        read_only: Sequence[Path],
        writable: Sequence[Path] = (),
    ) -> Pipes:
        """Start a program. environment: all of it, with paths as the program sees them.

        writable: folders it can write to besides the scratch folder, under their own names.
        """
        (read_input, stdin), (stdout, output), (stderr, log) = os.pipe(), os.pipe(), os.pipe()
        pipes = Pipes(
            stdin=os.fdopen(stdin, "wb"),
            stdout=os.fdopen(stdout, "rb"),
            stderr=os.fdopen(stderr, "rb"),
        )
        ends = (read_input, output, log)
        shown = {"read_only": read_only, "writable": writable, "accelerators": True}
        self._begin(argv, environment, ends, **shown)
        return pipes

    def poll_exit(self, *, within_s: float = 0.0) -> int | None:
        """The exit code, negative for a signal; None while it runs and after `close`."""
        if self._code is None and self._keeper is not None and self._keeper.answers(within_s):
            self._code = parse_exit_code(self._keeper.stdout.readline())
        return self._code
