"""The run and the dataset behind a bench evaluation, where they still lie where it found them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from legoworld.errors import LegoWorldError
from legoworld.evaluation.reconstruction.dataset import TRUTH, BenchDataset, read_dataset
from legoworld.evaluation.stored import StoredEvaluation
from legoworld.files import sha256_of_file
from legoworld.records.folders.read_run import ROWS

_MOVED: Final = "is not where the evaluation found it, so there are no pictures"


@dataclass(frozen=True, kw_only=True)
class BenchInputs:
    """What one evaluation was computed from. dataset: both halves, the private one included."""

    run: Path
    dataset: BenchDataset


def bench_inputs(side: StoredEvaluation) -> BenchInputs | str:
    """The folders of one evaluation, or why its cases have no pictures.

    Both must be the very files that were scored: rows and truth.json by the hashes in
    evidence.json, surfaces, renders and arrays by those in them.
    """
    rows = _find_folder(side, "run_rows", ROWS)
    if rows is None:
        return f"its run {_MOVED}"
    truth = _find_folder(side, "truth", TRUTH)
    if truth is None:
        return f"the private half of its dataset {_MOVED}"
    try:
        return BenchInputs(run=rows, dataset=read_dataset(truth))
    except LegoWorldError as error:
        return f"its dataset cannot be read: {error.what}"


def _find_folder(side: StoredEvaluation, role: str, name: str) -> Path | None:
    """The folder of an input of these bytes."""
    for entry in side.evidence.inputs:
        path = side.folder / entry.path
        if entry.role == role and path.name == name and path.is_file():
            return path.parent if sha256_of_file(path) == entry.sha256 else None
    return None
