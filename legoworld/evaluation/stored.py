"""A finished evaluation as comparisons and reports read it: named, and checked by its hashes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from legoworld.errors import LegoWorldError
from legoworld.evaluation.family import load_evaluation_family
from legoworld.files import sha256_of_file
from legoworld.records.base import decode
from legoworld.records.coco_file import ShownPrediction, TruthView
from legoworld.records.detection import CategoryRow
from legoworld.records.evaluation import EvaluationEvidence, EvaluationRow, Evidence, Summary
from legoworld.records.folders.read_evaluation import (
    EVIDENCE,
    MATCHES,
    PER_CATEGORY,
    PER_IMAGE,
    SUMMARY,
    VIEW,
    read_category_rows,
    read_evaluation_evidence,
    read_image_rows,
    read_summary,
    require_finished,
    translate_read_errors,
)
from legoworld.records.run_file import ImageSource, RunView, UsedTruth
from legoworld.records.run_rows import RunRow

if TYPE_CHECKING:
    from legoworld.records.depth import DepthSummary
    from legoworld.records.detection import DetectionRow, DetectionSummary
    from legoworld.records.reconstruction import ReconstructionRow, ReconstructionSummary

T = TypeVar("T")
RUN_VIEW: Final = f"{VIEW}/run.json"
#: What is read besides evidence.json, in the order it is listed; absent files are none of the task.
READ: Final = (SUMMARY, PER_IMAGE, PER_CATEGORY, MATCHES, RUN_VIEW)


class EvaluationChangedError(LegoWorldError):
    """An evaluation folder was changed after it was written."""

    code = "evaluation_changed"


@dataclass(frozen=True, kw_only=True)
class StoredEvaluation:
    """One evaluation.

    name: how tables and pages call it; run: its view/run.json; rows: of per_image.jsonl, ascending
    image id; categories: of per_category.jsonl.
    """

    folder: Path
    name: str
    summary: Summary
    evidence: EvaluationEvidence
    run: RunView
    rows: tuple[EvaluationRow, ...]
    categories: tuple[CategoryRow, ...]

    @property
    def task(self) -> str:
        """The task's name."""
        return self.summary.task

    @property
    def is_scene(self) -> bool:
        """Whether the run read scenes; a baseline otherwise."""
        return self.summary.kind == "scene"

    @property
    def detection(self) -> DetectionSummary:
        """The summary, of boxes or masks."""
        return cast("DetectionSummary", self.summary)

    @property
    def depth(self) -> DepthSummary:
        """The summary, of depth."""
        return cast("DepthSummary", self.summary)

    @property
    def reconstruction(self) -> ReconstructionSummary:
        """The summary, of a bench."""
        return cast("ReconstructionSummary", self.summary)

    @property
    def reconstruction_rows(self) -> list[ReconstructionRow]:
        """The rows, of a bench."""
        return cast("list[ReconstructionRow]", list(self.rows))

    @property
    def detection_rows(self) -> list[DetectionRow]:
        """The rows, of boxes or masks."""
        return cast("list[DetectionRow]", list(self.rows))

    def kept_rows(self, kept: NDArray[np.bool_]) -> list[Any]:
        """The rows of some images, (images,) bool."""
        return [row for row, keep in zip(self.rows, kept, strict=True) if keep]

    @property
    def used_truth(self) -> UsedTruth | None:
        """What the run says of truth it was prompted with; None for a run that saw none."""
        return self.run.configuration.used_truth or None

    @cached_property
    def run_rows(self) -> dict[int, RunRow]:
        """The run's own row of each image, by image id."""
        return {row.image_id: row for row in self.run.images}

    def source(self, image_id: int) -> ImageSource | None:
        """What an image's result was made from; None where the run does not say."""
        return (self.run.scenes or {}).get(str(image_id))

    @cached_property
    def matches(self) -> dict[str, NDArray[Any]]:
        """The arrays of matches.npz, shapes as in `MatchTable` and `MatchedCounts`."""
        with np.load(self.folder / MATCHES, allow_pickle=False) as arrays:
            return dict(arrays)

    def truth_view(self) -> TruthView:
        """Boxes and masks only: view/truth.json. EvaluationChangedError, EvaluationFolderError."""
        return self._view(TruthView, "truth.json")

    def prediction_views(self) -> list[ShownPrediction]:
        """Boxes and masks only: view/predictions.json. The same errors."""
        return self._view(list[ShownPrediction], "predictions.json")

    def image_view(self, kind: type[T], image_id: int) -> T | None:
        """Families of arrays only: an image's view, None where it was not scored."""
        name = f"{image_id}.json"
        return self._view(kind, name) if f"{VIEW}/{name}" in self.evidence.files else None

    def _view(self, kind: type[T], name: str) -> T:
        with translate_read_errors(self.folder, f"{VIEW}/{name}"):
            path = check_file(self.folder, self.evidence, f"{VIEW}/{name}")
            return decode(kind, path.read_bytes())


def read_evaluation(folder: Path, *, unnamed: str | None = None) -> StoredEvaluation:
    """A finished evaluation under its own name: "scene", or the baseline's.

    unnamed: what a baseline is called that recorded no name, None for the folder's name.
    EvaluationFolderError: it is none. EvaluationChangedError: a file is not the one its
    evidence.json has on record.
    """
    require_finished(folder)
    evidence = read_evaluation_evidence(folder)
    present = [name for name in READ if name in evidence.files]
    needed = {SUMMARY, PER_IMAGE, RUN_VIEW, *load_evaluation_family(evidence.task).files}
    if missing := sorted(needed - {*present}):
        raise EvaluationChangedError(
            f"{folder.name} has a different version",
            found=f"no {', '.join(missing)}",
            expected="a folder of this version's `legoworld evaluate`",
            next_step="evaluate again with --overwrite",
        )
    for name in present:
        check_file(folder, evidence, name)
    summary = read_summary(folder)
    with translate_read_errors(folder, RUN_VIEW) as path:
        run = decode(RunView, path.read_bytes())
    name = "scene"
    if summary.kind != "scene":
        name = str(run.configuration.baseline or unnamed or folder.resolve().name)
    return StoredEvaluation(
        folder=folder,
        name=name,
        summary=summary,
        evidence=evidence,
        run=run,
        rows=tuple(read_image_rows(folder, summary)),
        categories=tuple(read_category_rows(folder)) if PER_CATEGORY in present else (),
    )


def check_file(folder: Path, evidence: Evidence, name: str) -> Path:
    """A file's path. EvaluationChangedError when it is not what evidence.json has on record."""
    path = folder / name
    recorded = evidence.files.get(name)
    digest = sha256_of_file(path) if path.is_file() else None
    if digest is None or digest != recorded:
        raise EvaluationChangedError(
            f"{folder.name}/{name} is not what was written",
            found=digest[:12] if digest else "no such file",
            expected=f"{str(recorded)[:12]}, as in {EVIDENCE}",
            next_step="evaluate again; `legoworld evidence verify` names every difference",
        )
    return path
