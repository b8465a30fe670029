"""More single rules of the page: what is chosen, ordered and told at the edges, without a page."""

from __future__ import annotations

import hashlib
import math
import re
from dataclasses import dataclass
from dataclasses import replace as replace_dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import jinja2
import numpy as np
import pytest
from msgspec.structs import replace

from legoworld.evaluation.detection.inputs.masks import from_pixels
from legoworld.records.base import UNSET
from legoworld.records.coco_file import ShownPrediction, TrueAnnotation
from legoworld.records.comparison import ComparisonRow, Difference, Measured
from legoworld.records.evaluation import Outcome
from legoworld.records.reconstruction import Flag
from legoworld.records.report_page import Advice
from legoworld.report import (
    costs,
    depth_images,
    detection_section,
    first_screen,
    forest,
    mended_pixels,
    page_file,
    photos,
    pixel_section,
    plots,
    provenance,
    reconstruction_advice,
    relations_page,
    scene_files,
    sources,
    systems,
    tables,
)
from legoworld.report.mended_ap import MendedAp, prediction_errors
from legoworld.report.notebook import instances_text, statuses_html
from legoworld.report.parts import lone_part, shared_truth_parts
from legoworld.report.reconstruction_pictures import OUTCOMES
from legoworld.report.tried import Gains, _fitted_iou, try_steps


def truth(*box: float, category: int = 1) -> TrueAnnotation:
    return TrueAnnotation(image_id=1, category_id=category, bbox=box)  # type: ignore[arg-type]


def shape(*box: float, category: int = 1) -> ShownPrediction:
    return ShownPrediction(
        image_id=1, category_id=category, bbox=box, score=0.5, outcome_50="fp",  # type: ignore[arg-type]
    )  # fmt: skip


def photo(truths: list[TrueAnnotation], entries: list[ShownPrediction], **errors: Any) -> Any:
    known = {
        "truth": ("missed",) * len(truths), "finder": (None,) * len(truths),
        "kind": ("localisation",) * len(entries),
    }  # fmt: skip
    side = SimpleNamespace(entries=entries, errors=SimpleNamespace(**known | errors))
    image = SimpleNamespace(id=1, width=100, height=100)
    return SimpleNamespace(image=image, truths=truths), side


WHOLE = truth(0, 0, 10, 10)


@pytest.mark.parametrize(
    ("second", "together"),
    [
        ((0, 5, 10, 0.5), 0.55),  # 0.05 better than the first part alone
        ((0, 5, 10, 0.4), None),
        ((0, 7.5, 10, 3.125), 0.941),  # 80 % of it inside
        ((0, 7.5, 10, 3.2), None),
    ],
)
def test_parts_share_a_truth_from_80_percent_inside_and_a_gain_of_a_twentieth(second, together):
    image, side = photo([WHOLE], [shape(0, 0, 10, 5), shape(*second)])
    found = shared_truth_parts("coco", image, side)
    assert [round(one.together_iou, 3) for one in found] == ([together] if together else [])
    if found:
        assert (found[0].truth, found[0].predictions, found[0].best_iou) == (0, (0, 1), 0.5)


def test_only_parts_of_its_own_category_share_a_truth_that_is_not_ignored():
    halves = [shape(0, 0, 10, 5), shape(0, 5, 10, 5)]
    assert len(shared_truth_parts("coco", *photo([WHOLE], halves))) == 1
    assert shared_truth_parts("coco", *photo([WHOLE], halves, truth=("ignored",))) == []
    other = [halves[0], shape(0, 5, 10, 5, category=2)]
    assert shared_truth_parts("coco", *photo([WHOLE], other)) == []
    finder = photo([WHOLE], halves, finder=(0,), kind=(None, "duplicate"))
    assert [one.predictions for one in shared_truth_parts("coco", *finder)] == [(0, 1)]
    both_right = photo([WHOLE], halves, finder=(0,), kind=(None, None))
    assert shared_truth_parts("coco", *both_right) == []
    small = photo([WHOLE], [shape(0, 0, 10, 2.5), shape(0, 2.5, 10, 2.4)])
    assert shared_truth_parts("coco", *small) == [], "together under one half"
    half = photo([WHOLE], [shape(0, 0, 10, 2.5), shape(0, 2.5, 10, 2.5)])
    assert len(shared_truth_parts("coco", *half)) == 1


def test_a_lone_part_lies_in_the_truth_that_holds_most_of_it():
    truths = [truth(0, 0, 4, 10), truth(0, 0, 10, 10), truth(0, 0, 20, 20, category=2)]
    image, side = photo(truths, [shape(0, 0, 5, 2), shape(8, 0, 2.5, 2), shape(8, 0, 2.6, 2)])
    assert [lone_part("coco", image, entry, side) for entry in range(3)] == [1, 1, None]
    side.errors.truth = ("missed", "ignored", "missed")
    assert lone_part("coco", image, 0, side) == 0
    side.errors.truth = ("ignored", "ignored", "missed")
    assert lone_part("coco", image, 0, side) is None


@pytest.mark.parametrize(
    ("together", "fitted", "parts", "fit"),
    [(0.55, 0.54, True, False), (0.54, 0.0, False, False), (0.6, 0.6, True, True),
     (0.6, 0.61, False, True), (0.5, 0.55, False, True)],
)  # fmt: skip
def test_a_step_helps_from_a_gain_of_a_twentieth(together, fitted, parts, fit):
    tried = Gains(iou=0.5, given_back=(), together_iou=together, fitted_iou=fitted)
    assert (tried.parts_help, tried.fit_helps) == (parts, fit)


def test_parts_of_other_categories_are_given_back():
    entries = [shape(0, 0, 10, 5), shape(0, 5, 10, 4, category=2), shape(0, 9, 10, 1),
               shape(0, 8, 10, 2.6, category=2),
               shape(0, 8, 5, 2.5, category=3)]  # fmt: skip
    image, side = photo([WHOLE], entries)
    side.iou = np.array([[0.5], [0.4], [0.1], [0.2], [0.1]])
    found = try_steps("coco", image, side, 0, 0)
    assert (found.given_back, found.iou) == ((1, 4), 0.5), "80 % inside is enough"
    assert found.together_iou == pytest.approx(100 / 105), "the box around all three"
    assert found.fitted_iou == 1.0
    alone = try_steps("coco", image, side, 1, 0)
    assert (alone.given_back, round(alone.together_iou, 3)) == ((0, 2, 4), 0.952)


def test_a_mask_of_the_truth_s_form_fits_wherever_it_lies():
    def mask(*slices: slice) -> Any:
        pixels = np.zeros((20, 20), np.uint8)
        pixels[slices] = 1
        return from_pixels(pixels)

    wanted = mask(slice(2, 10), slice(4, 8))
    assert _fitted_iou(mask(slice(15, 19), slice(15, 17)), wanted) == 1.0
    assert _fitted_iou(from_pixels(np.zeros((20, 20), np.uint8)), wanted) == 0.0
    assert _fitted_iou(wanted, from_pixels(np.zeros((20, 20), np.uint8))) == 0.0


def test_a_relations_cell_counts_its_findings():
    row: Any = SimpleNamespace(
        status="ok", n_answered=7, sums={"accuracy": SimpleNamespace(score=3.0, n=4)}
    )
    advice = [SimpleNamespace(level=level, what=level) for level in ("bad", "bad", "warn")]
    cell = relations_page._cell(row, SimpleNamespace(advice=advice))  # type: ignore[arg-type]
    assert (cell.advice, cell.findings, cell.accuracy, cell.answered) == ("bad", 2, 0.75, 7)
    row.sums = {}
    cell = relations_page._cell(row, SimpleNamespace(advice=[]))  # type: ignore[arg-type]
    assert (cell.status, cell.advice, cell.findings, cell.accuracy) == ("ok", "", 0, None)


def side_of(run: dict[str, Any], *, scene: bool = True, **more: Any) -> Any:
    known = dict.fromkeys(
        ("baseline", "imported", "track_sha256", "source", "max_side", "variant", "require_frozen")
    )
    inputs = [SimpleNamespace(role="run", path="../my run/run.json", sha256="r"),
              SimpleNamespace(role="truth", path="/far/truth.json", sha256="t" * 64)]  # fmt: skip
    return SimpleNamespace(
        is_scene=scene, task="coco", name="one", folder=Path("out/eval"),
        run=SimpleNamespace(configuration=SimpleNamespace(**known | run), baseline=None),
        evidence=SimpleNamespace(inputs=inputs, configuration={"draws": 5, "seed": 3, "other": 1}),
        **more,
    )  # fmt: skip


CARDS: Any = [
    {"name": "coco", "title": "COCO", "licence": "CC", "files": [
        {"pattern": "a.json", "sha256": "h", "shipped": True},
        {"pattern": "b.json", "sha256": "t" * 64}]},
    {"name": "lvis", "title": "LVIS", "licence": "BY"},
]  # fmt: skip


@pytest.mark.parametrize(
    ("run", "words"),
    [
        ({}, ""),
        ({"variant": "geometric", "require_frozen": False, "max_side": 0}, ""),
        ({"track_sha256": "h"}, "--track datasets/coco/a.json "),
        ({"track_sha256": "unknown"}, "--track TRACK.json "),
        ({"source": "glb", "max_side": 640}, "--source glb --max-side 640 "),
        ({"variant": "alpha", "require_frozen": True}, "--variant alpha --require-frozen "),
    ],
)
def test_a_scene_s_run_is_repeated_with_its_own_options(run, words):
    said = provenance._made_run(side_of(run), CARDS)
    assert said == f"legoworld readout SCENES --task coco {words}-o 'my run'"


@pytest.mark.parametrize(
    ("run", "verb"),
    [({"baseline": "my net"}, "run 'my net'"), ({}, "run NAME"),
     ({"baseline": "x", "imported": True}, "import FILE_OR_DIR")],
)  # fmt: skip
def test_a_baseline_s_run_is_repeated_by_its_name_or_its_import(run, verb):
    assert provenance._made_run(side_of(run, scene=False), CARDS) == (
        f"legoworld baseline {verb} --task coco --track TRACK.json -o 'my run'"
    )


def test_an_evaluation_and_a_comparison_are_repeated_with_their_draws(monkeypatch):
    monkeypatch.setattr(provenance, "as_json", lambda values: values)
    assert provenance._describe_evaluation(side_of({})) == (
        "legoworld evaluate 'my run' --truth truth.json --draws 5 --seed 3 -o eval"
    )
    side = side_of({})
    side.evidence.inputs.pop()
    assert "--truth TRUTH " in provenance._describe_evaluation(side)
    made: Any = SimpleNamespace(bootstrap=SimpleNamespace(draws=20, seed=4))
    end = "--draws 20 --seed 4 -o COMPARISON"
    assert provenance.compare_command(made, [side, side]) == f"legoworld compare eval eval {end}"
    assert provenance.compare_command(made, []) == (
        f"legoworld compare EVAL_SCENE EVAL_BASELINE {end}"
    )


def test_the_licence_of_data_is_that_of_the_truth_s_own_bytes():
    side = side_of({})
    ((text, name, licence),) = provenance._data_licence(side, CARDS)
    assert (text.text, text.below, name, licence) == (
        "COCO", "this truth, by its hash", "coco", "CC",
    )  # fmt: skip
    side.evidence.inputs[1].sha256, side.task = "unknown", "lvis"
    ((text, name, _),) = provenance._data_licence(side, CARDS)
    assert (name, text.below.startswith("the usual dataset")) == ("lvis", True)
    assert provenance._model_licence(side) == []
    side.run.baseline = SimpleNamespace(title=None, name="net", licence="MIT")
    ((text, name, licence),) = provenance._model_licence(side)
    assert (text.text, text.below, name, licence) == ("", "the specialist", "net", "MIT")
    side.run.baseline.licence = None
    assert provenance._model_licence(side) == []
    assert [provenance._find_shipped(CARDS, sha256) for sha256 in ("h", "t" * 64, "")] == [
        "datasets/coco/a.json", None, None,
    ]  # fmt: skip
    assert provenance._flat({"b": None, "a": True, "c": 1.5}) == (
        ("a", "true"), ("b", "-"), ("c", "1.5"),
    )  # fmt: skip


def make_measured(value: float | None, **more: Any) -> Measured:
    return Measured(value=value, interval=None, over={"truths": 3, "images": 2}, **more)


def make_row(metric: str, level: Any, *, images: Any = "attempted", policy: str = "own") -> Any:
    return ComparisonRow(
        metric=metric, policy=policy, images=images, better="higher", level=level,
        scene=make_measured(0.5, constant=0.25), baseline=make_measured(0.25),
        difference=Difference(value=0.25, interval=None),
    )  # fmt: skip


def test_a_pair_s_rows_are_shown_or_folded_by_their_level():
    rows = (make_row("AP", 2), make_row("own.AP50", 1), make_row("AP75.own", 1))
    pair = SimpleNamespace(scene="s", baseline="b", coverage=None, dropped=(), rows=rows)
    (made,) = tables.comparison_tables(SimpleNamespace(pairs=[pair]))  # type: ignore[arg-type]
    assert (made.scene, made.baseline) == ("s", "b")
    assert [(t.title, t.folded, len(t.rows)) for t in made.tables] == [
        ("", False, 2), ("1 more rows", True, 1),
    ]  # fmt: skip
    assert [c.name for c in made.tables[0].columns] == [
        "metric", "images", "policy", "difference", "s", "b",
    ]  # fmt: skip
    (metric, images, policy, difference, scene, baseline), second = made.tables[0].rows
    assert (metric, second[0], images) == ("AP50", "AP75", "attempted")
    assert (policy.text, policy.below) == ("own", "higher is better")
    assert (difference.value, difference.signed) == (0.25, True)
    assert (scene.value, scene.below) == (0.5, "2 images, 3 truths; a constant: 0.2500")
    assert (baseline.value, baseline.below) == (0.25, "2 images, 3 truths")


def test_coverage_has_a_row_of_each_count_and_status_of_any_side():
    one = SimpleNamespace(attempted=5, scored=4, with_truth=3, by_status={"ok": 4, "failed": 1})
    two = SimpleNamespace(attempted=5, scored=5, valid=2, by_status={"ok": 5})
    sides: Any = [
        SimpleNamespace(name=name, summary=SimpleNamespace(coverage=coverage))
        for name, coverage in (("a", one), ("b", two))
    ]
    found = tables.coverage_table(sides)
    assert [c.name for c in found.columns] == ["images", "a", "b"]
    assert [*map(tuple, found.rows)] == [
        ("attempted", 5, 5), ("scored", 4, 5), ("valid", "-", 2), ("with truth", 3, "-"),
        ("status failed", 1, 0), ("status ok", 4, 5),
    ]  # fmt: skip
    assert found.title == "Coverage"


def test_without_a_specialist_the_first_row_says_so():
    shown_table = tables.table(["a"], [["x"], ["y"]], title="t")
    found = tables.without_specialist(shown_table)
    assert [c.name for c in found.columns] == ["a", "specialist"]
    assert [row[1].text for row in found.rows] == ["no specialist was run", ""]


@pytest.mark.parametrize(
    ("images", "taken"),
    [(("paired", "scored", "attempted"), "attempted"), (("paired", "scored"), "scored"),
     (("paired",), "paired"), ((), None)],
)  # fmt: skip
def test_a_plot_s_row_is_over_all_attempted_images_where_it_can_be(images, taken):
    rows = [make_row("AP", 1, images=name) for name in images]
    pair: Any = SimpleNamespace(rows=[make_row("AP50", 1), *rows])
    found = forest._row(pair, "AP")
    assert (found and found.images) == taken


def test_each_image_is_in_the_coverage_once():
    outcomes = [Outcome("failed", "timeout"), Outcome("scored", "ok"), Outcome("empty", "nothing"),
                Outcome("failed", "failed"), Outcome("scored", "ok"),
                Outcome("scored", "partial")]  # fmt: skip
    side: Any = SimpleNamespace(
        name="x", rows=[SimpleNamespace(outcome=outcome) for outcome in outcomes],
        summary=SimpleNamespace(coverage=SimpleNamespace(attempted=6)),
    )  # fmt: skip
    bar = first_screen._coverage(side)
    assert (bar.label, bar.attempted) == ("x", 6)
    assert [(part.name, part.sort, part.n) for part in bar.parts] == [
        ("scored", "scored", 2), ("partial", "scored", 1), ("nothing", "empty", 1),
        ("failed", "failed", 1), ("timeout", "failed", 1),
    ]  # fmt: skip


def costs_of(name: str, gain: dict[Any, float], *, failed: int = 0, scene: bool = True) -> Any:
    found = {
        key: costs.Finding(text=str(key[1]), gain=one, images=[1, 2], category=key[1])
        for key, one in gain.items()
    }
    return costs.Findings(
        side=SimpleNamespace(name=name, is_scene=scene),  # type: ignore[arg-type]
        metric="AP", over="all 4 images", by_error=found, n_attempted=4, n_failed=failed,
        value=0.25, value_answered=0.5, errors=", of 12 errors",
    )  # fmt: skip


def test_four_costs_are_named_of_one_side_and_three_of_each_of_two():
    gain = {("missed", n): 0.1 + n / 100 for n in range(6)}
    (one,) = costs.side_costs([costs_of("a", gain)])
    assert (one.label, [cost.text for cost in one.most]) == ("a", ["5", "4", "3", "2"])
    assert one.over == "Each mended alone: AP over all 4 images, of 12 errors"
    less = {key: value - 0.001 for key, value in gain.items()}
    (edge,) = costs.side_costs([replace_dataclass(costs_of("a", gain), least=0.14)])
    assert [cost.text for cost in edge.most] == ["5", "4"], "the least gain is one"
    first, second = costs.side_costs([costs_of("a", gain, failed=3), costs_of("b", less)])
    assert [cost.text for cost in first.most[1:]] == ["5", "4", "3"]
    assert second.most == (), "it is behind on none"
    lost = first.most[0]
    assert (lost.kind, lost.n, lost.images, lost.gain) == ("failed", 3, 3, 0.25)
    end = "AP 0.250, over the"
    assert lost.text == f"3 of 4 images without scene: {end} 1 with one 0.500"
    ((lost, *_),) = (c.most for c in costs.side_costs([costs_of("a", gain, failed=2, scene=False)]))
    assert lost.text == f"2 of 4 images without answer: {end} 2 with one 0.500"
    three = costs.side_costs([costs_of(name, gain) for name in "abc"])
    assert {len(side.most) for side in three} == {3}
    assert {cost.others for side in three for cost in side.most} == {None}


def test_an_error_of_classification_is_its_truth_s_and_any_other_its_own():
    kinds = ("classification", "localisation", "background", None)
    image, side = photo([truth(0, 0, 1, 1, category=7)], [shape(0, 0, 1, 1, category=2)] * 4)
    side.errors = SimpleNamespace(kind=kinds, about=(0, 0, None, 0), iou=(0.6, 0.3, None, 0.9))
    assert prediction_errors(image, side) == [
        (("classification", 7), 0, 0.6), (("localisation", 2), 0, 0.3),
        (("background", 2), None, 0.0), (None, 0, 0.9),
    ]  # fmt: skip


def test_the_histogram_has_true_positives_and_low_pairs():
    counts = plots.IouCounts()
    entries = [SimpleNamespace(outcome_50=o) for o in ("tp", "fp", "fp", "tp", "fp")]
    errors = SimpleNamespace(
        kind=(None, "localisation", "duplicate", None, "localisation"),
        iou=(0.52, 0.12, 0.9, 0.999, None),
    )
    counts.add(SimpleNamespace(entries=entries, errors=errors))  # type: ignore[arg-type]
    made = counts.histogram("x")
    assert (made.label, made.edges[0], made.edges[-1], len(made.edges)) == ("x", 0.1, 1.0, 19)
    assert (made.tp[8], made.tp[17], sum(made.tp)) == (1, 1, 2)
    assert (made.low[0], sum(made.low)) == (1, 1)


@pytest.mark.parametrize(
    ("size_wh", "shown_wh"),
    [((801, 400), (800, 400)), ((800, 3), (800, 3)), ((2000, 1), (800, 1)), ((1, 5), (1, 5)),
     ((400, 1600), (200, 800))],
)  # fmt: skip
def test_a_picture_is_at_most_800_pixels_long(size_wh, shown_wh, tmp_path):
    path = tmp_path / "a.png"
    picture = np.zeros((size_wh[1], size_wh[0], 3), np.uint8)
    picture[:, :, 2] = 255  # red, as OpenCV orders
    cv2.imwrite(str(path), picture)
    found = photos.page_picture(path, "it", size_wh)
    assert (found.note, found.webp is None) == ("", False)
    seen = cv2.imdecode(np.frombuffer(found.webp or b"", np.uint8), cv2.IMREAD_COLOR)
    assert seen.shape[:2] == shown_wh[::-1]
    assert seen[0, 0, 2] > 200 > 60 > seen[0, 0, 0]
    other = photos.page_picture(path, "it", (size_wh[0], size_wh[1] + 1))
    assert (other.webp, other.note.endswith(": not shown")) == (None, True)


def test_the_scene_of_a_submission_is_shown_where_folders_are_named(tmp_path, monkeypatch):
    monkeypatch.setattr(scene_files, "why_not_shown", lambda _glb: "")
    (tmp_path / "den").mkdir()
    (tmp_path / "den" / "scene.glb").write_bytes(b"glb")
    digest = hashlib.sha256(b"glb").hexdigest()
    scene: Any = SimpleNamespace(scene="den", files={"scene.glb": digest})
    pose = tuple((float(i), 0.0, 0.0, 1.0) for i in range(4))
    camera = SimpleNamespace(world_from_cam=pose, fx=1.0, fy=2.0, cx=3.0, cy=4.0, type="ORTHO")
    row: Any = SimpleNamespace(camera=camera, size_wh=(8, 6))
    files = scene_files.SceneFiles(folders=[tmp_path])
    found = files.bench_scene(scene, row, "no render")
    assert found is not None
    assert (found.render, found.render_said, found.glb, found.glb_said) == (
        None, "no render", 0, "",
    )  # fmt: skip
    assert found.camera is not None
    assert (found.camera.orthographic, found.camera.world_from_cam) == (True, pose[:3])
    assert (found.camera.fx, found.camera.fy, found.camera.cx, found.camera.cy) == (1, 2, 3, 4)
    assert found.camera.size_wh == (8, 6)
    camera.type = "PERSP"
    again = files.bench_scene(scene, row, "no render")
    assert again is not None
    assert again.camera is not None
    assert (again.camera.orthographic, again.glb, len(files.glbs)) == (False, 0, 1)
    for said in (files.bench_scene(None, row, ""),
                 scene_files.SceneFiles(folders=[]).bench_scene(scene, row, "")):  # fmt: skip
        assert said is not None
        assert (said.glb, said.glb_said) == (None, "no --scenes was given")
    for changes in ({"size_wh": None}, {"camera": UNSET}):
        bare: Any = SimpleNamespace(**{**vars(row), **changes})
        assert files.bench_scene(scene, bare, "").camera is None  # type: ignore[union-attr]


@pytest.mark.parametrize(("over", "index"), [(0, 0), (1, None)])
def test_a_glb_of_the_most_bytes_is_shown(over, index, tmp_path, monkeypatch):
    monkeypatch.setattr(scene_files, "MOST_BYTES", 10)
    monkeypatch.setattr(scene_files, "why_not_shown", lambda _glb: "")
    path = tmp_path / "den" / "scene.glb"
    path.parent.mkdir()
    path.write_bytes(bytes(10 + over))
    found, said = scene_files.SceneFiles(folders=[]).add_glb(path)
    assert (found, said) == (index, "den/scene.glb is 0 MB: more than a page shows" if over else "")


@dataclass(frozen=True)
class Side:
    """What tells the sides of a section apart."""

    name: str
    folder: Path
    is_scene: bool
    rows: tuple[Any, ...] = (SimpleNamespace(image_id=1, file_name="a"),)


def test_two_sides_of_one_name_are_told_apart_by_their_folders(monkeypatch):
    by_folder = SimpleNamespace(by_folder=False)
    monkeypatch.setattr(sources, "load_page_family", lambda _task: by_folder)
    given: Any = [Side("net", Path("x/n1"), False), Side("scene", Path("x/s"), True),
                  Side("net", Path("x/n2"), False)]  # fmt: skip
    made = sources._section("coco", given, None)
    assert [side.name for side in made.sides] == ["scene", "net (n1)", "net (n2)"]
    by_folder.by_folder = True
    assert [s.name for s in sources._section("coco", given, None).sides] == ["s", "n1", "n2"]
    there: Any = "a comparison"
    assert sources._section("coco", given, there).sides[0].name == "scene"
    assert [s.name for s in sources._section("coco", given[1:2], None).sides] == ["scene"]
    other: Any = Side("b", Path("y"), False, (SimpleNamespace(image_id=2, file_name="a"),))
    with pytest.raises(sources.ReportInputError, match="found: s: 1, y: 1"):
        sources._section("coco", [given[1], other], None)
    keyed = sources._with_keys([made, made, made])
    assert [section.key for section in keyed] == ["coco", "coco-2", "coco-3"]


def test_instances_and_statuses_in_a_line():
    def row(category: str | None) -> Any:
        return SimpleNamespace(category=category)

    assert instances_text([row("cup"), row(None), row("bus"), row("bus")]) == (
        "2 x bus, cup, without a category"
    )
    assert statuses_html("a<", {"ok": 3, "failed": 1}) == "<p><b>a&lt;</b>: 3 ok, 1 failed</p>"


@pytest.mark.parametrize(
    ("status", "has_score", "said"),
    [
        ("failed", False, ["bad no output (failed): no reason -> do"]),
        ("ok", False, ["bad not scored (hole): too few -> "]),
        ("ok", True, ["warn half -> mend it"]),
    ],
)
def test_an_array_that_is_not_scored_is_a_finding(status, has_score, said):
    page: Any = SimpleNamespace(
        advice=lambda _row: [Advice(level="warn", what="half", do="mend it")]
    )
    row: Any = SimpleNamespace(
        status="hole", reason="too few", has_score=has_score, warnings=("b", "a")
    )
    run_row: Any = SimpleNamespace(status=status, reason="no reason; next: do", warnings=("a", "c"))
    for scene in (True, False):
        found = pixel_section._advice(page, row, run_row, scene=scene)
        words = [f"{a.level} {a.what} -> {a.do}" for a in found]
        first = said if scene else [text.partition("->")[0] + "-> " for text in said]
        assert words == [*first, *(f"warn {text} -> " for text in "abc")]


def test_a_truth_that_may_be_met_often_is_an_ignored_crowd():
    truths = [replace(WHOLE, iscrowd=crowd) for crowd in (0, 1, 0, 1)]
    image, side = photo(truths, [], truth=("ignored", "ignored", "missed", "missed"))
    side.iou, side.places = np.zeros((0, 4)), ()
    side.run_row = SimpleNamespace(status="failed")
    made = MendedAp(side=side)
    made.add(image, side)
    ((_, _, ignored, crowd),) = made._image_truths
    assert ignored.tolist() == [True, True, False, False]
    assert crowd.tolist() == [False, True, False, False]


def test_the_page_s_scripts_know_the_outcome_that_does_not_count():
    script = (Path(sources.__file__).parent / "page" / "points.js").read_text("utf-8")
    (name,) = re.findall(r'const OUTSIDE = "(\w+)"', script)
    assert [one.name for one in OUTCOMES if "not in R" in one.text] == [name]


def test_a_detection_cell_counts_what_is_bad_and_says_what_comes_first(monkeypatch):
    monkeypatch.setattr(detection_section, "_errors", lambda _, side: side.kinds)

    def side(tp: int, *kinds: tuple[str, int]) -> Any:
        row = SimpleNamespace(greedy_50=SimpleNamespace(tp=tp, fp=tp + 1), n_truth=9)
        entries = [SimpleNamespace(outcome_50="tp", score=s) for s in (0.29, 0.3, 1.0)]
        return SimpleNamespace(
            quality=tp / 10, row=row, n_missed=tp + 2, kinds=kinds, entries=entries
        )

    def drawn(status: str, *levels: str) -> Any:
        advice = [SimpleNamespace(level=one, what=f"{one} {k}") for k, one in enumerate(levels)]
        return SimpleNamespace(status=status, advice=advice)

    image: Any = SimpleNamespace(sides=[side(1, ("b", 4), ("a", 4), ("b", 4)), side(5, ("a", 1))])
    views = (drawn("ok", "warn", "bad", "bad", "bad"), drawn("failed"))
    view: Any = SimpleNamespace(id=4, file_name="x.png", sides=views, categories={3, 1})
    row = detection_section._row(image, view, [True, False], 7)
    assert (row.id, row.file_name, row.view, row.n_truth, row.categories) == (4, "x.png", 7, 9,
                                                                              (1, 3))  # fmt: skip
    first, second = row.cells
    assert (first.status, first.findings, first.advice) == ("ok", 3, "warn 0")
    assert (first.quality, first.tp, first.fp, first.fn) == (0.1, 1, 2, 3)
    assert (first.errors, first.sure, second.sure) == ({"a": (4,), "b": (4,)}, (2, 0), UNSET)
    assert (second.status, second.findings, second.advice, second.errors) == ("failed", 0, "", {})


def test_a_flag_is_a_warning_with_its_number_and_its_limit():
    flag = Flag(kind="picture_in_scene", what="w", measured=0.123456, threshold=0.05)  # type: ignore[arg-type]
    assert reconstruction_advice._flag(flag) == Advice(
        level="warn", what="flag, picture in scene: w (0.123, flagged from 0.05)",
        do="for a person to look at: it changes no score",
    )  # fmt: skip


def test_a_template_escapes_every_value_and_refuses_one_that_is_not_given():
    environment = page_file._environment()
    shown = environment.from_string("{% if a %}\n  {{ a }}\n  {% endif %}")
    assert shown.render(a="<b>") == "  &lt;b&gt;\n"
    for text in ("{{ b }}", "{% if b %}{% endif %}", "{{ a.b }}"):
        with pytest.raises(jinja2.UndefinedError):
            environment.from_string(text).render(a="x")


@pytest.mark.parametrize(
    ("changes", "level", "what", "do"),
    [
        ({"outside_view_share": 0.25}, "warn", "25.0% of the measured pixels are outside the view",
         "widen the camera's field of view"),
        ({"hole_share": 0.5}, "bad", "50.0% of the measured pixels have no geometry",
         "close floor, walls"),
        ({"clamped_share": 0.5}, "warn", "50.0% of the pixels were held at the deepest truth",
         "the far end of the scene"),
        ({"worse_than_constant": True}, "bad", "a constant depth", "check the camera first"),
        ({"status": "inverted"}, "bad", "near and far are exchanged", "check the order"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_depth_has_its_level_and_what_to_do(changes, level, what, do):
    known = {"status": "ok", "hole_share": 0.0, "outside_view_share": 0.0, "clamped_share": 0.0,
             "worse_than_constant": False}  # fmt: skip
    assert depth_images.depth_advice(SimpleNamespace(**known)) == []  # type: ignore[arg-type]
    (advice,) = depth_images.depth_advice(SimpleNamespace(**known | changes))  # type: ignore[arg-type]
    assert advice.level == level
    assert advice.what.startswith(what)
    assert advice.do.startswith(do)


def test_a_difference_of_two_systems_is_signed_and_an_unknown_one_is_empty():
    interval = SimpleNamespace(ends=(-0.1, 0.3))
    ranked: Any = SimpleNamespace(
        differences={(0, 1): (0.2, interval), (0, 2): (math.nan, None)}, values=[0.5, 0.3, math.nan]
    )
    alone, other, unknown = systems._differences(ranked, 0)
    assert alone == ""
    assert (other.value, other.ends, other.signed) == (0.2, (-0.1, 0.3), True)
    assert (unknown.value, unknown.ends, unknown.signed) == (None, None, True)


def test_photos_that_a_side_failed_come_first_then_the_widest_apart():
    def row(*cells: tuple[str, float | None]) -> Any:
        return SimpleNamespace(cells=[SimpleNamespace(status=s, number=n) for s, n in cells])

    rows = [row(("ok", 0.5), ("ok", 0.25)), row(("ok", 0.5), ("failed", None)),
            row(("ok", 0.0), ("ok", 1.0)), row(("failed", None), ("failed", None))]  # fmt: skip
    assert [systems._apart(one) for one in rows] == [(True, -0.25), (False, 0.0), (True, -1.0),
                                                     (False, 0.0)]  # fmt: skip


@pytest.mark.parametrize(
    ("by", "covered"),
    [((0, 0), (slice(0, 4), slice(0, 5))), ((2, -1), (slice(2, 4), slice(0, 4))),
     ((-3, 4), (slice(0, 1), slice(4, 5)))],
)  # fmt: skip
def test_a_shifted_picture_covers_what_it_still_lies_on(by, covered):
    assert mended_pixels._overlap((4, 5), by) == covered
    picture = np.arange(20).reshape(4, 5)
    moved = np.full((4, 5), -1)
    moved[covered] = picture[mended_pixels._overlap((4, 5), (-by[0], -by[1]))]
    rows, cols = np.nonzero(moved >= 0)
    assert (moved[rows, cols] == picture[rows - by[0], cols - by[1]]).all()
