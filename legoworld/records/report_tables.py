"""A report's tables: what the page's templates show around its photos."""

from __future__ import annotations

from legoworld.records.base import UNSET, Record, UnsetType
from legoworld.records.comparison import Comparison, Dropped, PairCoverage
from legoworld.records.evaluation_summary import Evaluator, Ties
from legoworld.records.report_page import PhotoRow
from legoworld.records.report_reconstruction import BenchTables
from legoworld.records.report_summary import FirstScreen, Plots
from legoworld.tables.table import Table


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


class ComparedPair(Record, frozen=True, kw_only=True):
    """Two methods of a comparison."""

    scene: str
    baseline: str
    coverage: PairCoverage
    dropped: tuple[Dropped, ...]
    tables: tuple[Table, ...]


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
    """One side. scored: images; used_truth: whether its prompts came from the truth."""

    label: str
    scored: int
    scene: bool
    used_truth: bool


class SideNotes(Record, frozen=True, kw_only=True):
    """Sentences about one side's counts."""

    label: str
    lines: tuple[str, ...]


class SideOrigin(Record, frozen=True, kw_only=True):
    """How one side's numbers are made again: commands; hashes, versions, licences, options."""

    label: str
    folder: str
    commands: tuple[str, ...]
    partial: bool
    tables: tuple[Table, ...]


class PixelList(Record, frozen=True, kw_only=True):
    """A list of photos with an array each. metric, policy: of the score, the lower the better.

    constant: whether that of a constant is beside it.
    """

    metric: str
    policy: str
    constant: bool


class PageSection(Record, frozen=True, kw_only=True):
    """A section: evaluations of one task over one truth, or a comparison alone.

    specialist: whether a side is one, or the task has none; compared: the command that made the
    comparison; names: of the categories that are drawn, by id, absent where there are no
    evaluations.
    """

    key: str
    task: str
    family: str
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
    notes: tuple[SideNotes, ...] = ()
    provenance: tuple[SideOrigin, ...] = ()
    overview: tuple[Table, ...] = ()
    numbers: tuple[Table, ...] = ()
    ties: tuple[TiePicture, ...] = ()
    categories: tuple[CategoryLine, ...] = ()
    category_table: Table | None = None
    errors: tuple[ErrorCounts, ...] = ()
    names: dict[str, str] | UnsetType = UNSET
    images: tuple[PhotoRow, ...] = ()
    plots: Plots = Plots()
    bench: BenchTables | None = None
    pixels: PixelList | None = None
