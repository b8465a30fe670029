"""per_image.jsonl and per_category.jsonl of an evaluation."""

from __future__ import annotations

from typing import Final, Literal, NamedTuple

from legoworld.records.base import UNSET, Record, RecordError, UnsetType, decode, decode_lines

#: Depth: statuses of images that have numbers; every other status has none.
SCORED: Final = ("ok", "inverted", "degenerate")
#: Depth: the status of an image without enough valid truth.
NO_TRUTH: Final = "no_gt"
#: Depth: metric -> hole policy -> value.
Metrics = dict[str, dict[str, float]]


class ImageRow(Record, frozen=True, kw_only=True):
    """One image of an evaluation. status: ok, or why there is nothing to score."""

    image_id: int
    file_name: str
    status: str


class Outcome(NamedTuple):
    """How an image ended, for the coverage bar. words: its status, or a reason in words."""

    sort: Literal["scored", "empty", "failed"]
    words: str


class EvaluationRow(ImageRow, frozen=True, kw_only=True):
    """One image of an evaluation, as every family answers for it."""

    @property
    def has_score(self) -> bool:
        """Whether the image counts as scored."""
        raise NotImplementedError(type(self).__name__)

    @property
    def has_truth(self) -> bool:
        """Whether the image has usable ground truth."""
        raise NotImplementedError(type(self).__name__)

    @property
    def truth_gap(self) -> str:
        """Why the image has no usable ground truth; "" where it has."""
        return "" if self.has_truth else "no truth"

    @property
    def score_gap(self) -> str:
        """Why the image has no score, apart from missing truth; "" where nothing says so."""
        return "" if self.has_score or self.status == "ok" else self.status

    @property
    def outcome(self) -> Outcome:
        """How the image ended."""
        return Outcome("scored" if self.has_score else "failed", self.status)


class Outcomes(Record, frozen=True, kw_only=True):
    """Outcomes of predictions at IoU 0.5."""

    tp: int
    fp: int
    ignored: int


class PairSums(Record, frozen=True, kw_only=True):
    """Sums over one-to-one pairs of an image; quality: pairs above IoU 0.5."""

    n_gt: int
    n_dt: int
    iou_sum: float
    n_matched: int
    n_hits: int
    n_quality: int
    quality_sum: float
    n_hits_right_label: int | UnsetType = UNSET


class DetectionRow(EvaluationRow, frozen=True, kw_only=True):
    """One image of boxes or masks."""

    scored: bool
    n_truth: int
    n_ignored_truth: int
    n_predictions: int
    n_lost_to_cap: int
    n_unverified: int
    greedy_50: Outcomes
    class_aware: PairSums
    class_agnostic: PairSums

    @property
    def has_score(self) -> bool:
        """Whether the run answered for it."""
        return self.scored

    @property
    def has_truth(self) -> bool:
        """Whether an annotation is neither crowd nor ignored."""
        return self.n_truth > 0

    @property
    def truth_gap(self) -> str:
        """How many annotations do not count."""
        if self.has_truth:
            return ""
        ignored = self.n_ignored_truth
        return f"no truth: {ignored} crowd or ignored instances" if ignored else "no truth"

    @property
    def outcome(self) -> Outcome:
        """An image without a prediction is a part of its own."""
        if self.scored and self.n_predictions == 0:
            return Outcome("empty", "scored without predictions")
        return Outcome("scored" if self.scored else "failed", self.status)


class CategoryRow(Record, frozen=True, kw_only=True):
    """One category that has truth or predictions; None where a number is undefined."""

    category_id: int
    name: str
    n_truth: int
    n_images: int
    n_predictions: int
    AP: float | None
    AP50: float | None
    AP75: float | None
    AR: float | None
    greedy_50: Outcomes
    miou_gt: float | None
    frequency: str | UnsetType = UNSET


class DepthTruthRow(EvaluationRow, frozen=True, kw_only=True):
    """One image of depth: its verdict and its truth.

    group: what is drawn with it, its scene or itself. run_status: the run's own.
    """

    group: str
    code: str | None
    reason: str | None
    run_status: str
    truth_wh: tuple[int, int]
    n_valid: int
    truth_inf_px: int
    truth_nan_px: int
    truth_non_positive_px: int
    warnings: tuple[str, ...]

    @property
    def has_score(self) -> bool:
        """Whether it has numbers."""
        return False

    @property
    def has_truth(self) -> bool:
        """Whether enough of its truth is valid."""
        return self.status != NO_TRUTH

    @property
    def truth_gap(self) -> str:
        """How many pixels are valid."""
        return "" if self.has_truth else f"no truth: {self.n_valid} valid pixels"

    @property
    def score_gap(self) -> str:
        """The run's own status where the truth is what is missing."""
        status = self.run_status if self.status == NO_TRUTH else self.status
        return "" if self.has_score or status == "ok" else status


class UnscoredDepthRow(DepthTruthRow, frozen=True, kw_only=True):
    """One image of depth without numbers, with what is known of a prediction that could be read."""

    prediction_wh: tuple[int, int] | UnsetType = UNSET
    space: str | UnsetType = UNSET
    unit: str | UnsetType | None = UNSET
    resampled: bool | UnsetType = UNSET
    warped: bool | UnsetType = UNSET
    n_predicted: int | UnsetType = UNSET
    hole_share: float | UnsetType = UNSET
    outside_view_share: float | UnsetType = UNSET


class ScoredDepthRow(DepthTruthRow, frozen=True, kw_only=True):
    """One image of depth with its numbers; shares are of the valid truth.

    unit: None where the scale is unknown: of disparity always, of depth without a declared unit.
    s, t: aligned disparity = s * predicted + t. worse_than_constant: the hole policies under which
    AbsRel is above that of `constant`, which knows nothing of the picture.
    """

    prediction_wh: tuple[int, int]
    space: str
    unit: str | None
    resampled: bool
    warped: bool
    n_predicted: int
    hole_share: float
    outside_view_share: float
    s: float
    t: float
    clamped_share: float
    deepest_truth_z_m: float
    metrics: Metrics
    constant: Metrics
    worse_than_constant: tuple[str, ...]

    @property
    def has_score(self) -> bool:
        """Whether it has numbers."""
        return True


DepthRow = UnscoredDepthRow | ScoredDepthRow


def depth_rows(data: bytes) -> list[DepthRow]:
    """The lines of a depth evaluation's per_image.jsonl. RecordError."""
    lines = [line for line in data.split(b"\n") if line.strip()]
    rows: list[DepthRow] = []
    for row, line in zip(decode_lines(UnscoredDepthRow, data), lines, strict=True):
        try:
            rows.append(decode(ScoredDepthRow, line) if row.status in SCORED else row)
        except RecordError as error:
            raise RecordError(f"image {row.image_id}: {error}") from error
    return rows
