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
    from legoworld.api.comparison import Comparison, compare
    from legoworld.api.evaluation import Evaluation, evaluate
    from legoworld.api.listener import Listener
    from legoworld.api.reader import Reader, Reading
    from legoworld.api.readout import Run, readout
    from legoworld.api.scenes import Scene, SceneView, open_scene
    from legoworld.errors import LegoWorldError
    from legoworld.evaluation.pose.score import PoseScores, score_poses

_HOMES = {
    "ByTask": "legoworld.api.by_task",
    "Comparison": "legoworld.api.comparison",
    "Evaluation": "legoworld.api.evaluation",
    "LegoWorldError": "legoworld.errors",
    "Listener": "legoworld.api.listener",
    "PoseScores": "legoworld.evaluation.pose.score",
    "Reader": "legoworld.api.reader",
    "Reading": "legoworld.api.reader",
    "Run": "legoworld.api.readout",
    "Scene": "legoworld.api.scenes",
    "SceneView": "legoworld.api.scenes",
    "compare": "legoworld.api.comparison",
    "evaluate": "legoworld.api.evaluation",
    "open_scene": "legoworld.api.scenes",
    "readout": "legoworld.api.readout",
    "score_poses": "legoworld.evaluation.pose.score",
}

__all__ = [
    "ByTask",
    "Comparison",
    "Evaluation",
    "LegoWorldError",
    "Listener",
    "PoseScores",
    "Reader",
    "Reading",
    "Run",
    "Scene",
    "SceneView",
    "__version__",
    "compare",
    "evaluate",
    "open_scene",
    "readout",
    "score_poses",
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
