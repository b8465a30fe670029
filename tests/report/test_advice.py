"""What an author is told of one photo: the finding, and the step that mends it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from legoworld.records.base import to_record
from legoworld.records.coco_file import ShownPrediction, TrueAnnotation, TrueImage
from legoworld.records.detection import DetectionRow, Outcomes, PairSums
from legoworld.records.run_rows import RunRow, Unexported, Unmatched
from legoworld.report.advice import _alike, _edges, detection_advice
from legoworld.report.detection_images import DetectionImage, SideImage, _errors, _overlaps
from legoworld.visibility.view import UNSEEN_REASONS

CUP, TABLE, DINING_TABLE = 1, 2, 3
NAMES = {CUP: "cup", TABLE: "table", DINING_TABLE: "dining_table"}
SIZE = (100, 120)  # height, width

Box = tuple[int, int, int, int]


_NO_PAIRS = PairSums(n_gt=0, n_dt=0, iou_sum=0, n_matched=0, n_hits=0, n_quality=0, quality_sum=0)
ROW = DetectionRow(
    image_id=1, file_name="1.jpg", status="ok", scored=True, n_truth=0, n_ignored_truth=0,
    n_predictions=0, n_lost_to_cap=0, n_unverified=0, greedy_50=Outcomes(tp=0, fp=0, ignored=0),
    class_aware=_NO_PAIRS, class_agnostic=_NO_PAIRS,
)  # fmt: skip


def make_shape(task: str, box: Box) -> dict[str, Any]:
    """A box, or the mask that fills it."""
    x, y, w, h = box
    if task == "coco":
        return {"bbox": [x, y, w, h], "area": w * h}
    mask = np.zeros(SIZE, np.uint8, order="F")
    mask[y : y + h, x : x + w] = 1
    flat = mask.flatten(order="F")
    edges = np.flatnonzero(np.diff(flat, prepend=0, append=0)).tolist()
    counts = np.diff([0, *edges, len(flat)] if edges[-1] != len(flat) else [0, *edges]).tolist()
    return {
        "bbox": [x, y, w, h],
        "area": w * h,
        "segmentation": {"size": list(SIZE), "counts": counts},
    }


def advice(
    task: str,
    truths: list[tuple[Box, int]],
    predictions: list[tuple[Box, int, str]],
    *,
    scene: bool = True,
    run_row: RunRow | None = None,
) -> list[str]:
    """Each finding as "what => do"; predictions are (box, category, outcome at IoU 0.5)."""
    image = TrueImage(id=1, height=SIZE[0], width=SIZE[1])
    true = tuple(
        to_record(TrueAnnotation, {**make_shape(task, b), "image_id": 1, "category_id": c})
        for b, c in truths
    )
    entries = tuple(
        to_record(ShownPrediction, {**make_shape(task, b), **prediction(c, outcome)})
        for b, c, outcome in predictions
    )
    iou = _overlaps(task, image, true, entries)
    side = SideImage(
        row=ROW,
        run_row=run_row or RunRow(image_id=1, file_name="a.jpg", status="ok"),
        scene=None,
        entries=entries,
        places=tuple(range(len(entries))),
        iou=iou,
        errors=_errors(task, image, true, entries, iou),
    )
    found = detection_advice(
        task, DetectionImage(image=image, truths=true, sides=(side,)), side, NAMES, scene=scene
    )
    return [f"{a.what} => {a.do}" for a in found]


def prediction(category: int, outcome: str) -> dict[str, Any]:
    """All of a prediction but its shape."""
    return {"image_id": 1, "category_id": category, "score": 1.0, "outcome_50": outcome}


def test_a_missed_truth_that_an_uncounted_prediction_covers_is_built_already() -> None:
    table = (10, 20, 80, 60)
    (said,) = advice("lvis", [(table, TABLE)], [((10, 20, 80, 59), DINING_TABLE, "unverified")])
    assert said == (
        "missed: 1 x table; dining_table covers it (IoU 0.98), in a category that is not annotated "
        "in this image => it is built already: if it is a table, set lvis_category = table on it"
    )
    assert "build it" in advice("lvis", [(table, TABLE)], [])[0]
    far = advice("lvis", [(table, TABLE)], [((10, 20, 30, 59), DINING_TABLE, "unverified")])
    assert far[0].startswith("missed: 1 x table => build it")


@pytest.mark.parametrize(
    ("outcome", "why"),
    [
        ("ignored", ", which the evaluator ignores in this image"),
        ("over_cap", ", beyond the evaluator's cap"),
        ("unverified", ", in a category that is not annotated in this image"),
    ],
)
def test_why_what_covers_a_missed_truth_is_not_counted(outcome: str, why: str) -> None:
    box = (10, 20, 80, 60)
    (said,) = advice("coco", [(box, TABLE)], [(box, DINING_TABLE, outcome)])
    assert said.startswith(f"missed: 1 x table; dining_table covers it (IoU 1.00){why} => ")


def test_every_reason_for_no_pixel_has_what_helps() -> None:
    reasons = [*UNSEEN_REASONS.values(), "holdout", "not_rendered"]
    row = RunRow(
        image_id=1,
        file_name="a.jpg",
        status="ok",
        unexported=tuple(Unexported(name=r, category="cup", reason=r) for r in reasons),
    )
    nothing, *others = advice("coco", [], [], run_row=row)
    assert nothing.startswith("nothing was exported from this scene")
    said = dict(a.split(" => ") for a in others)
    assert list(said) == [f"{r} (cup) is labelled but has no pixel: {r}" for r in reasons]
    assert len({*said.values()} - {""}) == len(reasons)


@pytest.mark.parametrize(
    ("left", "right", "outcome"),
    [
        ((10, 10, 20, 30), (30, 10, 20, 30), "fp"),  # either half: IoU 0.5, not enough
        ((10, 10, 26, 30), (36, 10, 14, 30), "tp"),  # one part finds the truth alone
        ((10, 10, 12, 30), (22, 10, 2, 30), "fp"),  # one is under the background's IoU
    ],
)
@pytest.mark.parametrize("task", ["coco", "lvis"])
def test_two_labelled_parts_of_one_thing_are_one_finding(
    task: str, left: Box, right: Box, outcome: str
) -> None:
    truth = (10, 10, 41, 31) if outcome == "fp" and right[0] == 30 else (10, 10, 40, 30)
    if right[0] == 22:
        truth = (10, 10, 25, 30)
    said = advice(task, [(truth, CUP)], [(left, CUP, outcome), (right, CUP, "fp")])
    assert said[0].startswith("2 x cup are parts of one annotated cup: together they cover it")
    assert "label the whole once: the category on the parts' parent" in said[0]
    assert not any("move or resize" in s or "missed" in s for s in said)


def test_copies_of_the_whole_are_no_parts() -> None:
    whole = (10, 10, 40, 30)
    said = advice("coco", [(whole, CUP)], [(whole, CUP, "tp"), ((10, 10, 40, 29), CUP, "fp")])
    assert [s.partition(" (")[0] for s in said] == [
        "a second cup on an object that is detected already"
    ]


def test_two_things_beside_each_other_are_no_parts() -> None:
    said = advice(
        "coco",
        [((10, 10, 20, 30), CUP), ((60, 10, 20, 30), CUP)],
        [((10, 10, 20, 12), CUP, "fp"), ((60, 10, 20, 12), CUP, "fp")],
    )
    assert [s.partition(" (")[0] for s in said] == ["2 x cup overlaps its object too little"]
    assert said[0].endswith("move or resize it to the photo")


def test_a_lone_small_part_is_told_to_label_the_whole() -> None:
    (missed, part) = advice("coco", [((10, 10, 60, 60), CUP)], [((20, 20, 9, 9), CUP, "fp")])
    assert missed.startswith("missed: 1 x cup")
    assert part == (
        "cup is a small part of an annotated cup => label the whole object, not a part of it"
    )


def test_a_second_one_beside_a_found_truth_is_not_told_to_fit_it() -> None:
    truth = (10, 10, 40, 40)
    said = advice("coco", [(truth, CUP)], [(truth, CUP, "tp"), ((25, 25, 40, 40), CUP, "fp")])
    assert len(said) == 1
    assert "another one has that object already" in said[0]


def test_a_mask_whose_box_fits_is_told_to_model_its_outline() -> None:
    """A ring is predicted as its filled box would be: the box is right."""
    truth, frame = (10, 10, 40, 40), (10, 10, 40, 40)
    ring = make_shape("lvis", truth)
    mask = np.zeros(SIZE, np.uint8)
    mask[10:50, 10:50] = 1
    mask[14:46, 14:46] = 0
    edges = np.flatnonzero(np.diff(mask.flatten(order="F"), prepend=0)).tolist()
    ring["segmentation"]["counts"] = np.diff([0, *edges, mask.size]).tolist()
    image = TrueImage(id=1, height=SIZE[0], width=SIZE[1])
    true = (to_record(TrueAnnotation, {**ring, "image_id": 1, "category_id": CUP}),)
    entry = to_record(ShownPrediction, {**make_shape("lvis", frame), **prediction(CUP, "fp")})
    iou = _overlaps("lvis", image, true, (entry,))
    side = SideImage(
        row=ROW,
        run_row=RunRow(image_id=1, file_name="a.jpg", status="ok"),
        scene=None,
        entries=(entry,),
        places=(0,),
        iou=iou,
        errors=_errors("lvis", image, true, (entry,), iou),
    )
    view = DetectionImage(image=image, truths=true, sides=(side,))
    (said,) = detection_advice("lvis", view, side, NAMES, scene=True)
    assert said.do.startswith("its box fits, its mask does not")


def test_a_neighbour_is_not_what_a_prediction_stands_for() -> None:
    said = advice("coco", [((10, 10, 40, 40), TABLE)], [((30, 30, 40, 40), CUP, "fp")])
    assert any(
        s.startswith("cup where nothing is annotated; nearest: table (IoU 0.14)") for s in said
    )


def test_a_baseline_is_told_what_and_not_what_to_do() -> None:
    halves = [((10, 10, 20, 30), CUP, "fp"), ((30, 10, 20, 30), CUP, "fp")]
    (said,) = advice("coco", [((10, 10, 41, 31), CUP)], halves, scene=False)
    assert said.startswith("2 x cup are parts of one annotated cup")
    assert said.endswith("=> ")


@pytest.mark.parametrize(
    ("name", "alike"),
    [
        ("cellphone", True), ("Cell_Phone.003", True), ("cell-phones", True), ("my phone", True),
        ("cell", True), ("CellPhones 2", True), ("my cellphone", True), ("headphones", False),
        ("cupboard", False),
    ],
)  # fmt: skip
def test_names_are_alike_whatever_stands_between_their_words(name: str, alike: bool) -> None:
    assert _alike("cell phone", name) == alike
    assert not _alike("cup", "Cupboard")
    assert _alike("bat_(animal)", "Bats")


def test_a_label_outside_the_vocabulary_is_named_where_its_category_is_missed() -> None:
    row = RunRow(
        image_id=1,
        file_name="a.jpg",
        status="ok",
        unmatched=(Unmatched(label="Tables", count=1, nearest=("table",)),),
    )
    said = advice("lvis", [((10, 20, 80, 60), TABLE)], [], run_row=row)
    assert said[:2] == [
        "the label 'Tables' (1 x) is not in the vocabulary => nearest names: table",
        "missed: 1 x table => the label 'Tables' is not in the vocabulary: write 'table'",
    ]
    far = replace(row, unmatched=(Unmatched(label="plate", count=1, nearest=("airplane",)),))
    said = advice("lvis", [((10, 20, 80, 60), TABLE)], [], run_row=far)
    assert [text.startswith("the label 'plate'") for text in said].index(True) == len(said) - 1
    plain = advice("lvis", [((10, 20, 80, 60), TABLE)], [])[0]
    assert "`legoworld inspect` lists objects without category" in plain


@pytest.mark.parametrize(
    ("box", "said"),
    [
        ((8, 20, 30, 40), "left +2 px, top +0 px, right -2 px, bottom +0 px"),
        ((10, 17, 30, 40), "left +0 px, top +3 px, right +0 px, bottom -3 px"),
        ((10, 20, 34, 40), "left +0 px, top +0 px, right +4 px, bottom +0 px"),
        ((10, 20, 30, 45), "left +0 px, top +0 px, right +0 px, bottom +5 px"),
    ],
)
def test_an_edge_is_named_by_its_own_side(box, said):
    assert _edges(box, (10, 20, 30, 40)) == f"edges out (+) or in (-): {said}"


def test_another_label_is_advised_only_where_it_would_find_the_object() -> None:
    truth, wrong = ((10, 10, 40, 40), CUP), ((10, 10, 40, 38), TABLE, "fp")
    (found,) = advice("coco", [truth], [wrong])
    what = "table stands where the annotation is cup (IoU 0.95)"
    assert found == f"{what} => if it is one, set category = cup on it"
    taken = advice("coco", [truth], [((10, 10, 40, 40), CUP, "tp"), wrong])
    assert taken == [f"{what} => that object is detected already: remove it or its category"]


def nested_advice(own: int, part: int) -> list[str]:
    """A truth of 40 x 40; a prediction without its lower half, and one of that half."""
    return advice(
        "coco-masks",
        [((10, 10, 40, 40), CUP)],
        [((10, 10, 40, 24), own, "tp"), ((12, 34, 36, 16), part, "fp")],
    )


def test_parts_that_would_close_a_hole_are_told_with_what_they_gain() -> None:
    said = next(s for s in nested_advice(CUP, TABLE) if s.startswith("detected, but"))
    assert said == (
        "detected, but with an IoU below 0.75: cup 0.60 => count table in, if part of it: IoU 0.96 "
        "with it; a label cuts its object out of the one around it"
    ), "what is there already comes before a shape that is stretched"
    ring = advice(
        "coco-masks",
        [((10, 10, 40, 40), CUP)],
        [((10, 10, 40, 24), CUP, "tp"), ((10, 34, 40, 16), TABLE, "fp")],
    )
    assert any("count table in, if part of it: IoU 1.00 with it" in s for s in ring)
