"""A stand-in for the Blender process: a scene.blend that is a .glb by another name."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from legoworld.errors import WorkerCrashedError, WorkerTimeoutError
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.gltf.container import parse_glb
from legoworld.scene.gltf.snapshot import read_glb_snapshot
from legoworld.scene.snapshot import Snapshot, save

FACTS: dict[str, Any] = {
    "images": [], "world_nodes": ["Background"], "compositor_nodes": [], "texts": [], "drivers": 2,
    "joints": [], "images_of": {},
}  # fmt: skip


def of_glb(blend: Path) -> Snapshot:
    """As a .blend would be read: what a .glb does not say is no warning."""
    snapshot = read_glb_snapshot(parse_glb(blend.read_bytes()), blend.parent)
    return replace(snapshot, warnings=())


class StandIn(BlenderProcess):
    """Answers as the worker does.

    lost: how often the process is lost before it answers; slow: it never does; meanwhile: what
    happens while it reads; pictures: what renders show, one after another; names: the objects of
    a file, each of which is met at one pixel, n scene units away for the n-th question.
    """

    def __init__(
        self,
        *,
        snapshot_of: Callable[[Path], Snapshot] = of_glb,
        lost: int = 0,
        slow: bool = False,
        meanwhile: Callable[[], object] = lambda: None,
        pictures: tuple[bytes, ...] = (),
        facts: dict[str, Any] | None = None,
        names: tuple[tuple[str, str], ...] = (),
    ) -> None:
        super().__init__(Limits())
        self.asked: list[dict[str, Any]] = []
        self._snapshot_of = snapshot_of
        self._lost, self._slow = lost, slow
        self._meanwhile = meanwhile
        self._pictures = list(pictures)
        self._facts = facts or FACTS
        self._names = names

    def request(self, message: dict[str, Any]) -> dict[str, Any]:
        self.asked.append(message)
        if self._lost:
            self._lost -= 1
            raise WorkerCrashedError("lost")
        if self._slow:
            raise WorkerTimeoutError("slow")
        output, blend = Path(message["output"]), Path(message["blend"])
        assert blend.is_absolute()
        self._meanwhile()
        if message["kind"] == "card_render":
            output.write_bytes(self._pictures.pop(0))
            return {}
        if message["kind"] == "card_depth":
            met = np.arange(len(self._names), dtype=np.int32)[None]
            depth = np.full(met.shape, len(self.asked), np.float32)
            names = np.frombuffer(json.dumps(self._names).encode(), np.uint8)
            np.savez(output, depth_z=depth, object=met, object_names=names)
            return {}
        if message["kind"] == "facts":
            np.savez(output, textures=np.full((1, 2, 2, 3), len(self.asked), np.uint8))
            return {"facts": self._facts}
        save(self._snapshot_of(blend), output, passing=message["passing"])
        baked = blend.parent / "baked"
        more = ["baked/0.bphys"] if baked.is_dir() else []
        return {"dependencies": ["wood.png", *more], "watched": ["baked"]}
