"""Normals as a family of records: rows, summary and evidence.json."""

# A scored row requires what other rows may leave out, which msgspec allows of a subclass.
# pyright: reportGeneralTypeIssues=false

from __future__ import annotations

from functools import partial
from typing import Final

from legoworld.records.base import UNSET, Record, UnsetType
from legoworld.records.evaluation import EvaluationEvidence, RecordFamily, ScoreConfiguration
from legoworld.records.pixels import Means, Metrics, PixelRow, PixelSummary, pixel_rows


class NormalsRow(PixelRow, frozen=True, kw_only=True):
    """One image of normals, with numbers or without. sign: of the prediction."""

    sign: str | UnsetType = UNSET


class AngularErrors(Record, frozen=True, kw_only=True):
    """The errors of n pixels as the sums that pool over images.

    below: how many are strictly below each threshold. counts: pixels by error rounded to
    hundredths of a degree, from 0; a negative number stands for that many zeros.
    """

    n: int
    sum_deg: float
    sum_deg2: float
    below: tuple[int, ...]
    counts: tuple[int, ...]


class ScoredNormalsRow(NormalsRow, frozen=True, kw_only=True):
    """One image of normals with its numbers; errors: of the pixels with a prediction."""

    prediction_wh: tuple[int, int]
    sign: str
    resampled: bool
    n_predicted: int
    hole_share: float
    errors: AngularErrors
    metrics: Metrics

    @property
    def scores(self) -> Metrics:
        """Its numbers."""
        return self.metrics


class NormalsChoices(Record, frozen=True, kw_only=True):
    """The card's choices that decide a number."""

    aggregate: str
    pooled_median: str
    resolution: str
    resample: str
    valid_truth: str
    min_valid_px: int
    policies: tuple[str, ...]
    primary: str


class AllAttempted(Record, frozen=True, kw_only=True):
    """Mean error by hole policy over every image with truth, `missing` at missing_mean_deg."""

    mean_deg: dict[str, float | None]
    images: int
    missing: int
    missing_mean_deg: float


class NormalsSummary(PixelSummary, frozen=True, kw_only=True):
    """Of normals. metrics: means over images; pooled: over all valid pixels of scored images.

    pooled_px: how many those are, predicted_px: with a prediction.
    """

    protocol: NormalsChoices
    pooled: Means
    pooled_px: int
    predicted_px: int
    all_attempted: AllAttempted
    mean_hole_share: float | None


class NormalsConfiguration(ScoreConfiguration, frozen=True, kw_only=True):
    """What the numbers of normals depend on besides the inputs."""

    card_version: str


class NormalsEvidence(EvaluationEvidence, frozen=True, kw_only=True):
    """Of normals."""

    configuration: NormalsConfiguration
    protocol: NormalsChoices
    metrics: Means
    pooled: Means


class NormalsView(Record, frozen=True, kw_only=True):
    """view/ID.json of normals: a small picture of truth and prediction.

    Arrays are base64 of little-endian float32 x, y, z towards the camera, row major, NaN where
    there is none; size_wh is theirs, image_wh the truth's.
    """

    size_wh: tuple[int, int]
    image_wh: tuple[int, int]
    truth: str
    predicted: str


RECORDS: Final = RecordFamily(
    summary=NormalsSummary,
    rows=partial(pixel_rows, unscored=NormalsRow, scored=ScoredNormalsRow, statuses=("ok",)),
    evidence=NormalsEvidence,
    method=("configuration", "protocol", "metrics"),
)
