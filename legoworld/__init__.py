"""Read COCO boxes, LVIS masks and depth out of frozen Blender scenes, and score them.

The names below are the Python API; docs/python.md shows how to use them. Each is imported on first
use, so that `import legoworld` stays fast.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from legoworld.version import __version__

if TYPE_CHECKING:
    from legoworld.api.by_task import ByTask
    from legoworld.api.cameras import orbit, read_cameras
    from legoworld.api.coco_export import export
    from legoworld.api.comparison import Comparison, compare
    from legoworld.api.evaluation import Evaluation, evaluate
    from legoworld.api.listener import Listener
    from legoworld.api.reader import Failed, Ok, Reader, Reading
    from legoworld.api.readout import Run, readout
    from legoworld.api.scene_view import SceneView
    from legoworld.api.scenes import Scene, open_scene
    from legoworld.api.scoring import Truth, score
    from legoworld.api.views import Views
    from legoworld.errors import LegoWorldError
    from legoworld.evaluation.family import Scores
    from legoworld.visibility.posed_camera import Camera

_HOMES = {
    "ByTask": "legoworld.api.by_task",
    "Camera": "legoworld.visibility.posed_camera",
    "Comparison": "legoworld.api.comparison",
    "Evaluation": "legoworld.api.evaluation",
    "Failed": "legoworld.api.reader",
    "LegoWorldError": "legoworld.errors",
    "Listener": "legoworld.api.listener",
    "Ok": "legoworld.api.reader",
    "Reader": "legoworld.api.reader",
    "Reading": "legoworld.api.reader",
    "Run": "legoworld.api.readout",
    "Scene": "legoworld.api.scenes",
    "SceneView": "legoworld.api.scene_view",
    "Scores": "legoworld.evaluation.family",
    "Truth": "legoworld.api.scoring",
    "Views": "legoworld.api.views",
    "compare": "legoworld.api.comparison",
    "evaluate": "legoworld.api.evaluation",
    "export": "legoworld.api.coco_export",
    "open_scene": "legoworld.api.scenes",
    "orbit": "legoworld.api.cameras",
    "read_cameras": "legoworld.api.cameras",
    "readout": "legoworld.api.readout",
    "score": "legoworld.api.scoring",
}

__all__ = [
    "ByTask",
    "Camera",
    "Comparison",
    "Evaluation",
    "Failed",
    "LegoWorldError",
    "Listener",
    "Ok",
    "Reader",
    "Reading",
    "Run",
    "Scene",
    "SceneView",
    "Scores",
    "Truth",
    "Views",
    "__version__",
    "compare",
    "evaluate",
    "export",
    "open_scene",
    "orbit",
    "read_cameras",
    "readout",
    "score",
]


def __getattr__(name: str) -> object:
    """Import a name of the API on first use."""
    if name not in _HOMES:
        raise AttributeError(f"module 'legoworld' has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The names of the API, whether imported yet or not."""
    return sorted({*globals(), *__all__})
