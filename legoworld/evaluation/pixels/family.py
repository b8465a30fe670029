"""What a family with one array for each image says of itself; the rest of scoring follows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from legoworld.cards import Card
from legoworld.depth_files.headers import SizeCheck
from legoworld.errors import LegoWorldError
from legoworld.readouts.pixels import PixelFile
from legoworld.records.comparison import Better
from legoworld.records.evidence import EvaluationEvidence
from legoworld.records.pixels import PixelRow
from legoworld.records.run_rows import RunImage
from legoworld.tasks.task import Family

if TYPE_CHECKING:
    from legoworld.evaluation.pixels.predictions import PixelRun

F64 = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]
#: The parameters that only some families take, such as a camera model.
Options = Mapping[str, str]


@dataclass(frozen=True, kw_only=True)
class Stored:
    """How a file stores an array. array: its name in an .npz or an EXR, None in other formats."""

    array: str | None
    dtype: str
    shape: tuple[int, ...]


class PixelArray(Protocol):
    """A predicted array, (H, W) or (H, W, channels), with what its family declares of it."""

    @property
    def values(self) -> NDArray[Any]:
        """As the file has them."""
        ...

    @property
    def size_wh(self) -> tuple[int, int]:
        """(width, height)."""
        ...

    @property
    def stored(self) -> Stored | None:
        """How its file has it; None for an array of no file."""
        ...

    def at(self, rows: Index, cols: Index) -> tuple[F64, Mask]:
        """What is resampled at pixels (n,), 0 where not predicted, and a mask of predictions."""
        ...


class PixelProtocol(Protocol):
    """What a task's card declares. min_valid_px: fewer in truth or prediction are not scored."""

    @property
    def card(self) -> Card:
        """The card."""
        ...

    @property
    def min_valid_px(self) -> int:
        """Fewer pixels in truth or prediction are not scored."""
        ...


class TruthFile(Protocol):
    """One image's ground truth, as it was found. calibration: further files that it needs."""

    @property
    def path(self) -> Path:
        """Of the array."""
        ...

    @property
    def calibration(self) -> tuple[Path, ...]:
        """Further files that it needs."""
        ...


@dataclass(frozen=True, kw_only=True)
class PixelTruth:
    """One image's ground truth, in memory.

    values: (H, W) or (H, W, channels), valid where the family says so; counts: fields of the row
    that are the family's own; warnings: of the row.
    """

    values: NDArray[Any]
    counts: Mapping[str, int]
    warnings: tuple[str, ...] = ()

    @property
    def size_wh(self) -> tuple[int, int]:
        """(width, height)."""
        return int(self.values.shape[1]), int(self.values.shape[0])


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
class PixelErrors:
    """The errors of a family, each with its own code.

    truth: of ground truth, which ends scoring; prediction, missing: of a file that is unusable, or
    not there; unseen: of a machine that does not see the same files as the command.
    """

    truth: type[LegoWorldError]
    prediction: type[LegoWorldError]
    missing: type[LegoWorldError]
    unseen: type[LegoWorldError]


@dataclass(frozen=True, kw_only=True)
class Measuring:
    """One image with a prediction, to be measured. row: with all that is known before."""

    row: Any
    prediction: Any
    truth: PixelTruth
    file: Any
    protocol: Any
    options: Options


@dataclass(frozen=True, kw_only=True)
class PixelFamily:
    """How answers of one array for each image are scored.

    Every function is a module's own, so that workers can take this value. noun: what the array is,
    in a sentence; stored: how a run keeps it; row: the type of a row without numbers.

    metrics, primary: in display order, and the policy that headlines follow.
    protocol: a task's, from its card; valid: mask of the values of truth that count.
    group: what is drawn with an image, by its file name.
    find_truth: of every image, below a folder; load_truth: one of them; truth_of: an array in
    memory. read: a file of a run, its size checked before it is read; array: one in memory, as
    readouts have it.
    measure: an image's row with numbers, and its view.
    check: refuses options that do not fit to run and truth; declaration: the file of a truth folder
    that says what its arrays are. summarise, configuration, evidence: records of the family.
    options_of: those that a summary was made with.
    """

    family: Family
    noun: str
    stored: PixelFile
    row: Callable[..., PixelRow]
    errors: PixelErrors
    metrics: tuple[PixelMetric, ...]
    primary: str
    declaration: str
    protocol: Callable[[str], PixelProtocol]
    valid: Callable[[NDArray[Any]], Mask]
    group: Callable[[str], str]
    find_truth: Callable[[Path, Sequence[RunImage]], tuple[Any, ...]]
    load_truth: Callable[[Any], PixelTruth]
    truth_of: Callable[[NDArray[Any]], PixelTruth]
    read: Callable[[Path, SizeCheck | None], PixelArray]
    array: Callable[[NDArray[Any]], PixelArray]
    measure: Callable[[Measuring], ImageResult]
    check: Callable[[PixelRun, Sequence[Any], Options], None]
    summarise: Callable[..., Any]
    configuration: Callable[[Any, Settings], Any]
    evidence: Callable[[Any, Any], EvaluationEvidence]
    options_of: Callable[[Any], Options]
