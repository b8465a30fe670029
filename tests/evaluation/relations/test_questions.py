"""Questions made of known facts, statements of people, and what answers to them score."""

from __future__ import annotations

import pytest
from msgspec.structs import replace
from readouts.cubes import view_of

from legoworld.evaluation.relations.answering import Reply, answer_by_facts, read_answer
from legoworld.evaluation.relations.questions import make_questions
from legoworld.evaluation.relations.rows import Prior, iou, mean_relative_accuracy, score
from legoworld.evaluation.relations.truth import statement_answers
from legoworld.readouts.family import protocol
from legoworld.readouts.relation_facts import relation_facts
from legoworld.readouts.relation_kinds import FactBase
from legoworld.records.relations import Statement, TrueAnswer
from legoworld.records.track import Designator, Question

ROOM = (
    ("cup", (-1.2, 0.85, 5), 0.3),
    ("cup", (1.2, 0.35, 6), 0.3),
    ("dining table", (1.2, 1, 6), 1),
    ("chair", (-2, 0.75, 8), 1.5),
    ("laptop", (0.3, 1.35, 4.5), 0.3),
    ("laptop", (-0.5, -0.9, 7), 0.4),
    (None, (0, 2, 10), (30, 20, 1)),
)
CATEGORIES = ["cup", "dining table", "chair", "laptop", "bear", "bus", "kite"]


def facts_of(*placed):
    return relation_facts(*view_of(*placed))


@pytest.fixture(scope="module")
def room():
    return facts_of(*ROOM)


def asked(facts, scene="room"):
    return make_questions(facts, scene, 7, CATEGORIES)


def test_a_scene_answers_all_questions_about_itself(room):
    made, base = asked(room), FactBase(room)
    assert {one.question.kind for one in made} == {"yes_no", "choice", "count", "number", "refer"}
    for one in made:
        reply = answer_by_facts(one.question, base)
        assert score(one.question, one.answer, reply.value) == 1.0, one.question.text
        json_like = list(one.answer) if isinstance(one.answer, tuple) else one.answer
        assert read_answer(one.question, json_like).value == one.answer
    assert len({one.question.id for one in made}) == len(made)


def test_a_question_has_the_boxes_of_what_it_is_about(room):
    for one in asked(room):
        asks, relation = one.question, one.question.relation
        if asks.kind == "count":
            expected = one.answer
        elif relation == "exists":
            expected = int(one.answer)
        else:
            expected = 2 if asks.kind == "yes_no" or relation in ("nearest_to", "distance") else 1
        assert len(one.boxes) == expected, asks.text
        assert {*one.boxes} <= {thing.bbox_xywh_px for thing in room.objects}


def test_true_and_false_are_balanced_and_seeded_by_the_photo(room):
    made = [one for one in asked(room) if one.question.kind == "yes_no"]
    for relation in {one.question.relation for one in made}:
        answers = [one.answer for one in made if one.question.relation == relation]
        assert answers.count(True) == answers.count(False) <= 2
    assert asked(room) == asked(room)
    assert asked(room) != asked(room, "another")


def test_questions_are_asked_beyond_the_slack_alone():
    """Two cubes side by side: left is certain, in front of is not asked."""
    made = asked(facts_of(("cup", (0, 0, 5), 1), ("chair", (2, 0, 5), 1)))
    relations = {one.question.relation for one in made}
    assert {"left_of", "right_of", "distance", "height", "exists", "count"} <= relations
    assert not relations & {"in_front_of", "behind", "closest_to_camera", "above", "below"}
    (distance,) = [one for one in made if one.question.relation == "distance"]
    assert distance.answer == 2.0
    texts = {one.question.text: one.answer for one in made}
    assert texts["Is the cup to the left of the chair?"] is True
    assert texts["Is the chair to the left of the cup?"] is False


def test_what_is_small_or_mostly_hidden_is_not_asked_about():
    hidden = facts_of(("cup", (0, 0, 8), 1), ("chair", (0.06, 0.06, 4), 0.5))
    assert 0 < hidden.objects[0].visible < 0.25
    assert {one.question.a.category for one in asked(hidden)} & {"cup"} == set()
    small = asked(facts_of(("cup", (0, 0, 9), 0.2), ("chair", (2, 0, 5), 1)))
    assert all("cup" not in one.question.text for one in small)


def test_no_name_gives_an_answer_away_and_no_unseen_gap_is_asked_about(room):
    depth = {"in_front_of", "behind", "closest_to_camera"}
    for one in asked(room):
        named = {one.question.a.which, *(o.which for o in one.question.options)}
        named |= {one.question.b.which} if one.question.b else set()
        if one.question.relation in depth:
            assert not named & {"closest", "farthest"}
        if one.question.relation in ("left_of", "right_of") and one.question.kind == "yes_no":
            assert not named & {"leftmost", "rightmost"}
    above = [("cup", (0, 0, 5), 0.5), ("dining table", (0, 0.56, 5), 0.5), ("chair", (-2, 0, 5), 1)]
    made = asked(facts_of(*above, ("laptop", (-2, -0.75, 5), 0.5)))
    touching = {one.question.text for one in made if one.question.relation in ("on", "touching")}
    assert any("laptop" in text and "chair" in text for text in touching)
    assert not any("cup" in text and "dining table" in text for text in touching)


def test_expressions_name_one_of_several(room):
    made = [one for one in asked(room) if one.question.kind == "refer"]
    assert all(one.chance == 0.5 for one in made), "two of each category"
    by_text = {one.question.text: one for one in made}
    for one in made:
        assert one.answer in {thing.bbox_xywh_px for thing in room.objects}
    assert len(by_text) == len(made) == 4


def test_another_scene_answers_by_its_own_facts(room):
    moved = facts_of(*((k, (-x, y, z), s) for k, (x, y, z), s in ROOM[:3]))
    for one in asked(room):
        reply = answer_by_facts(one.question, FactBase(moved))
        if one.question.relation == "exists" and one.question.a.category == "chair":
            assert reply.value is False
        if one.question.relation == "count" and one.question.a.category == "laptop":
            assert reply.value == 0
        if one.question.kind == "yes_no" and "chair" in one.question.text and one.question.b:
            assert reply == Reply(None, "not_there")


def question(kind, relation="left_of", **fields):
    cup, chair = Designator(category="cup"), Designator(category="chair")
    given = {"a": cup, "b": chair, "options": (cup, chair), **fields}
    return Question(id="1", image_id=1, kind=kind, relation=relation, text="?", **given)


@pytest.mark.parametrize(
    ("truth", "given", "expected"),
    [(2, 2, 1.0), (2, 2.2, 0.8), (2, 1.8, 0.8), (2, 4, 0.0), (2, 3, 0.0), (1, 0.5, 0.0),
     (3, 0, 0.0), (2, 1.0001, 0.1), (0.3, 0.33, 0.8)],
)  # fmt: skip
def test_mean_relative_accuracy_in_whole_numbers(truth, given, expected):
    assert mean_relative_accuracy(given, truth) == expected
    assert score(question("number", "distance"), truth, given) == expected


def test_scores_of_boxes_and_counts():
    assert iou((0, 0, 2, 2), (0, 0, 2, 1)) == 0.5
    assert score(question("refer"), (0, 0, 2, 2), (0, 0, 2, 1)) == 1.0
    assert score(question("refer"), (0, 0, 2, 2), (0, 0, 2, 0.99)) == 0.0
    assert iou((0, 0, 0, 0), (0, 0, 0, 0)) == 0.0
    assert score(question("count"), 3, 4) == 0.0


@pytest.mark.parametrize(
    ("kind", "given", "value"),
    [
        ("yes_no", "Yes, it is.", True), ("yes_no", "no", False), ("yes_no", True, True),
        ("yes_no", "TRUE", True), ("yes_no", "maybe", None), ("yes_no", 1, None),
        ("choice", "The Chair.", "the chair"), ("choice", "cup", "the cup"),
        ("choice", "table", None),
        ("count", "3", 3), ("count", 2.0, 2), ("count", 2.5, None), ("count", True, None),
        ("number", "1.5 m", 1.5), ("number", "2 metres", 2.0), ("number", "150 cm", None),
        ("number", float("1e400"), None), ("refer", [1, 2, 3, 4], (1, 2, 3, 4)),
        ("refer", [1, 2, 3], None), ("refer", [1, 2, -3, 4], None), ("refer", "left", None),
    ],
)  # fmt: skip
def test_given_answers_are_read_by_the_question_s_kind(kind, given, value):
    reply = read_answer(question(kind), given)
    assert reply == (Reply(value) if value is not None else Reply(None, "unreadable"))


@pytest.mark.parametrize("given", [None, "", "unknown", "None"])
def test_no_answer_is_no_answer(given):
    assert read_answer(question("count"), given) == Reply(None, "no_answer")


def statements(*captions):
    lines = [
        Statement(image="a.jpg", caption=caption, relation=relation, label=label,
                  reference_frame=frame[0] if frame else None)
        for caption, relation, label, *frame in captions
    ]  # fmt: skip
    return statement_answers(lines, protocol("relations", None).vocabulary)["a.jpg"]


def reply(one, facts):
    return answer_by_facts(one.question, FactBase(facts))


def test_statements_are_read_by_their_relation():
    made = statements(
        ("The cup is on top of the dining table.", "on top of", 1),
        ("A cup is at the left side of the chair.", "at the left side of", 0),
        ("The dining table contains the cups.", "contains", 0),
        ("The potted plant is facing away from the tv.", "facing away from", 1),
        ("The cup is parallel to the chair.", "parallel to", 1),
    )
    found = [(o.question.relation, o.question.a.category, o.question.b.category) for o in made]
    assert found == [
        ("on", "cup", "dining table"),
        ("left_of", "cup", "chair"),
        ("contains", "dining table", "cup"),
        ("facing_away", "potted plant", "tv"),
        ("parallel to", "cup", "chair"),
    ]
    assert [one.answer for one in made] == [True, False, False, True, True]


def test_statements_of_what_is_not_there_twice_there_or_in_another_frame(room):
    made = statements(
        ("The cup is on the dining table.", "on", 1),
        ("The cup is behind the cup.", "behind", 1),
        ("The bear is behind the cup.", "behind", 1),
        ("The cup is behind the chair.", "behind", 0, "intrinsic"),
        ("The cup is parallel to the chair.", "parallel to", 0),
        ("Nothing of the kind", "behind", 0),
        ("The cup is facing the chair.", "facing", 0),
    )
    assert [tuple(reply(one, room)) for one in made] == [
        (True, ""),
        (None, "named_twice"),
        (None, "not_there"),
        (None, "foreign_frame"),
        (None, "not_a_relation"),
        (None, "not_there"),
        (False, ""),
    ]


def test_labels_that_contradict_each_other_are_no_truth():
    made = statements(
        ("The cup is on the chair.", "on", 1),
        ("The  Cup is on the chair", "on", 0),
        ("The cup is under the chair.", "under", 0),
        ("The cup is under the chair.", "under", 0),
    )
    assert [one.answer for one in made] == [None, False]


def test_the_prior_knows_the_answers_of_other_images_alone():
    def true(answer, kind="count", relation="count"):
        return TrueAnswer(question=question(kind, relation), answer=answer)

    prior = Prior({"a": [true(1), true(2)], "b": [true(2)], "c": [true(2)]})
    assert prior.scores("a", true(2)) == (1.0, 1.0)
    assert prior.scores("b", true(2)) == (pytest.approx(2 / 3), 1.0)
    assert prior.scores("b", true(1)) == (pytest.approx(1 / 3), 0.0)
    lengths = Prior({"a": [true(1.0, "number")], "b": [true(2.0, "number"), true(4.0, "number")]})
    assert lengths.scores("a", true(3.0, "number")) == (0.4, 1.0)
    yes = replace(true(True, "yes_no", "on"), chance=0.5)
    alone = Prior({"a": [yes]})
    assert alone.scores("a", yes) == (0.5, 0.5)
    tied = Prior({"a": [yes], "b": [yes, replace(yes, answer=False)]})
    assert tied.scores("a", yes) == (0.5, 0.5)
