"""What a run folder holds, to compare two of them byte for byte."""

from __future__ import annotations

import json
from pathlib import Path

from legoworld import cli


def tree(folder: Path) -> dict[str, bytes]:
    """Every file, temporary ones included; run.json without its time."""
    files = {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    if "run.json" in files:
        document = json.loads(files["run.json"])
        document.pop("finished_at")
        files["run.json"] = json.dumps(document, sort_keys=True).encode()
    return files


def readout(scenes: object, run: object, *more: object, task: str = "coco") -> int:
    return cli.run(["readout", "-q", str(scenes), "--task", task, "-o", str(run), *map(str, more)])


def results_alone(run: Path) -> dict[str, bytes]:
    """Everything a run wrote but run.json, which has its time."""
    return {
        str(p.relative_to(run)): p.read_bytes()
        for p in sorted(run.rglob("*"))
        if p.is_file() and p.name != "run.json"
    }


def results(run: Path, *, with_time: bool = False) -> dict[str, bytes]:
    """A finished run: all but the lock's file, which stays where the run was written."""
    files = tree(run)
    files.pop(".lock", None)
    assert "run.json" in files
    return {**files, "run.json": (run / "run.json").read_bytes()} if with_time else files
