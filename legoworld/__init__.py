"""Read COCO boxes, LVIS masks and depth out of frozen Blender scenes, and score them.

The names below are the Python API; docs/python.md shows how to use them. Each is imported on first
use, so that `import legoworld` stays fast.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from legoworld.version import __version__ as __version__

if TYPE_CHECKING:
    from legoworld.agents.campaign import reconstruct as reconstruct
    from legoworld.api.baselines import baseline_import as baseline_import
    from legoworld.api.baselines import baseline_run as baseline_run
    from legoworld.api.bench import bench_export as bench_export
    from legoworld.api.bench import bench_judges as bench_judges
    from legoworld.api.bench import bench_make as bench_make
    from legoworld.api.bench import bench_score as bench_score
    from legoworld.api.bench import bench_serve as bench_serve
    from legoworld.api.bench import bench_table as bench_table
    from legoworld.api.by_task import ByTask as ByTask
    from legoworld.api.cameras import orbit as orbit
    from legoworld.api.cameras import read_cameras as read_cameras
    from legoworld.api.comparison import Comparison as Comparison
    from legoworld.api.comparison import compare as compare
    from legoworld.api.evaluation import Evaluation as Evaluation
    from legoworld.api.evaluation import evaluate as evaluate
    from legoworld.api.evidence import evidence_verify as evidence_verify
    from legoworld.api.exporting import export as export
    from legoworld.api.listener import Listener as Listener
    from legoworld.api.merging import merge as merge
    from legoworld.api.plugin_evidence import plugin_evidence as plugin_evidence
    from legoworld.api.reader import Failed as Failed
    from legoworld.api.reader import Ok as Ok
    from legoworld.api.reader import Reader as Reader
    from legoworld.api.reader import Reading as Reading
    from legoworld.api.readout import Run as Run
    from legoworld.api.readout import readout as readout
    from legoworld.api.report_page import write_report as write_report
    from legoworld.api.scene_folders import execute as execute
    from legoworld.api.scene_folders import freeze as freeze
    from legoworld.api.scene_folders import import_usd as import_usd
    from legoworld.api.scene_view import SceneView as SceneView
    from legoworld.api.scenes import Scene as Scene
    from legoworld.api.scenes import open_scene as open_scene
    from legoworld.api.score import score_photo as score_photo
    from legoworld.api.scoring import Truth as Truth
    from legoworld.api.scoring import score as score
    from legoworld.api.tracks import track_check as track_check
    from legoworld.api.tracks import track_make as track_make
    from legoworld.api.views import Views as Views
    from legoworld.bench.reward import bench_reward as bench_reward
    from legoworld.endpoint.workspace_finalisation import blender_finalise as blender_finalise
    from legoworld.errors import LegoWorldError as LegoWorldError
    from legoworld.evaluation.family import Scores as Scores
    from legoworld.evaluation.pose.score import PoseScores as PoseScores
    from legoworld.evaluation.pose.score import score_poses as score_poses
    from legoworld.plugin.ledger import plugin_replay as plugin_replay
    from legoworld.trajectories.api import trajectory_pairs as trajectory_pairs
    from legoworld.trajectories.api import trajectory_pick as trajectory_pick
    from legoworld.trajectories.api import trajectory_report as trajectory_report
    from legoworld.trajectories.api import trajectory_score as trajectory_score
    from legoworld.trajectories.api import trajectory_show as trajectory_show
    from legoworld.viewing.view import View as View
    from legoworld.viewing.view import view as view
    from legoworld.visibility.posed_camera import Camera as Camera

#: Where the names are at home.
_NAMES = {
    "legoworld.agents.campaign": "reconstruct",
    "legoworld.api.baselines": "baseline_import baseline_run",
    "legoworld.api.bench": "bench_export bench_judges bench_make bench_score bench_serve"
    " bench_table",
    "legoworld.api.by_task": "ByTask",
    "legoworld.api.cameras": "orbit read_cameras",
    "legoworld.api.comparison": "Comparison compare",
    "legoworld.api.evaluation": "Evaluation evaluate",
    "legoworld.api.evidence": "evidence_verify",
    "legoworld.api.exporting": "export",
    "legoworld.api.listener": "Listener",
    "legoworld.api.merging": "merge",
    "legoworld.api.plugin_evidence": "plugin_evidence",
    "legoworld.api.reader": "Failed Ok Reader Reading",
    "legoworld.api.readout": "Run readout",
    "legoworld.api.report_page": "write_report",
    "legoworld.api.scene_folders": "execute freeze import_usd",
    "legoworld.api.scene_view": "SceneView",
    "legoworld.api.scenes": "Scene open_scene",
    "legoworld.api.score": "score_photo",
    "legoworld.api.scoring": "Truth score",
    "legoworld.api.tracks": "track_check track_make",
    "legoworld.api.views": "Views",
    "legoworld.bench.reward": "bench_reward",
    "legoworld.endpoint.workspace_finalisation": "blender_finalise",
    "legoworld.errors": "LegoWorldError",
    "legoworld.evaluation.family": "Scores",
    "legoworld.evaluation.pose.score": "PoseScores score_poses",
    "legoworld.plugin.ledger": "plugin_replay",
    "legoworld.trajectories.api": "trajectory_pairs trajectory_pick trajectory_report"
    " trajectory_score trajectory_show",
    "legoworld.viewing.view": "View view",
    "legoworld.visibility.posed_camera": "Camera",
}
_HOMES = {name: module for module, names in _NAMES.items() for name in names.split()}

__all__ = sorted([*_HOMES, "__version__"])  # pyright: ignore[reportUnsupportedDunderAll]


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
