"""Access to the scene's render state.

`evaluated_depsgraph_get()` is the viewport's state: other subdivision levels, other visibility.
The render's own dependency graph is only handed to a render engine, so one that draws nothing is
registered, and the scene is rendered with it at 16 x 16 pixels.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import bpy

from legoworld.errors import SceneInvalidError

_ENGINE = "LEGOWORLD_SNAPSHOT"


class SnapshotEngine(bpy.types.RenderEngine):  # type: ignore[misc]
    """A render engine that only passes the render's dependency graph on."""

    bl_idname = _ENGINE
    bl_label = "legoworld snapshot"
    bl_use_preview = False

    visit: ClassVar[Callable[[Any], None] | None] = None
    view_layer: ClassVar[str] = ""
    error: ClassVar[BaseException | None] = None

    def render(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Called by Blender once per view layer."""
        cls = SnapshotEngine
        if depsgraph.view_layer.name != cls.view_layer or cls.visit is None:
            return
        try:
            cls.visit(depsgraph)
        except BaseException as error:  # noqa: BLE001  Blender prints and swallows what is raised here
            cls.error = error
        cls.visit = None


def visit_render_state(scene: bpy.types.Scene, visit: Callable[[Any], None]) -> None:
    """Call `visit` once with a scene's render depsgraph, of `rendered_view_layer`.

    Evaluated data is gone when `visit` returns: it must copy what it keeps. Changes the open
    file's render settings, so read them before.
    """
    if not SnapshotEngine.is_registered:
        bpy.utils.register_class(SnapshotEngine)
    SnapshotEngine.visit, SnapshotEngine.error = visit, None
    SnapshotEngine.view_layer = rendered_view_layer(scene).name
    render = scene.render
    render.engine = _ENGINE
    render.resolution_x = render.resolution_y = 16
    render.resolution_percentage = 100
    for switch in ("use_compositing", "use_sequencer", "use_border", "use_multiview",
                   "use_freestyle", "use_persistent_data", "use_stamp"):  # fmt: skip
        setattr(render, switch, False)
    render.use_single_layer = False
    render_scene(scene, write_still=False)
    if SnapshotEngine.error is not None:
        raise SnapshotEngine.error
    if SnapshotEngine.visit is not None:
        raise RuntimeError("Blender did not render the view layer")


def rendered_view_layer(scene: bpy.types.Scene) -> Any:
    """The view layer a render's picture of a scene shows: the first that renders at all."""
    layers = scene.view_layers
    for layer in layers:
        if layer.use:
            return layer
    layers[0].use = True
    return layers[0]


def render_scene(scene: bpy.types.Scene, *, write_still: bool) -> None:
    """Render a scene. SceneInvalidError where Blender refuses to."""
    other = {} if scene == bpy.context.scene else {"scene": scene.name}
    try:
        bpy.ops.render.render(write_still=write_still, **other)
    except RuntimeError as error:
        raise SceneInvalidError(
            "Blender refuses to render the scene",
            found=str(error).removeprefix("Error: "),
            expected="a scene that renders",
            next_step="render it in Blender and correct what it complains about",
        ) from error
