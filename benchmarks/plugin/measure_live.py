"""What measuring a live scene costs, stage by stage, in CPU seconds.

    python benchmarks/plugin/measure_live.py [--objects 100 10000] [--repeat 5]

A headless endpoint holds a room of so many objects with a hundred materials of nodes; 20 of them
have the five requirements of the picture. Stages: Blender saves its copy and the endpoint keeps
its own; the reader opens it and extracts; the snapshot is loaded and signed; the kernel renders;
residuals are computed. CPU and wall seconds of all processes, the median of the repeats.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from copies import required_of_each

from legoworld.endpoint.server import EndpointServer
from legoworld.endpoint.session import Session, Trial
from legoworld.plugin.connection import Address, BlenderConnection
from legoworld.plugin.evidence import read_evidence
from legoworld.plugin.live import LiveBlender
from legoworld.plugin.make_evidence import UserEvidence, make_evidence
from legoworld.plugin.measure import measure, surface_view
from legoworld.plugin.state import LiveScene, read_live
from legoworld.records.plugin_requirements import Requirement
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.workers.descendants import descendants
from legoworld.workers.protections import protections
from legoworld.workers.sandbox import SandboxLimits

SIZE_WH = (640, 360)
MEASURED = 20
ROOM = """
import bpy, math
scene = bpy.context.scene
scene.render.resolution_x, scene.render.resolution_y = 640, 360
for old in list(bpy.data.objects):
    if old.type == "MESH": bpy.data.objects.remove(old)
materials = []
for n in range(100):
    m = bpy.data.materials.new(f"m{{n}}")
    m.use_nodes = True
    m.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (n / 100, 0.5, 0.5, 1)
    materials.append(m)
side = math.ceil(math.sqrt({n}))
for n in range({n}):
    x, y = n % side, n // side
    mesh = bpy.data.meshes.new(f"mesh{{n}}")
    s, z = 0.3, 0.2 + (n % 7) * 0.1
    c = [(-s, -s, 0), (s, -s, 0), (s, s, 0), (-s, s, 0),
         (-s, -s, z), (s, -s, z), (s, s, z), (-s, s, z)]
    f = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
    mesh.from_pydata(c, [], f)
    mesh.materials.append(materials[n % 100])
    o = bpy.data.objects.new(f"object{{n}}", mesh)
    o.location = (x - side / 2, y - side / 2, 0)
    scene.collection.objects.link(o)
camera = bpy.data.objects["Camera"]
camera.location, camera.rotation_euler = (0, -side, side * 0.8), (0.9, 0, 0)
camera.data.clip_end = 10 * side
print(len(bpy.data.objects))
"""
_T = TypeVar("_T")


def cpu_s(pids: list[int]) -> float:
    """CPU seconds of processes so far."""
    total = 0.0
    for pid in pids:
        try:
            fields = Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2].split()
        except OSError:
            continue
        total += (int(fields[11]) + int(fields[12])) / 100
    return total


class Stages:
    """CPU and wall seconds of named stages, over repeats."""

    def __init__(self) -> None:
        self.cpu: dict[str, list[float]] = {}
        self.wall: dict[str, list[float]] = {}

    def timed(self, name: str, call: Callable[[], _T]) -> _T:
        import os

        pids = [os.getpid(), *descendants(os.getpid())]
        began, spent = time.perf_counter(), cpu_s(pids)
        made = call()
        self.cpu.setdefault(name, []).append(cpu_s(pids) - spent)
        self.wall.setdefault(name, []).append(time.perf_counter() - began)
        return made

    def tell(self) -> None:
        cpu = {name: statistics.median(values) for name, values in self.cpu.items()}
        wall = {name: statistics.median(values) for name, values in self.wall.items()}
        for name in cpu:
            print(f"  {name:22} {cpu[name]:7.3f} CPU s  {wall[name]:7.3f} s")
        print(
            f"  {'all':22} {sum(cpu.values()):7.3f} CPU s  {sum(wall.values()):7.3f} s", flush=True
        )


def requirements(scene: LiveScene, folder: Path) -> tuple[Any, list[Requirement]]:
    """Evidence of the scene's own masks, and five requirements on each of 20 objects."""
    import cv2

    seen = surface_view(scene, SIZE_WH).instance
    shown, counts = np.unique(seen[seen >= 0], return_counts=True)
    chosen = shown[np.argsort(-counts)[:MEASURED]].tolist()
    shot = scene.snapshot
    names = [
        shot.objects[shot.occurrence_object[shot.surface_occurrence[surface]]].name
        for surface in chosen
    ]
    outlines = []
    for surface, name in zip(chosen, names, strict=True):
        found = cv2.findContours(
            (seen == surface).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
        )[0]
        polygons = [c[:, 0].tolist() for c in found if len(c) >= 3]
        outlines.append({"name": name, "polygons": polygons})
    (folder / "outlines.json").write_text(json.dumps({"regions": outlines}))
    cv2.imwrite(str(folder / "photo.png"), np.zeros((*SIZE_WH[::-1], 3), np.uint8))
    np.save(folder / "depth.npy", np.linspace(1, 2, SIZE_WH[0] * SIZE_WH[1]).reshape(SIZE_WH[::-1]))
    given = UserEvidence(
        photo=folder / "photo.png",
        regions=[folder / "outlines.json"],
        image_id=None,
        vocabulary=None,
        depth=folder / "depth.npy",
        depth_space="disparity",
        hfov_deg=None,
    )
    make_evidence(given, folder / "evidence")
    return read_evidence(folder / "evidence"), required_of_each(names)


def measured(n: int, repeat: int, folder: Path) -> None:
    """All stages for n objects."""
    (folder / "workspace").mkdir()
    session = Session(
        Trial(
            workspace=folder / "workspace",
            record=folder / "record",
            limits=SandboxLimits(time_s=3600, memory_bytes=8 << 30),
            protections=protections("auto"),
        )
    )
    stages = Stages()
    with (
        closing(session),
        EndpointServer(session, 0, by="plugin") as server,
        BlenderProcess(Limits(time_s=600)) as reader,
    ):
        connection = BlenderConnection(Address(port=server.port))
        connection.run(ROOM.format(n=n))
        live = LiveBlender(connection, reader, folder)
        scene, _ = live.read()
        evidence, wanted = requirements(scene, folder)
        for _ in range(repeat):
            copy, _ = stages.timed("save over the endpoint", live._save)
            scene = stages.timed("read the copy", lambda copy=copy: read_live(copy, reader))
            stages.timed("kernel", lambda scene=scene: surface_view(scene, SIZE_WH))
            stages.timed(
                "kernel and residuals", lambda scene=scene: measure(scene, wanted, evidence)
            )
            copy.unlink()
        print(
            f"{n} objects, {len(wanted)} requirements, {repeat} repeats (the kernel counts twice)"
        )
        stages.tell()


def main() -> None:
    """A table for each number of objects."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--objects", type=int, nargs="+", default=[100])
    parser.add_argument("--repeat", type=int, default=5)
    chosen = parser.parse_args()
    for n in chosen.objects:
        with tempfile.TemporaryDirectory() as made:
            measured(n, chosen.repeat, Path(made))


if __name__ == "__main__":
    main()
