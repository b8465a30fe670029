"""Writes docs/schemas from the types of legoworld/records; --check says if they are current."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import msgspec

from legoworld import exit_codes
from legoworld.files import readable_json
from legoworld.records.agents import ReconstructionFile
from legoworld.records.bench_dataset import BenchTrackFile, BenchTruthFile
from legoworld.records.coco_file import CocoFile
from legoworld.records.comparison import Comparison, JoinedComparison
from legoworld.records.depth import DepthEvidence, DepthRow, DepthSummary, ScoredDepthRow
from legoworld.records.detection import DetectionEvidence
from legoworld.records.evaluation_rows import (
    CategoryRow,
    DetectionRow,
)
from legoworld.records.evaluation_summary import DetectionSummary
from legoworld.records.execution import ExecutionFile
from legoworld.records.frozen import FrozenFile
from legoworld.records.instances import InstancesFile
from legoworld.records.labels import LabelsFile
from legoworld.records.plugin_evidence import EvidenceFile, Outlines, ProviderCamera
from legoworld.records.plugin_install import InstalledFile
from legoworld.records.plugin_ledger import Declaration, Entry, HookMark
from legoworld.records.plugin_requirements import Report
from legoworld.records.plugin_room import ConstructionPlan, Room
from legoworld.records.plugin_state import SceneState
from legoworld.records.predictions import Prediction
from legoworld.records.reconstruction import BenchEvidence
from legoworld.records.reconstruction_judges import Judgement
from legoworld.records.reconstruction_leaderboard import Leaderboard
from legoworld.records.reconstruction_rows import ReconstructionRow
from legoworld.records.reconstruction_summary import ReconstructionSummary
from legoworld.records.run_file import RunFile, RunSummary
from legoworld.records.run_rows import RunRow
from legoworld.records.submission import BenchRow
from legoworld.records.track import TrackFile
from legoworld.records.trajectory_scores import TrajectoryFile

FOLDER = Path(__file__).with_name("schemas")

#: The public formats: the name in docs/schemas, and the type of a file, or of a line of it.
FORMATS: dict[str, Any] = {
    "bench-run-per-image": BenchRow,
    "bench-track": BenchTrackFile,
    "bench-truth": BenchTruthFile,
    "coco-export": CocoFile,
    "comparison": Comparison,
    "comparison-joined": JoinedComparison,
    "execution": ExecutionFile,
    "reconstruction": ReconstructionFile,
    "trajectories": TrajectoryFile,
    "evaluation-evidence-bench": BenchEvidence,
    "evaluation-evidence-depth": DepthEvidence,
    "evaluation-evidence-detection": DetectionEvidence,
    "evaluation-per-category": CategoryRow,
    "evaluation-per-image-bench": ReconstructionRow,
    "evaluation-per-image-depth": DepthRow,
    "evaluation-per-image-depth-scored": ScoredDepthRow,
    "evaluation-per-image-detection": DetectionRow,
    "evaluation-summary-bench": ReconstructionSummary,
    "evaluation-summary-depth": DepthSummary,
    "evaluation-summary-detection": DetectionSummary,
    "bench-judgement": Judgement,
    "bench-leaderboard": Leaderboard,
    "frozen": FrozenFile,
    "instances": InstancesFile,
    "labels": LabelsFile,
    "plugin-camera": ProviderCamera,
    "plugin-evidence": EvidenceFile,
    "plugin-hooks": HookMark,
    "plugin-install": InstalledFile,
    "plugin-ledger": Entry,
    "plugin-outlines": Outlines,
    "plugin-plan": ConstructionPlan,
    "plugin-report": Report,
    "plugin-room": Room,
    "plugin-state": SceneState,
    "plugin-transaction": Declaration,
    "run": RunFile,
    "run-per-image": RunRow,
    "run-prediction": Prediction,
    "run-summary": RunSummary,
    "track": TrackFile,
}


def rendered() -> dict[str, str]:
    """The text of each schema by its file's name: JSON Schema 2020-12, self-contained."""
    texts = {}
    for name, kind in FORMATS.items():
        (schema,), parts = msgspec.json.schema_components([kind], ref_template="#/$defs/{name}")
        document = {
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            "title": name,
            **schema,
            "$defs": parts,
        }
        texts[f"{name}.schema.json"] = readable_json(document)
    return texts


def main() -> int:
    """Write the schemas; with --check return 1 when one is not current."""
    texts = rendered()
    present = {p.name: p.read_text(encoding="utf-8") for p in FOLDER.glob("*.json")}
    if "--check" in sys.argv[1:]:
        return exit_codes.DONE if present == texts else exit_codes.INCOMPLETE
    FOLDER.mkdir(exist_ok=True)
    for stale in present.keys() - texts.keys():
        (FOLDER / stale).unlink()
    for name, text in texts.items():
        (FOLDER / name).write_text(text, encoding="utf-8")
    return exit_codes.DONE


if __name__ == "__main__":
    sys.exit(main())
