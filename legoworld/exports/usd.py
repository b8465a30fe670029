"""Scenes as USD by Blender's exporter, with UsdSemantics labels on the prims of each instance.

Taxonomy `class` holds the category, as Replicator asks for it; `instance` the instance's id and
name, equal on all prims of one instance. Units and up axis are the stage's own metadata.
"""

# pxr fills its modules at run time.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import groupby
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import UsageError
from legoworld.exports.formats import ExportResult
from legoworld.exports.view import ExportedView
from legoworld.pluralize import plural
from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.folder import BLEND
from legoworld.scene.usd_labels import CLASS, INSTANCE, refuse_missing_usd

#: How Blender's exporter calls the object that a prim was.
OBJECT_NAME: Final = "userProperties:blender:object_name"
#: How far an exported placement may be from ours, as a share of its largest number.
_SAME: Final = 1e-4

NONE: Final = -1


def write_views(views: Iterable[ExportedView], output: Path) -> ExportResult:
    """Write SCENE/scene.usdc, textures beside it, of each scene once. UsageError: no .blend."""
    refuse_missing_usd()
    images = annotations = 0
    lost: list[str] = []
    for scene, group in groupby(views, key=lambda view: view.scene):
        view = next(group)
        blend = view.folder / BLEND if view.folder else None
        if blend is None or not blend.is_file():
            raise UsageError(
                f"scene {scene!r} has no {BLEND}",
                expected=f"{BLEND}: Blender's exporter writes the USD",
            )
        file = output / scene / "scene.usdc"
        file.parent.mkdir(parents=True)
        with BlenderProcess(view.limits) as blender:
            blender.request({"kind": "usd", "blend": str(blend), "output": str(file.resolve())})
        labelled, missing = _annotate(file, view)
        images, annotations = images + 1, annotations + labelled
        if missing:
            names = ", ".join(missing[:5]) + (", ..." if missing[5:] else "")
            count = plural(len(missing), "labelled instance", "labelled instances")
            lost.append(f"{count} of {scene} without a prim of their own: {names}")
    return ExportResult(images=images, annotations=annotations, losses=tuple(lost))


def _annotate(file: Path, view: ExportedView) -> tuple[int, list[str]]:
    """Label the prims of a stage; how many instances have labels, and the names of the others."""
    from pxr import Usd, UsdGeom, UsdSemantics

    stage = Usd.Stage.Open(str(file))
    # Blender writes its numbers as they are, and 1 metre for each.
    UsdGeom.SetStageMetersPerUnit(stage, view.view.depth_scale)
    shown = _instances_of_prims(stage, view)
    below: dict[str, set[int]] = {}
    own: dict[int, list[str]] = {}
    for path, instance_id in shown.items():
        own.setdefault(instance_id, []).append(path)
        while path:
            below.setdefault(path, set()).add(instance_id)
            path = path.rpartition("/")[0]
    inside = _inside(view.grouping.enclosing_instance)
    missing = []
    for instance in view.labelled():
        assert instance.category is not None
        labels = {CLASS: instance.category.name, INSTANCE: f"{instance.id}:{instance.name}"}
        allowed = {instance.id} | inside.get(instance.id, set())
        for path in {_top(path, below, allowed) for path in own.get(instance.id, ())}:
            for taxonomy, label in labels.items():
                api = UsdSemantics.LabelsAPI.Apply(stage.GetPrimAtPath(path), taxonomy)
                api.CreateLabelsAttr([label])
        if instance.id not in own:
            missing.append(instance.name)
    stage.Save()
    return len(view.labelled()) - len(missing), missing


def _top(path: str, below: Mapping[str, set[int]], allowed: set[int]) -> str:
    """The uppermost prim at or above one that shows nothing but allowed instances."""
    parent = path.rpartition("/")[0]
    return _top(parent, below, allowed) if parent and below[parent] <= allowed else path


def _inside(nested: Mapping[int, int]) -> dict[int, set[int]]:
    """Of each instance those that were cut out of it, directly or not."""
    inside: dict[int, set[int]] = {}
    for inner in nested:
        outer = nested.get(inner)
        while outer is not None:
            inside.setdefault(outer, set()).add(inner)
            outer = nested.get(outer)
    return inside


def _instances_of_prims(stage: Any, view: ExportedView) -> dict[str, int]:
    """The instance of each prim with geometry, by its object's name and placement; or NONE."""
    from pxr import UsdGeom

    cache = UsdGeom.XformCache()
    prims: dict[str, list[tuple[str, NDArray[np.float64]]]] = {}
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.Gprim):
            holder = prim if prim.HasAttribute(OBJECT_NAME) else prim.GetParent()
            name = str(holder.GetAttribute(OBJECT_NAME).Get())
            matrix = np.array(cache.GetLocalToWorldTransform(prim)).T[:3]
            prims.setdefault(name, []).append((str(prim.GetPath()), matrix))
    snapshot = view.snapshot
    found = {path: NONE for placed in prims.values() for path, _ in placed}
    for surface, instance in enumerate(view.grouping.surface_instance.tolist()):
        shown = snapshot.occurrence_object[snapshot.surface_occurrence[surface]]
        candidates = prims.get(snapshot.objects[shown].name, [])
        wanted = snapshot.world_from_mesh[surface]
        apart = [float(np.abs(matrix - wanted).max()) for _, matrix in candidates]
        # Hair is meshed in a frame of its own: a name that only one prim has needs no placement.
        if len(apart) == 1 or (apart and min(apart) <= _SAME * max(1.0, np.abs(wanted).max())):
            found[candidates[int(np.argmin(apart))][0]] = instance
    return found
