"""Evidence for the photos of a track, out of runs of specialist models; never of ground truth."""

from __future__ import annotations

from pathlib import Path, PurePosixPath
from typing import Final

import numpy as np

from legoworld.plugin.evidence import EvidenceInvalidError
from legoworld.records.base import RecordError, decode
from legoworld.records.folders.prediction_files import PREDICTIONS
from legoworld.records.folders.run_reading import RUN
from legoworld.records.plugin_evidence import DepthSpace
from legoworld.records.run_file import RunHead

_DEPTH: Final = "depth"
_ARRAYS: Final = (".npz", ".npy", ".png")


def regions_file(path: Path) -> Path:
    """The results file of a run folder, or a file itself.

    EvidenceInvalidError for a run that was prompted with ground truth.
    """
    run = path / RUN if path.is_dir() else path.parent / RUN
    if run.is_file():
        _refuse_truth(run)
    file = path / PREDICTIONS if path.is_dir() else path
    if not file.is_file():
        raise EvidenceInvalidError(
            f"{path.name} holds no regions",
            found=f"no {PREDICTIONS}",
            expected="a run of boxes or masks, or a COCO or LVIS results file",
        )
    return file


def depth_of(folder: Path, file_name: str) -> tuple[Path, DepthSpace] | None:
    """A photo's depth in a run folder or a folder of arrays, and its space; None where none is."""
    below = folder / _DEPTH if (folder / RUN).is_file() else folder
    stem = PurePosixPath(file_name).with_suffix("")
    paths = [below / f"{stem}{suffix}" for suffix in _ARRAYS]
    found = next((path for path in paths if path.is_file()), None)
    return None if found is None else (found, _space(found))


def _space(path: Path) -> DepthSpace:
    """What a baseline's .npz says of itself; depth for any other array."""
    if path.suffix != ".npz":
        return "depth"
    with np.load(path, allow_pickle=False) as stored:
        said = str(stored["space"]) if "space" in stored else "depth"
    if said == "disparity":
        return "disparity"
    if said != "depth":
        raise EvidenceInvalidError(
            f"{path.name} is no depth along the camera's axis",
            found=said,
            expected="depth or disparity",
        )
    return "depth"


def _refuse_truth(run: Path) -> None:
    try:
        used = decode(RunHead, run.read_bytes()).configuration.used_truth
    except (OSError, RecordError) as error:
        raise EvidenceInvalidError(
            f"{run.name} beside the regions cannot be read",
            found=str(error),
            expected="a run folder of `legoworld baseline run`",
        ) from error
    if used:
        raise EvidenceInvalidError(
            "the regions were made with ground truth",
            found="used_truth in run.json",
            expected="regions of a run that saw photos alone",
            next_step="run the baseline without --prompts-from-truth",
        )
