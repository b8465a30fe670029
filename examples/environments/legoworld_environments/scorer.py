"""Scores of programs and scenes from a `legoworld bench serve` that runs in its own environment."""

from __future__ import annotations

import itertools
import json
import os
import shlex
import subprocess
import tempfile
import threading
from collections.abc import Sequence
from concurrent.futures import Future
from functools import lru_cache
from pathlib import Path
from typing import Any

from legoworld_environments.cases import dataset_folder

#: The command that is legoworld, where it is not on PATH: "/path/to/venv/bin/legoworld".
COMMAND = "LEGOWORLD_COMMAND"
#: How `legoworld execute` ends where a program is at fault, or has made a scene.
_PROGRAM_ENDINGS = (0, 1, 2, 5)


class ScoringError(RuntimeError):
    """No score: the scoring process ended or failed. Never a verdict on a submission."""


class Scorer:
    """One scoring process; any number of threads may ask it.

    render: False for R alone, without A and S. root: the folder that scenes lie below; a temporary
    one without it, so that no scene of an agent's choice is read. time_limit_s: of a program.
    """

    def __init__(
        self, dataset: str | Path | None = None, *, render: bool = True,
        root: str | Path | None = None, time_limit_s: float = 120, workers: int | None = None,
        command: Sequence[str] | None = None,
    ) -> None:  # fmt: skip
        self._command = [*(command or shlex.split(os.environ.get(COMMAND, "legoworld")))]
        self._made = tempfile.TemporaryDirectory(prefix="legoworld-submissions-", dir=root)
        self.root = Path(root or self._made.name).resolve()
        self._time_limit_s = time_limit_s
        options = [] if render else ["--no-render"]
        options += ["--workers", str(workers)] if workers else []
        self._server = subprocess.Popen(
            [*self._command, "bench", "serve", str(dataset_folder(dataset).resolve()),
             "--root", str(self.root), "--no-cache", *options],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )  # fmt: skip
        self._numbers, self._lock = itertools.count(), threading.Lock()
        self._waiting: dict[int, Future[dict[str, Any]]] = {}
        threading.Thread(target=self._read, daemon=True).start()

    def score_program(self, image_id: int, program: str) -> dict[str, Any]:
        """Run a program of an agent in legoworld's sandbox; the answer of `bench serve`.

        A program that stops is scored by the scene it has built until then, and one without a scene
        scores zero; `program_error` says what happened. Raises ScoringError.
        """
        with tempfile.TemporaryDirectory(dir=self._made.name) as folder:
            source, scene = Path(folder, "program.py"), Path(folder, "scene")
            source.write_text(program, "utf-8", errors="replace")
            done = subprocess.run(
                [*self._command, "execute", str(source), "-o", str(scene), "--time-limit",
                 str(self._time_limit_s), "-q"],
                stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False,
            )  # fmt: skip
            if done.returncode not in _PROGRAM_ENDINGS:
                raise ScoringError(f"legoworld execute ended with {done.returncode}: {done.stderr}")
            scene.mkdir(exist_ok=True)
            said = (done.stderr.strip() or done.stdout.strip()).partition("\n")[0]
            error = said if done.returncode else None
            return {**self.score_scene(image_id, scene), "program_error": error}

    def score_scene(self, image_id: int, scene: str | Path) -> dict[str, Any]:
        """The answer of `bench serve` to a scene folder below the root. Raises ScoringError."""
        future: Future[dict[str, Any]] = Future()
        with self._lock:
            number = next(self._numbers)
            self._waiting[number] = future
            line = json.dumps({"scene": str(scene), "image_id": image_id, "id": number})
            try:
                assert self._server.stdin is not None
                self._server.stdin.write(line.encode() + b"\n")
                self._server.stdin.flush()
            except (OSError, ValueError) as error:
                raise ScoringError("the scoring process has ended") from error
        answer = future.result()
        if answer["status"] in ("refused", "evaluator_error"):
            raise ScoringError(f"{answer['status']}: {answer['reason']}")
        return answer

    def close(self) -> None:
        """End the scoring process and remove what was made."""
        with self._lock:
            assert self._server.stdin is not None
            self._server.stdin.close()
        self._server.wait()
        self._made.cleanup()

    def __enter__(self) -> Scorer:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    def _read(self) -> None:
        assert self._server.stdout is not None
        for line in self._server.stdout:
            answer = json.loads(line)
            self._waiting.pop(answer.pop("id")).set_result(answer)
        with self._lock:  # what is asked from now on finds the pipe closed
            for future in self._waiting.values():
                future.set_exception(ScoringError("the scoring process has ended"))


def reward_of(answer: dict[str, Any]) -> float:
    """S, or R where nothing was rendered; both are 0 for a submission that is not valid."""
    return float(answer["R"] if answer["S"] is None else answer["S"])


@lru_cache(maxsize=4)
def shared_scorer(dataset: Path, *, render: bool = True) -> Scorer:
    """One scorer of a dataset for all callers in this process."""
    return Scorer(dataset, render=render)
