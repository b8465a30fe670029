"""Runs of facts, tracks of their questions and answers to them, through the commands."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from msgspec.structs import asdict
from readouts.cubes import SIZE, view_of

from legoworld import cli
from legoworld.evaluation.relations.truth import read_truth
from legoworld.readouts.family import protocol
from legoworld.readouts.relation_facts import relation_facts
from legoworld.readouts.relations import write_answers
from legoworld.records.relations import AnswerFile

TABLE = (
    ("cup", (-1.2, 0.85, 5), 0.3),
    ("cup", (1.2, 0.35, 6), 0.3),
    ("dining table", (1.2, 1, 6), 1),
    ("chair", (-2, 0.75, 8), 1.5),
    ("laptop", (0.3, 1.35, 4.5), 0.3),
)
STREET = (
    ("car", (-1.5, 0.5, 7), 1.2),
    ("bus", (2.5, 0, 9), 2),
    ("person", (0.4, 0.3, 6), (0.5, 0.5, 1.6)),
)


def call(*words: object) -> int:
    return cli.run([str(word) for word in words])


def write_facts(folder: Path, scenes: Mapping[str, Any]) -> Path:
    """A finished run of scenes by file name; None is one that failed."""
    rows = []
    folder.mkdir(parents=True)
    for image_id, (name, placed) in enumerate(scenes.items(), start=1):
        row: dict[str, Any] = {"image_id": image_id, "file_name": name, "scene": Path(name).stem}
        if placed is None:
            rows.append({**row, "status": "invalid", "reason": "it was broken"})
            continue
        file = AnswerFile(facts=relation_facts(*view_of(*placed)))
        written = asdict(write_answers(folder, Path(name).stem, file))
        rows.append({**row, "size_wh": SIZE, "status": "ok", "reason": None, "answer": written})
    reading = protocol("relations", None)
    configuration = {
        "task": "relations",
        "kind": "scene",
        "attempted": len(rows),
        "partial": False,
        "card_sha256": reading.card.sha256,
        "card_version": reading.card.version,
        "vocabulary_sha256": reading.vocabulary.sha256,
    }
    (folder / "run.json").write_text(json.dumps({"configuration": configuration, "scenes": {}}))
    (folder / "per_image.jsonl").write_text("".join(json.dumps(r) + "\n" for r in rows))
    return folder


def true_answers(truth: Path) -> dict[str, Any]:
    images = read_truth(truth, "relations").images.values()
    return {one.question.id: one.answer for image in images for one in image.answers}


def write_answer_lines(path: Path, answers: Mapping[str, Any]) -> Path:
    lines = [json.dumps({"id": key, "answer": value}) for key, value in answers.items()]
    path.write_text("\n".join(lines) + "\n")
    return path


def evaluated(run: Path, truth: Path, output: Path) -> dict[str, Any]:
    assert call("evaluate", run, "--truth", truth, "-o", output, "--draws", 100) == 0
    return json.loads((output / "summary.json").read_text())
