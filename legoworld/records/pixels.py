"""Evaluations of one array for each image: rows and summary, as every such family has them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final, Literal, TypeVar

from legoworld.records.base import UNSET, Record, RecordError, UnsetType, decode, decode_lines
from legoworld.records.evaluation import EvaluationRow, Interval, MetricValue, NotScored, Summary

#: The status of an image without enough valid truth.
NO_TRUTH: Final = "no_gt"
#: Metric -> hole policy -> value of one image.
Metrics = dict[str, dict[str, float]]
#: Metric -> hole policy -> mean over images; None where nothing was scored.
Means = dict[str, dict[str, float | None]]

R = TypeVar("R", bound="PixelRow")


class PixelRow(EvaluationRow, frozen=True, kw_only=True):
    """One image: its verdict, its truth, and what is known of a prediction that could be read.

    group: what is drawn with it, its scene or itself. run_status: the run's own. hole_share: of
    the valid truth.
    """

    group: str
    code: str | None
    reason: str | None
    run_status: str
    truth_wh: tuple[int, int]
    n_valid: int
    warnings: tuple[str, ...]
    prediction_wh: tuple[int, int] | UnsetType = UNSET
    resampled: bool | UnsetType = UNSET
    n_predicted: int | UnsetType = UNSET
    hole_share: float | UnsetType = UNSET

    @property
    def scores(self) -> Metrics | None:
        """Its numbers; None where it has none."""
        return None

    @property
    def has_score(self) -> bool:
        """Whether it has numbers."""
        return self.scores is not None

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


def pixel_rows(data: bytes, unscored: type[R], scored: type[R], statuses: Sequence[str]) -> list[R]:
    """The lines of a per_image.jsonl. statuses: those of images that have numbers. RecordError."""
    lines = [line for line in data.split(b"\n") if line.strip()]
    rows: list[R] = []
    for row, line in zip(decode_lines(unscored, data), lines, strict=True):
        try:
            rows.append(decode(scored, line) if row.status in statuses else row)
        except RecordError as error:
            raise RecordError(f"image {row.image_id}: {error}") from error
    return rows


class PixelBootstrap(Record, frozen=True, kw_only=True):
    """How intervals were drawn. groups: how many scenes (or images) there are to draw."""

    draws: int
    seed: int
    unit: Literal["scene", "image"]
    groups: int
    level: float


class PixelSummary(Summary, frozen=True, kw_only=True):
    """What every summary of such a family says. resampled: predictions smaller than the truth."""

    metrics: Means
    intervals: dict[str, dict[str, Interval]]
    bootstrap: PixelBootstrap
    resampled: int
    not_scored: tuple[NotScored, ...]
    warnings: int

    def metric_values(self) -> Iterator[MetricValue]:
        """The means by metric and hole policy."""
        for name, by_policy in self.metrics.items():
            for policy, value in by_policy.items():
                yield MetricValue(name, policy, value, self.intervals[name][policy])
