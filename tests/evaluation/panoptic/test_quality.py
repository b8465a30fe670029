"""Panoptic quality: the vectors, and the official rule and hotcoco to the last digit."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from evaluation.panoptic.official_rule import quality
from evaluation.panoptic.panoptic_files import CATEGORIES, call, scored, write_panoptic
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from legoworld.evaluation.panoptic.family import count_segments, panoptic_values, places
from legoworld.records.coco_file import SegmentInfo

hotcoco = pytest.importorskip("hotcoco.panoptic")

PERSON, CAR, SKY, WALL = (category["id"] for category in CATEGORIES)


def listed(*segments, ids):
    return tuple(
        SegmentInfo(id=i, category_id=c, iscrowd=crowd, area=int((ids == i).sum()))
        for i, c, crowd in segments
    )


def counted(true, truths, answer, answers):
    true, answer = np.array(true), np.array(answer)
    truths, answers = listed(*truths, ids=true), listed(*answers, ids=answer)
    return count_segments(
        places(true, truths, "t", ValueError),
        places(answer, answers, "a", ValueError),
        truths,
        answers,
    )


WALL_AND_TWO = (
    [[9, 9, 9, 9, 9, 0]] * 2 + [[5, 5, 5, 6, 6, 0]] * 2,
    [(9, WALL, 0), (5, PERSON, 0), (6, PERSON, 0)],
)
THEIRS = (
    [[1] * 6] * 2 + [[2, 2, 3, 3, 3, 1]] * 2,
    [(1, WALL, 0), (2, PERSON, 0), (3, PERSON, 0)],
)


def test_a_wall_and_two_persons(tmp_path):
    true, theirs = ({7: (np.array(ids), listed)} for ids, listed in (WALL_AND_TWO, THEIRS))
    truth = write_panoptic(tmp_path / "truth.json", true)
    answers = write_panoptic(tmp_path / "a.json", theirs, truth=False)
    found = scored(tmp_path, truth, answers)["metrics"]
    assert (found["PQ"], found["PQ_things"], found["PQ_stuff"]) == (
        0.8333333333333333, 0.6666666666666666, 1.0,
    )  # fmt: skip
    assert found["RQ"] == 1.0
    _, matched = counted(*WALL_AND_TWO, *THEIRS)
    assert [(m.truth, m.answer, m.intersection, m.union) for m in matched] == [
        (5, 2, 4, 6), (6, 3, 4, 6), (9, 1, 10, 10),
    ]  # fmt: skip


def test_an_iou_of_one_half_is_no_match():
    counts, matched = counted([[1, 1]], [(1, PERSON, 0)], [[4, 0]], [(4, PERSON, 0)])
    assert (counts, matched) == ({PERSON: (0, 1, 1)}, ())


@pytest.mark.parametrize(
    ("true", "false"), [([[0, 0, 1, 1]], 1), ([[0, 0, 0, 1]], 0), ([[2, 2, 2, 1]], 0)]
)
def test_an_answer_on_void_and_on_its_crowd(true, false):
    """Half of it is a false positive, more is dropped; the crowd of another category is not it."""
    truths = [(1, WALL, 0), (2, PERSON, 1)]
    counts, _ = counted(true, truths, [[3, 3, 3, 3]], [(3, PERSON, 0)])
    assert counts.get(PERSON, (0, 0, 0)) == (0, false, 0)
    other, _ = counted([[2, 2, 2, 1]], truths, [[3, 3, 3, 3]], [(3, CAR, 0)])
    assert other[CAR] == (0, 1, 0)


def test_of_two_crowds_the_one_listed_last_counts():
    true, answer = [[1, 1, 2]], ([[3, 3, 3]], [(3, PERSON, 0)])
    first, _ = counted(true, [(2, PERSON, 1), (1, PERSON, 1)], *answer)
    last, _ = counted(true, [(1, PERSON, 1), (2, PERSON, 1)], *answer)
    assert (first, last) == ({}, {PERSON: (0, 1, 0)})


def test_many_segments_are_counted_without_a_table_of_all_pairs():
    ids = np.arange(1, 10_001).reshape(100, 100)
    segments = listed(*((i, PERSON, 0) for i in range(1, 10_001)), ids=np.zeros(1))
    segments = tuple(SegmentInfo(id=s.id, category_id=PERSON, area=1) for s in segments)
    counts, matched = count_segments(ids, ids, segments, segments)
    assert counts == {PERSON: (10_000, 0, 0)}
    assert len(matched) == 10_000


def test_no_category_of_a_group_is_no_number():
    sums = np.array([[0.9, 1, 0, 0]])
    values = panoptic_values(sums, np.array([True]))
    assert values["PQ"] == values["PQ_things"] == 0.9
    assert math.isnan(values["PQ_stuff"])


@st.composite
def image(draw):
    shape = draw(st.tuples(st.integers(1, 9), st.integers(1, 9)))
    true = draw(arrays.arrays(np.int64, shape, elements=st.integers(0, 5)))
    near = draw(arrays.arrays(np.bool_, shape, elements=st.sampled_from([False, False, True])))
    other = draw(arrays.arrays(np.int64, shape, elements=st.integers(0, 5)))
    answer = np.where(near, other, true) * 70_001
    category = st.sampled_from([PERSON, CAR, SKY, WALL])
    pictures = []
    for ids, crowd in ((true, st.sampled_from([0, 0, 1])), (answer, st.just(0))):
        seen = [int(i) for i in np.unique(ids) if i]
        order = draw(st.permutations(seen))
        pictures.append((ids, [(i, draw(category), draw(crowd)) for i in order]))
    return pictures


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(image(), min_size=1, max_size=3))
def test_counts_are_those_of_the_official_rule_and_of_hotcoco(tmp_path, images):
    truth = write_panoptic(tmp_path / "truth.json", {n: t for n, (t, _) in enumerate(images)})
    answers = {n: a for n, (_, a) in enumerate(images)}
    file = write_panoptic(tmp_path / "answers.json", answers, truth=False)
    totals = np.zeros((4, 4))
    for (true, truths), (answer, given_segments) in images:
        counts, matched = counted(true, truths, answer, given_segments)
        for k, category in enumerate((PERSON, CAR, SKY, WALL)):
            totals[k, 1:] += counts.get(category, (0, 0, 0))
            for one in matched:
                totals[k, 0] += one.intersection / one.union if one.category_id == category else 0
    found = panoptic_values(totals, np.array([True, True, False, False]))
    assert {k: float(v) for k, v in found.items()} == pytest.approx(
        quality(truth, file), abs=0, rel=0, nan_ok=True
    )
    theirs = hotcoco.PanopticEval(str(truth), str(file))
    theirs.evaluate()
    report = theirs.results()
    for group, suffix in (("All", ""), ("Things", "_things"), ("Stuff", "_stuff")):
        for name in ("pq", "sq", "rq"):
            if not math.isnan(found[name.upper() + suffix]):
                assert report[group][name] == found[name.upper() + suffix]


def test_own_answers_as_truth_score_one_and_no_order_changes_a_byte(tmp_path):
    rng = np.random.default_rng(5)
    segments = [(i, (PERSON, CAR, SKY, WALL)[i % 4], 0) for i in range(1, 7)]
    pictures = {n: (rng.integers(0, 7, (20, 30)), segments) for n in (3, 1, 2)}
    truth = write_panoptic(tmp_path / "truth.json", pictures)
    found = scored(tmp_path, truth, truth)
    assert set(found["metrics"].values()) == {1.0}
    kept = (tmp_path / "eval/summary.json").read_bytes()
    shuffled = {n: (ids, listed[::-1]) for n, (ids, listed) in sorted(pictures.items())}
    scored(tmp_path, write_panoptic(tmp_path / "truth.json", shuffled), tmp_path / "truth.json")
    again = json.loads((tmp_path / "eval/summary.json").read_bytes())
    assert again == json.loads(kept)
    call("evidence", "verify", tmp_path / "eval")
