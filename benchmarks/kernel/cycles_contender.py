"""Cycles as a contender: a process of its own that renders when asked."""

from __future__ import annotations

import os
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from legoworld.visibility.kernel import Surfaces


class Cycles:
    """One scene at one size, kept open between renders. Use as a context manager."""

    def __init__(self, python: str, surfaces: Surfaces, size_wh: tuple[int, int]) -> None:
        self._folder = tempfile.TemporaryDirectory()
        folder = Path(self._folder.name)
        self._depth = folder / "depth.npy"
        np.savez(
            folder / "scene.npz",
            vertices=surfaces.vertices,
            triangles=surfaces.triangles,
            vertex_start=surfaces.vertex_start,
            triangle_start=surfaces.triangle_start,
            placement_mesh=surfaces.placement_mesh,
            cam_from_mesh=surfaces.cam_from_mesh,
            size_wh=np.array(size_wh),
        )
        reader, writer = os.pipe()
        server = Path(__file__).with_name("cycles_server.py")
        self._process = subprocess.Popen(
            [python, str(server), str(folder / "scene.npz"), str(self._depth), str(writer)],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            text=True,
            pass_fds=[writer],
        )
        os.close(writer)
        self._answers = os.fdopen(reader)

    def __enter__(self) -> Cycles:
        return self

    def __exit__(self, *_: object) -> None:
        if self._process.stdin is not None:
            self._process.stdin.close()
        self._process.wait()
        self._answers.close()
        self._folder.cleanup()

    def _ask(self, line: str) -> str:
        if self._process.stdin is None:
            raise RuntimeError("the Cycles process has no standard input")
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()
        answer = self._answers.readline()
        if not answer:
            raise RuntimeError("the Cycles process ended")
        return answer

    def render(self) -> tuple[float, float]:
        """Wall and CPU seconds of one render."""
        wall, cpu = self._ask("render").split()
        return float(wall), float(cpu)

    def depth(self) -> NDArray[np.float32]:
        """Planar z of one render that is not timed, +inf = nothing."""
        self._ask("check")
        depth: NDArray[np.float32] = np.load(self._depth)
        return depth
