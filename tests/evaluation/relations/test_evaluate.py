"""Both directions: scenes against statements of people, and answers of others against scenes."""

from __future__ import annotations

import json

import pytest
from evaluation.relations.folders import (
    STREET,
    TABLE,
    call,
    evaluated,
    true_answers,
    write_answer_lines,
    write_facts,
)

from legoworld.files import sha256_of_file

SCENES = {"a.jpg": TABLE, "b.jpg": STREET}


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    return write_facts(tmp_path_factory.mktemp("facts") / "run", SCENES)


@pytest.fixture(scope="module")
def track(truth):
    path = truth.parent / "track.json"
    assert call("track", "make", "--task", "relations", "--truth", truth, "-o", path) == 0
    return path


def imported(track, answers, folder, *more, code=0):
    path = write_answer_lines(folder / "answers.jsonl", answers)
    words = ("--task", "relations", "--track", track, "-o", folder / "theirs", *more)
    assert call("baseline", "import", path, *words) == code
    return folder / "theirs"


def test_the_track_asks_and_does_not_answer(truth, track):
    document = json.loads(track.read_text())
    ids = [question["id"] for question in document["questions"]]
    assert ids == list(true_answers(truth))
    assert {i["file_name"]: (i["width"], i["height"]) for i in document["images"]} == {
        "a.jpg": (320, 240), "b.jpg": (320, 240)
    }  # fmt: skip
    assert not any({"answer", "boxes", "chance"} & question.keys()
                   for question in document["questions"])  # fmt: skip


def test_a_scene_scores_1_against_itself_and_so_do_its_answers(truth, track, tmp_path):
    whole = evaluated(truth, truth, tmp_path / "self")
    assert whole["unanswered"] == {}
    for name in ("accuracy", "chance_adjusted", "count_exact", "mra", "refer_50", "answered"):
        assert whole["metrics"][name]["answers"] == 1.0
    assert whole["metrics"]["count_error"]["answers"] == 0.0
    theirs = imported(track, true_answers(truth), tmp_path)
    assert evaluated(theirs, truth, tmp_path / "theirs-eval")["metrics"] == whole["metrics"]
    assert call("evidence", "verify", tmp_path / "self") == 0
    assert call("evidence", "verify", tmp_path / "theirs-eval") == 0


def test_wrong_missing_and_unreadable_answers(truth, track, tmp_path):
    answers = true_answers(truth)
    yes_no = [key for key, value in answers.items() if isinstance(value, bool)]
    wrong, missing, unreadable = yes_no[:3]
    answers[wrong] = not answers[wrong]
    answers[missing] = "unknown"
    answers[unreadable] = "perhaps"
    summary = evaluated(imported(track, answers, tmp_path), truth, tmp_path / "eval")
    n = summary["metrics"]["accuracy"]["n"]
    assert summary["metrics"]["accuracy"]["answers"] == pytest.approx((n - 3) / n)
    assert summary["metrics"]["accuracy_answered"]["answers"] == pytest.approx((n - 3) / (n - 2))
    assert summary["unanswered"] == {"no_answer": 1, "unreadable": 1}
    chance = summary["metrics"]["accuracy"]["chance"]
    adjusted = ((n - 3) / n - chance) / (1 - chance)
    assert summary["metrics"]["chance_adjusted"]["answers"] == pytest.approx(adjusted)
    assert 0 < summary["metrics"]["accuracy"]["blind"] < 1
    assert summary["metrics"]["accuracy"]["interval"]["unit"] == "image"


def test_every_table_has_a_row_of_a_guess_and_of_the_prior(truth, tmp_path, capsys):
    evaluated(truth, truth, tmp_path / "eval")
    assert "chance 0.4" in capsys.readouterr().out
    assert call("evaluate", truth, "--truth", truth, "-o", tmp_path / "v", "-v") == 0
    printed = capsys.readouterr().out
    assert "Accuracy by relation" in printed
    rows = [line.split()[:2] for line in printed.splitlines() if line.startswith("accuracy ")]
    assert rows[-3:] == [["accuracy", p] for p in ("answers", "chance", "blind")]


def test_two_sides_are_compared_over_the_same_draws_and_shown(truth, track, tmp_path):
    nothing = dict.fromkeys(true_answers(truth))
    theirs = imported(track, nothing, tmp_path)
    evaluated(truth, truth, tmp_path / "scene")
    evaluated(theirs, truth, tmp_path / "theirs-eval")
    sides = (tmp_path / "scene", tmp_path / "theirs-eval")
    assert call("compare", *sides, "-o", tmp_path / "compared", "--draws", 50) == 0
    document = json.loads((tmp_path / "compared/comparison.json").read_text())
    rows = {(r["metric"], r["images"]): r for r in document["pairs"][0]["rows"]}
    assert rows["accuracy.answers", "attempted"]["difference"]["value"] == 1.0
    assert rows["accuracy.chance", "attempted"]["difference"]["value"] == 0.0
    assert call("evidence", "verify", tmp_path / "compared") == 0
    assert call("report", tmp_path / "compared", *sides, "-o", tmp_path / "page.html") == 0
    page = (tmp_path / "page.html").read_text()
    assert "Is the cup" in page or "Is the car" in page
    assert "answered; accuracy" in page


def statements(path, *captions):
    lines = [
        {"image": image, "caption": caption, "relation": relation, "label": label}
        for image, caption, relation, label in captions
    ]
    path.write_text("\n".join(map(json.dumps, lines)) + "\n")
    return path


def test_scenes_against_statements_of_people(tmp_path):
    run = write_facts(tmp_path / "run", {"a.jpg": TABLE, "b.jpg": None, "c.jpg": STREET})
    truth = statements(
        tmp_path / "vsr.jsonl",
        ("a.jpg", "The cup is on the dining table.", "on", 1),
        ("a.jpg", "The laptop is behind the chair.", "behind", 1),
        ("a.jpg", "The bear is behind the chair.", "behind", 0),
        ("a.jpg", "The cup is near the cup.", "near", 1),
        ("a.jpg", "The chair is left of the laptop.", "left of", 1),
        ("a.jpg", "The chair is left of the laptop", "left of", 0),
        ("b.jpg", "The car is near the bus.", "near", 0),
    )
    summary = evaluated(run, truth, tmp_path / "eval")
    metrics = summary["metrics"]
    assert summary["unanswered"] == {"failed_image": 1, "named_twice": 1, "not_there": 1}
    assert summary["contradictory"] == 1
    assert (metrics["accuracy"]["n"], metrics["accuracy"]["answers"]) == (5, 0.2)
    assert (metrics["accuracy_answered"]["n"], metrics["accuracy_answered"]["answers"]) == (2, 0.5)
    assert metrics["answered"]["answers"] == 0.4
    assert metrics["accuracy"]["chance"] == 0.5
    rows = [json.loads(x) for x in (tmp_path / "eval/per_image.jsonl").read_text().splitlines()]
    assert [row["status"] for row in rows] == ["ok", "invalid", "ok"]
    assert rows[2]["reason"] == "the truth asks nothing of this image"
    assert summary["coverage"] == {
        "attempted": 3, "scored": 1, "with_truth": 2, "by_status": {"invalid": 1, "ok": 2}
    }  # fmt: skip


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", "no statement"),
        ("{}\n", "no truth of relations"),
        ('{"image": "a.jpg", "caption": "x", "relation": "on", "label": 2}\n', "<= 1"),
        ("not JSON\n", "not JSON"),
    ],
)
def test_truths_that_cannot_be_used_are_refused_in_one_sentence(
    truth, tmp_path, capsys, content, said
):
    (tmp_path / "vsr.jsonl").write_text(content)
    words = ("evaluate", truth, "--truth", tmp_path / "vsr.jsonl", "-o", tmp_path / "eval")
    assert call(*words) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "eval").exists()


def test_answers_are_no_truth_and_altered_answers_are_refused(truth, track, tmp_path, capsys):
    theirs = imported(track, true_answers(truth), tmp_path)
    assert call("evaluate", truth, "--truth", theirs, "-o", tmp_path / "eval") == 2
    assert "answers to questions" in capsys.readouterr().err
    (theirs / "answer/a.json").write_text("{}")
    assert call("evaluate", theirs, "--truth", truth, "-o", tmp_path / "eval") == 2
    assert "is not the one that the run wrote" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("answers", "said"),
    [
        ('{"id": "a-999", "answer": true}\n', "answers what the track does not ask"),
        ('{"id": "a-001", "answer": true}\n{"id": "a-001", "answer": false}\n', "twice"),
        ('{"id": "a-001"}\n', "cannot be read"),
        ('{"id": "a-001", "answer": {}}\n', "cannot be read"),
    ],
)
def test_answers_that_cannot_be_imported(track, tmp_path, capsys, answers, said):
    (tmp_path / "answers.jsonl").write_text(answers)
    words = ("--task", "relations", "--track", track, "-o", tmp_path / "theirs")
    assert call("baseline", "import", tmp_path / "answers.jsonl", *words) == 2
    assert said in capsys.readouterr().err


def test_a_track_without_questions_and_a_truth_of_other_photos(truth, track, tmp_path, capsys):
    document = json.loads(track.read_text())
    del document["questions"]
    (tmp_path / "track.json").write_text(json.dumps(document))
    write_answer_lines(tmp_path / "answers.jsonl", {"a-001": True})
    words = ("--task", "relations", "--track", tmp_path / "track.json", "-o", tmp_path / "theirs")
    assert call("baseline", "import", tmp_path / "answers.jsonl", *words) == 2
    assert "asks no questions" in capsys.readouterr().err
    others = write_facts(tmp_path / "others", {"z.jpg": TABLE})
    summary = evaluated(truth, others, tmp_path / "eval")
    assert (summary["coverage"]["with_truth"], summary["metrics"]) == (0, {})
    assert call("evidence", "verify", tmp_path / "eval") == 0


def test_answers_to_other_questions_are_ignored_on_request(truth, track, tmp_path):
    answers = true_answers(truth) | {"z-001": True}
    theirs = imported(track, answers, tmp_path, "--subset")
    assert evaluated(theirs, truth, tmp_path / "eval")["metrics"]["accuracy"]["answers"] == 1.0


def test_a_track_of_statements_needs_the_photos(tmp_path, capsys):
    import cv2
    import numpy as np

    truth = statements(
        tmp_path / "vsr.jsonl",
        ("a.jpg", "The cup is on the table.", "on", 1),
        ("b.jpg", "The cup is on the table.", "on", 1),
    )
    words = ("track", "make", "--task", "relations", "--truth", truth, "-o", tmp_path / "t.json")
    assert call(*words) == 2
    assert "--photos" in capsys.readouterr().err
    cv2.imwrite(str(tmp_path / "a.jpg"), np.zeros((6, 8, 3), np.uint8))
    assert call(*words, "--photos", tmp_path) == 0
    document = json.loads((tmp_path / "t.json").read_text())
    (image,) = document["images"]
    assert (image["file_name"], image["width"], image["height"]) == ("a.jpg", 8, 6)
    assert [question["text"] for question in document["questions"]] == ["The cup is on the table."]


def test_a_changed_row_is_seen(truth, tmp_path):
    evaluated(truth, truth, tmp_path / "eval")
    rows = tmp_path / "eval/per_image.jsonl"
    first, *others = rows.read_text().splitlines()
    changed = json.loads(first)
    changed["sums"]["accuracy"]["score"] -= 1
    rows.write_text("\n".join([json.dumps(changed), *others]) + "\n")
    evidence = json.loads((tmp_path / "eval/evidence.json").read_text())
    evidence["files"]["per_image.jsonl"] = sha256_of_file(rows)
    (tmp_path / "eval/evidence.json").write_text(json.dumps(evidence))
    assert call("evidence", "verify", tmp_path / "eval") == 1
