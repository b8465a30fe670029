"""A report's tables: what the page's templates show around its photos."""

from __future__ import annotations

from legoworld.records.base import UNSET, Record, UnsetType
from legoworld.records.comparison import Better, Comparison, Dropped, Images, Level, PairCoverage
from legoworld.records.evaluation_summary import Evaluator, Ties
from legoworld.records.evidence import Input
from legoworld.records.report_page import Facts, PhotoRow
from legoworld.records.report_reconstruction import BenchTables
from legoworld.records.report_summary import FirstScreen, Plots


class NumberCell(Record, frozen=True, kw_only=True):
    """A number as text, with its interval and what it is over."""

    value: str
    spread: str
    over: str
    constant: str | UnsetType = UNSET


class NumberRow(Record, frozen=True, kw_only=True):
    """A metric, a cell of each side. policy: depth's for holes."""

    name: str
    cells: tuple[NumberCell | None, ...]
    policy: str | UnsetType = UNSET


class CountRow(Record, frozen=True, kw_only=True):
    """Images of one sort, a cell of each side."""

    name: str
    cells: tuple[int | str, ...]


class CategoryCell(Record, frozen=True, kw_only=True):
    """One side's numbers of a category."""

    ap: float | None
    ap50: float | None
    miou: float | None
    n: int
    tp: int
    fp: int


class CategoryLine(Record, frozen=True, kw_only=True):
    """A category, a cell of each side that has truth or predictions of it."""

    id: int
    name: str
    frequency: str | None
    n_truth: int
    n_images: int
    cells: tuple[CategoryCell | None, ...]


class ComparedRow(Record, frozen=True, kw_only=True):
    """A row of a comparison as text."""

    name: str
    policy: str
    images: Images
    better: Better
    level: Level
    scene: NumberCell
    baseline: NumberCell
    difference: NumberCell


class ComparedPair(Record, frozen=True, kw_only=True):
    """Two methods of a comparison."""

    scene: str
    baseline: str
    coverage: PairCoverage
    dropped: tuple[Dropped, ...]
    rows: tuple[ComparedRow, ...]


class ErrorCounts(Record, frozen=True, kw_only=True):
    """One side's errors, and images with them, by kind. reached: truths that an error reaches."""

    label: str
    counts: dict[str, int]
    images: dict[str, int]
    reached: int


class TieBar(Record, frozen=True, kw_only=True):
    """A bar of a tie picture."""

    x: float
    y: float
    w: float
    h: float
    text: str


class TieDrawing(Record, frozen=True, kw_only=True):
    """Bars and marks of a tie picture, in its coordinates. x: of worst, best, expected and ap."""

    bars: tuple[TieBar, ...]
    x: dict[str, float]
    spread: tuple[float, float]
    width: int
    height: int
    base: int
    top: int


class TiePicture(Record, frozen=True, kw_only=True):
    """AP over tie orders. drawing: None where the bounds are one number."""

    title: str
    ap: float | None
    ties: Ties
    drawing: TieDrawing | None


class SideHead(Record, frozen=True, kw_only=True):
    """One side. used_truth: whether its prompts came from the truth."""

    label: str
    scene: bool
    used_truth: bool


class SideNotes(Record, frozen=True, kw_only=True):
    """Sentences about one side's counts."""

    label: str
    lines: tuple[str, ...]


class UsedVersion(Record, frozen=True, kw_only=True):
    """A package that a score was computed with."""

    name: str
    version: str
    licence: str


class UsedInput(Input, frozen=True, kw_only=True):
    """A file that was read. card: where a shipped file of these bytes lies."""

    name: str
    card: str | None


class UsedData(Record, frozen=True, kw_only=True):
    """A dataset or a specialist with its licence. said: how that is known."""

    name: str
    title: str
    licence: str
    said: str


class SideOrigin(Record, frozen=True, kw_only=True):
    """How one side's numbers are made again. outputs: the evaluation's files and their hashes."""

    label: str
    folder: str
    commands: tuple[str, ...]
    partial: bool
    configuration: Facts
    evaluation: Facts
    versions: tuple[UsedVersion, ...]
    inputs: tuple[UsedInput, ...]
    outputs: Facts
    data: tuple[UsedData, ...]


class PageSection(Record, frozen=True, kw_only=True):
    """A section: evaluations of one task over one truth, or a comparison alone.

    specialist: whether a side is one; compared: the command that made the comparison; names: of the
    categories that are drawn, by id, absent where there are no evaluations.
    """

    key: str
    task: str
    title: str
    sides: tuple[SideHead, ...]
    specialist: bool
    comparison: Comparison | None
    pairs: tuple[ComparedPair, ...]
    compared: str | None
    first: FirstScreen
    attempted: int = 0
    evaluators: tuple[Evaluator, ...] = ()
    partial: tuple[str, ...] = ()
    coverage: tuple[CountRow, ...] = ()
    notes: tuple[SideNotes, ...] = ()
    provenance: tuple[SideOrigin, ...] = ()
    head: tuple[NumberRow, ...] = ()
    score_free: tuple[NumberRow, ...] = ()
    ties: tuple[TiePicture, ...] = ()
    categories: tuple[CategoryLine, ...] = ()
    errors: tuple[ErrorCounts, ...] = ()
    names: dict[str, str] | UnsetType = UNSET
    images: tuple[PhotoRow, ...] = ()
    plots: Plots = Plots()
    bench: BenchTables | None = None
