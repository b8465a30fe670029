"""What Blender itself costs: opens each .blend and evaluates its render state, nothing else.

    python blender_alone.py SCENE.blend ...

The same two calls as in a readout's worker process, without reading anything out.
"""

from __future__ import annotations

import sys
from pathlib import Path

from legoworld.scene.blender.opening import open_blend
from legoworld.scene.blender.render_state import visit_render_state


def main() -> int:
    """Open and evaluate; see the module's docstring."""
    for path in sys.argv[1:]:
        open_blend(Path(path))
        visit_render_state(lambda graph: len(graph.object_instances))
    return 0


if __name__ == "__main__":
    sys.exit(main())
