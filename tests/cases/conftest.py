"""All scenes of the readout cases, built once by one Blender process and read by another."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from cases.reading import Cases

from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.cache import SnapshotCache

HERE = Path(__file__).resolve().parent


@pytest.fixture(scope="session")
def cases(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cases]:
    folder = tmp_path_factory.mktemp("cases")
    modules = sorted(f"cases.{path.stem}" for path in HERE.glob("scenes_*.py"))
    done = subprocess.run(
        [sys.executable, str(HERE / "build.py"), str(folder / "scenes"), *modules],
        env={**os.environ, "PYTHONPATH": str(HERE.parent)},
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=900,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    with BlenderProcess(Limits(time_s=600)) as blender:
        yield Cases(
            folder=folder / "scenes", blender=blender, cache=SnapshotCache(folder / "cache")
        )
