"""The public file formats by name, and the JSON Schema of each."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import msgspec

from legoworld.files import readable_json


@dataclass(frozen=True)
class Format:
    """A file, or a line of one. record: "module:Type" in legoworld.records, loaded when asked."""

    file: str
    record: str


#: What `legoworld list formats` lists; docs/formats.md is made from it.
FORMATS: Final[Mapping[str, Format]] = {
    "bench-judge-pair": Format("a line of pairs.jsonl", "bench_results:JudgePair"),
    "bench-judgement": Format("a line of JUDGEMENTS.jsonl", "bench_results:Judgement"),
    "bench-leaderboard": Format("leaderboard.json", "bench_results:Leaderboard"),
    "bench-run-per-image": Format("a line of RUN/per_image.jsonl, bench", "submission:BenchRow"),
    "bench-track": Format("DATASET/public/track.json", "bench_dataset:BenchTrackFile"),
    "bench-truth": Format("DATASET/private/truth.json", "bench_dataset:BenchTruthFile"),
    "coco-export": Format("COCO.json of `legoworld export`", "coco_file:CocoFile"),
    "comparison": Format("COMPARISON/comparison.json", "comparison:Comparison"),
    "comparison-joined": Format(
        "COMPARISON/comparison.json, several tasks", "comparison:JoinedComparison"
    ),
    "evaluation-evidence-bench": Format(
        "EVALUATION/evidence.json, bench", "reconstruction:BenchEvidence"
    ),
    "evaluation-evidence-depth": Format("EVALUATION/evidence.json, depth", "depth:DepthEvidence"),
    "evaluation-evidence-detection": Format(
        "EVALUATION/evidence.json, boxes and masks", "detection:DetectionEvidence"
    ),
    "evaluation-evidence-label-maps": Format(
        "EVALUATION/evidence.json, panoptic segments and semantic maps",
        "label_maps:LabelMapEvidence",
    ),
    "evaluation-evidence-normals": Format(
        "EVALUATION/evidence.json, normals", "normals:NormalsEvidence"
    ),
    "evaluation-per-category": Format(
        "a line of EVALUATION/per_category.jsonl", "detection:CategoryRow"
    ),
    "evaluation-per-image-bench": Format(
        "a line of EVALUATION/per_image.jsonl, bench", "reconstruction:ReconstructionRow"
    ),
    "evaluation-per-image-depth": Format(
        "a line of EVALUATION/per_image.jsonl, depth, not scored", "depth:DepthRow"
    ),
    "evaluation-per-image-depth-scored": Format(
        "a line of EVALUATION/per_image.jsonl, depth, scored", "depth:ScoredDepthRow"
    ),
    "evaluation-per-image-detection": Format(
        "a line of EVALUATION/per_image.jsonl, boxes and masks", "detection:DetectionRow"
    ),
    "evaluation-per-image-label-maps": Format(
        "a line of EVALUATION/per_image.jsonl, panoptic segments and semantic maps",
        "label_maps:LabelMapRow",
    ),
    "evaluation-per-image-normals": Format(
        "a line of EVALUATION/per_image.jsonl, normals, not scored", "normals:NormalsRow"
    ),
    "evaluation-per-image-normals-scored": Format(
        "a line of EVALUATION/per_image.jsonl, normals, scored", "normals:ScoredNormalsRow"
    ),
    "evaluation-per-image-relations": Format(
        "a line of EVALUATION/per_image.jsonl, relations", "relations:RelationsRow"
    ),
    "evaluation-summary-bench": Format(
        "EVALUATION/summary.json, bench", "reconstruction:ReconstructionSummary"
    ),
    "evaluation-summary-depth": Format("EVALUATION/summary.json, depth", "depth:DepthSummary"),
    "evaluation-summary-detection": Format(
        "EVALUATION/summary.json, boxes and masks", "detection:DetectionSummary"
    ),
    "evaluation-summary-label-maps": Format(
        "EVALUATION/summary.json, panoptic segments and semantic maps", "label_maps:LabelMapSummary"
    ),
    "evaluation-summary-normals": Format(
        "EVALUATION/summary.json, normals", "normals:NormalsSummary"
    ),
    "evaluation-summary-relations": Format(
        "EVALUATION/summary.json, relations", "relations:RelationsSummary"
    ),
    "execution": Format("SCENE/execution.json", "scene_folder:ExecutionFile"),
    "frozen": Format("SCENE/frozen.json", "scene_folder:FrozenFile"),
    "instances": Format("instances.json of `legoworld inspect`", "scene_folder:InstancesFile"),
    "labels": Format("SCENE/labels.json", "scene_folder:LabelsFile"),
    "plugin-camera": Format("CAMERA.json, camera.json", "plugin_evidence:ProviderCamera"),
    "plugin-evidence": Format("EVIDENCE/evidence.json", "plugin_evidence:EvidenceFile"),
    "plugin-hooks": Format("a line of LEDGER/hooks.jsonl", "plugin_ledger:HookMark"),
    "plugin-install": Format(
        "record of `legoworld plugin install`", "plugin_install:InstalledFile"
    ),
    "plugin-ledger": Format("a line of LEDGER/ledger.jsonl", "plugin_ledger:Entry"),
    "plugin-outlines": Format("OUTLINES.json", "plugin_evidence:Outlines"),
    "plugin-plan": Format("LEDGER/initial/plan.json", "plugin_evidence:ConstructionPlan"),
    "plugin-report": Format("resource legoworld://reports/SHA256", "plugin_requirements:Report"),
    "plugin-room": Format("LEDGER/initial/room.json", "plugin_evidence:Room"),
    "plugin-state": Format("state of the scene, in the ledger's folder", "plugin_state:SceneState"),
    "plugin-transaction": Format("request of the plugin's `begin`", "plugin_ledger:Declaration"),
    "reconstruction": Format("SCENE/reconstruction.json", "agents:ReconstructionFile"),
    "run": Format("RUN/run.json", "run_file:RunFile"),
    "run-per-image": Format("a line of RUN/per_image.jsonl", "run_rows:RunRow"),
    "run-prediction": Format("an entry of RUN/predictions.json", "predictions:Prediction"),
    "run-summary": Format("RUN/summary.json", "run_file:RunSummary"),
    "track": Format("TRACK.json", "track:TrackFile"),
    "trajectories": Format("trajectories.json", "trajectories:TrajectoryFile"),
}


def schema_text(name: str) -> str:
    """JSON Schema 2020-12 of a format, self-contained. KeyError for another name."""
    module, _, record = FORMATS[name].record.partition(":")
    kind = getattr(importlib.import_module(f"legoworld.records.{module}"), record)
    (schema,), parts = msgspec.json.schema_components([kind], ref_template="#/$defs/{name}")
    return readable_json(
        {
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            "title": name,
            **schema,
            "$defs": parts,
        }
    )
