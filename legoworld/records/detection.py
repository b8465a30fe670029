"""Boxes and masks as a family of records: rows, summary and evidence.json of evaluations."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Final, Literal, NamedTuple

from legoworld.records.base import UNSET, Record, UnsetType, decode_lines
from legoworld.records.evaluation import (
    Coverage,
    EvaluationEvidence,
    EvaluationRow,
    Interval,
    MetricValue,
    Outcome,
    RecordFamily,
    ScoreConfiguration,
    Summary,
    Values,
)


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


class TieSpread(NamedTuple):
    """AP over tie orders: mean and standard deviation, and its bounds."""

    expected: float
    sd: float
    worst: float
    best: float


class Ties(Record, frozen=True, kw_only=True):
    """AP over random orders of equally confident predictions; None where AP is undefined."""

    expected: float | None
    sd: float | None
    worst: float | None
    best: float | None
    draws: int
    seed: int
    n_tied: int

    @property
    def spread(self) -> TieSpread | None:
        """The numbers where AP is defined."""
        expected, sd, worst, best = self.expected, self.sd, self.worst, self.best
        if expected is None or sd is None or worst is None or best is None:
            return None
        return TieSpread(expected, sd, worst, best)


class EqualConfidence(Record, frozen=True, kw_only=True):
    """The same predictions, none ranked above another."""

    already_equal: bool
    metrics: Values
    official: tuple[float, ...]
    ties: Ties


class Matched(Record, frozen=True, kw_only=True):
    """The score-free numbers of one-to-one pairs, in the order they are shown."""

    miou_gt_micro: float | None
    miou_gt_macro: float | None
    miou_matched: float | None
    n_matched: int
    precision_50: float | None
    recall_50: float | None
    f1_50: float | None
    sq: float | None
    rq: float | None
    pq: float | None
    n_gt: int
    n_dt: int
    n_hits_50: int
    label_accuracy: float | UnsetType | None = UNSET

    def values(self) -> Values:
        """The numbers that are no counts, in the order they are shown."""
        names = (name for name in self.__struct_fields__ if not name.startswith("n_"))
        present = {name: getattr(self, name) for name in names}
        return {name: value for name, value in present.items() if value is not UNSET}


class MatchedKinds(Record, frozen=True, kw_only=True):
    """Pairs within a category, and across categories."""

    class_aware: Matched
    class_agnostic: Matched


class TruthCounts(Record, frozen=True, kw_only=True):
    """Scored truth of one size."""

    categories_with_truth: int
    truth_instances: int


class FrequencyCounts(TruthCounts, frozen=True, kw_only=True):
    """Scored truth of one of LVIS's frequency groups."""

    categories: int


class Counts(FrequencyCounts, frozen=True, kw_only=True):
    """What the numbers are over, and what is not counted.

    areas: by COCO's area names; frequency_groups: by LVIS's letters.
    """

    truth_ignored: int
    predictions: int
    empty_masks_dropped: int
    lost_to_cap: int
    unverified_dropped: int
    false_positives_in_absent_categories: int
    areas: dict[str, TruthCounts]
    frequency_groups: dict[str, FrequencyCounts] | UnsetType = UNSET


class DetectionCoverage(Coverage, frozen=True, kw_only=True):
    """Coverage of boxes and masks."""

    scored_with_truth: int
    scored_without_predictions: int


class OcclusionLevel(Record, frozen=True, kw_only=True):
    """The evaluator's numbers where truths of another occlusion are ignored."""

    truth_instances: int
    metrics: Values


class AmodalNumbers(Record, frozen=True, kw_only=True):
    """What AP of amodal masks hides.

    levels: by occlusion of the truth. controls: every number where each amodal mask is replaced by
    the visible one, or by its convex hull. metrics and controls are empty, and there are no sums
    over the images, where the predictions have no visible masks.
    """

    metrics: Values
    sums: AmodalSums | UnsetType = UNSET
    levels: dict[str, OcclusionLevel]
    controls: dict[str, Values]


class SpaceErrors(Record, frozen=True, kw_only=True):
    """Medians over one-to-one pairs of boxes in space that overlap, within categories.

    center_m: between centres; volume_ratio: to the truth's; yaw_mod_90_deg: in [0, 45].
    """

    pairs: int
    center_m: float | None
    volume_ratio: float | None
    yaw_mod_90_deg: float | None


class DetectionSummary(Summary, frozen=True, kw_only=True):
    """Of boxes and masks. official: the evaluator's numbers in its order, -1 where undefined."""

    coverage: DetectionCoverage
    dataset_version: str
    iou_type: Literal["bbox", "segm", "bbox3D"]
    metrics: Values
    official: tuple[float, ...]
    ties: Ties
    equal_confidence: EqualConfidence
    matched: MatchedKinds
    intervals: dict[str, Interval]
    counts: Counts
    warnings: tuple[str, ...]
    amodal: AmodalNumbers | UnsetType = UNSET
    in_space: SpaceErrors | UnsetType = UNSET

    def metric_values(self) -> Iterator[MetricValue]:
        """The official metrics."""
        for name, value in self.metrics.items():
            yield MetricValue(name, None, value, self.intervals.get(name))


class DetectionConfiguration(ScoreConfiguration, frozen=True, kw_only=True):
    """What the numbers of boxes and masks depend on besides the inputs."""

    evaluator: str


class RunOrigin(Record, frozen=True, kw_only=True):
    """What a run says of itself: what it read, and the hashes of what it was for."""

    kind: str | None
    source: str | None
    track_sha256: str | None
    images_sha256: str | None
    vocabulary_sha256: str | None


class CardOrigin(Record, frozen=True, kw_only=True):
    """The readout card that was scored by."""

    task: str
    card_version: str
    card_sha256: str


class RawScores(Record, frozen=True, kw_only=True):
    """The evaluator's own numbers and lines, and the hash of the results it was given."""

    official: tuple[float, ...]
    lines: tuple[str, ...]
    prediction_order: str
    canonical_predictions_sha256: str


class EqualScores(Record, frozen=True, kw_only=True):
    """The evaluator's own numbers of the same predictions, none ranked above another."""

    official: tuple[float, ...]
    predictions_sha256: str


class DetectionEvidence(EvaluationEvidence, frozen=True, kw_only=True):
    """Of boxes and masks."""

    coverage: DetectionCoverage
    configuration: DetectionConfiguration
    run: RunOrigin
    protocol: CardOrigin
    raw: RawScores
    equal_confidence: EqualScores


RECORDS: Final = RecordFamily(
    summary=DetectionSummary,
    rows=partial(decode_lines, DetectionRow),
    evidence=DetectionEvidence,
    method=("configuration", "run", "protocol", "raw", "equal_confidence"),
)
