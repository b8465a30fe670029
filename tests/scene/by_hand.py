"""Snapshots built by hand, to try grouping without Blender."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from legoworld.scene.instances import Grouping, group
from legoworld.scene.labels import OutsideLabel, resolve_labels
from legoworld.scene.snapshot import (
    RenderSettings,
    SceneCamera,
    SceneCollection,
    SceneObject,
    Snapshot,
)
from legoworld.tracks.vocabulary import Vocabulary, from_json

CAMERA = SceneCamera(
    name="Camera",
    type="PERSP",
    world_from_camera=((1.0, 0.0, 0.0, 0.0), (0.0, -1.0, 0.0, 0.0), (0.0, 0.0, -1.0, 10.0)),
    lens_mm=36.0,
    sensor_width_mm=36.0,
    sensor_height_mm=24.0,
    sensor_fit="AUTO",
    shift_x=0.0,
    shift_y=0.0,
    ortho_scale=6.0,
    clip_start=0.1,
    clip_end=100.0,
)
RENDER = RenderSettings(
    resolution_x=64,
    resolution_y=48,
    resolution_percentage=100,
    pixel_aspect_x=1.0,
    pixel_aspect_y=1.0,
    use_border=False,
    frame=1,
    subframe=0.0,
    unit_system="METRIC",
    unit_scale=1.0,
    scene_name="Scene",
    view_layer="ViewLayer",
)

VOCABULARY = from_json(
    [
        {"id": 1, "name": "chair"},
        {"id": 5, "name": "dining table"},
        {"id": 7, "name": "apple"},
        {"id": 9, "name": "tree"},
    ],
    "the test's vocabulary",
)


@dataclass
class HandScene:
    """Objects and collections by name, and what occurs; `grouped` resolves it."""

    objects: list[SceneObject] = field(default_factory=list)
    collections: list[SceneCollection] = field(default_factory=list)
    rows: list[tuple[int, int, int]] = field(default_factory=list)
    surfaces: list[int] = field(default_factory=list)

    def collection(self, name: str, *parents: str, **labels: str) -> None:
        self.collections.append(
            SceneCollection(
                name=name,
                library=None,
                parents=tuple(self._collection(p) for p in parents),
                properties=labels,
            )
        )

    def object(
        self,
        name: str,
        *,
        parent: str | None = None,
        collections: tuple[str, ...] = (),
        makes: str = "NONE",
        kind: str = "MESH",
        **labels: str,
    ) -> None:
        self.objects.append(
            SceneObject(
                name=name,
                library=None,
                type=kind,
                parent=-1 if parent is None else self._object(parent),
                collections=tuple(self._collection(c) for c in collections),
                instance_type=makes,
                properties=labels,
            )
        )

    def occurs(self, name: str, *, by: int = -1, frame: int = 0, surfaces: int = 1) -> int:
        """Add an occurrence, made by another one (its number), with some surfaces."""
        self.rows.append((self._object(name), by, frame))
        self.surfaces += [len(self.rows) - 1] * surfaces
        return len(self.rows) - 1

    def snapshot(self) -> Snapshot:
        n = len(self.surfaces)
        matrix = np.zeros((n, 3, 4))
        matrix[:, range(3), range(3)] = 1.0
        object_, instancer, frame = (
            np.array(column, np.int32) for column in zip(*self.rows, strict=True)
        )
        return Snapshot(
            objects=tuple(self.objects),
            collections=tuple(self.collections),
            camera=CAMERA,
            render=RENDER,
            warnings=(),
            vertices=np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32),
            triangles=np.array([[0, 1, 2]], np.int32),
            vertex_start=np.array([0, 3], np.int64),
            triangle_start=np.array([0, 1], np.int64),
            occurrence_object=object_,
            occurrence_instancer=instancer,
            occurrence_frame=frame,
            surface_occurrence=np.array(self.surfaces, np.int32),
            surface_mesh=np.zeros(n, np.int32),
            surface_holdout=np.zeros(n, np.uint8),
            world_from_mesh=matrix,
        )

    def grouped(
        self,
        *outside: OutsideLabel,
        vocabulary: Vocabulary | None = VOCABULARY,
        override: str | None = "coco_category",
    ) -> Grouping:
        snapshot = self.snapshot()
        return group(snapshot, resolve_labels(snapshot, outside, vocabulary, override))

    def _object(self, name: str) -> int:
        return [o.name for o in self.objects].index(name)

    def _collection(self, name: str) -> int:
        return [c.name for c in self.collections].index(name)


def summary(grouping: Grouping) -> list[tuple[str, str | None, tuple[str, ...]]]:
    """(name, category, objects) of every instance, in order of ids."""
    return [
        (i.name, i.category.name if i.category else None, i.objects) for i in grouping.instances
    ]


def categories(grouping: Grouping) -> list[str | None]:
    return [i.category.name if i.category else None for i in grouping.instances]


def outside(kind: Any, name: str, **categories: str) -> OutsideLabel:
    return OutsideLabel(kind=kind, name=name, categories=categories)
