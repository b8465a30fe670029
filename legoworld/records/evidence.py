"""evidence.json: the hashes of what a folder holds and was made from, and its raw numbers."""

from __future__ import annotations

from legoworld.conventions import SCHEMA_VERSION
from legoworld.records.base import UNSET, Record, UnsetType, decode
from legoworld.records.comparison import KIND, PairHead
from legoworld.records.evaluation_summary import (
    Coverage,
    DepthChoices,
    DepthCoverage,
    DetectionCoverage,
    Evaluator,
    Means,
    Values,
)
from legoworld.records.reconstruction_summary import (
    ReconstructionCoverage,
    ReconstructionRules,
)


class HashedInput(Record, frozen=True, kw_only=True):
    """A file by its role and its bytes."""

    role: str
    sha256: str


class Input(HashedInput, frozen=True, kw_only=True):
    """A file that was read. path: from the folder, or a whole one where the folder is at a URL.

    without: keys of a JSON file that its hash and size leave out.
    """

    path: str
    bytes: int | UnsetType = UNSET
    without: tuple[str, ...] | UnsetType = UNSET


class OfKind(Record, frozen=True, kw_only=True):
    """A file of several kinds."""

    kind: str


class Evidence(OfKind, frozen=True, kw_only=True):
    """What every evidence.json says. files: sha256 of each other file of the folder, by path.

    inputs, files: the folder's writer fills in those that are empty.
    """

    schema_version: int = SCHEMA_VERSION
    versions: dict[str, str]
    inputs: tuple[Input, ...]
    files: dict[str, str]


class AnyEvidence(Evidence, frozen=True, kw_only=True):
    """evidence.json of any kind, as far as all are alike."""

    configuration: dict[str, str | int | bool | None]


class DetectionConfiguration(Record, frozen=True, kw_only=True):
    """What the numbers of boxes and masks depend on besides the inputs."""

    task: str
    evaluator: str
    draws: int
    seed: int
    card_sha256: str


class DepthConfiguration(Record, frozen=True, kw_only=True):
    """What the numbers of depth depend on besides the inputs."""

    task: str
    card_version: str
    card_sha256: str
    camera_model: str
    draws: int
    seed: int


class BenchConfiguration(Record, frozen=True, kw_only=True):
    """What the numbers of a bench depend on besides the inputs."""

    task: str
    card_version: str
    card_sha256: str
    reference_sampling: str
    diagnostics: bool
    draws: int
    seed: int


class EvaluationEvidence(Evidence, frozen=True, kw_only=True):
    """What every evaluation's evidence says."""

    kind: str = "evaluation"
    task: str
    evaluator: Evaluator
    coverage: Coverage


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


class DepthEvidence(EvaluationEvidence, frozen=True, kw_only=True):
    """Of depth."""

    coverage: DepthCoverage
    configuration: DepthConfiguration
    protocol: DepthChoices
    metrics: Means


class BenchEvidence(EvaluationEvidence, frozen=True, kw_only=True):
    """Of a bench."""

    coverage: ReconstructionCoverage
    configuration: BenchConfiguration
    protocol: ReconstructionRules
    metrics: Values


class MethodEvidence(Record, frozen=True, kw_only=True):
    """One side of a comparison: its own evidence, of which files."""

    name: str
    evaluator: Evaluator
    inputs: tuple[HashedInput, ...]


class DetectionMethod(MethodEvidence, frozen=True, kw_only=True):
    """A side of boxes and masks."""

    configuration: DetectionConfiguration
    run: RunOrigin
    protocol: CardOrigin
    raw: RawScores
    equal_confidence: EqualScores


class DepthMethod(MethodEvidence, frozen=True, kw_only=True):
    """A side of depth."""

    configuration: DepthConfiguration
    protocol: DepthChoices
    metrics: Means


class BenchMethod(MethodEvidence, frozen=True, kw_only=True):
    """A side of a bench."""

    configuration: BenchConfiguration
    protocol: ReconstructionRules
    metrics: Values


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
    """Of a comparison. pairs: filled in when the numbers are made."""

    kind: str = KIND
    task: str
    configuration: ComparisonSettings
    methods: tuple[MethodEvidence, ...]
    pairs: tuple[PairEvidence, ...] = ()


class DetectionComparison(ComparisonEvidence, frozen=True, kw_only=True):
    """Of a comparison of boxes or masks."""

    methods: tuple[DetectionMethod, ...]


class DepthComparison(ComparisonEvidence, frozen=True, kw_only=True):
    """Of a comparison of depth."""

    methods: tuple[DepthMethod, ...]


class BenchComparison(ComparisonEvidence, frozen=True, kw_only=True):
    """Of a comparison of bench runs."""

    methods: tuple[BenchMethod, ...]


class _Task(Record, frozen=True, kw_only=True):
    task: str


#: What the numbers of any task depend on, and the evidence of its evaluation.
TaskConfiguration = DetectionConfiguration | DepthConfiguration | BenchConfiguration
TaskEvidence = DetectionEvidence | DepthEvidence | BenchEvidence


def evaluation_evidence(data: bytes) -> TaskEvidence:
    """The content of an evaluation's evidence.json, by its task. RecordError."""
    task = decode(_Task, data).task
    if task == "eth3d":
        return decode(DepthEvidence, data)
    if task == "bench":
        return decode(BenchEvidence, data)
    return decode(DetectionEvidence, data)
