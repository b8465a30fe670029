"""evidence.json: the hashes of what a folder holds and was made from, and its raw numbers."""

from __future__ import annotations

from legoworld.conventions import SCHEMA_VERSION
from legoworld.records.base import UNSET, Record, UnsetType
from legoworld.records.comparison import KIND, PairHead
from legoworld.records.evaluation_summary import (
    Coverage,
    Evaluator,
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


class ScoreConfiguration(Record, frozen=True, kw_only=True):
    """What the numbers of an evaluation depend on besides the inputs; each family adds its own."""

    task: str
    card_sha256: str
    draws: int
    seed: int


class EvaluationEvidence(Evidence, frozen=True, kw_only=True):
    """What every evaluation's evidence says."""

    kind: str = "evaluation"
    task: str
    evaluator: Evaluator
    coverage: Coverage
    configuration: ScoreConfiguration


class MethodEvidence(Record, frozen=True, kw_only=True):
    """One side of a comparison: its own evidence, of which files."""

    name: str
    evaluator: Evaluator
    inputs: tuple[HashedInput, ...]


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
