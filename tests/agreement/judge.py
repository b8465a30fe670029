"""Asking the judge: the Cycles process, started once and asked for one scene after another."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import IO, Self

from agreement.comparison import ObjectPicture, read_judgement
from asked import AskedProgram, EndedError


class JudgeError(Exception):
    """Cycles could not render the scene, or its process ended."""


class Judge:
    """A running `cycles_pass.py`; a context manager. log: where Blender's own output goes."""

    def __init__(self, log: IO[bytes]) -> None:
        self._cycles = AskedProgram(Path(__file__).with_name("cycles_pass.py"), log)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._cycles.close()

    def picture_of(self, blend: Path, size_wh: tuple[int, int], output: Path) -> ObjectPicture:
        """Cycles' picture of a .blend; `output` (.npz) keeps it. Raises JudgeError."""
        request = {"blend": str(blend.resolve()), "size_wh": size_wh, "output": str(output)}
        try:
            answer = self._cycles.ask(request)
        except EndedError as error:
            raise JudgeError(f"the Cycles process and {blend.name}: {error}") from error
        if not answer["ok"]:
            raise JudgeError(answer["error"])
        return read_judgement(output)
