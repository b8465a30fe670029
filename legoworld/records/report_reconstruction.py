"""A report's bench cases: what the page draws of a submission and its reference."""

from __future__ import annotations

from legoworld.records.base import Record
from legoworld.records.bench_results import Leaderboard
from legoworld.records.reconstruction import FlagKind, PrecisionRecall
from legoworld.records.report_page import Answer, DrawnTruth, PageView, PhotoCell, PhotoRow


class BenchObject(DrawnTruth, frozen=True, kw_only=True):
    """A scored object where the reference shows it, in raster pixels. n: its name."""

    n: str


class ObjectScore(PrecisionRecall, frozen=True, kw_only=True):
    """One side's object. at: F at the other tolerances, by name; eligible: whether R counts it."""

    eligible: bool
    n_reference: int
    n_submitted: int
    at: dict[str, float]


class BenchRaster(Record, frozen=True, kw_only=True):
    """The pixel grid of the drawn points: every `step`-th pixel of the scoring raster each way.

    size_wh: of the thinned grid; fx, fy, cx, cy: its intrinsics, pixel (r, c) being at (c + 0.5,
    r + 0.5); n_raster: points of the whole raster; z0_m, depth_step: a code is
    z0_m * exp(depth_step * code) metres, 65535 none; reference: base64 of uint16 codes.
    """

    size_wh: tuple[int, int]
    step: int
    n_raster: int
    fx: float
    fy: float
    cx: float
    cy: float
    z0_m: float
    depth_step: float
    reference: str


class BenchPoints(Record, frozen=True, kw_only=True):
    """One side's points. submitted: base64 of uint16 depth codes.

    reference_outcome, submitted_outcome: base64 of a byte each, a place in the section's outcomes.
    """

    submitted: str
    reference_outcome: str
    submitted_outcome: str


class CheckLine(Record, frozen=True, kw_only=True):
    """A validity check, as the readout recorded it."""

    name: str
    ok: bool
    found: str
    expected: str
    next_step: str


class BenchAnswer(Answer, frozen=True, kw_only=True):
    """One submission.

    objects: in the order of the view's; empty where it was not compared; hit_picture,
    error_picture: places among the page's overlays, None with why_no_picture saying why.
    """

    objects: tuple[ObjectScore, ...]
    checks: tuple[CheckLine, ...]
    hit_picture: int | None
    error_picture: int | None
    why_no_picture: str
    points: BenchPoints | None


class BenchPageView(PageView, frozen=True, kw_only=True):
    """A case. size_wh: of the scoring raster, which everything is drawn in."""

    sides: tuple[BenchAnswer, ...]
    objects: tuple[BenchObject, ...]
    raster: BenchRaster | None


class BenchCell(PhotoCell, frozen=True, kw_only=True):
    """One side of a case in the list. flags: kinds, each once."""

    valid: bool
    R: float | None
    A: float | None
    S: float | None
    flags: tuple[FlagKind, ...]

    @property
    def number(self) -> float | None:
        """S, or R where there is no render."""
        return self.R if self.S is None else self.S


class CaseLine(PhotoRow, frozen=True, kw_only=True):
    """A case in the list, with what it can be filtered by. tier: "" where it has none."""

    family: str
    tier: str


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
