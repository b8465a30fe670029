"""summary.json of an evaluation: every number with its interval and what it is over."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal, NamedTuple

from legoworld.conventions import SCHEMA_VERSION
from legoworld.records.base import UNSET, Record, UnsetType
from legoworld.records.evaluation_rows import AmodalSums

#: Metric -> value; None where the metric is undefined.
Values = dict[str, float | None]


class Evaluator(Record, frozen=True, kw_only=True):
    """What computed the official numbers."""

    name: str
    version: str


class Interval(Record, frozen=True, kw_only=True):
    """The percentile interval of bootstrap samples; low and high are None when none is defined.

    unit: what is drawn. undefined_draws: samples that left the metric undefined. bootstrap_mean:
    where the samples lay before they were shifted onto the value.
    """

    low: float | None
    high: float | None
    level: float
    unit: str
    draws: int
    undefined_draws: int
    bootstrap_mean: float | UnsetType | None = UNSET

    @property
    def ends(self) -> tuple[float, float] | None:
        """(low, high) where they are defined."""
        return None if self.low is None or self.high is None else (self.low, self.high)


class Coverage(Record, frozen=True, kw_only=True):
    """Images by outcome: the denominators of every number."""

    attempted: int
    scored: int
    with_truth: int
    by_status: dict[str, int]


class MetricValue(NamedTuple):
    """One number of an evaluation. policy: what it is over, where a metric has several."""

    name: str
    policy: str | None
    value: float | None
    interval: Interval | None


class Summary(Record, frozen=True, kw_only=True):
    """What every evaluation says. kind: "scene", or what made the predictions instead."""

    schema_version: int = SCHEMA_VERSION
    task: str
    kind: str | None
    partial: bool
    evaluator: Evaluator
    coverage: Coverage

    def metric_values(self) -> Iterator[MetricValue]:
        """Every metric in display order."""
        raise NotImplementedError(type(self).__name__)


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


class DepthRules(Record, frozen=True, kw_only=True):
    """The choices of the depth card that decide a number."""

    space: str
    model: str
    solver: str
    disparity_floor: str
    fit_pixels: str
    aggregate: str
    resolution: str
    resample: str
    valid_truth: str
    policies: tuple[str, ...]
    primary: str
    min_valid_px: int


class NotScored(Record, frozen=True, kw_only=True):
    """An image without a score, and why."""

    image_id: int
    file_name: str
    status: str
    reason: str | None
