"""Evaluations of a bench: per_image.jsonl, summary.json, evidence.json and the family of them."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Annotated, Final, Literal

from msgspec import Meta

from legoworld.records.base import UNSET, Record, UnsetType, decode_lines
from legoworld.records.bench_dataset import Articulation, ArticulationSummary, Tier
from legoworld.records.evaluation import (
    Coverage,
    EvaluationEvidence,
    EvaluationRow,
    Interval,
    MetricValue,
    NotScored,
    Outcome,
    RecordFamily,
    ScoreConfiguration,
    Summary,
    Values,
)
from legoworld.records.second_card import XScores
from legoworld.records.submission import Check

#: Statuses of submissions that were compared; of every other one V, R, A and S are 0.
COMPARED: Final = "ok"
#: What could not be evaluated although the readout had made everything, after one retry.
EVALUATOR_ERROR: Final = "evaluator_error"
FlagKind = Literal[
    "picture_in_scene",
    "picture_in_world",
    "compositor_nodes",
    "camera_facing_planes",
    "text_blocks",
    "drivers",
    "appearance_without_geometry",
    "view_drop",
    "sub_pixel_surface",
    "one_view_geometry",
    "one_view_appearance",
    "surface_not_in_picture",
    "picture_like_reference",
]


class PrecisionRecall(Record, frozen=True, kw_only=True):
    """Shares of points within tau: precision of submitted ones, recall of reference ones."""

    f1: float
    precision: float
    recall: float


class ObjectRow(PrecisionRecall, frozen=True, kw_only=True):
    """One scored object at the headline's tolerance. at: the same by the other tolerances' names.

    An object without a reference point is not eligible: it is listed and not averaged.
    """

    id: int
    name: str
    category: str
    eligible: bool
    n_reference: int
    n_submitted: int
    at: dict[str, PrecisionRecall]


class Registration(Record, frozen=True, kw_only=True):
    """The rigid motion that trimmed ICP finds from the submitted surface to the reference's."""

    rotation_deg: float
    translation_m: float
    iterations: int
    trimmed_rms_m: float


class CameraError(Record, frozen=True, kw_only=True):
    """The submission's camera against the reference's.

    fov_deg: horizontal, submitted minus reference; null for an orthographic camera. world_*: of the
    two poses as each scene's own world states them, which say nothing where an agent chose its own
    origin; registration: of the surfaces, in the camera frame, null where ICP has too few points.
    """

    fov_deg: float | None
    world_rotation_deg: float | None
    world_translation_m: float | None
    registration: Registration | None


class Diagnostics(Record, frozen=True, kw_only=True):
    """Numbers beside R, none of which enters it; null where undefined. docs/protocols/bench.md."""

    object_union: PrecisionRecall
    visible_scene: PrecisionRecall
    chamfer_l1_half_sum_over_reference_visible_box_diagonal: float | None
    voxel_iou_5_percent_of_median_depth: float | None
    voxel_iou_5cm: float | None
    voxel_iou_10cm: float | None
    R_median_scale: float | None
    R_disparity_scale_shift: float | None
    R_rigid: float | None
    R_own_intrinsics: float | None


class NoiseBeside(Record, frozen=True, kw_only=True):
    """What the render card's noise can do to A; null where it was not measured.

    reference_mean, reference_sd: A of the reference's own renders by seed; two_seeds: the share of
    pixels that two seeds of this submission's render put more than delta apart.
    """

    reference_mean: float | None
    reference_sd: float | None
    two_seeds: float | None


class Appearance(Record, frozen=True, kw_only=True):
    """A's parts. curve: A by delta; where_*: A of pixels whose geometry agrees, or does not."""

    n_px: int
    n_hits: int
    curve: dict[str, float]
    where_geometry_agrees: float | None
    n_geometry_agrees_px: int
    where_geometry_differs: float | None
    n_geometry_differs_px: int
    noise: NoiseBeside


class Flag(Record, frozen=True, kw_only=True):
    """Something a person should look at; it changes no score. measured: its number, see kind."""

    kind: FlagKind
    what: str
    measured: float
    threshold: float


class ReconstructionRow(EvaluationRow, frozen=True, kw_only=True):
    """One case. status: ok where it was compared; valid, R, A, S: zeros where it was not.

    run_status: the readout's. R and A are null where they were not asked for (A without a render),
    S then too. validity: each check, null where the readout recorded none. articulation: left out
    where the reference has no joint, x where the task is not bench-x.
    """

    code: str | None
    reason: str | None
    run_status: str
    warnings: tuple[str, ...]
    family: str
    environment: str | None
    theme: str | None
    split: str | None
    tier: Tier | None
    view: int
    valid: bool
    validity: dict[str, Check] | None
    R: float | None
    A: float | None
    S: float | None
    R_at: dict[str, float]
    objects: tuple[ObjectRow, ...]
    fov_error_deg: float | None
    camera: CameraError | None
    diagnostics: Diagnostics | None
    appearance: Appearance | None
    flags: tuple[Flag, ...]
    articulation: Articulation | UnsetType = UNSET
    x: XScores | UnsetType = UNSET

    @property
    def has_score(self) -> bool:
        """Whether the submission is valid."""
        return self.valid

    @property
    def has_truth(self) -> bool:
        """Always: a case without an eligible object is refused when it is made."""
        return True

    @property
    def score_gap(self) -> str:
        """Why the submission counts 0."""
        if self.valid:
            return ""
        return "not valid" if self.status == COMPARED else self.status

    @property
    def outcome(self) -> Outcome:
        """A submission that was compared and is not valid is a part of its own."""
        if self.status != COMPARED:
            return Outcome("failed", self.status)
        return Outcome("scored", self.status) if self.valid else Outcome("empty", "not valid")


#: Which cases a mean is over: all that were attempted, zeros included, or the valid ones.
Over = Literal["attempted", "valid"]


class Mean(Record, frozen=True, kw_only=True):
    """A mean over cases in [0, 1]; null where nothing defines it. n: its denominator."""

    value: float | None
    n: Annotated[int, Meta(ge=0)]
    over: Over
    interval: Interval | None


#: Metric -> mean: V, R, A, S over all attempted, R_valid, A_valid, S_valid over the valid.
Means = dict[str, Mean]


class Group(Record, frozen=True, kw_only=True):
    """Cases that share a value. families: how many different ones there are."""

    cases: int
    families: int
    metrics: Means


class Groups(Record, frozen=True, kw_only=True):
    """The same means by tier (easy, medium, hard), split, environment, theme and family."""

    tier: dict[str, Group]
    split: dict[str, Group]
    environment: dict[str, Group]
    theme: dict[str, Group]
    family: dict[str, Group]


class ReconstructionCoverage(Coverage, frozen=True, kw_only=True):
    """Coverage of a bench. scored: compared; valid: V = 1 among all attempted."""

    valid: int


class ReconstructionRules(Record, frozen=True, kw_only=True):
    """What decides a number: the card's constants and the command line's choices."""

    tolerance: float
    tolerances: tuple[float, ...]
    tolerances_m: tuple[float, ...]
    depth_limit_m: float
    delta: int
    reference_sampling: str
    reference_points: Literal["raster", "full_resolution_pixels"]
    diagnostics: bool


class FamilyBootstrap(Record, frozen=True, kw_only=True):
    """How intervals were drawn: all tiers and views of a family together."""

    draws: int
    seed: int
    unit: Literal["family"]
    groups: int
    level: float


class NoiseSummary(Record, frozen=True, kw_only=True):
    """What render noise can do to A: means over the cases where it was measured."""

    reference_mean: float | None
    reference_sd: float | None
    n_reference: int
    two_seeds: float | None
    n_two_seeds: int


class CaseFlag(Flag, frozen=True, kw_only=True):
    """A flag and its case."""

    image_id: int
    file_name: str


class ReconstructionSummary(Summary, frozen=True, kw_only=True):
    """Of a bench run. not_scored: zeros by name and reason; zeros: how many by status.

    articulation: the pilot's, left out where no reference has joints.
    """

    coverage: ReconstructionCoverage
    protocol: ReconstructionRules
    metrics: Means
    diagnostics: Means
    groups: Groups
    bootstrap: FamilyBootstrap
    noise: NoiseSummary
    flags: tuple[CaseFlag, ...]
    not_scored: tuple[NotScored, ...]
    warnings: int
    articulation: ArticulationSummary | UnsetType = UNSET

    def metric_values(self) -> Iterator[MetricValue]:
        """The means, each with the cases it is over."""
        for name, mean in self.metrics.items():
            yield MetricValue(name, mean.over, mean.value, mean.interval)


class BenchConfiguration(ScoreConfiguration, frozen=True, kw_only=True):
    """What the numbers of a bench depend on besides the inputs."""

    card_version: str
    reference_sampling: str
    diagnostics: bool


class BenchEvidence(EvaluationEvidence, frozen=True, kw_only=True):
    """Of a bench."""

    coverage: ReconstructionCoverage
    configuration: BenchConfiguration
    protocol: ReconstructionRules
    metrics: Values


RECORDS: Final = RecordFamily(
    summary=ReconstructionSummary,
    rows=partial(decode_lines, ReconstructionRow),
    evidence=BenchEvidence,
    method=("configuration", "protocol", "metrics"),
)
