"""What Blender itself costs: opens each .blend and evaluates its render state, nothing else.

    python blender_alone.py SCENE.blend ...

The same two calls as in a readout's worker process, without reading anything out. Blender puts
the subdivision of a mesh off until somebody asks for its faces, so every mesh is asked for their
number.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from legoworld.scene.blender.opening import open_blend
from legoworld.scene.blender.render_state import visit_render_state


def main() -> int:
    """Open and evaluate; see the module's docstring."""
    for path in sys.argv[1:]:
        open_blend(Path(path))
        visit_render_state(evaluate_meshes)
    return 0


def evaluate_meshes(graph: Any) -> None:
    """Make Blender finish every mesh that the render shows."""
    for instance in graph.object_instances:
        if instance.object.type == "MESH":
            len(instance.object.data.polygons)


if __name__ == "__main__":
    sys.exit(main())
