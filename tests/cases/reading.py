"""Reading a built case the way every command does, and asking about it by object name."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scene.snapshots import snapshot_of

from legoworld.running.inspection import instance_entries
from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.cache import SnapshotCache
from legoworld.scene.instances import Grouping, group
from legoworld.scene.labels import resolve_labels
from legoworld.scene.read_scene import ReadScene
from legoworld.visibility.view import View, view


@dataclass(frozen=True, kw_only=True)
class Case:
    """One scene read at one size; labels count as they are written."""

    scene: ReadScene
    grouping: Grouping
    view: View
    expected: Any

    @property
    def instance(self) -> NDArray[np.int32]:
        return self.view.buffers.instance

    @property
    def depth(self) -> NDArray[np.float32]:
        return self.view.buffers.depth_z_m

    @property
    def warnings(self) -> tuple[str, ...]:
        return (*self.scene.snapshot.warnings, *self.grouping.warnings)

    @cached_property
    def entries(self) -> tuple[dict[str, Any], ...]:
        return instance_entries(self.scene, self.grouping, self.view)

    def named(self, name: str) -> list[dict[str, Any]]:
        """The rows of instances.json with a name."""
        return [entry for entry in self.entries if entry.name == name]

    def one(self, name: str) -> dict[str, Any]:
        """The one row with a name."""
        (entry,) = self.named(name)
        return entry

    def area(self, name: str) -> int:
        return int(self.one(name).area_px)

    def bbox(self, name: str) -> list[int]:
        return list(self.one(name).bbox_xywh_px)

    def mask(self, name: str) -> NDArray[np.bool_]:
        return np.asarray(self.instance == self.one(name).id)

    def of_category(self, category: str) -> list[dict[str, Any]]:
        return [entry for entry in self.entries if entry.category == category]


@dataclass(frozen=True, kw_only=True)
class Cases:
    """The built scenes, and the Blender process that reads them."""

    folder: Path
    blender: BlenderProcess
    cache: SnapshotCache

    def read(
        self, name: str, size_wh: tuple[int, int] | None = None, *, threads: int | None = None
    ) -> Case:
        """Read a scene at a size (its own when None); raises its verdict."""
        scene = snapshot_of(self.folder / name, self.blender, self.cache)
        snapshot = scene.snapshot
        grouping = group(snapshot, resolve_labels(snapshot, (), None, None))
        expected = self.folder / name / "expected.json"
        return Case(
            scene=scene,
            grouping=grouping,
            view=view(snapshot, grouping, size_wh or snapshot.render.size_wh, threads=threads),
            expected=json.loads(expected.read_text()) if expected.exists() else None,
        )
