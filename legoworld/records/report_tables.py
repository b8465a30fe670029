"""A report's first screen, its plots, and the tables that the templates show around its photos."""

from __future__ import annotations

from typing import Literal

from legoworld.records.base import UNSET, Record, UnsetType
from legoworld.records.bench_results import Leaderboard
from legoworld.records.comparison import Comparison, Dropped, PairCoverage
from legoworld.records.detection import Ties
from legoworld.records.evaluation import Evaluator
from legoworld.records.report_page import PhotoRow
from legoworld.tables.table import Table

#: How two sides stand: by the interval of their difference.
Standing = Literal["better", "worse", "not told apart", "no interval", "alone"]


class Verdict(Record, frozen=True, kw_only=True):
    """One sentence with its denominators. standing: of the first side named.

    main: it is over the images that both sides answer; otherwise it repeats one over all attempted.
    """

    sentence: str
    main: bool = True
    standing: Standing


class Cost(Record, frozen=True, kw_only=True):
    """What one change would mend on one side; or its images without an answer.

    gain: how the metric changes with it; others: where the other side's is mended, of two. n errors
    in so many images; link: where in the section they are.
    """

    kind: str
    link: str
    n: int
    images: int
    text: str
    gain: float
    others: float | None


class SideCosts(Record, frozen=True, kw_only=True):
    """What costs a side most of a metric, the most first. over: what the changes are of."""

    label: str
    metric: str
    over: str
    most: tuple[Cost, ...]


class Span(Record, frozen=True, kw_only=True):
    """A number and the ends of its interval, None where it has none. over: its denominators."""

    value: float | None
    low: float | None
    high: float | None
    over: str


class ForestRow(Record, frozen=True, kw_only=True):
    """A metric: a span of each side, and of the difference to each other side.

    better: which way is better.
    """

    name: str
    better: Literal["higher", "lower"]
    sides: tuple[Span | None, ...]
    differences: tuple[Span | None, ...]


class CoveragePart(Record, frozen=True, kw_only=True):
    """Images of one sort. sort: what its colour says."""

    name: str
    sort: Literal["scored", "empty", "failed"]
    n: int


class CoverageBar(Record, frozen=True, kw_only=True):
    """All attempted images of a side, each in one part."""

    label: str
    attempted: int
    parts: tuple[CoveragePart, ...]


class PrecisionRecall(Record, frozen=True, kw_only=True):
    """Precision at the 101 recall thresholds at IoU 0.5, the mean over categories with truth.

    The mean of `precision` is AP50. low, high: the 2.5th and 97.5th percentile over random orders
    of equally confident predictions, empty where no order is open; draws: how many.
    """

    label: str
    policy: Literal["own scores", "equal confidence"]
    categories: int
    precision: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    draws: int


class IouHistogram(Record, frozen=True, kw_only=True):
    """IoU of predictions with the ground truth of their category that they are about.

    edges: of the bins; tp, low: true positives, and localisation errors, in each.
    """

    label: str
    edges: tuple[float, ...]
    tp: tuple[int, ...]
    low: tuple[int, ...]


class DepthError(Record, frozen=True, kw_only=True):
    """|aligned - truth| / truth by true depth, over the drawn pixels of all scored photos.

    edges_m: of the bins, equal ratios apart; n: pixels in each; low, median, high: the 10th, 50th
    and 90th percentile there, None where a bin is empty.
    """

    label: str
    edges_m: tuple[float, ...]
    n: tuple[int, ...]
    low: tuple[float | None, ...]
    median: tuple[float | None, ...]
    high: tuple[float | None, ...]


class FirstScreen(Record, frozen=True, kw_only=True):
    """What is read before anything else."""

    verdicts: tuple[Verdict, ...]
    costs: tuple[SideCosts, ...]
    forest: tuple[ForestRow, ...]
    coverage: tuple[CoverageBar, ...]


class Plots(Record, frozen=True, kw_only=True):
    """Curves and histograms; empty where a task has none."""

    precision_recall: tuple[PrecisionRecall, ...] = ()
    iou: tuple[IouHistogram, ...] = ()
    depth_error: tuple[DepthError, ...] = ()


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


class MatchedSide(Record, frozen=True, kw_only=True):
    """A side's match table in the order AP is accumulated in; a column is a text of `cohorts`.

    ranked: whether its scores differ; above: (confidences + 1, categories) how many predictions
    there are at each confidence or above, first those at any. Columns: image, the place of each
    prediction's; outcome, its row among the distinct `outcomes`, (rows, areas * thresholds): 0
    false, 1 true, 2 not counted; truth_image, truth_category: cells with scored truth; n_truths:
    (areas, cells).
    """

    ranked: bool
    above: tuple[tuple[int, ...], ...]
    image: str
    outcome: str
    outcomes: str
    truth_image: str
    truth_category: str
    n_truths: str


class Cohorts(Record, frozen=True, kw_only=True):
    """What any selection of a section's photos is scored with.

    areas: names of sizes, the first is all; half: the place of IoU 0.5 among the thresholds;
    confidences: that predictions can be counted from; usual: the first choice among them;
    categories: id and name; images: id, width and height.
    """

    areas: tuple[str, ...]
    half: int
    thresholds: int
    confidences: tuple[float, ...]
    usual: float
    categories: tuple[tuple[int, str], ...]
    images: tuple[tuple[int, int, int], ...]
    sides: tuple[MatchedSide, ...]


class Outcome(Record, frozen=True, kw_only=True):
    """A colour of a picture and what it stands for. colour: #rrggbb."""

    name: str
    text: str
    colour: str


class TierBar(Record, frozen=True, kw_only=True):
    """One agent's metric by tier. values, sds: in the order of `tiers`; None where undefined."""

    label: str
    metric: str
    tiers: tuple[str, ...]
    cases: tuple[int, ...]
    values: tuple[float | None, ...]
    sds: tuple[float | None, ...]


class BenchTables(Record, frozen=True, kw_only=True):
    """What only a bench's section has.

    outcomes: of the picture of R and the points, errors: of the picture of A, each in the order of
    its codes; delta: A's tolerance; tolerance: R's, a share of the depth; noise_floor: what the
    references' own renders score, empty where it was not measured.
    """

    board: Leaderboard
    tiers: tuple[TierBar, ...]
    outcomes: tuple[Outcome, ...]
    errors: tuple[Outcome, ...]
    delta: int
    tolerance: float
    noise_floor: str


class PageSection(Record, frozen=True, kw_only=True):
    """A section: evaluations of one task over one truth, or a comparison alone.

    specialist: whether a side is one, or the task has none; compared: the command that made the
    comparison; names: of the categories that are drawn, by id, absent where there are no
    evaluations; tags: each with its image ids.
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
    cohorts: Cohorts | None = None
    tags: tuple[tuple[str, tuple[int, ...]], ...] = ()
