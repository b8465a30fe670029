"""summary.json of a bench evaluation: every mean with what it is over."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from msgspec import Meta

from legoworld.records.articulation import ArticulationSummary
from legoworld.records.base import UNSET, Record, UnsetType
from legoworld.records.evaluation_summary import (
    Coverage,
    Interval,
    MetricValue,
    NotScored,
    Summary,
)
from legoworld.records.reconstruction_rows import Flag

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
