"""Which surface Cycles meets in the first sample of a render by a card, and how far away."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import bpy
import numpy as np
from numpy.typing import NDArray

from legoworld.conventions import ALPHA_THRESHOLD, MOST_OBJECTS
from legoworld.scene.blender.cameras import refuse_missing_camera
from legoworld.scene.blender.card_render import open_by_card
from legoworld.scene.blender.objects import identity
from legoworld.scene.blender.render_state import render_scene, rendered_view_layer
from legoworld.scene.requests import CardRequest

#: Cycles' depth where nothing is met.
_NOTHING_M: Final = 1e9
_PASSES: Final = ("Depth", "Object Index")


def surface_by_card(blend: Path, request: CardRequest) -> dict[str, NDArray[Any]]:
    """depth_z: (H, W) planar depth in scene units, +inf where nothing is met; object: (H, W) int32.

    object_names: JSON, `identity` of each; the n-th is n % MOST_OBJECTS in `object`.

    A surface is met where its alpha reaches the threshold, as Cycles' data passes have it. Light
    and what follows the first surface are left out: they do not change it. Raises as
    `render_by_card`.
    """
    scene = open_by_card(blend, {**request, "samples": 1, "denoise": False})
    refuse_missing_camera(scene)
    cycles = scene.cycles
    cycles.max_bounces, cycles.tile_size = 0, 8192
    cycles.transparent_max_bounces = max(1024, cycles.transparent_max_bounces)
    for camera in bpy.data.cameras:
        camera.dof.use_dof = False
    scene.world = None
    layer = rendered_view_layer(scene)
    layer.use_pass_z = layer.use_pass_object_index = True
    layer.pass_alpha_threshold = ALPHA_THRESHOLD
    scene.render.filepath = ""
    objects = list(bpy.data.objects)
    for number, thing in enumerate(objects):
        thing.pass_index = number % MOST_OBJECTS
    with _keeping_passes() as kept:
        render_scene(scene, write_still=False)
    depth, index = kept[-1].reshape(2, request["size_wh"][1], request["size_wh"][0])[:, ::-1]
    names = json.dumps([identity(thing) for thing in objects]).encode()
    return {
        "depth_z": np.where(depth < _NOTHING_M, depth, np.float32(np.inf)),
        "object": index.astype(np.int32),
        "object_names": np.frombuffer(names, np.uint8),
    }


@contextmanager
def _keeping_passes() -> Iterator[list[NDArray[np.float32]]]:
    """`_PASSES` of the renders meanwhile, as Cycles hands them to Blender, bottom row first."""
    import cycles  # type: ignore[import-not-found]

    kept: list[NDArray[np.float32]] = []
    original = cycles.CyclesRender.render

    def render(engine: Any, depsgraph: Any) -> None:
        original(engine, depsgraph)
        result = engine.get_result()
        values = np.empty((2, result.resolution_x * result.resolution_y), np.float32)
        for name, row in zip(_PASSES, values, strict=True):
            result.layers[0].passes[name].rect.foreach_get(row)
        kept.append(values)

    cycles.CyclesRender.render = render
    try:
        yield kept
    finally:
        cycles.CyclesRender.render = original
