"""Opening a file without the viewport's evaluation, which no readout uses.

Blender evaluates the scene of its window as soon as a file is read, and a render evaluates it
again in its own way: with 10,000 objects the first is half of the time. A handler that runs in
between gives the window an empty scene to look at. The file's own scene is then evaluated once, by
the render. Evaluating for the viewport can leave marks in a file's data, animated values and
simulations above all; where it could, nothing is left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final

import bpy

from legoworld.scene.blender.outside_files import irregular_files

#: Modifiers whose result depends on nothing but their input and their settings.
_PURE: Final = frozenset(
    ("ARMATURE", "ARRAY", "BEVEL", "BOOLEAN", "CAST", "CURVE", "DATA_TRANSFER", "DECIMATE",
     "DISPLACE", "EDGE_SPLIT", "HOOK", "LAPLACIANSMOOTH", "LATTICE", "MASK", "MIRROR", "MULTIRES",
     "NODES", "NORMAL_EDIT", "REMESH", "SCREW", "SHRINKWRAP", "SIMPLE_DEFORM", "SKIN", "SMOOTH",
     "SOLIDIFY", "SUBSURF", "TRIANGULATE", "UV_PROJECT", "UV_WARP", "VERTEX_WEIGHT_EDIT",
     "VERTEX_WEIGHT_MIX", "VERTEX_WEIGHT_PROXIMITY", "VOLUME_TO_MESH", "WARP", "WAVE",
     "WEIGHTED_NORMAL", "WELD", "WIREFRAME")
)  # fmt: skip

#: Geometry nodes that keep something from one evaluation to the next.
_REMEMBERING: Final = ("GeometryNodeSimulationOutput", "GeometryNodeBake")

#: What may be animated or driven and reaches a surface, as bpy.data names it.
_ANIMATED: Final = ("cameras", "curves", "hair_curves", "lattices", "materials", "meshes",
                    "metaballs", "node_groups", "objects", "pointclouds", "scenes", "shape_keys",
                    "textures")  # fmt: skip


@contextmanager
def detach_viewport() -> Iterator[Callable[[], Any]]:
    """While the block opens a file, its scene is kept from the window where that changes nothing.

    Yields a function that returns the file's own scene once the file is open; None without one.
    """
    kept: list[Any] = []

    @bpy.app.handlers.persistent  # type: ignore[untyped-decorator]
    def look_away(*_arguments: object) -> None:
        scene = bpy.context.scene
        # Also where an evaluation would not end: a FIFO is read as soon as it is needed.
        if scene is not None and (_is_still(scene) or irregular_files()):
            kept.append(scene)
            empty = bpy.data.scenes.new("Nothing to see")
            # A render of another scene than the window's is a render of the window's frame.
            empty.frame_set(scene.frame_current, subframe=scene.frame_subframe)
            bpy.context.window.scene = empty

    handlers = bpy.app.handlers.load_post
    handlers.append(look_away)
    try:
        yield lambda: kept[0] if kept else bpy.context.scene
    finally:
        handlers.remove(look_away)


def _is_still(scene: bpy.types.Scene) -> bool:
    """Whether an evaluation for the viewport leaves nothing behind in the open file."""
    return not (
        bpy.context.window is None
        or any(s.library for s in bpy.data.scenes)  # a render looks for its scene by name
        or len(scene.timeline_markers)
        or scene.rigidbody_world is not None
        or len(bpy.data.actions)
        or any(_is_driven(block) for kind in _ANIMATED for block in getattr(bpy.data, kind))
        or any(image.source in ("SEQUENCE", "MOVIE") for image in bpy.data.images)
        or any(m.type not in _PURE for o in bpy.data.objects for m in o.modifiers)
        or any(n.bl_idname in _REMEMBERING for tree in bpy.data.node_groups for n in tree.nodes)
    )


def _is_driven(block: bpy.types.ID) -> bool:
    tree = getattr(block, "node_tree", None)
    return block.animation_data is not None or (tree is not None and bool(tree.animation_data))
