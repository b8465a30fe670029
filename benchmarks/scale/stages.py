"""Seconds of each stage of one readout: `stages.py blender BLEND SNAPSHOT`, then `stages.py main
SNAPSHOT TASK`. Each prints one line of JSON and runs in a process of its own.

open: Blender loads the file and evaluates its viewport. evaluate: the render's dependency graph.
extract: arrays copied out of it, the object tree and placements. save, load: the snapshot on disk.
group: labels and instances. kernel: visibility. encode: boxes, masks or the depth file.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any


def blender_stages(blend: Path, output: Path) -> dict[str, float]:
    """Read a .blend as the worker does, and time it."""
    import bpy  # noqa: F401  not part of any stage

    from legoworld.scene.blender import extract
    from legoworld.scene.snapshot import save

    spent: dict[str, float] = {}
    for name in ("open_blend", "visit_render_state", "walk"):
        setattr(extract, name, _timed(getattr(extract, name), name, spent))
    began = time.perf_counter()
    snapshot = extract.read_blend_snapshot(blend)
    total = time.perf_counter() - began
    began = time.perf_counter()
    save(snapshot, output)
    evaluate = spent["visit_render_state"] - spent["walk"]
    return {
        "open": spent["open_blend"],
        "evaluate": evaluate,
        "extract": total - spent["open_blend"] - evaluate,
        "save": time.perf_counter() - began,
        "meshes": float(len(snapshot.vertex_start) - 1),
        "surfaces": float(len(snapshot.surface_mesh)),
        "triangles": float(len(snapshot.triangles)),
        "virtual_triangles": float(snapshot.n_triangles),
    }


def main_stages(snapshot_path: Path, task: str) -> dict[str, float]:
    """Everything after Blender, as a run does it."""
    from legoworld.readouts.depth import write_depth
    from legoworld.readouts.family import protocol
    from legoworld.scene.instances import group
    from legoworld.scene.labels import Labels, resolve_labels
    from legoworld.scene.snapshot import load
    from legoworld.visibility.view import view

    rules = protocol(task, None)
    clock = [time.perf_counter()]

    def lap() -> float:
        clock.append(time.perf_counter())
        return clock[-1] - clock[-2]

    snapshot, _ = load(snapshot_path)
    spent = {"load": lap()}
    labels = Labels(objects={}, collections={}, warnings=())
    if rules.vocabulary is not None:
        labels = resolve_labels(snapshot, (), rules.vocabulary, rules.override_property)
    grouping = group(snapshot, labels)
    spent["group"] = lap()
    seen = view(snapshot, grouping, snapshot.render.size_wh)
    spent["kernel"] = lap()
    if rules.task.predict is None:
        with tempfile.TemporaryDirectory() as folder:
            write_depth(Path(folder) / "depth.npz", seen.buffers.depth_z_m)
    else:
        rules.task.predict(1, grouping.instances, seen)
    spent["encode"] = lap()
    return spent


def _timed(function: Callable[..., Any], name: str, spent: dict[str, float]) -> Any:
    def timed(*arguments: Any, **named: Any) -> Any:
        began = time.perf_counter()
        try:
            return function(*arguments, **named)
        finally:
            spent[name] = spent.get(name, 0.0) + time.perf_counter() - began

    return timed


if __name__ == "__main__":
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # Blender prints on standard output
    if sys.argv[1] == "blender":
        found = blender_stages(Path(sys.argv[2]), Path(sys.argv[3]))
    else:
        found = main_stages(Path(sys.argv[2]), sys.argv[3])
    answers.write(json.dumps(found) + "\n")
    answers.flush()
    os._exit(0)  # as the worker ends: without Blender's own exit code
