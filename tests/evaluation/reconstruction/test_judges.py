"""The published 6 x 6 matrix: builders in rows, judges in columns, 60 items a cell."""

from __future__ import annotations

import json

import pytest

from legoworld import cli
from legoworld.evaluation.reconstruction.judges import (
    JudgementsError,
    judge_agreement,
    summarise_matrix,
)
from legoworld.records.bench_results import Agreement

NAMES = ("astra", "6-sol", "6-luna", "5.6-sol", "5.6-terra", "5.6-luna")
PUBLISHED = """
61.7/76.7 51.7/78.3 50.0/83.3 58.3/86.7 51.7/76.7 53.3/78.3
45.0/75.0 45.0/78.3 46.7/76.7 43.3/75.0 48.3/81.7 45.0/63.3
51.7/71.7 56.7/76.7 43.3/66.7 46.7/71.7 41.7/70.0 41.7/65.0
41.7/48.3 45.0/60.0 38.3/53.3 46.7/48.3 46.7/55.0 46.7/46.7
45.0/58.3 40.0/66.7 36.7/56.7 40.0/70.0 43.3/65.0 43.3/55.0
41.7/51.7 43.3/46.7 45.0/35.0 35.0/43.3 41.7/41.7 35.0/38.3
"""
ITEMS = 60


def judgements():
    for builder, line in zip(NAMES, PUBLISHED.strip().splitlines(), strict=True):
        for judge, cell in zip(NAMES, line.split(), strict=True):
            aspects = zip(("reconstruction", "appearance"), cell.split("/"), strict=True)
            for aspect, percent in aspects:
                agreed = round(float(percent) * ITEMS / 100)
                assert round(100 * agreed / ITEMS, 1) == float(percent)
                for k in range(ITEMS):
                    yield {
                        "builder": builder, "judge": judge, "aspect": aspect, "item": str(k),
                        "shown": ["x", "y"], "better": "x", "chosen": "x" if k < agreed else "y",
                    }  # fmt: skip


def write(path, lines):
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return path


def test_the_published_matrix(tmp_path):
    found = judge_agreement(write(tmp_path / "j.jsonl", judgements()))
    assert list(found.aspects) == ["reconstruction", "appearance"]
    r, a = found.aspects["reconstruction"], found.aspects["appearance"]
    assert (round(100 * r.self_mean, 2), round(100 * a.self_mean, 2)) == (45.83, 62.22)
    # From counts; the published 45.40 and 63.95 are means of the cells as printed, see below.
    assert (round(100 * r.cross_mean, 2), round(100 * a.cross_mean, 2)) == (45.39, 63.94)
    assert (r.self_above_others, a.self_above_others, r.builders) == (3, 2, 6)
    shown = [
        [f"{100 * side.matrix[b][j].share:.1f}" for j in NAMES for side in (r, a)] for b in NAMES
    ]
    expected = [line.replace("/", " ").split() for line in PUBLISHED.strip().splitlines()]
    assert shown == expected


@pytest.mark.parametrize(
    ("place", "own", "cross", "above"), [(0, 45.83, 45.40, 3), (1, 62.22, 63.95, 2)]
)
def test_the_published_means_are_of_the_printed_cells(place, own, cross, above):
    cells = [[float(cell.split("/")[place]) for cell in line.split()]
             for line in PUBLISHED.strip().splitlines()]  # fmt: skip
    matrix = {
        builder: {j: Agreement(agreed=0, n=ITEMS, share=c / 100)
                  for j, c in zip(NAMES, row, strict=True)}
        for builder, row in zip(NAMES, cells, strict=True)
    }  # fmt: skip
    found = summarise_matrix(matrix, {})
    assert round(100 * found.self_mean, 2) == own
    assert round(100 * found.cross_mean, 2) == cross
    assert found.self_above_others == above


def test_a_swapped_order_shows_who_follows_the_place(tmp_path):
    def said(judge, item, shown, chosen):
        return {"builder": "b", "judge": judge, "aspect": "appearance", "item": item,
                "shown": shown, "chosen": chosen, "better": "x"}  # fmt: skip

    lines = [
        said("place", "1", ["x", "y"], "x"), said("place", "1", ["y", "x"], "y"),
        said("sight", "1", ["x", "y"], "x"), said("sight", "1", ["y", "x"], "x"),
        said("sight", "2", ["x", "y"], None), said("sight", "3", ["y", "x"], "y"),
        said("sight", "4", ["y", "x"], "x"), said("b", "1", ["y", "x"], "x"),
        said("silent", "1", ["x", "y"], "failed"), said("silent", "1", ["y", "x"], "failed"),
    ]  # fmt: skip
    found = judge_agreement(write(tmp_path / "j.jsonl", lines)).aspects["appearance"]
    assert (found.order_swaps["place"].share, found.order_swaps["place"].first_share) == (0.0, 1.0)
    assert (found.order_swaps["silent"].swapped, found.order_swaps["silent"].share) == (0, None)
    assert (found.order_swaps["sight"].swapped, found.order_swaps["sight"].share) == (1, 1.0)
    assert (found.matrix["b"]["sight"].agreed, found.matrix["b"]["sight"].n) == (3, 5)
    # 1 of 1 by its own builder; others: (1 of 2 + 3 of 5 + 0 of 2) / 3 cells.
    assert (found.self_mean, found.cross_mean) == (1.0, pytest.approx((0.5 + 0.6) / 3))
    alone = [line for line in lines if line["judge"] != "b"]
    found = judge_agreement(write(tmp_path / "k.jsonl", alone)).aspects["appearance"]
    assert (found.self_mean, found.builders) == (None, 0)


def test_a_judge_that_is_level_with_the_others_is_not_above_them():
    half = Agreement(agreed=1, n=2, share=0.5)
    assert summarise_matrix({"a": {"a": half, "b": half}}, {}).self_above_others == 0


@pytest.mark.parametrize(
    "change",
    [{"better": "z"}, {"chosen": "z"}, {"shown": ["x", "x"]}, {"aspect": "beauty"}, {"judge": ""},
     {"better": "both_bad"}, {"shown": ["x", "tie"]}],
)  # fmt: skip
def test_a_judgement_that_cannot_be_counted_is_refused(tmp_path, change):
    good = next(judgements())
    with pytest.raises(JudgementsError):
        judge_agreement(write(tmp_path / "j.jsonl", [good, good | change]))
    with pytest.raises(JudgementsError, match="no judgement"):
        judge_agreement(write(tmp_path / "j.jsonl", []))


def test_the_command(tmp_path, capsys):
    path = write(tmp_path / "j.jsonl", judgements())
    assert cli.run(["bench", "judges", str(path), "-o", str(tmp_path / "judges.json")]) == 0
    out = capsys.readouterr().out
    lines = out.splitlines()
    assert lines[1].split() == ["builder", *NAMES]
    assert lines[9:12] == [
        f"{36 * ITEMS} judgements: 0 ties, 0 both_bad, 0 failed; the score ties in 0",
        "own builds 45.83, others' 45.39; own above the others' mean for 3 of 6 builders",
        "astra: the same choice in - of 0 swapped items; chose the first shown in 47.8%",
    ]
    written = tmp_path / "judges.json"
    assert json.loads(written.read_text())["judgements"] == 36 * 2 * ITEMS
    written.write_text("mine")
    assert cli.run(["bench", "judges", str(path), "-o", str(written)]) == 2
    assert written.read_text() == "mine"
    assert cli.run(["bench", "judges", str(path), "-o", str(written), "--overwrite"]) == 0
    assert written.read_text() != "mine"


def test_ties_and_both_bad_count(tmp_path):
    answers = [("x", "x"), ("tie", "x"), (None, "tie"), ("tie", "tie"), ("both_bad", "tie"),
               ("both_bad", "y"), ("y", "tie"), ("failed", "x")]  # fmt: skip
    lines = [
        {"builder": "b", "judge": "j", "aspect": "appearance", "item": str(number),
         "shown": ["x", "y"], "chosen": chosen, "better": better}
        for number, (chosen, better) in enumerate(answers)
    ]  # fmt: skip
    found = judge_agreement(write(tmp_path / "j.jsonl", lines)).aspects["appearance"]
    assert found.matrix["b"]["j"] == Agreement(
        agreed=3, n=8, share=3 / 8, ties=3, both_bad=2, failed=1, score_ties=4
    )


def test_evaluations_say_what_is_better(tmp_path):
    scores = {
        "one": {"a.png": (0.5, 0.5), "b.png": (0.5, None)},
        "two": {"a.png": (0.5 + 9e-7, 0.500002), "b.png": (0.0, 0.1)},
    }

    def said(chosen, item="a.png", aspect="reconstruction", **more):
        return {"builder": "b", "judge": "j", "aspect": aspect, "item": item,
                "shown": ["one", "two"], "chosen": chosen, **more}  # fmt: skip

    lines = [said("tie"), said("two", aspect="appearance"), said("one", "b.png", better="one")]
    path = write(tmp_path / "j.jsonl", lines)
    found = judge_agreement(path, scores, {"one": "0" * 64})
    assert {a: f.matrix["b"]["j"].agreed for a, f in found.aspects.items()} == {
        "reconstruction": 2, "appearance": 1
    }  # fmt: skip
    assert found.evidence_sha256 == {"one": "0" * 64}
    for line, why in [
        (said("one", better="one"), "better 'one', but 'tie' by the evaluations"),
        (said("one", "c.png"), "one has no case 'c.png'"),
        (said("one", "b.png", "appearance"), "one has no appearance of 'b.png'"),
        (said("one") | {"shown": ["one", "three"]}, "no evaluation 'three'"),
    ]:
        with pytest.raises(JudgementsError, match=why):
            judge_agreement(write(tmp_path / "k.jsonl", [*lines, line]), scores)
    with pytest.raises(JudgementsError, match="neither `better` nor evaluations"):
        judge_agreement(path)
