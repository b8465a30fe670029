"""Single rules of the page at their edges, without a page."""

from __future__ import annotations

from collections import Counter
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from legoworld.comparison.provenance import NOT_RECORDED
from legoworld.evaluation.detection.matching.outcomes import FALSE_POSITIVE, TRUE_POSITIVE
from legoworld.records.coco_file import TrueAnnotation
from legoworld.records.detection import TieSpread
from legoworld.records.report_page import Advice
from legoworld.records.report_tables import CategoryCell, CategoryLine, FirstScreen
from legoworld.report import (
    costs,
    label_maps_page,
    mended_cases,
    reconstruction_advice,
    reconstruction_tables,
    relations_page,
    tie_picture,
)
from legoworld.report.advice import _words
from legoworld.report.detection_images import _is_ignored
from legoworld.report.error_kinds import _cover, image_errors
from legoworld.report.plots import DepthPixels, _mean_curve
from legoworld.report.reconstruction_pictures import error_steps
from legoworld.report.scene_files import _camera
from legoworld.report.tables import category_table, tasks_table

TRUTH = TrueAnnotation(image_id=1, category_id=1, bbox=(0, 0, 1, 1))


@pytest.mark.parametrize(
    ("task", "changes", "ignored"),
    [
        ("lvis", {"area": 0}, True), ("lvis", {"area": 0.5}, False), ("lvis", {}, True),
        ("lvis", {"area": 9, "ignore": 1}, True), ("lvis", {"area": 9, "iscrowd": 1}, False),
        ("coco", {"area": 0}, False), ("coco", {"iscrowd": 1}, True),
        ("coco", {"ignore": 1}, False),
    ],
)  # fmt: skip
def test_what_is_neither_found_nor_missed(
    task: str, changes: dict[str, Any], ignored: bool
) -> None:
    assert _is_ignored(task, replace(TRUTH, **changes)) is ignored


def errors(iou: list[list[float]], outcome: list[str], categories: list[int]) -> Any:
    return image_errors(
        outcome=outcome,
        category=np.array(categories),
        score=np.ones(len(outcome)),
        truth_category=np.ones(len(iou[0]), np.int64),
        ignored=np.zeros(len(iou[0]), bool),
        iou=np.array(iou),
    )


@pytest.mark.parametrize(
    ("iou", "category", "kind"),
    [(0.1, 2, "background"), (0.1001, 2, "both"), (0.0999, 1, "background"),
     (0.1, 1, "localisation"), (0.5, 2, "classification"), (0.4999, 2, "both")],
)  # fmt: skip
def test_a_kind_of_error_at_its_threshold(iou: float, category: int, kind: str) -> None:
    assert errors([[iou]], ["fp"], [category]).kind == (kind,)


def test_a_missed_truth_is_covered_by_what_is_not_counted_from_one_half_on() -> None:
    all_of_it = np.ones(2, bool)
    assert _cover(np.array([0.2, 0.5]), all_of_it) == 1
    assert _cover(np.array([0.2, 0.4999]), all_of_it) is None
    assert _cover(np.array([0.2, 0.9]), np.array([True, False])) is None
    assert _cover(np.zeros(0), np.zeros(0, bool)) is None
    # A false positive is counted: of two truths that it covers one is reached, the other missed.
    found = errors([[0.9, 0.8]], ["fp"], [2])
    assert (found.truth, found.cover) == (("reached", "missed"), (None, None))
    assert errors([[0.9, 0.8]], ["over_cap"], [1]).cover == (0, 0)


@pytest.mark.parametrize(
    ("name", "words"),
    [("Cups.001", ["cup"]), ("bus", ["bus"]), ("gas_Stoves (old)", ["gas", "stove"]), ("S", ["s"])],
)
def test_the_words_of_a_name(name: str, words: list[str]) -> None:
    assert _words(name) == words


def test_the_picture_of_ties_spans_its_bounds_and_its_ap() -> None:
    known = TieSpread(worst=0.2, best=0.6, expected=0.3, sd=0.15)
    drawing = tie_picture._draw_ties(np.array([0.2, 0.3, 0.3, 0.6]), 0.7, known)
    left, right = 30, tie_picture.WIDTH - 30
    assert drawing.x == {
        "worst": left, "best": left + (right - left) * 0.8, "ap": right,
        "expected": left + (right - left) * 0.2,
    }  # fmt: skip
    assert drawing.spread == (left, left + round((right - left) * 0.5, 2))
    (first, second, _), width = drawing.bars, (right - left) / 40
    assert (first.x, first.w) == (left + 0.5, round(width - 1, 2))
    assert (first.h, second.h) == (round(second.h / 2, 2), drawing.base - drawing.top)
    assert first.y + first.h == second.y + second.h == drawing.base
    assert first.text == "1 of 4 orders: 0.2000 to 0.2125"
    narrow = TieSpread(worst=0.2, best=0.6, expected=0.3, sd=0.02)
    inner = tie_picture._draw_ties(np.array([0.3]), 0.3, narrow)
    assert inner.spread == (left + (right - left) * 0.2, left + (right - left) * 0.3)


def test_shuffled_orders_keep_the_more_confident_first() -> None:
    """Two of three tie, one of them right; the third is less confident and right."""
    states = np.array([FALSE_POSITIVE, TRUE_POSITIVE, TRUE_POSITIVE], np.uint8)
    table: Any = SimpleNamespace(score=np.array([0.9, 0.9, 0.1]))
    curves = [
        _mean_curve(states, [(slice(0, 3), 2)], table, np.random.default_rng(seed))
        for seed in range(20)
    ]
    ends = {(round(float(c[0]), 4), round(float(c[-1]), 4)) for c in curves}
    assert ends == {(1.0, 0.6667), (0.6667, 0.6667)}


def test_depth_errors_are_in_bins_from_the_nearest_to_the_farthest_truth() -> None:
    pixels = DepthPixels()
    assert pixels.plot("a") is None
    pixels.truth_z_m.append(np.array([1.0, 1.0, 16.0]))
    pixels.error.append(np.array([0.1, 0.3, 0.5]))
    plot = pixels.plot("a")
    assert plot is not None
    assert (plot.edges_m[0], plot.edges_m[-1]) == pytest.approx((1.0, 16.0))


CELL = CategoryCell(ap=0.5, ap50=0.6, miou=0.7, n=8, tp=3, fp=5)


def test_a_category_s_row_has_a_cell_for_each_column() -> None:
    lines = [
        CategoryLine(id=4, name="cup", frequency=None, n_truth=9, n_images=2, cells=(CELL, None)),
        CategoryLine(id=5, name="bus", frequency="r", n_truth=1, n_images=1, cells=(None, CELL)),
    ]
    sides: Any = [SimpleNamespace(name="one"), SimpleNamespace(name="two")]
    found = category_table("coco", sides, lines)
    assert [(c.name, c.key, c.group) for c in found.columns if isinstance(c, object)] == [
        ("category", "name", ""), ("freq.", "freq", ""), ("objects", "truth", ""),
        ("images", "images", ""),
        *((name, f"{key}{k}", side) for k, side in enumerate(("one", "two")) for name, key in (
            ("AP", "ap"), ("AP50", "ap50"), ("mIoU", "miou"), ("predictions", "n"),
            ("TP", "tp"), ("FP", "fp"),
        )),
    ]  # fmt: skip
    first, second = found.rows
    assert (first[0].text, first[0].link) == ("cup", "#/coco?tab=photos&cat=4")
    assert first[1:4] == ("-", 9, 2)
    assert [cell.value for cell in first[4:7]] == [0.5, 0.6, 0.7]
    assert (first[7], first[8].n, first[8].of, first[9]) == (8, 3, 9, 5)
    assert first[10:] == second[4:10] == ("-", "-", "-", 0, 0, 0)
    assert found.notes[0].startswith("AP over IoU 0.50 to 0.95; TP and FP at IoU 0.5")
    assert "freq." not in {c.name for c in category_table("coco", sides, lines[:1]).columns}


@pytest.mark.parametrize(
    ("low", "high", "ends"),
    [(0.1, 0.9, (0.1, 0.9)), (None, 0.9, None), (0.1, None, None), (None, None, None)],
)
def test_each_task_s_first_number_stands_with_its_interval(
    low: float | None, high: float | None, ends: tuple[float, float] | None
) -> None:
    span = SimpleNamespace(value=0.5, low=low, high=high, over="12 images")
    section: Any = SimpleNamespace(
        title="COCO", key="coco-2", attempted=5, sides=[SimpleNamespace(label="one", scored=4)],
        evaluators=[SimpleNamespace(name="pycocotools", version="2")],
        first=SimpleNamespace(forest=[SimpleNamespace(name="AP", sides=[span])]),
    )  # fmt: skip
    ((task, side, metric, number, scored, evaluator),) = tasks_table([section]).rows
    assert (task.text, task.link, side, metric) == ("COCO", "#/coco-2", "one", "AP")
    assert (number.value, number.ends, number.digits) == (0.5, ends, 3)
    assert (number.below, evaluator) == ("12 images", "pycocotools 2")
    assert (scored.n, scored.of) == (4, 5)
    section.first.forest, section.attempted = [], None
    ((_, _, metric, number, scored, _),) = tasks_table([section]).rows
    assert (metric, number.value, number.ends, number.below, scored.of) == ("-", None, None, "", 0)


def row(image_id: int, *scores: tuple[str, float], valid: bool = True) -> Any:
    objects = [SimpleNamespace(category=name, f1=f1, eligible=True) for name, f1 in scores]
    return SimpleNamespace(image_id=image_id, valid=valid, objects=objects)


def test_an_object_that_loses_nothing_is_not_among_the_losses() -> None:
    rows = [row(1, ("cup", 1.0), ("bus", 0.5)), row(2, ("bus", 0.0)), row(3, valid=False)]
    losses = [loss for one in rows for loss in mended_cases.surface_losses(one)]
    assert losses == [(1, "bus", 0.25), (2, "bus", 1.0)]


@pytest.mark.parametrize(
    ("n", "comparison", "said"), [(2, None, True), (1, None, False), (2, "there is one", False)]
)
def test_who_leads_is_said_of_several_without_a_comparison(
    n: int, comparison: str | None, said: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reconstruction_tables, "_leads", lambda board: f"{board} leads")
    first = FirstScreen(verdicts=(), costs=(), coverage=(), forest=())
    monkeypatch.setattr(reconstruction_tables, "first_screen", lambda *_: first)
    section: Any = SimpleNamespace(sides=[0] * n, comparison=comparison)
    board: Any = "the board"
    found = reconstruction_tables.bench_first_screen(section, board, ())
    assert [v.sentence for v in found.verdicts] == (["the board leads"] if said else [])


def test_the_camera_of_a_page_is_the_upper_three_rows() -> None:
    rows = [[float(4 * i + j) for j in range(4)] for i in range(4)]
    scene: Any = SimpleNamespace(
        camera=SimpleNamespace(world_from_camera=rows, type="PERSP"),
        projection=SimpleNamespace(fx=1, fy=2, cx=3, cy=4, orthographic=False),
    )
    found = _camera(scene, SimpleNamespace(rendered_wh=(8, 6)))  # type: ignore[arg-type]
    assert found is not None
    assert found.world_from_cam == tuple(map(tuple, rows[:3]))
    assert (found.fx, found.fy, found.cx, found.cy, found.size_wh) == (1, 2, 3, 4, (8, 6))
    assert _camera(scene, SimpleNamespace(rendered_wh=None)) is None  # type: ignore[arg-type]


def test_the_objects_that_lose_most_come_first() -> None:
    def scored(name: str, f1: float, *, eligible: bool = True) -> Any:
        return SimpleNamespace(name=name, f1=f1, eligible=eligible, precision=f1, recall=f1,
                               at={}, n_submitted=9, n_reference=9)  # fmt: skip

    objects = [scored("a", 0.6), scored("b", 0.2), scored("c", 0.6), scored("d", 0.99),
               scored("e", 0.0, eligible=False)]  # fmt: skip
    row_of: Any = SimpleNamespace(objects=objects)
    said = [advice.what.partition(":")[0] for advice in reconstruction_advice._objects(row_of)]
    assert said == ["b", "a", "c"]


def test_flags_are_a_table_to_the_third_digit() -> None:
    flag = SimpleNamespace(file_name="a.png", image_id=4, kind="photo_copied", what="a texture",
                           measured=0.98765, threshold=0.9)  # fmt: skip
    side = SimpleNamespace(name="one", reconstruction=SimpleNamespace(flags=[flag]))
    section: Any = SimpleNamespace(key="bench", sides=[side])
    (found,) = reconstruction_tables.flag_tables(section)
    ((case, of, kind, what, measured, threshold),) = found.rows
    assert (case.text, case.link, of) == ("a.png", "#/bench/4", "one")
    assert (kind, what, threshold) == ("photo copied", "a texture", "0.9")
    assert (measured.value, measured.digits) == (0.98765, 3)
    assert (found.title, found.folded) == ("1 integrity flag", True)
    side.reconstruction.flags = []
    assert reconstruction_tables.flag_tables(section) == []


@pytest.mark.parametrize("failed", [False, True])
@pytest.mark.parametrize("page", [relations_page, label_maps_page])
def test_an_answer_s_warnings_and_wrong_answers_are_advice(
    page: Any, failed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    why = [Advice(level="bad", what="no output")] if failed else []
    for name, value in {
        "failure_advice": lambda _row: [*why], "run_facts": lambda *_: (("a", "b"),),
        "run_tables": lambda _row: ("table",),
    }.items():  # fmt: skip
        monkeypatch.setattr(page, name, value)
    run_row = SimpleNamespace(warnings=("odd", "late"))
    side: Any = SimpleNamespace(
        label="x", name="one", is_scene=True, run_rows={3: run_row}, source=lambda n: f"source {n}"
    )
    document = SimpleNamespace(scenes=SimpleNamespace(page_scene=lambda *words: words))
    row: Any = SimpleNamespace(image_id=3, status="ok", has_score=True)
    if page is relations_page:
        asked = [SimpleNamespace(score=s, text=f"q{k}?", answer="yes", truth="no")
                 for k, s in enumerate([1.0, 0.0, None, 0.5])]  # fmt: skip
        found = page._answer(side, row, asked, document)
        bad = ["q1? yes, truly no", "q3? yes, truly no"]
    else:
        monkeypatch.setattr(page, "_values", lambda *_: {"PQ": None, "SQ": 0.5})
        asked = SimpleNamespace(document=document, family=None)
        found, bad = page._answer(asked, side, row), []
        assert found.facts[1:] == (("PQ", "-"), ("SQ", "0.5000"))
    expected = [*(["no output"] if failed else bad), "late", "odd"]
    assert [(a.level, a.what) for a in found.advice] == [
        ("warn" if what in ("odd", "late") else "bad", what) for what in expected
    ]
    assert (found.label, found.status, found.facts[0]) == ("one", "ok", ("a", "b"))
    assert (found.tables, found.scene) == (("table",), ("source 3", run_row))
    side.is_scene = False
    again = page._answer(*((side, row, asked, document) if page is relations_page else
                           (asked, side, row)))  # fmt: skip
    assert again.scene is None


@pytest.mark.parametrize(
    ("delta", "texts"),
    [
        (30, ["0 to 30: counts for A", "31 to 60", "61 to 120", "121 to 255"]),
        (59, ["0 to 59: counts for A", "60 to 60", "61 to 120", "121 to 255"]),
        (60, ["0 to 60: counts for A", "61 to 120", "121 to 255"]),
        (255, ["0 to 255: counts for A"]),
    ],
)
def test_the_steps_of_a_s_picture(delta: int, texts: list[str]) -> None:
    assert [step.text for step in error_steps(delta)] == texts


GAIN = {("missed", 1): 0.02, ("background", 2): 0.05, ("both", 1): 0.02, ("duplicate", 2): 0.0004,
        ("classification", 2): 0.03}  # fmt: skip


@pytest.mark.parametrize(
    ("other", "kinds"),
    [
        (None, ["background", "classification", "both", "missed"]),
        ({("background", 2): 0.05, ("missed", 1): 0.0, ("both", 1): 0.015},
         ["classification", "missed", "both"]),
    ],
)  # fmt: skip
def test_what_costs_most_comes_first_and_of_two_sides_what_tells_them_apart(
    other: Any, kinds: list[str]
) -> None:
    def findings(gain: Any) -> Any:
        return {
            key: costs.Finding(text=str(key), gain=one, images=[4, 4, 7], category=key[1])
            for key, one in gain.items()
        }

    side: Any = SimpleNamespace(by_error=findings(GAIN), least=0.0005, sign=1)
    made = costs._costs(side, None if other is None else findings(other), 0)
    assert [cost.kind for cost in made] == kinds
    for cost in made:
        key = next(key for key in GAIN if str(key) == cost.text)
        assert (cost.gain, cost.n, cost.images) == (GAIN[key], 3, 2)
        assert cost.others == (None if other is None else other.get(key, 0.0))
        assert cost.link == f"?tab=photos&cat={key[1]}&of=0"


def make_repeated(mean: float | None, ends: tuple[float, float] | None = None) -> Any:
    interval = None if ends is None else SimpleNamespace(ends=ends)
    return SimpleNamespace(mean=mean, sd=0.01, interval=interval, n=(6,))


@pytest.mark.parametrize(
    ("s", "several", "said"),
    [
        (make_repeated(0.5, (0.25, 0.75)), True,
         "Highest S of 2: codex, 0.500 [0.250, 0.750] over 6 cases, 1 run."),
        (make_repeated(0.5), False, "codex: S 0.500 over 6 cases, mean of 1 run."),
        (make_repeated(None), False, "codex: R 0.125 over 6 cases, mean of 1 run."),
    ],
)  # fmt: skip
def test_who_leads(s: Any, several: bool, said: str) -> None:
    def board_row(agent: str, s: Any) -> Any:
        group = SimpleNamespace(cases=6, metrics={"S": s, "R": make_repeated(0.125)})
        return SimpleNamespace(agent=agent, model=NOT_RECORDED, evaluations=("e",),
                               groups=[group, None])  # fmt: skip

    rows = [board_row("codex", s), *[board_row("other", make_repeated(0.9))] * several]
    board: Any = SimpleNamespace(rows=rows)
    assert reconstruction_tables._leads(board) == said


def test_a_mean_of_runs_has_its_interval_and_its_deviation_below() -> None:
    alone = reconstruction_tables._mean_of_runs(make_repeated(0.5))
    assert (alone.value, alone.sd, alone.digits, alone.ends, alone.below) == (
        0.5, 0.01, 3, None, "",
    )  # fmt: skip
    both = reconstruction_tables._mean_of_runs(make_repeated(0.5, (0.25, 0.75)))
    assert (both.ends, both.digits, both.below) == ((0.25, 0.75), 3, alone.interval_text)


@pytest.mark.parametrize("failed", [False, True])
@pytest.mark.parametrize("page", ["PANOPTIC", "SEMANTIC"])
def test_label_maps_without_any_segment_have_no_number(page: str, failed: bool) -> None:
    family, mends = getattr(label_maps_page, page).fill.args
    rows = [
        SimpleNamespace(image_id=i, has_score=not failed or i == 1, counts={}, matched=())
        for i in (1, 2)
    ]
    side: Any = SimpleNamespace(
        rows=rows, summary=SimpleNamespace(categories=()), name="x", is_scene=True
    )
    findings = label_maps_page._findings(family, mends, side, Counter())
    assert (findings.value, findings.value_answered, findings.by_error) == (None, None, {})
    (shown,) = costs.side_costs([findings])
    assert shown.most == ()
