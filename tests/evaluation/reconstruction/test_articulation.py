"""The articulation pilot: hand-computed counts, what makes a joint correct, and its card."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from evaluation.reconstruction.datasets import (
    Submission,
    evaluate_bench,
    scene,
    small_raster,
    write_dataset,
    write_run,
)
from msgspec.structs import replace

from legoworld.evaluation.reconstruction.articulation import (
    Present,
    _iou,
    articulation_rules,
    articulation_score,
    count_joints,
    match_joints,
    none_found,
)
from legoworld.evaluation.reconstruction.joints import _present
from legoworld.evaluation.reconstruction.points import points_m
from legoworld.records.base import UNSET, as_json, decode, decode_lines, readable, to_record
from legoworld.records.bench_dataset import BenchTruthFile, ReferenceJoint
from legoworld.records.joints import SceneJoint
from legoworld.records.reconstruction import ReconstructionRow
from legoworld.records.submission import BenchRow

RULES = articulation_rules()
ALL = Present(object=1.0, part=1.0)
NAMES = {1: "Cupboard", 2: "Desk"}
#: A door 2 m away, hinged on its left side.
DOOR = ReferenceJoint(
    part="Door", source="property", type="revolute", axis_cam=(0.0, 1.0, 0.0),
    origin_cam_m=(0.0, 0.0, 2.0), lower=0.0, upper=1.5,
    box_cam_m=((0.0, -0.5, 1.9), (0.5, 0.5, 2.1)), object_id=1,
)  # fmt: skip
DRAWER = replace(
    DOOR, part="Drawer", type="prismatic", axis_cam=(0.0, 0.0, -1.0),
    box_cam_m=((2.0, 0.0, 3.0), (3.0, 0.4, 4.0)), origin_cam_m=(2.5, 0.2, 3.0), object_id=2,
)  # fmt: skip


def submitted(joint: ReferenceJoint, **changes: object) -> SceneJoint:
    values = {k: v for k, v in as_json(joint).items() if k != "object_id"}
    return to_record(SceneJoint, {**values, **changes})


def outcome(joint: ReferenceJoint, *answers: SceneJoint, present: Present = ALL) -> str:
    return count_joints([joint], NAMES, answers, [present], RULES).joints[0].outcome


def turned(degrees: float) -> tuple[float, float, float]:
    return math.sin(math.radians(degrees)), math.cos(math.radians(degrees)), 0.0


@pytest.mark.parametrize(
    ("counts", "score"),
    [
        ((1, 0, 0, 0, 0, 0), 1.0),
        ((0, 1, 0, 0, 0, 0), 0.0),
        ((3, 1, 1, 1, 2, 1), 6 / 13),  # 6 + 1 + 1 + 2 + 2 + 1
        ((1, 1, 0, 0, 0, 0), 2 / 4),  # a wrong joint is one that lacks and one too many
        ((1, 0, 0, 0, 1, 1), 2 / 4),
        ((1, 0, 0, 1, 0, 0), 2 / 3),
        ((1, 0, 1, 0, 0, 0), 2 / 3),
        ((0, 0, 0, 0, 0, 3), 0.0),
        ((0, 0, 0, 0, 0, 0), None),
    ],
)
def test_the_formula(counts, score):
    assert articulation_score(**dict(zip("CWPOJE", counts, strict=True))) == score
    c, w, p, o, j, e = counts
    if c:  # F1 of joints: c right of c + w + e submitted and of c + w + p + o + j there are
        precision, recall = c / (c + w + e), c / (c + w + p + o + j)
        assert score == pytest.approx(2 * precision * recall / (precision + recall))


@pytest.mark.parametrize(
    ("joint", "change", "expected"),
    [
        (DOOR, {}, "correct"),
        (DOOR, {"part": "Another name", "source": "x.urdf"}, "correct"),
        (DOOR, {"axis_cam": (0.0, -1.0, 0.0)}, "correct"),
        (DOOR, {"lower": -3.0, "upper": None}, "correct"),
        (DOOR, {"type": "continuous"}, "correct"),
        (DOOR, {"type": "prismatic"}, "wrong"),
        (DOOR, {"axis_cam": turned(9.9), "origin_cam_m": (0.0, 0.0, 2.0)}, "correct"),
        (DOOR, {"axis_cam": turned(10.1), "origin_cam_m": (0.0, 0.0, 2.0)}, "wrong"),
        (DOOR, {"origin_cam_m": (0.0, 7.0, 2.0)}, "correct"),  # another point of the same line
        (
            replace(DOOR, origin_cam_m=(0.0, 5.0, 2.0)),
            {"axis_cam": turned(9.9), "origin_cam_m": (0.0, 0.0, 2.0)},
            "correct",
        ),  # met at the part
        (DOOR, {"origin_cam_m": (0.099, 0.0, 2.0)}, "correct"),  # 5 % of 2 m
        (DOOR, {"origin_cam_m": (0.101, 0.0, 2.0)}, "wrong"),
        (DOOR, {"origin_cam_m": (0.5, 0.0, 2.0)}, "wrong"),  # hinged on the other side
        (DRAWER, {}, "correct"),
        (DRAWER, {"origin_cam_m": (9.0, 9.0, 9.0)}, "correct"),  # it slides: no place of an axis
        (DRAWER, {"axis_cam": (1.0, 0.0, 0.0)}, "wrong"),
        (DRAWER, {"type": "revolute"}, "wrong"),
    ],
)
def test_what_makes_a_joint_correct(joint, change, expected):
    assert outcome(joint, submitted(joint, **change)) == expected


def test_parts_correspond_from_an_iou_of_a_quarter():
    """Padded by 1 % of 2 m the door is 0.54 wide: aside by d the IoU is (.54 - d) / (.54 + d)."""
    for aside, expected in ((0.323, "correct"), (0.325, "joint_missing")):
        assert DOOR.box_cam_m
        box = tuple((x + aside, y, z) for x, y, z in DOOR.box_cam_m)
        assert outcome(DOOR, submitted(DOOR, box_cam_m=box)) == expected
        pairs = match_joints([DOOR], [submitted(DOOR, box_cam_m=box)], RULES)
        if pairs:
            assert pairs[0][1] == pytest.approx((0.54 - aside) / (0.54 + aside))
    assert outcome(DOOR, submitted(DOOR, box_cam_m=None)) == "joint_missing"


@pytest.mark.parametrize(
    ("present", "expected"),
    [
        (Present(object=0.49, part=1.0), "object_missing"),
        (Present(object=None, part=None), "object_missing"),
        (Present(object=0.5, part=0.49), "part_missing"),
        (Present(object=0.5, part=0.5), "joint_missing"),
        (Present(object=0.9, part=None), "joint_missing"),  # a part that no reference point shows
    ],
)
def test_a_joint_that_is_not_there_is_told_by_what_is(present, expected):
    assert outcome(DOOR, present=present) == expected


def test_counts_of_a_case():
    scenery = replace(DOOR, part="Gate", object_id=None, box_cam_m=((8, 0, 8), (9, 1, 9)))
    lid = replace(DRAWER, part="Lid", box_cam_m=((-3, 0, 3), (-2, 1, 4)))
    answers = [
        submitted(scenery), submitted(DOOR), submitted(DRAWER, type="revolute"),
        submitted(DOOR, part="Nowhere", box_cam_m=((50, 0, 8), (51, 1, 9))),
    ]  # fmt: skip
    found = count_joints([scenery, DOOR, DRAWER, lid], NAMES, answers, [ALL] * 4, RULES)
    assert [row.outcome for row in found.joints] == ["ignored", "correct", "wrong", "joint_missing"]
    assert [row.object for row in found.joints] == [None, "Cupboard", "Desk", "Desk"]
    assert found.extra == ("Nowhere",)
    assert (found.C, found.W, found.P, found.O, found.J, found.E) == (1, 1, 0, 0, 1, 1)
    assert found.score == 2 / 6
    nothing = none_found([scenery, DOOR, lid], NAMES)
    assert (nothing.O, nothing.score) == (2, 0.0)


def test_the_assignment_does_not_depend_on_the_order_of_answers():
    random = np.random.default_rng(4)
    doors = []
    for k in range(6):
        x = 0.4 * k
        doors.append(replace(DOOR, part=f"D{k}", box_cam_m=((x, 0, 2), (x + 0.5, 1, 2.1))))
    answers = [submitted(door) for door in doors]
    whole = match_joints(doors, answers, RULES)
    assert whole == {k: (k, 1.0) for k in range(6)}
    order = random.permutation(6).tolist()
    shuffled = match_joints(doors, [answers[k] for k in order], RULES)
    assert {g: order[q] for g, (q, _) in shuffled.items()} == {k: k for k in range(6)}


def with_joints(root, dataset, joints):
    """The dataset with these joints in every case."""
    path = root / "private" / "truth.json"
    truth = decode(BenchTruthFile, path.read_bytes())
    images = {k: replace(one, joints=joints) for k, one in truth.images.items()}
    path.write_text(readable(replace(truth, images=images)))
    return dataset


def test_rows_and_summary_of_an_evaluation(tmp_path):
    scenery = replace(DOOR, part="Gate", object_id=None, box_cam_m=((8, 0, 8), (9, 1, 9)))
    dataset = with_joints(
        tmp_path / "bench", write_dataset(tmp_path / "bench", tiers=("easy",)),
        (replace(DOOR, object_id=1), scenery),
    )  # fmt: skip
    run = write_run(tmp_path / "run", dataset, {2: Submission(status="invalid")})
    path = run / "per_image.jsonl"
    rows = decode_lines(BenchRow, path.read_bytes())
    answered = [replace(rows[0], joints=(submitted(DOOR),)), rows[1]]
    path.write_text("".join(f"{readable(r)}".replace("\n", " ") + "\n" for r in answered))
    summary = evaluate_bench(run, dataset.private, tmp_path / "eval", draws=2)
    lines = (tmp_path / "eval" / "per_image.jsonl").read_bytes()
    found = [row.articulation or None for row in decode_lines(ReconstructionRow, lines)]
    assert found[0]
    assert found[1]
    assert (found[0].C, found[0].score) == (1, 1.0)
    assert (found[1].O, found[1].score) == (1, 0.0)
    assert summary.articulation
    assert summary.articulation.cases == 2
    assert summary.articulation.score == 2 / 3
    assert summary.articulation.mean_score == 0.5
    assert summary.articulation.card_sha256 == RULES.sha256


def test_the_numbers_of_the_card():
    read = articulation_rules.__wrapped__()  # what the process keeps was read at import
    assert (read.version, read.box_pad, read.min_box_iou) == ("0.1.0", 0.01, 0.25)
    assert (read.present_recall, read.max_axis_deg, read.max_axis_apart) == (0.5, 10.0, 0.05)


def test_joints_that_are_all_ignored_are_no_case(tmp_path):
    dataset = write_dataset(tmp_path / "bench", families=1, tiers=("easy",))
    with_joints(tmp_path / "bench", dataset, (replace(DOOR, object_id=None),))
    run = write_run(tmp_path / "run", dataset)
    assert evaluate_bench(run, dataset.private, tmp_path / "eval", draws=2).articulation is UNSET
    (row,) = decode_lines(ReconstructionRow, (tmp_path / "eval/per_image.jsonl").read_bytes())
    assert [joint.outcome for joint in row.articulation.joints] == ["ignored"]


def test_a_bench_without_joints_says_nothing_of_them(tmp_path):
    dataset = write_dataset(tmp_path / "bench", families=1, tiers=("easy",))
    run = write_run(tmp_path / "run", dataset)
    assert evaluate_bench(run, dataset.private, tmp_path / "eval", draws=2).articulation is UNSET
    assert b"articulation" not in (tmp_path / "eval" / "per_image.jsonl").read_bytes()
    assert b"articulation" not in (tmp_path / "eval" / "summary.json").read_bytes()


def test_boxes_overlap_by_what_they_share():
    """The grown reference is 2 m deep: a pad of a hundredth is 2 cm at each side."""
    unit = replace(DOOR, box_cam_m=((0, 0, 2), (1, 1, 2)))
    thin = submitted(DOOR, box_cam_m=((0.99, 0, 2), (3, 1, 2)))
    assert _iou(unit, submitted(unit), 0.0) == 0.0, "boxes without a volume"
    shared, deep = 0.05 * 1.04 * 0.04, 1.04 * 0.04
    assert _iou(unit, thin, 0.01) == pytest.approx(shared / (deep * (1.04 + 2.05) - shared))
    apart = submitted(DOOR, box_cam_m=((1.05, 0, 2), (3, 1, 2)))
    assert _iou(unit, apart, 0.01) == 0.0


def test_what_is_there_is_counted_point_by_point():
    """Against every distance: hits of an object's points, and of those within the part's box."""
    raster, relative = small_raster(), 0.004
    depth, label = scene(raster, seed=3)
    other = depth.copy()
    other[label == 1] *= 1.003
    other[:, : raster.width // 2] *= 1.006
    points = points_m(depth, raster)
    known = np.isfinite(depth)
    theirs = points_m(other, raster)[np.isfinite(other)]
    distance = np.array([np.sqrt(((theirs - one) ** 2).sum(axis=1)).min() for one in points[known]])
    hits = np.zeros(depth.shape, bool)
    hits[known] = distance <= relative * depth[known]
    joints, expected = [], []
    for k in (0, 1, 2):
        own = points[known & (label == k)]
        low, high = own.min(axis=0), own.max(axis=0)
        high[0] = (low[0] + high[0]) / 2
        inside = known & (label == k) & ((points >= low) & (points <= high)).all(axis=2)
        joints.append(replace(DOOR, object_id=10 + k, box_cam_m=(tuple(low), tuple(high))))
        whole = known & (label == k)
        expected.append(Present(object=hits[whole].mean(), part=hits[inside].mean()))
    far = replace(DOOR, object_id=11, box_cam_m=((90.0, 0.0, 2.0), (91.0, 1.0, 3.0)))
    scored = [SimpleNamespace(id=10 + k) for k in range(3)]
    found = _present(
        SimpleNamespace(truth=SimpleNamespace(scored=scored)),
        (*joints, far, replace(DOOR, object_id=None)),
        SimpleNamespace(depth_z_m=depth, label=label, raster=raster),
        SimpleNamespace(depth_z_m=other),
        relative,
    )
    assert found[:3] == expected
    assert 0 < found[0].object < 1
    assert found[3] == Present(object=expected[1].object, part=None)
    assert found[4] == Present(object=None, part=None)


def test_an_axis_beside_itself_is_apart_by_no_angle_however_it_rounds() -> None:
    axis = (1 / math.sqrt(3),) * 3
    axes = [
        axis,
        *(tuple(v / np.linalg.norm(v)) for v in np.random.default_rng(0).normal(size=(99, 3))),
    ]
    assert max(float(np.dot(one, one)) for one in axes) > 1.0
    for one in axes:
        joint = replace(DOOR, axis_cam=tuple(map(float, one)))
        assert outcome(joint, submitted(joint)) == "correct"
