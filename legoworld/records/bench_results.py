"""Results of the bench: leaderboard.json, judges.json, and what `legoworld bench serve` says."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, field

from legoworld.conventions import SCHEMA_VERSION
from legoworld.records.base import UNSET, Record, UnsetType
from legoworld.records.evaluation import Evaluator, Interval
from legoworld.records.reconstruction import Flag, ObjectRow, Over
from legoworld.records.second_card import XNumbers, XScores
from legoworld.records.submission import Check


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


class Rank(Record, frozen=True, kw_only=True):
    """A system's rank, 1 the best, with its interval over draws; null over a single family."""

    rank: int
    low: int | None
    high: int | None


class PairedDifference(Record, frozen=True, kw_only=True):
    """Of two rows, by their places from 0: the first's mean minus the second's."""

    first: int
    second: int
    difference: float
    interval: Interval | None


class Cost(Record, frozen=True, kw_only=True):
    """A system's mean cost a trial in US dollars, of those that tell it; null where none does.

    usd: by the transcript or a price card, told by `told` trials; standard_usd: all tokens at one
    price, by `standard_told`. frontier: every trial tells it, and no other system is as good and as
    cheap, and better in one.
    """

    trials: int
    usd: float | None
    told: int
    standard_usd: float | None
    standard_told: int
    frontier: bool
    standard_frontier: bool


class Standings(Record, frozen=True, kw_only=True):
    """Rows against each other. ranks, costs: of each row."""

    metric: Literal["S", "R"]
    ranks: tuple[Rank, ...]
    pairs: tuple[PairedDifference, ...]
    costs: tuple[Cost, ...]


class Leaderboard(Record, frozen=True, kw_only=True):
    """Rows by falling S over all attempted; evidence_sha256: of each evaluation, by its name."""

    schema_version: int = SCHEMA_VERSION
    task: str
    evaluator: Evaluator
    draws: int
    seed: int
    rows: tuple[LeaderboardRow, ...]
    evidence_sha256: dict[str, str]
    standings: Standings | UnsetType = UNSET


Aspect = Literal["reconstruction", "appearance"]
Text = Annotated[str, Meta(min_length=1)]
#: What a judge says, and a metric shows, of two that it does not tell apart.
TIE = "tie"
#: What a judge says of two that it would have neither of.
BOTH_BAD = "both_bad"
#: What stands for a judge that gave no answer.
FAILED = "failed"


class Judgement(Record, frozen=True, kw_only=True):
    """One line: a judge saw two submissions of one builder and chose.

    item: what is compared, the same in both orders: with evaluations, the case's file name; shown:
    the two submissions in the order shown: with evaluations, their folders' names; chosen: one of
    them, "tie" (also null), "both_bad" or "failed"; better: the one that the score prefers, or
    "tie"; left out where evaluations say it.
    """

    builder: Text
    judge: Text
    aspect: Aspect
    item: Text
    shown: tuple[Text, Text]
    chosen: str | None
    better: Text | UnsetType = UNSET

    @property
    def answer(self) -> str:
        """What was chosen; "tie" for null."""
        return TIE if self.chosen is None else self.chosen


#: Edits between two scenes of one trajectory.
Gap = Literal["1-2", "3-5", ">=6"]


class JudgePair(Record, frozen=True, kw_only=True):
    """One line of pairs.jsonl: two scenes of one trial, in the order in which they are shown.

    shown: checkpoints' ordinals, "final" for the submission; renders: the evaluator's pictures of
    the two, relative to the folder of scores.
    """

    builder: Text
    item: Text
    gap: Gap
    shown: tuple[Text, Text]
    renders: tuple[Text, Text] | UnsetType = UNSET


class Agreement(Record, frozen=True, kw_only=True):
    """Judgements of which the choice is the score's direction, over all of them.

    A tie agrees with a tie of the score; "both_bad" and "failed" are wrong; all count in n. ties,
    both_bad, failed: how many were answered so; score_ties: how many the score does not tell apart.
    """

    agreed: int
    n: int
    share: float
    ties: int = 0
    both_bad: int = 0
    failed: int = 0
    score_ties: int = 0


class OrderSwaps(Record, frozen=True, kw_only=True):
    """Items that a judge answered in both orders. first_share: of all judgements, the first shown.

    share: consistent over swapped, null without any.
    """

    swapped: int
    consistent: int
    share: float | None
    first_share: float


class AspectAgreement(Record, frozen=True, kw_only=True):
    """matrix: builder -> judge -> agreement. Means are over cells, each weighted alike.

    self_mean: judges of their own builds; cross_mean: of others'; null where there is no such cell.
    self_above_others: builders whose own judge agrees more than the mean of the others;
    builders: how many of them have both. by_gap: where the pairs were chosen by it.
    """

    matrix: dict[str, dict[str, Agreement]]
    self_mean: float | None
    cross_mean: float | None
    self_above_others: int
    builders: int
    order_swaps: dict[str, OrderSwaps]
    by_gap: dict[Gap, Agreement] | UnsetType = UNSET


class JudgesFile(Record, frozen=True, kw_only=True):
    """judges.json. aspects: by their names, those that were judged.

    evidence_sha256: of the evaluations that gave the directions, by name, or of trajectories.json;
    empty where the judgements hold them.
    """

    schema_version: int = SCHEMA_VERSION
    judgements_sha256: str
    evidence_sha256: dict[str, str] = field(default_factory=dict)
    judgements: int
    aspects: dict[str, AspectAgreement]


#: What of a submission is scored: R, A and S with an A, the second card with an X.
Parts = Literal["R", "RA", "RX", "RAX"]


class ServeRequest(Record, frozen=True, kw_only=True):
    """One submission to score. scene: its folder, "" where it is sent; id: given back as it is.

    parts: where it is left out, all that the server offers but the second card.
    """

    scene: str
    image_id: int
    id: str | int | None = None
    parts: Parts | UnsetType = UNSET


class Answered(Record, frozen=True, kw_only=True):
    """What every answer has. status, reason: why there are no scores, or zeros."""

    id: str | int | None
    image_id: int | None
    status: str
    reason: str | None
    V: Literal[0, 1] | None
    R: float | None
    A: float | None
    S: float | None


class ServeAnswer(Answered, frozen=True, kw_only=True):
    """Its scores; zeros for a submission that is missing or invalid, and why.

    status: ok, the readout's verdict, `refused` for a line that is not a request, or
    `evaluator_error`; V, R, A and S are null for the last two, and A and S with --no-render.
    validity: the checks of V that were made; x: of the second card, where it is a part.
    """

    scene: str | None
    objects: tuple[ObjectRow, ...]
    validity: dict[str, Check] | None
    flags: tuple[Flag, ...]
    warnings: tuple[str, ...]
    x: XScores | UnsetType = UNSET


class ScalarAnswer(Answered, frozen=True, kw_only=True):
    """A `ServeAnswer` over HTTP, without what tells the private half apart.

    reward: S, or R where nothing is rendered. Every score is a multiple of `step`, exact where that
    is 0. V: null for a valid .blend that was sent alone, too: it has no artefacts.
    """

    reward: float | None
    step: float
    x: XNumbers | UnsetType = UNSET


class ObjectsAnswer(ScalarAnswer, frozen=True, kw_only=True):
    """With --per-object: all of a `ServeAnswer` but its path; the objects' numbers are exact."""

    # Narrower than the scalar answer's; no field is ever assigned.
    x: XScores | UnsetType = UNSET
    objects: tuple[ObjectRow, ...]
    validity: dict[str, Check] | None
    flags: tuple[Flag, ...]
    warnings: tuple[str, ...]


class RewardsRequest(Record, frozen=True, kw_only=True):
    """OpenRLHF's form. query: scenes' paths below the root; labels: their image ids."""

    query: tuple[str, ...]
    labels: tuple[int | str, ...]


class RewardsAnswer(Record, frozen=True, kw_only=True):
    """The rewards, in the order of the queries."""

    rewards: tuple[float, ...]
