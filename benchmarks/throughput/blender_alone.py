"""What Blender itself costs: opens each .blend and evaluates its render state, nothing else.

    python blender_alone.py SCENE.blend ...

What a readout asks of Blender, without reading anything out, and opened as anybody opens a file:
the evaluation for the viewport, which a readout leaves out, is Blender's own cost. Blender puts
the subdivision of a mesh off until somebody asks for its faces, so every mesh is asked for their
number.
"""

from __future__ import annotations

import sys
from typing import Any

import bpy

from legoworld.scene.blender.render_state import visit_render_state


def main() -> int:
    """Open and evaluate; see the module's docstring."""
    for path in sys.argv[1:]:
        bpy.ops.wm.open_mainfile(filepath=path, load_ui=False, use_scripts=False)
        visit_render_state(bpy.context.scene, evaluate_meshes)
    return 0


def evaluate_meshes(graph: Any) -> None:
    """Make Blender finish every mesh that the render shows."""
    for instance in graph.object_instances:
        if instance.object.type == "MESH":
            len(instance.object.data.polygons)


if __name__ == "__main__":
    sys.exit(main())
