"""comparison.json and its evidence: evaluations beside each other; several comparisons as one."""

from __future__ import annotations

from typing import Any, Final, Literal

from legoworld.conventions import SCHEMA_VERSION
from legoworld.records.base import UNSET, Record, UnsetType, decode
from legoworld.records.evaluation import Coverage, DepthRules, Evaluator, Evidence, Interval

#: What `kind` says, in evidence.json too.
KIND: Final = "comparison"
JOINED: Final = "joined_comparison"

#: Which images a number is over; docs/protocols/comparison.md says what each means.
Images = Literal["attempted", "scored", "paired"]
Better = Literal["higher", "lower"]
#: 1: also in the joined table of several tasks; 2: in a comparison's table; 3: in CSV and JSON.
Level = Literal[1, 2, 3]
#: How scenes were made: field -> method -> value -> images.
ByField = dict[str, dict[str, dict[str, int]]]


class Difference(Record, frozen=True, kw_only=True):
    """A number and its interval; None where it is undefined, or where there is none to give."""

    value: float | None
    interval: Interval | None

    @property
    def ends(self) -> tuple[float, float] | None:
        """(low, high) of the interval where they are defined."""
        return self.interval.ends if self.interval else None


class Measured(Difference, frozen=True, kw_only=True):
    """A number of one side. over: its denominators, by their names.

    constant: of depth, the number of a constant that knows nothing of the picture. sd, worst, best:
    of AP over tie orders.
    """

    over: dict[str, int]
    constant: float | UnsetType | None = UNSET
    sd: float | UnsetType | None = UNSET
    worst: float | UnsetType | None = UNSET
    best: float | UnsetType | None = UNSET


class ComparisonRow(Record, frozen=True, kw_only=True):
    """A metric over some images, of both sides, and scene minus baseline."""

    metric: str
    policy: str
    images: Images
    better: Better
    level: Level
    scene: Measured
    baseline: Measured
    difference: Difference


class PairCoverage(Record, frozen=True, kw_only=True):
    """Images that were attempted, have truth, and were scored by one side or by both."""

    attempted: int
    with_truth: int
    scene_scored: int
    baseline_scored: int
    paired: int


class ImageName(Record, frozen=True, kw_only=True):
    """An image of the track."""

    image_id: int
    file_name: str


class Dropped(ImageName, frozen=True, kw_only=True):
    """An image that is not paired, with every reason."""

    reasons: tuple[str, ...]


class Unscored(ImageName, frozen=True, kw_only=True):
    """An image that a method has no score of."""

    status: str


class PairHead(Record, frozen=True, kw_only=True):
    """Two methods by their names, and which images both scored."""

    scene: str
    baseline: str
    coverage: PairCoverage
    paired_image_ids: tuple[int, ...]
    dropped: tuple[Dropped, ...]


class Pair(PairHead, frozen=True, kw_only=True):
    """Two methods and their numbers."""

    rows: tuple[ComparisonRow, ...]


class MadeBy(Record, frozen=True, kw_only=True):
    """A scene's provenance.json, or words where there is none, and how many images have it."""

    provenance: Any
    images: int


class Method(Record, frozen=True, kw_only=True):
    """One evaluation. used_truth: what its run says of truth it was prompted with.

    camera_model, max_side, resampled: of depth.
    """

    name: str
    role: Literal["scene", "baseline"]
    kind: str
    coverage: Coverage
    not_scored: tuple[Unscored, ...]
    used_truth: Any
    camera_model: str | None
    max_side: int | None
    resampled: int | None
    provenance: tuple[MadeBy, ...]


class ComparisonBootstrap(Record, frozen=True, kw_only=True):
    """How intervals were drawn. unit: what is drawn."""

    draws: int
    seed: int
    level: float
    unit: str


class Comparison(Record, frozen=True, kw_only=True, tag_field="kind", tag=KIND):
    """The first evaluation beside each of the others. protocol: of depth."""

    schema_version: int = SCHEMA_VERSION
    task: str
    dataset_version: str | None
    evaluator: Evaluator
    protocol: DepthRules | None
    bootstrap: ComparisonBootstrap
    images: tuple[ImageName, ...]
    methods: tuple[Method, ...]
    pairs: tuple[Pair, ...]
    provenance: ByField
    notes: tuple[str, ...]


class JoinedComparison(Record, frozen=True, kw_only=True, tag_field="kind", tag=JOINED):
    """Comparisons of different tasks. common_images: those that are in every track."""

    schema_version: int = SCHEMA_VERSION
    comparisons: tuple[Comparison, ...]
    common_images: int
    provenance: ByField
    notes: tuple[str, ...]


class ComparisonSettings(Record, frozen=True, kw_only=True):
    """What the numbers of a comparison depend on besides the evaluations."""

    draws: int
    seed: int
    allow_truth_prompts: bool


class PairedNumbers(Record, frozen=True, kw_only=True):
    """A metric over the paired images."""

    scene: float | None
    baseline: float | None
    difference: float | None


class PairEvidence(PairHead, frozen=True, kw_only=True):
    """Two methods and their numbers over the paired images, by metric."""

    paired_metrics: dict[str, PairedNumbers]


class ComparisonEvidence(Evidence, frozen=True, kw_only=True):
    """Of a comparison. methods: each side's name, and of its own evidence what its family says.

    pairs: filled in when the numbers are made.
    """

    kind: str = KIND
    task: str
    configuration: ComparisonSettings
    methods: tuple[dict[str, Any], ...]
    pairs: tuple[PairEvidence, ...] = ()


def decode_comparison(data: bytes) -> Comparison | JoinedComparison:
    """The content of a comparison.json. RecordError."""
    kind: Any = Comparison | JoinedComparison
    comparison: Comparison | JoinedComparison = decode(kind, data)
    return comparison
