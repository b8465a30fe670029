"""How far the surface lies that Cycles meets in the first sample of a render by a card."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import bpy
import numpy as np
from numpy.typing import NDArray

from legoworld.conventions import ALPHA_THRESHOLD
from legoworld.scene.blender.cameras import refuse_missing_camera
from legoworld.scene.blender.card_render import open_by_card
from legoworld.scene.blender.render_state import render_scene, rendered_view_layer
from legoworld.scene.requests import CardRequest

#: Cycles' depth where nothing is met.
_NOTHING_M: Final = 1e9


def depth_by_card(blend: Path, wanted: CardRequest) -> NDArray[np.float32]:
    """(H, W) planar depth in scene units, +inf where nothing is met.

    A surface is met where its alpha reaches the threshold, as Cycles' data passes have it. Light
    and what follows the first surface are left out: they do not change it. Raises as
    `render_by_card`.
    """
    scene = open_by_card(blend, {**wanted, "samples": 1, "denoise": False})
    refuse_missing_camera(scene)
    cycles = scene.cycles
    cycles.max_bounces, cycles.tile_size = 0, 8192
    cycles.transparent_max_bounces = max(1024, cycles.transparent_max_bounces)
    for camera in bpy.data.cameras:
        camera.dof.use_dof = False
    scene.world = None
    layer = rendered_view_layer(scene)
    layer.use_pass_z = True
    layer.pass_alpha_threshold = ALPHA_THRESHOLD
    scene.render.filepath = ""
    with _keeping_depth() as kept:
        render_scene(scene, write_still=False)
    depth = kept[-1].reshape(wanted["size_wh"][1], wanted["size_wh"][0])[::-1]
    return np.where(depth < _NOTHING_M, depth, np.float32(np.inf))


@contextmanager
def _keeping_depth() -> Iterator[list[NDArray[np.float32]]]:
    """Depth of the renders meanwhile, as Cycles hands it to Blender, bottom row first."""
    import cycles  # type: ignore[import-not-found]

    kept: list[NDArray[np.float32]] = []
    original = cycles.CyclesRender.render

    def render(engine: Any, depsgraph: Any) -> None:
        original(engine, depsgraph)
        result = engine.get_result()
        values = np.empty(result.resolution_x * result.resolution_y, np.float32)
        result.layers[0].passes["Depth"].rect.foreach_get(values)
        kept.append(values)

    cycles.CyclesRender.render = render
    try:
        yield kept
    finally:
        cycles.CyclesRender.render = original
