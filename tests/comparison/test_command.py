"""`legoworld compare` and `legoworld evidence verify` as they are called."""

from __future__ import annotations

import csv
import json
import re
import shutil
import subprocess
import sys

import pytest
from comparison.evaluations import (
    bad,
    change_json,
    compare,
    depth_scene_and_baseline,
    forge,
    row_of,
    scene_and_baseline,
)

from legoworld import cli
from legoworld.comparison.folder import read_document
from legoworld.comparison.tables import coverage_table, headline_table
from legoworld.comparison.verification import verify_comparison
from legoworld.tables.table import line as spelt


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """Evaluations of a scene and a baseline, coco."""
    return scene_and_baseline(tmp_path_factory.mktemp("pair"), "coco")


@pytest.fixture(scope="module")
def depth_pair(tmp_path_factory):
    return depth_scene_and_baseline(tmp_path_factory.mktemp("depth"))


def call(*arguments):
    return cli.run(["compare", *map(str, arguments), "--draws", "30"])


def test_two_tables_on_standard_output_and_six_in_the_folder(pair, tmp_path, capsys):
    out = tmp_path / "out"
    assert call(*pair, "-o", out, "-v") == 0
    shown = capsys.readouterr()
    assert shown.err == "30 bootstrap samples of scene and specialist\n"
    attempted, paired_block, coverage, notes = shown.out.split("\n\n")[:4]
    document = json.loads((out / "comparison.json").read_text())
    paired = document["pairs"][0]["coverage"]["paired"]
    titles = ("coco, 12 attempted images: ", f"coco, {paired} paired images: ")
    for block, title in zip((attempted, paired_block), titles, strict=True):
        lines = block.splitlines()
        assert lines[0] == f"{title}scene and specialist"
        assert lines[1].split() == ["metric", "scene", "specialist", "difference"]
        assert sum(line[0] != " " for line in lines[3:]) == 15
    row = coverage.splitlines()[2].split()
    assert row[:3] == ["coco", "12", str(document["pairs"][0]["coverage"]["with_truth"])]
    assert "scene: missing (1)" in coverage
    assert "specialist: failed (1)" in coverage
    notes = " ".join(notes.split())
    assert "30 bootstrap samples over images, shared by both methods, seed 0" in notes
    assert "specialist ranked by own scores, scene equally confident" in notes
    names = {f"{a}.{b}" for a in ("table", "coverage") for b in ("md", "tex", "csv")}
    assert {p.name for p in out.iterdir()} == {*names, "comparison.json", "evidence.json"}
    assert len((out / "table.md").read_text().splitlines()) >= 2 + 30


@pytest.mark.parametrize("task", ["coco", "eth3d"])
def test_without_v_each_headline_metric_has_a_verdict(task, pair, depth_pair, tmp_path, capsys):
    out = tmp_path / "out"
    assert call(*(pair if task == "coco" else depth_pair), "-o", out) == 0
    lines = capsys.readouterr().out.splitlines()
    (one,) = json.loads((out / "comparison.json").read_text())["pairs"]
    coverage = one["coverage"]
    verdict, lines = lines[: lines.index("")], lines[lines.index("") + 1 :]
    first = next(r for r in one["rows"] if r["level"] == 1 and r["images"] == "paired")
    sentence = " ".join(verdict)
    assert sentence.startswith("Scene boxes: AP " if task == "coco" else "Scene depth: AbsRel ")
    assert f" {first['scene']['value']:.3f} [" in sentence
    assert f"{coverage['paired']} of {coverage['attempted']} images paired: " in sentence
    assert lines[0] == (
        f"{task}: {one['scene']} against {one['baseline']}, "
        f"{coverage['paired']} paired of {coverage['attempted']} attempted images"
    )
    rows = [r for r in one["rows"] if r["level"] == 1 and r["images"] == "paired"]
    assert len(rows) >= 1
    for line, row in zip(lines[3:], rows, strict=False):
        assert line.split()[0] == row["metric"]
        assert f"{row['scene']['value']:.3f}" in line
        assert f"{row['difference']['value']:+.3f}" in line
        low, high = (row["difference"]["interval"][k] for k in ("low", "high"))
        gain = low > 0 if row["better"] == "higher" else high < 0
        loss = high < 0 if row["better"] == "higher" else low > 0
        word = "better" if gain else "worse" if loss else "undecided"
        assert line.endswith(f"  {word}")
    assert any(line.startswith("not paired in ") for line in lines)
    assert lines[-2] == f"-> {out}"
    assert lines[-1] == f"look at it: legoworld report {out} --photos PHOTOS -o report.html"
    assert max(map(len, lines[:-2])) <= 100


def shown_numbers(text: str) -> list[str]:
    """Every number and word of a terminal's tables, sorted: order and layout left out."""
    return sorted(re.sub(r"[,:\[\]()]", " ", text).split())


@pytest.mark.parametrize("which", ["two", "three", "depth", "joined", "long names"])
def test_the_terminal_has_100_columns_and_every_number(which, pair, depth_pair, tmp_path, capsys):
    out = tmp_path / "out"
    sides = [*pair]
    if which in ("three", "long names"):
        sides += [tmp_path / "other"]
        shutil.copytree(pair[1], sides[-1])
        name = "third" if which == "three" else " ".join(["a detector of many letters"] * 5)
        forge(
            sides[-1],
            "view/run.json",
            lambda p: change_json(p, lambda run: run["configuration"].update(baseline=name)),
        )
    if which == "depth":
        sides = [*depth_pair]
    if which == "joined":
        compare(pair, tmp_path / "one", draws=30)
        compare(depth_pair, tmp_path / "two", draws=30)
        assert cli.run(["compare", "--join", str(tmp_path / "one"), str(tmp_path / "two"),
                        "-o", str(out), "-v"]) == 0  # fmt: skip
    else:
        assert call(*sides, "-o", out, "-v") == 0
    shown = capsys.readouterr().out
    text = shown[: shown.rindex("\n-> ")]
    assert max(map(len, text.splitlines())) <= 100
    document = read_document(out)
    headline, coverage = headline_table(document), coverage_table(document)
    words = set(shown_numbers(text))
    for table in (headline, coverage):
        for row in table.rows:
            missing = [cell for cell in row if not set(shown_numbers(spelt(cell))) <= words]
            assert not missing
    # Value by value: the cells of each metric, in its own lines.
    blocks = [b.splitlines() for b in text.split("\n\n")]
    lines = [text for b in blocks for text in b if "↑" in text or "↓" in text]
    assert len(lines) == len(headline.rows)
    for first, row in zip(lines, headline.rows, strict=True):
        values = row[2:5] if len(row) == 6 else [row[3], row[5], row[6]]
        assert first.split()[:2] == row[1].split()
        assert first.split()[2:] == [str(value) for value in values]
        below = text[text.index(first) + len(first) :]
        assert all(value.interval_text in below.split("\n")[1] for value in values)


def test_the_json_form_is_the_file(pair, tmp_path, capsys):
    assert call(*pair, "-o", tmp_path / "out", "--json") == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["schema_version"] == 1
    assert shown["below_threshold"] == []
    assert shown["comparison"] == json.loads((tmp_path / "out" / "comparison.json").read_text())


def test_the_csv_has_every_row_unrounded(pair, tmp_path):
    document = compare(pair, tmp_path / "out")
    with (tmp_path / "out" / "table.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    expected = document["pairs"][0]["rows"]
    assert len(rows) == len(expected) > 60
    for row, one in zip(rows, expected, strict=True):
        assert (row["metric"], row["images"]) == (one["metric"], one["images"])
        for side in ("scene", "baseline", "difference"):
            value = one[side]["value"]
            assert row[f"{side}_value"] == ("" if value is None else repr(value))
            interval = one[side]["interval"] or {"low": None}
            assert row[f"{side}_low"] == ("" if interval["low"] is None else repr(interval["low"]))
        assert row["scene_over_images"] == str(one["scene"]["over"]["images"])


def test_thresholds_trip_with_code_three_and_still_write(pair, tmp_path, capsys):
    out = tmp_path / "out"
    document = compare(pair, tmp_path / "first", draws=30)
    attempted, paired = (
        row_of(document, "AP", images)["difference"]["value"] for images in ("attempted", "paired")
    )
    assert attempted != paired
    for name, value in (("AP", attempted), ("paired.AP", paired)):
        assert call(*pair, "-o", out, "--fail-below", f"{name}={value}") == 0
        capsys.readouterr()
        assert call(*pair, "-o", out, "--fail-below", f"{name}={value + 1e-9}") == 3
        shown = capsys.readouterr()
        images = "paired" if "." in name else "attempted"
        assert f"AP over {images} images: gain over specialist {value:+.4f}" in shown.err
        assert "-> " in shown.out
    assert (out / "evidence.json").is_file()
    both = ["--fail-below", "AP=-1", "--fail-below", "AP50=1"]
    assert call(*pair, "-o", out, *both) == 3
    assert "AP50" in capsys.readouterr().err


def test_an_undefined_gain_never_passes(pair, tmp_path, capsys):
    """Three images of large things: AP of small ones has no value."""
    from comparison.evaluations import evaluate
    from evaluation.detection_runs import random_predictions, random_truth

    truth = random_truth("coco", seed=6)
    truth["annotations"] = [a for a in truth["annotations"] if a["area"] > 32**2]
    sides = [
        evaluate(tmp_path / k, "coco", truth, random_predictions("coco", truth, seed=1))
        for k in ("a", "b")
    ]
    assert call(*sides, "-o", tmp_path / "out", "--fail-below", "APs=-1") == 3
    assert "undefined" in capsys.readouterr().err


def test_an_error_gains_by_getting_smaller(depth_pair, tmp_path, capsys):
    out = tmp_path / "out"
    document = compare(depth_pair, tmp_path / "first", draws=30)
    row = row_of(document, "abs_rel.error_1", "attempted")
    assert row["better"] == "lower"
    loss = row["difference"]["value"]
    assert loss > 0.2  # the scene is worse
    assert call(*depth_pair, "-o", out, "--fail-below", f"abs_rel.error_1={-loss - 1e-9}") == 0
    assert call(*depth_pair, "-o", out, "--fail-below", f"abs_rel.error_1={-loss + 1e-9}") == 3
    paired = row_of(document, "rmse_m.exclude", "paired")["difference"]["value"]
    capsys.readouterr()
    assert call(*depth_pair, "-o", out, "--fail-below", f"rmse_m.exclude={-paired + 1e-9}") == 3
    assert "rmse_m.exclude over paired images" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("threshold", "message"),
    [
        ("APP=0", "nearest: AP"),
        ("abs_rel.error_1=0", "names no metric of this task"),
        ("AP", "METRIC=DELTA"),
        ("AP=much", "METRIC=DELTA"),
        ("AP=nan", "METRIC=DELTA"),
    ],
)
def test_a_threshold_that_means_nothing(pair, tmp_path, threshold, message, capsys):
    assert call(*pair, "-o", tmp_path / "out", "--fail-below", threshold) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_refusals_are_one_line_and_code_two(pair, depth_pair, tmp_path, capsys):
    assert call(pair[0], depth_pair[0], "-o", tmp_path / "out") == 2
    shown = capsys.readouterr()
    assert shown.err.count("\n") == 1
    assert "task coco and eth3d" in shown.err
    assert shown.out == ""
    assert call(pair[0], "-o", tmp_path / "out") == 2


@pytest.mark.parametrize("task", ["coco", "eth3d"])
def test_a_fresh_comparison_holds(task, pair, depth_pair, tmp_path, capsys):
    out = tmp_path / "out"
    compare(pair if task == "coco" else depth_pair, out, draws=30)
    checks = verify_comparison(out, None)
    assert not bad(checks)
    assert cli.run(["evidence", "verify", str(out)]) == 0
    assert f"{len(checks)} of {len(checks)} checks hold" in capsys.readouterr().out


def test_forged_comparisons_are_seen(pair, tmp_path, capsys):
    out = tmp_path / "out"

    def fresh():
        shutil.rmtree(out, ignore_errors=True)
        compare(pair, out, draws=30)

    fresh()
    with (out / "table.md").open("a") as stream:
        stream.write(" ")
    assert [c.what for c in bad(verify_comparison(out, None))] == ["file table.md"]
    fresh()
    forge(out, "table.md", lambda p: p.write_text(p.read_text().replace("scene", "winner")))
    assert [c.what for c in bad(verify_comparison(out, None))] == ["table.md from comparison.json"]
    fresh()

    def better(document):
        document["pairs"][0]["rows"][0]["scene"]["value"] += 1e-9

    forge(out, "comparison.json", lambda p: change_json(p, better))
    assert "numbers from the evaluations" in [c.what for c in bad(verify_comparison(out, None))]
    assert cli.run(["evidence", "verify", str(out)]) == 1
    assert ".pairs[0].rows[0].scene.value" in capsys.readouterr().out
    fresh()

    def no_number(document):
        for place in (0, 3):
            document["pairs"][0]["rows"][place]["scene"]["value"] = float("nan")

    forge(out, "comparison.json", lambda p: change_json(p, no_number))
    (wrong,) = bad(verify_comparison(out, None))
    assert "comparison.json cannot be read; found: not JSON: NaN" in wrong.found
    fresh()
    change_json(out / "evidence.json", lambda e: e["pairs"][0]["paired_image_ids"].pop())
    assert [c.what for c in bad(verify_comparison(out, None))] == ["paired images and numbers"]
    fresh()
    change_json(out / "evidence.json", lambda e: e["methods"][0]["raw"]["official"].reverse())
    assert [c.what for c in bad(verify_comparison(out, None))] == ["raw numbers of the evaluations"]


def test_evaluations_that_moved_are_found_below_a_root(tmp_path):
    scene_and_baseline(tmp_path, "coco")
    sides = (tmp_path / "scene" / "eval", tmp_path / "baseline" / "eval")
    compare(sides, tmp_path / "out", draws=10)
    (tmp_path / "deep" / "er").mkdir(parents=True)
    for name in ("scene", "baseline"):
        shutil.move(tmp_path / name, tmp_path / "deep" / "er" / name)
    assert {c.status for c in bad(verify_comparison(tmp_path / "out", None))} == {"MISSING"}
    assert not bad(verify_comparison(tmp_path / "out", tmp_path / "deep" / "er"))


def test_evidence_holds_both_sides_raw_numbers_and_exports(pair, tmp_path):
    document = compare(pair, tmp_path / "out")
    evidence = json.loads((tmp_path / "out" / "evidence.json").read_text())
    for method, folder in zip(evidence["methods"], pair, strict=True):
        own = json.loads((folder / "evidence.json").read_text())
        assert method["raw"] == own["raw"]
        assert method["equal_confidence"] == own["equal_confidence"]
        assert {"role": "truth", "sha256": own["inputs"][0]["sha256"]} in method["inputs"]
    found = evidence["pairs"][0]
    assert found["dropped"] == document["pairs"][0]["dropped"]
    row = row_of(document, "equal_confidence.AP", "paired")
    assert found["paired_metrics"]["equal_confidence.AP"] == {
        side: row[side]["value"] for side in ("scene", "baseline", "difference")
    }
    roles = {entry["role"] for entry in evidence["inputs"]}
    assert roles == {"evaluation 0", "evaluation 1"}


def test_comparing_starts_neither_blender_nor_an_evaluator(pair, tmp_path):
    program = (
        "import sys; from legoworld.cli import run;"
        f"assert run(['compare', {str(pair[0])!r}, {str(pair[1])!r}, '-o',"
        f" {str(tmp_path / 'out')!r}, '--draws', '5']) == 0;"
        "bad = {'bpy', 'torch', 'cv2', 'matplotlib', 'pycocotools.cocoeval', 'hotcoco', 'lvis',"
        " 'legoworld.visibility.kernel', 'legoworld.scene.blender_process'} & set(sys.modules);"
        " assert not bad, bad"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
