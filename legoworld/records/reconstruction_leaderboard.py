"""leaderboard.json: agents and models over repeated bench runs."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from legoworld.conventions import SCHEMA_VERSION
from legoworld.records.base import Record
from legoworld.records.evaluation_summary import Evaluator, Interval
from legoworld.records.reconstruction_summary import Over


class Repeated(Record, frozen=True, kw_only=True):
    """A metric over repeated runs: their mean, and standard deviation with ddof = 1.

    runs: each run's own mean in the runs' order, null where undefined; n: each one's denominator.
    mean is null where any run's is; sd also with a single run. interval: of the mean, over
    families drawn alike for all runs; only over all cases, null elsewhere.
    """

    mean: float | None
    sd: float | None
    runs: tuple[float | None, ...]
    n: tuple[int, ...]
    over: Over
    interval: Interval | None


class LeaderboardGroup(Record, frozen=True, kw_only=True):
    """Cases of one kind of group (all, split, environment, theme or tier) and its name."""

    kind: str
    name: str
    cases: int
    metrics: dict[str, Repeated]


class LeaderboardRow(Record, frozen=True, kw_only=True):
    """One agent and model. evaluations: names of the folders of its runs."""

    agent: str
    model: str
    evaluations: Annotated[tuple[str, ...], Meta(min_length=1)]
    groups: tuple[LeaderboardGroup, ...]


class Leaderboard(Record, frozen=True, kw_only=True):
    """Rows by falling S over all attempted; evidence_sha256: of each evaluation, by its name."""

    schema_version: int = SCHEMA_VERSION
    task: str
    evaluator: Evaluator
    draws: int
    seed: int
    rows: tuple[LeaderboardRow, ...]
    evidence_sha256: dict[str, str]
