"""All scenes of the readout cases, built once by one Blender process and read by another."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from cases.reading import Cases
from scene.snapshots import build

from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.cache import SnapshotCache

HERE = Path(__file__).resolve().parent


@pytest.fixture(scope="session")
def cases(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cases]:
    folder = tmp_path_factory.mktemp("cases")
    modules = sorted(f"cases.{path.stem}" for path in HERE.glob("scenes_*.py"))
    scenes = build(folder / "scenes", *modules, cwd=folder)
    with BlenderProcess(Limits(time_s=600)) as blender:
        yield Cases(folder=scenes, blender=blender, cache=SnapshotCache(folder / "cache"))
