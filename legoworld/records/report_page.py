"""A report's photos and cases: a view of each as the page's JSON, and its line in the list."""

from __future__ import annotations

from typing import Literal

from legoworld.records.base import UNSET, Record, UnsetType
from legoworld.records.reconstruction import FlagKind, PrecisionRecall
from legoworld.records.track import ShownQuestion

#: (name, text) lines.
Facts = tuple[tuple[str, str], ...]


class Advice(Record, frozen=True, kw_only=True):
    """One finding. level: bad costs score, warn may, note explains. do: what helps, if anything.

    truths, predictions: positions of what it is about, in the view and in the side's answer.
    """

    level: Literal["bad", "warn", "note"]
    what: str
    do: str = ""
    truths: tuple[int, ...] = ()
    predictions: tuple[int, ...] = ()


class FactTable(Record, frozen=True, kw_only=True):
    """A small table of texts."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


class DrawnTruth(Record, frozen=True, kw_only=True):
    """A truth as it is drawn.

    c: category id; box: x, y, w, h; where masks are scored, one of rle (pycocotools' compressed
    counts) and polygons; h: counts of the part of an amodal mask that is not visible.
    """

    c: int
    box: tuple[int | float, ...]
    rle: str | UnsetType = UNSET
    h: str | UnsetType = UNSET
    polygons: tuple[tuple[int | float, ...], ...] | UnsetType = UNSET


class DrawnPrediction(DrawnTruth, frozen=True, kw_only=True):
    """A prediction. s: score; o: outcome at IoU 0.5; k: error kind; t: truth meant; i: IoU.

    n: what the scene calls it; m: its objects, by their names in scene.glb.
    """

    n: str | UnsetType = UNSET
    m: tuple[str, ...] | UnsetType = UNSET
    s: int | float
    o: str
    k: str | None
    t: int | None
    i: float | None


class PageCamera(Record, frozen=True, kw_only=True):
    """The camera a scene was read out with. world_from_cam: 3 x 4, z up, the camera's z forward.

    fx, fy, cx, cy in pixels of size_wh; of an orthographic camera fx, fy are pixels per metre.
    """

    world_from_cam: tuple[tuple[float, ...], ...]
    fx: float
    fy: float
    cx: float
    cy: float
    orthographic: bool
    size_wh: tuple[int, int]


class PageScene(Record, frozen=True, kw_only=True):
    """What the page shows of a scene folder.

    render, glb: places among the page's renders and scenes, None with the reason in render_said and
    glb_said; camera: None where the run recorded none.
    """

    render: int | None
    render_said: str
    glb: int | None
    glb_said: str
    camera: PageCamera | None


class Answer(Record, frozen=True, kw_only=True):
    """What one side made of a photo. scene: of a side that reads scenes, where they were given."""

    label: str
    status: str
    facts: Facts
    tables: tuple[FactTable, ...]
    advice: tuple[Advice, ...]
    scene: PageScene | None = None


class DetectionAnswer(Answer, frozen=True, kw_only=True):
    """Its boxes or masks. truth: what became of each truth."""

    predictions: tuple[DrawnPrediction, ...]
    truth: tuple[str, ...]


class PageView(Record, frozen=True, kw_only=True):
    """A photo of a section. photo: its place in the page's photos, or None with `said`."""

    section: str
    id: int
    file_name: str
    size_wh: tuple[int, int]
    photo: int | None
    said: str
    sides: tuple[Answer, ...]


class DetectionPageView(PageView, frozen=True, kw_only=True):
    """A photo of boxes or masks."""

    sides: tuple[DetectionAnswer, ...]
    truths: tuple[DrawnTruth, ...]

    @property
    def categories(self) -> set[int]:
        """Of every truth and prediction."""
        drawn = [d.c for side in self.sides for d in side.predictions]
        return {*drawn, *(d.c for d in self.truths)}


class DepthDrawing(Record, frozen=True, kw_only=True):
    """The drawn arrays of one photo on one scale.

    size_wh of the arrays; near_far_z_m: the colour scale's ends; error_m: the error scale's end;
    z0_m, step: a code c is z0_m * exp(step * c) metres, 65535 none; truth, aligned: base64 of
    little-endian uint16 codes, row major, None for a side without a score.
    """

    size_wh: tuple[int, int]
    image_wh: tuple[int, int]
    near_far_z_m: tuple[float, float]
    error_m: float
    z0_m: float
    step: float
    truth: str
    aligned: tuple[str | None, ...]


class DepthPageView(PageView, frozen=True, kw_only=True):
    """A photo of depth. depth: None where no side scored."""

    depth: DepthDrawing | None


class NormalsDrawing(Record, frozen=True, kw_only=True):
    """The drawn normals of one photo. size_wh: of the arrays; error_deg: the error scale's end.

    truth, predicted: base64 of x, y, z as signed bytes of 1 / 127, row major, 0, 0, 0 for none;
    errors: little-endian uint16 hundredths of a degree, 65535 for none. None for a side without a
    score.
    """

    size_wh: tuple[int, int]
    image_wh: tuple[int, int]
    error_deg: float
    truth: str
    predicted: tuple[str | None, ...]
    errors: tuple[str | None, ...]


class NormalsPageView(PageView, frozen=True, kw_only=True):
    """A photo of normals. normals: None where no side scored."""

    normals: NormalsDrawing | None


class RelationsPageView(PageView, frozen=True, kw_only=True):
    """A photo of relations. questions: of each side, in one order."""

    questions: tuple[tuple[ShownQuestion, ...], ...]


class MapPictures(Record, frozen=True, kw_only=True):
    """Label maps of one photo, as places among the page's overlays."""

    truth: int
    answers: tuple[int, ...]
    agreements: tuple[int, ...]


class LabelMapPageView(PageView, frozen=True, kw_only=True):
    """A photo of label maps."""

    maps: MapPictures


class PhotoCell(Record, frozen=True, kw_only=True):
    """One side of a photo in the list. advice: the first finding; findings: how many are bad."""

    status: str
    advice: str
    findings: int

    @property
    def number(self) -> float | None:
        """The photo's own number, None without one."""
        raise NotImplementedError(type(self).__name__)


class DetectionCell(PhotoCell, frozen=True, kw_only=True):
    """Of boxes or masks. errors: category ids of its errors by kind, each once.

    sure: TP and FP of the predictions at the usual confidence, absent where all are as confident.
    """

    quality: float | None
    tp: int
    fp: int
    fn: int
    errors: dict[str, tuple[int, ...]]
    sure: tuple[int, int] | UnsetType = UNSET

    @property
    def number(self) -> float | None:
        """Its quality."""
        return self.quality


class PixelCell(PhotoCell, frozen=True, kw_only=True):
    """Of an array; None where it has no score. metric: what the score is called.

    constant: the score of a constant, absent where a family has none.
    """

    metric: str
    score: float | None
    holes: float | None
    constant: float | UnsetType | None = UNSET

    @property
    def number(self) -> float | None:
        """Its score."""
        return self.score


class RelationsCell(PhotoCell, frozen=True, kw_only=True):
    """Of relations. accuracy: None where nothing true or false is asked; answered: questions."""

    accuracy: float | None
    answered: int

    @property
    def number(self) -> float | None:
        """Its accuracy."""
        return self.accuracy


class LabelMapCell(PhotoCell, frozen=True, kw_only=True):
    """Of label maps. quality: the photo's own `metric`; counts: the family's three, summed."""

    metric: str
    quality: float | None
    counts: tuple[int, int, int]

    @property
    def number(self) -> float | None:
        """Its quality."""
        return self.quality


class PhotoRow(Record, frozen=True, kw_only=True):
    """A photo in the list. view: its place in the page's views."""

    id: int
    file_name: str
    view: int
    n_truth: int
    cells: tuple[PhotoCell, ...]
    categories: tuple[int, ...]


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
