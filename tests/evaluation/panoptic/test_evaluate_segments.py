"""Runs of segments: failed images, unusable truth, workers, comparison, page."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest
from evaluation.panoptic.official_rule import quality
from evaluation.panoptic.panoptic_files import call, scored, write_ids, write_panoptic

PERSON, WALL = 1, 199


@pytest.fixture
def made(tmp_path):
    """Ground truth of three images, answers of two of them."""
    rng = np.random.default_rng(2)
    pictures = {n: (rng.integers(0, 4, (12, 16)), [(1, PERSON, 0), (2, PERSON, 0), (3, WALL, 0)])
                for n in (1, 2, 5)}  # fmt: skip
    truth = write_panoptic(tmp_path / "truth.json", pictures)
    answers = {n: (np.roll(ids, 1, 1), listed) for n, (ids, listed) in pictures.items() if n != 5}
    return tmp_path, truth, write_panoptic(tmp_path / "theirs.json", answers, truth=False)


def test_an_image_without_an_answer_is_all_void_for_the_official_rule_too(made):
    folder, truth, answers = made
    summary = scored(folder, truth, answers, code=1)
    assert summary["coverage"] == {
        "attempted": 3, "scored": 2, "with_truth": 3, "by_status": {"missing": 1, "ok": 2},
    }  # fmt: skip
    assert summary["missed"] == 1
    written = json.loads((folder / "run/answer.json").read_text())["annotations"]
    assert [(e["image_id"], len(e["segments_info"])) for e in written] == [(1, 3), (2, 3), (5, 0)]
    assert summary["metrics"] == quality(truth, folder / "run/answer.json")
    assert next(c for c in summary["categories"] if c["id"] == WALL)["counts"][2] >= 1


def test_workers_change_no_byte_and_a_comparison_pairs_what_both_answered(made, tmp_path):
    folder, truth, answers = made
    scored(folder, truth, answers, code=1)
    words = ("--truth", truth, "-o", folder / "two", "--draws", 50, "--workers", 2)
    call("evaluate", "-q", folder / "run", *words)
    for name in ("summary.json", "per_image.jsonl", "view/1.json"):
        assert (folder / "two" / name).read_bytes() == (folder / "eval" / name).read_bytes()
    shutil.copytree(folder / "run", folder / "other")
    call("evaluate", "-q", folder / "other", "--truth", truth, "-o", folder / "eval-other")
    sides = (folder / "eval", folder / "eval-other")
    call("compare", *sides, "-o", folder / "comparison", "--draws", 20)
    document = json.loads((folder / "comparison/comparison.json").read_text())
    (pair,) = document["pairs"]
    assert pair["paired_image_ids"] == [1, 2]
    assert {row["difference"]["value"] for row in pair["rows"]} == {0.0}
    call("evidence", "verify", folder / "comparison")
    call("report", *sides, folder / "comparison", "-o", folder / "page.html")
    page = (folder / "page.html").read_text()
    assert page.count('id="overlay-') == 3 * (1 + 2 + 2)  # truth, answers, agreement, each image
    assert "PQ_stuff" in page


def test_the_inputs_are_told_by_their_roles(made):
    folder, truth, answers = made
    scored(folder, truth, answers, code=1)
    inputs = json.loads((folder / "eval/evidence.json").read_text())["inputs"]
    assert [(i["role"], i["path"].rpartition("/")[2]) for i in inputs] == [
        ("run", "run.json"), ("run_rows", "per_image.jsonl"), ("answer", "1.png"),
        ("answer", "2.png"), ("truth", "truth.json"),
        *(("truth_png", f"{n}.png") for n in (1, 2, 5)),
    ]  # fmt: skip


def test_an_altered_answer_is_seen(made):
    folder, truth, answers = made
    scored(folder, truth, answers, code=1)
    write_ids(folder / "run/answer/1.png", np.zeros((12, 16), np.int64))
    call("evidence", "verify", folder / "eval", code=1)
    call("evaluate", "-q", folder / "run", "--truth", truth, "-o", folder / "again")
    rows = [json.loads(x) for x in (folder / "again/per_image.jsonl").read_text().splitlines()]
    assert [row["status"] for row in rows] == ["invalid", "ok", "missing"]
    assert "is not the file that the run wrote" in rows[0]["reason"]


def _damaged(truth, how):
    document = json.loads(truth.read_text())
    first = document["annotations"][0]
    if how == "area":
        first["segments_info"][0]["area"] += 1
    elif how == "id":
        first["segments_info"].pop()
    elif how == "category":
        first["segments_info"][0]["category_id"] = 77
    elif how == "twice":
        first["segments_info"].append(first["segments_info"][0])
    elif how == "image":
        document["annotations"].pop(0)
    elif how == "names":
        document["categories"][0]["name"] = "someone"
    else:
        (truth.with_suffix("") / first["file_name"]).unlink()
    truth.write_text(json.dumps(document))


@pytest.mark.parametrize(
    ("how", "said"),
    [("area", "another area than its file says"), ("id", "are not in the JSON file"),
     ("category", "category 77"), ("twice", "segment 1 twice"), ("image", "no ground truth"),
     ("names", "different categories"), ("png", "a PNG of the ground truth is missing")],
)  # fmt: skip
def test_unusable_truth_ends_scoring_in_one_sentence(made, capsys, how, said):
    folder, truth, answers = made
    scored(folder, truth, answers, code=1)
    _damaged(truth, how)
    call("evaluate", folder / "run", "--truth", truth, "-o", folder / "no", code=2)
    assert said in capsys.readouterr().err
    assert not (folder / "no/summary.json").exists()


def test_other_files_are_no_panoptic_truth(made, capsys):
    folder, truth, answers = made
    scored(folder, truth, answers, code=1)
    call("evaluate", folder / "run", "--truth", answers, "-o", folder / "no", code=2)
    assert "is no panoptic ground truth" in capsys.readouterr().err
