"""What a page says of one bench case and of one label, at the edges of each rule."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from legoworld.records.base import UNSET
from legoworld.records.reconstruction import COMPARED
from legoworld.records.report_page import Advice
from legoworld.report import advice, reconstruction_advice
from legoworld.report.advice import failure_advice, sorted_advice
from legoworld.report.reconstruction_advice import bench_advice, bench_facts, check_lines


def item(name: str, f1: float, *, eligible: bool = True, n: int = 5, farther: Any = None) -> Any:
    at = {} if farther is None else {"F10": SimpleNamespace(f1=farther)}
    return SimpleNamespace(name=name, f1=f1, eligible=eligible, n_submitted=n, at=at,
                           precision=0.25, recall=0.756)  # fmt: skip


def texts(found: tuple[Advice, ...] | list[Advice]) -> list[tuple[str, str, str]]:
    return [(one.level, one.what, one.do) for one in found]


def test_objects_are_told_below_nine_tenths_the_worst_first():
    row: Any = SimpleNamespace(objects=[
        item("a", 0.9), item("b", math.nextafter(0.9, 0)), item("c", 0.5), item("d", 0.51),
        item("e", 0.0, n=0), item("f", 0.1, eligible=False), item("g", 0.5),
    ])  # fmt: skip
    shares = "(precision 0.25, recall 0.76)"
    found = reconstruction_advice._objects(row)
    assert texts(found) == [
        ("bad", "e: nothing stands where it is seen", "build it, or move it there"),
        ("bad", f"c: F 0.50 {shares}", ""), ("bad", f"g: F 0.50 {shares}", ""),
        ("warn", f"d: F 0.51 {shares}", ""), ("warn", f"b: F 0.90 {shares}", ""),
    ]  # fmt: skip
    assert [one.truths for one in found] == [(4,), (2,), (6,), (3,), (1,)]


@pytest.mark.parametrize(("farther", "near"), [(0.5, False), (0.51, True), (None, False)])
def test_an_object_that_is_near_is_told_to_be_moved_by_a_little(farther, near):
    (one,) = reconstruction_advice._objects(
        SimpleNamespace(objects=[item("a", 0.25, farther=farther)])  # type: ignore[arg-type]
    )
    assert one.do == ("near: F 0.51 at 10 % of its depth; move it by a little" if near else "")


@pytest.mark.parametrize(
    ("fov", "text"), [(0.5, None), (-0.5, None), (None, None), (0.51, "+0.5"), (-7.26, "-7.3")]
)
def test_a_field_of_view_is_off_beyond_half_a_degree(fov, text):
    camera: Any = SimpleNamespace(fov_deg=fov)
    found = reconstruction_advice._camera(camera)
    assert reconstruction_advice._camera(None) == []
    assert [one.what for one in found] == (
        [f"its field of view is off by {text} degrees"] if text else []
    )
    assert all(one.level == "warn" and "hfov_deg" in one.do for one in found)


def case(r: float | None, posed: float | None, rigid: float | None, scaled: float | None) -> Any:
    camera = SimpleNamespace(
        world_rotation_deg=12.34, world_translation_m=0.567,
        registration=SimpleNamespace(rotation_deg=5.67, translation_m=0.891),
    )  # fmt: skip
    row: Any = SimpleNamespace(
        R=r, camera=camera, diagnostics=SimpleNamespace(R_rigid=rigid, R_median_scale=scaled)
    )
    return reconstruction_advice._alignment_advice(row, posed)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ((0.0, 0.01, 0.0, None), None), ((None, 0.9, 0.9, 0.9), None),
        ((0.5, 0.75, 0.6, 0.7), "R 0.500 would be 0.750 with the surfaces seen from the reference "
         "camera's pose, 12.3 degrees and 0.57 m from its own"),
        ((0.5, None, 0.6, 0.7), "R 0.500 would be 0.700 with the surfaces scaled to the "
         "reference's median depth"),
        ((0.5, 0.52, 0.625, None), "R 0.500 would be 0.625 with the surfaces moved by 5.7 degrees "
         "and 0.89 m"),
    ],
)  # fmt: skip
def test_the_best_of_what_was_tried_is_told_from_a_hundredth_on(given, words):
    found = case(*given)
    assert [one.what for one in found] == ([words] if words else [])
    assert all(one.level == "warn" and one.do for one in found)


def check(ok: bool, **more: Any) -> Any:
    return SimpleNamespace(**{"ok": ok, "found": None, "expected": None, "next_step": None} | more)


def test_checks_are_in_v_s_order_and_each_that_fails_is_bad():
    names = reconstruction_advice._CHECKS
    failed = check(False, found="f", expected="e", next_step="n")
    row: Any = SimpleNamespace(
        validity={names[1]: failed, names[0]: check(True)}, status=COMPARED, reason=None,
        camera=None, R=None, diagnostics=None, objects=(), flags=(), warnings=("late", "early"),
    )  # fmt: skip
    lines = check_lines(row)
    assert [line.name for line in lines] == [name.replace("_", ".") for name in names[:2]]
    assert [(line.ok, line.found, line.expected, line.next_step) for line in lines] == [
        (True, "", "", ""), (False, "f", "e", "n"),
    ]  # fmt: skip
    run_row: Any = SimpleNamespace(status="ok", warnings=("early", "own"))
    bad = ("bad", f"not valid, {names[1].replace('_', '.')}: f; expected e", "n")
    warned = [("warn", text, "") for text in ("early", "late", "own")]
    assert texts(bench_advice(row, run_row)) == [bad, *warned]
    row.status, row.reason = "missing", "nothing came"
    not_scored = ("bad", "not scored (missing): nothing came", "")
    assert texts(bench_advice(row, run_row)) == [not_scored, bad, *warned]
    run_row.status, run_row.reason = "failed", "it broke; next: mend it"
    failure = ("bad", "no output (failed): it broke", "mend it")
    assert texts(bench_advice(row, run_row)) == [failure, bad, *warned]
    row.validity = None
    assert check_lines(row) == ()


def test_a_failure_without_a_reason_says_so():
    row: Any = SimpleNamespace(status="failed", reason=None)
    assert texts(failure_advice(row)) == [
        ("bad", "no output (failed): the run gives no reason", "")
    ]


def test_the_facts_of_a_case_are_its_scores_its_cameras_and_its_files():
    seen = SimpleNamespace(
        n_hits=1234, n_px=5678, where_geometry_agrees=0.5, n_geometry_agrees_px=2000,
        where_geometry_differs=None, n_geometry_differs_px=3000,
        curve={"20": 0.25, "5": 0.125},
        noise=SimpleNamespace(reference_mean=0.9, reference_sd=0.01),
    )  # fmt: skip
    registration = SimpleNamespace(rotation_deg=1.234, translation_m=0.5, trimmed_rms_m=0.0625)
    row: Any = SimpleNamespace(
        status=COMPARED, valid=True, R=0.5, A=None, S=0.25, R_at={"R5": 0.75}, appearance=seen,
        diagnostics=None,
        camera=SimpleNamespace(fov_deg=-0.1234, world_rotation_deg=2.0, world_translation_m=3.0,
                               registration=registration),
    )  # fmt: skip
    own = SimpleNamespace(hfov_deg=50.123, clip_start_m=0.1, clip_end_m=1000.0)
    run_row: Any = SimpleNamespace(
        surface=SimpleNamespace(bytes=1234, sha256="ab"), render=UNSET, camera=own,
        integrity=SimpleNamespace(images=[1, 2], drivers=3, texts=[1]),
    )  # fmt: skip
    assert bench_facts(row, run_row) == [
        ("status", COMPARED), ("V", "1"), ("R", "0.5000"), ("A", "-"), ("S", "0.2500"),
        ("R5", "0.7500"), ("pixels of A", "1,234 of 5,678 within the tolerance"),
        ("A where geometry agrees", "0.5000 over 2,000 px"),
        ("A where it differs", "- over 3,000 px"), ("A by delta", "5: 0.125, 20: 0.250"),
        ("A of the reference itself", "0.9000, sd 0.0100 between seeds"),
        ("field of view, error", "-0.123 degrees"),
        ("camera, in each one's world", "2.00 degrees, 3.000 m"),
        ("surfaces, best rigid fit", "1.23 degrees, 0.500 m, rms 0.062 m"),
        ("submitted camera", "50.12 degrees wide, clip 0.1 to 1000 m"),
        ("surface, 1,234 bytes", "sha256 ab"),
        ("in the scene", "2 image textures, 3 drivers, 1 texts"),
    ]  # fmt: skip
    own.hfov_deg, seen.noise.reference_sd = None, None
    facts = dict(bench_facts(row, run_row))
    assert facts["submitted camera"] == "orthographic, clip 0.1 to 1000 m"
    assert facts["A of the reference itself"] == "0.9000 between seeds"


def test_advice_is_in_the_order_of_its_levels_and_stable():
    made = [Advice(level=level, what=str(k)) for k, level in  # type: ignore[arg-type]
            enumerate(("note", "warn", "bad", "note", "bad", "warn"))]  # fmt: skip
    assert [one.what for one in sorted_advice(made)] == ["2", "4", "1", "5", "0", "3"]


def test_labels_outside_the_vocabulary_cost_where_a_name_is_alike():
    def unmatched(label: str, *nearest: str) -> Any:
        return SimpleNamespace(label=label, count=2, nearest=nearest)

    row: Any = SimpleNamespace(
        unmatched=[unmatched("Chairs", "chair", "bench"), unmatched("gizmo", "clock"),
                   unmatched("x")]
    )  # fmt: skip
    assert texts(advice._unknown_labels(row)) == [
        ("bad", "the label 'Chairs' (2 x) is not in the vocabulary",
         "nearest names: chair, bench"),
        ("warn", "the label 'gizmo' (2 x) is not in the vocabulary", "nearest names: clock"),
        ("warn", "the label 'x' (2 x) is not in the vocabulary", ""),
    ]  # fmt: skip
    assert advice._unknown_labels(SimpleNamespace(unmatched=None)) == []  # type: ignore[arg-type]


def test_what_is_labelled_and_not_seen_and_what_is_nested():
    unexported = [SimpleNamespace(name="cup", category="cup", reason=r) for r in ("hidden", "?")]
    row: Any = SimpleNamespace(
        unexported=unexported, nested=SimpleNamespace(instances=1, px=7)
    )  # fmt: skip
    assert texts(advice._labels(row)) == [
        ("warn", "cup (cup) is labelled but has no pixel: hidden",
         "other surfaces cover it: move what stands in front"),
        ("warn", "cup (cup) is labelled but has no pixel: ?", ""),
        ("note", "1 instance is nested in another: 7 px are cut out of the outer one", ""),
    ]  # fmt: skip
    row.unexported, row.nested = None, SimpleNamespace(instances=0, px=0)
    assert advice._labels(row) == []


def test_predictions_that_do_not_count_are_told_by_their_number():
    side: Any = SimpleNamespace(row=SimpleNamespace(n_unverified=1, n_lost_to_cap=2))
    assert texts(advice._advise_uncounted(side)) == [
        ("note", "1 prediction is of categories that are not annotated in this image: LVIS does "
         "not count them", ""),
        ("warn", "2 predictions are beyond the evaluator's cap", "export fewer objects"),
    ]  # fmt: skip
    side.row = SimpleNamespace(n_unverified=0, n_lost_to_cap=0)
    assert advice._advise_uncounted(side) == []
