"""per_image.jsonl and per_category.jsonl of an evaluation."""

from __future__ import annotations

from typing import Literal, NamedTuple

from legoworld.records.base import UNSET, Record, UnsetType


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


class AmodalSums(Record, frozen=True, kw_only=True):
    """Amodal masks of an image: what the numbers besides AP are made of. docs/protocols/amodal.md.

    n_matched: truths with a prediction of their category at IoU 0.5; n_occluded: those with an
    invisible part, invisible_iou_sum over them; n_hidden: those without a visible pixel; order:
    pairs of which one is in front.
    """

    n_matched: int
    fraction_error_sum: float
    n_occluded: int
    n_occluded_matched: int
    invisible_iou_sum: float
    n_hidden: int
    n_hidden_matched: int
    n_order_truth: int
    n_order_predicted: int
    n_order_right: int


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
    amodal: AmodalSums | UnsetType = UNSET

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
