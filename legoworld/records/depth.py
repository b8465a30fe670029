"""Depth as a family of records: rows, summary and evidence.json of evaluations and comparisons."""

# A scored row requires what other rows may leave out, which msgspec allows of a subclass.
# pyright: reportGeneralTypeIssues=false

from __future__ import annotations

from functools import partial
from typing import Final, Literal

from legoworld.records.base import UNSET, Record, UnsetType
from legoworld.records.evaluation import (
    Coverage,
    DepthRules,
    EvaluationEvidence,
    RecordFamily,
    ScoreConfiguration,
)
from legoworld.records.pixels import Means, Metrics, PixelRow, PixelSummary, pixel_rows

#: Statuses of images that have numbers; every other status has none.
SCORED: Final = ("ok", "inverted", "degenerate")


class DepthRow(PixelRow, frozen=True, kw_only=True):
    """One image of depth, with numbers or without."""

    truth_inf_px: int
    truth_nan_px: int
    truth_non_positive_px: int
    space: str | UnsetType = UNSET
    unit: str | UnsetType | None = UNSET
    warped: bool | UnsetType = UNSET
    outside_view_share: float | UnsetType = UNSET


class ScoredDepthRow(DepthRow, frozen=True, kw_only=True):
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
    def scores(self) -> Metrics:
        """Its numbers."""
        return self.metrics


class PartOfEth3d(Record, frozen=True, kw_only=True):
    """How much of ETH3D's training set was attempted."""

    images: int
    of_images: int
    scenes: int
    of_scenes: int


class DepthCoverage(Coverage, frozen=True, kw_only=True):
    """Coverage of depth. eth3d: where every image is one of its photos."""

    eth3d: PartOfEth3d | UnsetType = UNSET


class DepthChoices(DepthRules, frozen=True, kw_only=True):
    """The card's choices and the command line's."""

    camera_model: str


class AllAttempted(Record, frozen=True, kw_only=True):
    """AbsRel by hole policy over every image with truth, `missing` of them at missing_abs_rel."""

    abs_rel: dict[str, float | None]
    images: int
    missing: int
    missing_abs_rel: float


class DepthSummary(PixelSummary, frozen=True, kw_only=True):
    """Of depth. constant: the means of the constant that knows nothing of the picture."""

    coverage: DepthCoverage
    protocol: DepthChoices
    constant: Means
    all_attempted: AllAttempted
    mean_hole_share: float | None
    mean_outside_view_share: float | None
    mean_clamped_share: float | None
    worse_than_constant: int


class DepthConfiguration(ScoreConfiguration, frozen=True, kw_only=True):
    """What the numbers of depth depend on besides the inputs."""

    card_version: str
    camera_model: str


class DepthEvidence(EvaluationEvidence, frozen=True, kw_only=True):
    """Of depth."""

    coverage: DepthCoverage
    configuration: DepthConfiguration
    protocol: DepthChoices
    metrics: Means


class Fit(Record, frozen=True, kw_only=True):
    """Depth: aligned disparity = scale * predicted disparity + shift."""

    scale: float
    shift: float
    status: Literal["ok", "inverted", "degenerate"]


class DepthView(Record, frozen=True, kw_only=True):
    """view/ID.json of depth: a small picture of truth and aligned prediction.

    Arrays are base64 of little-endian float32 metres along camera z, row major, inf where there is
    none; size_wh is theirs, image_wh the truth's.
    """

    size_wh: tuple[int, int]
    image_wh: tuple[int, int]
    truth_z_m: str
    aligned_z_m: str
    fit: Fit


RECORDS: Final = RecordFamily(
    summary=DepthSummary,
    rows=partial(pixel_rows, unscored=DepthRow, scored=ScoredDepthRow, statuses=SCORED),
    evidence=DepthEvidence,
    method=("configuration", "protocol", "metrics"),
)
