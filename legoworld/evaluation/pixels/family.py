"""What a family with one array for each image says of itself; the rest of scoring follows."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from legoworld import exit_codes
from legoworld.cards import Card
from legoworld.depth_files.headers import SizeCheck
from legoworld.errors import LegoWorldError
from legoworld.files import Json
from legoworld.readouts.pixels import PixelFile
from legoworld.records.comparison import Better
from legoworld.records.evaluation import Coverage, EvaluationEvidence, Evaluator, ScoreConfiguration
from legoworld.records.pixels import PixelRow, PixelSummary
from legoworld.records.run_rows import RunImage
from legoworld.tasks.task import Family

if TYPE_CHECKING:
    from legoworld.evaluation.pixels.rows import PixelRun

#: What every family's code implements.
_FIXED: Final[dict[str, Any]] = {
    "scoring.resolution": "truth",
    "scoring.images": "track",
    "scoring.failed_image": "left_out_and_listed",
    "holes.exclude": "not_scored",
}


class PixelErrors(NamedTuple):
    """The errors of a family, each with its own code.

    truth: ground truth is missing, undeclared or contradicts the track, which ends scoring;
    prediction, missing: of a file that is unusable, or not there; unseen: of a machine that does
    not see the same files as the command.
    """

    truth: type[LegoWorldError]
    prediction: type[LegoWorldError]
    missing: type[LegoWorldError]
    unseen: type[LegoWorldError]


def pixel_errors(noun: str, module: str) -> PixelErrors:
    """The errors of a family, such as `DepthTruthError` of "depth" with the code "depth_truth".

    module: the one that holds them under these names, by which they cross processes.
    """
    attributes: dict[str, dict[str, Any]] = {
        "truth": {},
        "prediction": {"status": "invalid"},
        "missing": {"status": "missing"},
        "unseen": {"exit_code": exit_codes.BLOCKED},
    }
    return PixelErrors(
        **{
            kind: type(
                f"{noun.capitalize()}{kind.capitalize()}Error",
                (LegoWorldError,),
                {"code": f"{noun}_{kind}", "__module__": module, **own},
            )
            for kind, own in attributes.items()
        }
    )


@dataclass(frozen=True, kw_only=True)
class PixelProtocol:
    """A card, held to what the code implements. declared: its choices that summaries repeat."""

    card: Card
    declared: Sequence[str]

    @property
    def evaluator(self) -> Evaluator:
        """What scores."""
        value = self.card.value
        return Evaluator(
            name=str(value("scoring.evaluator")), version=str(value("scoring.evaluator_version"))
        )

    @property
    def min_valid_px(self) -> int:
        """Fewer pixels in truth or prediction are not scored."""
        return int(self.card.value("scoring.min_valid_px"))

    def failed_image(self, metric: str) -> float:
        """The metric's value of an image without a score, where all attempted ones count."""
        return float(self.card.value(f"scoring.failed_image_{metric}"))

    @property
    def choices(self) -> dict[str, Any]:
        """The choices that determine a number, by the last part of their card key."""
        keys = (*self.declared, "scoring.min_valid_px")
        return {key.split(".")[1]: self.card.value(key) for key in keys}


def pixel_protocol(
    card: Card, *, fixed: Mapping[str, Json], declared: Sequence[str]
) -> PixelProtocol:
    """A card's protocol; InstallationError if a fixed value differs from the code's."""
    card.hold_to({**_FIXED, **fixed})
    return PixelProtocol(card=card, declared=declared)


F64 = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]
#: The parameters that only some families take, such as a camera model.
Options = Mapping[str, Json]


@dataclass(frozen=True, kw_only=True)
class Stored:
    """How a file stores an array. array: its name in an .npz or an EXR, None in other formats."""

    array: str | None
    dtype: str
    shape: tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class _Picture:
    """values: (H, W) or (H, W, channels)."""

    values: NDArray[Any]

    @property
    def size_wh(self) -> tuple[int, int]:
        """(width, height)."""
        return int(self.values.shape[1]), int(self.values.shape[0])


@dataclass(frozen=True, kw_only=True)
class PixelArray(_Picture, ABC):
    """A predicted array, with what its family declares of it.

    stored: how its file has it; None for an array of no file.
    """

    stored: Stored | None = None

    @abstractmethod
    def at(self, rows: Index, cols: Index) -> tuple[F64, Mask]:
        """What is resampled at pixels (n,), 0 where not predicted, and a mask of predictions."""


@dataclass(frozen=True, kw_only=True)
class TruthFile:
    """One image's ground truth, as it was found. calibration: further files that it needs."""

    path: Path
    calibration: tuple[Path, ...] = ()


@dataclass(frozen=True, kw_only=True)
class PixelTruth(_Picture):
    """One image's ground truth, in memory.

    Values are valid where the family says so; counts: fields of the row that are the family's own;
    warnings: of the row.
    """

    counts: Mapping[str, int]
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class ImageResult:
    """A per_image row, and the image's view (None if not scored)."""

    row: PixelRow
    view: Any = None


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What a score is made with besides its inputs. options: the family's own."""

    options: Options
    draws: int
    seed: int


@dataclass(frozen=True, kw_only=True)
class PixelMetric:
    """A number of an image, and of its mean over images.

    policies: what is done with pixels that have no prediction, where the metric is defined for it;
    headline: those of them that comparisons begin with; detail: whether short tables leave it out.
    """

    name: str
    better: Better
    policies: tuple[str, ...]
    headline: tuple[str, ...] = ()
    detail: bool = False


def metric_policies(metrics: Sequence[PixelMetric]) -> list[tuple[str, str]]:
    """Every (metric, hole policy) that is defined, in display order."""
    return [(metric.name, policy) for metric in metrics for policy in metric.policies]


@dataclass(frozen=True, kw_only=True)
class Measuring:
    """One image with a prediction, to be measured. row: with all that is known before."""

    row: Any
    prediction: Any
    truth: PixelTruth
    file: Any
    protocol: Any
    options: Options


def _usual(_rows: Sequence[PixelRow], coverage: Coverage) -> Coverage:
    """No more than every family says."""
    return coverage


@dataclass(frozen=True, kw_only=True)
class PixelRecords:
    """The types of a family's files. choices, attempted: of parts of its summary.

    coverage: of every attempted row, from the usual one.
    """

    summary: Callable[..., PixelSummary]
    choices: type[Any]
    attempted: Callable[..., Any]
    configuration: Callable[..., ScoreConfiguration]
    evidence: type[EvaluationEvidence]
    coverage: Callable[[Sequence[Any], Coverage], Coverage] = _usual


@dataclass(frozen=True, kw_only=True)
class SecondReading:
    """What only arrays can say, of which the rows of all images say what is to be asked.

    question: options that are measured with, from the scored rows; the answer is in the view's
    place. conclude: options of the summary, from these rows and the answers; recall: those that a
    summary was made with.
    """

    question: Callable[[Sequence[Any]], Options]
    conclude: Callable[[Sequence[Any], Sequence[Any]], Options]
    recall: Callable[[Any], Options]


def _fits(_run: PixelRun, _files: Sequence[TruthFile], _options: Options) -> None:
    """Every option fits to every run and truth."""


@dataclass(frozen=True, kw_only=True)
class PixelFamily:
    """How answers of one array for each image are scored.

    Every function is a module's own, so that workers can take this value. noun: what the array is,
    in a sentence; stored: how a run keeps it; row: the type of a row without numbers.

    metrics, primary: in display order, and the policy that headlines follow; of the first one the
    card has `scoring.failed_image_<name>`.
    options: the family's own parameters, by name with their defaults.
    protocol: of a task's card; valid: mask of the values of truth that count.
    group: what is drawn with an image, by its file name.
    find_truth: of every image, below a folder; load_truth: one of them; make_truth: an array in
    memory. read: a file of a run, its size checked before it is read; array: one in memory, as
    readouts have it.
    measure: an image's row with numbers, and its view.
    check: refuses options that do not fit to run and truth; declaration: the file of a truth folder
    that says what its arrays are. again: what is read of the arrays once all are measured.
    records: types of the files; choices: of the summary's protocol. own: fields of the summary that
    are the family's own, from the rows, the scored ones, and the settings.
    """

    family: Family
    noun: str
    stored: PixelFile
    row: Callable[..., PixelRow]
    errors: PixelErrors
    metrics: tuple[PixelMetric, ...]
    primary: str
    declaration: str
    protocol: Callable[[Card], PixelProtocol]
    valid: Callable[[NDArray[Any]], Mask]
    find_truth: Callable[[Path, Sequence[RunImage]], tuple[Any, ...]]
    load_truth: Callable[[Any], PixelTruth]
    make_truth: Callable[[NDArray[Any]], PixelTruth]
    read: Callable[[Path, SizeCheck | None], PixelArray]
    array: Callable[[NDArray[Any]], PixelArray]
    measure: Callable[[Measuring], ImageResult]
    records: PixelRecords
    own: Callable[[Sequence[Any], Sequence[Any], Settings], Mapping[str, Any]]
    group: Callable[[str], str] = str
    options: Options = field(default_factory=dict)
    check: Callable[[PixelRun, Sequence[Any], Options], None] = _fits
    again: SecondReading | None = None
