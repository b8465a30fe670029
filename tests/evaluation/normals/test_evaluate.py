"""Runs of normals through evaluate, evidence verify, compare and report."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from evaluation.normals.folders import evaluate, wall, write_run, write_truth

from legoworld import cli
from legoworld.depth_files.errors import DepthFileError
from legoworld.errors import LegoWorldError
from legoworld.evaluation.evidence import verify
from legoworld.evaluation.normals.arrays import Declaration, NormalsTruthError, read_normals
from legoworld.evaluation.normals.family import normals_metrics, short_normals
from legoworld.evaluation.pixels import evaluate as pixels_evaluate
from legoworld.files import sha256_of_file
from legoworld.readouts.normals import NORMALS_FILE
from legoworld.records.base import decode
from legoworld.records.normals import NormalsSummary
from legoworld.workers.tasks import WorkerPool

SIZE = (8, 4)
NAMES = ("a.png", "b.png", "c.png")


@pytest.fixture
def truth(tmp_path):
    arrays = {name: wall(SIZE) for name in NAMES}
    arrays["b.png"][:2] = 0
    return write_truth(tmp_path / "truth", arrays)


@pytest.fixture
def run(tmp_path):
    arrays = {"a.png": wall(SIZE, 10), "b.png": wall(SIZE, 20), "c.png": np.empty(0)}
    arrays["a.png"][0] = np.nan
    return write_run(tmp_path / "run", arrays)


def test_pixels_are_pooled_and_images_are_averaged(run, truth, tmp_path):
    summary = evaluate(run, truth, tmp_path / "evaluation")
    assert (summary.coverage.attempted, summary.coverage.scored) == (3, 2)
    # 24 pixels at 10 degrees and 8 holes; 16 pixels at 20 degrees.
    assert (summary.pooled_px, summary.predicted_px) == (48, 40)
    assert summary.pooled["mean_deg"]["exclude"] == pytest.approx((240 + 320) / 40, abs=1e-5)
    assert summary.pooled["mean_deg"]["error_90"] == pytest.approx((560 + 720) / 48, abs=1e-5)
    errors = [np.degrees(np.arccos(np.float64(np.cos(np.radians(x))))) for x in (10, 20)]
    assert summary.pooled["median_deg"]["exclude"] == pytest.approx(errors[0], abs=1e-5)
    assert summary.pooled["median_deg"]["error_90"] == pytest.approx(sum(errors) / 2, abs=1e-5)
    assert summary.pooled["below_11_25"] == {"fails": 0.5, "exclude": 0.6}
    assert summary.metrics["mean_deg"]["exclude"] == pytest.approx(15, abs=1e-5)
    assert summary.metrics["mean_deg"]["error_90"] == pytest.approx((30 + 20) / 2, abs=1e-5)
    assert summary.all_attempted.mean_deg["exclude"] == pytest.approx((30 + 90) / 3, abs=1e-5)
    assert summary.bootstrap.unit == "image"
    assert summary.intervals["mean_deg"]["exclude"].low == pytest.approx(10, abs=1e-5)


def test_two_workers_write_the_same_bytes(run, truth, tmp_path, monkeypatch):
    monkeypatch.setattr("legoworld.evaluation.pixels.evaluate._FEW_BYTES", 0)
    evaluate(run, truth, tmp_path / "one")
    evaluate(run, truth, tmp_path / "two", pool=WorkerPool(workers=2))
    files = {p.relative_to(tmp_path / "one") for p in (tmp_path / "one").rglob("*") if p.is_file()}
    assert {str(name) for name in files} >= {"summary.json", "per_image.jsonl", "view/1.json"}
    for name in files:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_an_array_that_changes_between_the_readings_ends_scoring(run, truth, tmp_path, monkeypatch):
    original = pixels_evaluate.scored_images
    readings = []

    def scored(tasks, pool):
        readings.append(tasks)
        if len(readings) == 2:
            other = wall(SIZE, 11).astype(np.float32)
            NORMALS_FILE.write(run / "normals/a.npz", other, {})
        return original(tasks, pool)

    monkeypatch.setattr(pixels_evaluate, "scored_images", scored)
    with pytest.raises(LegoWorldError, match="changed while it was scored"):
        evaluate(run, truth, tmp_path / "evaluation")
    assert not (tmp_path / "evaluation/summary.json").exists()


def rewritten(folder, name, change):
    """Change the first object of a file of an evaluation, and its hash with it; what is seen."""
    lines = (folder / name).read_text().splitlines() if name.endswith("l") else None
    first = json.loads(lines[0] if lines else (folder / name).read_text())
    change(first)
    (folder / name).write_text("\n".join([json.dumps(first), *(lines or [""])[1:]]) + "\n")
    evidence = json.loads((folder / "evidence.json").read_text())
    evidence["files"][name] = sha256_of_file(folder / name)
    (folder / "evidence.json").write_text(json.dumps(evidence))
    return [check.what for check in verify(folder, None) if check.status != "ok"]


def test_an_altered_number_is_seen_from_the_rows_and_the_arrays(run, truth, tmp_path):
    folder = tmp_path / "evaluation"
    evaluate(run, truth, folder)
    assert cli.run(["evidence", "verify", str(folder)]) == 0
    was = json.loads((folder / "summary.json").read_text())["pooled"]["median_deg"]

    def median(exclude):
        return lambda summary: summary["pooled"]["median_deg"].update(exclude=exclude)

    seen = rewritten(folder, "summary.json", median(10.02))
    assert seen == ["pooled from the rows"]
    assert rewritten(folder, "summary.json", median(was["exclude"])) == []
    counts = lambda row: row["errors"]["counts"].append(0)  # noqa: E731  no number depends on it
    assert rewritten(folder, "per_image.jsonl", counts) == ["row of image 1"]


def test_two_evaluations_are_compared_and_shown(run, truth, tmp_path):
    other = write_run(tmp_path / "other", {name: wall(SIZE, 40) for name in NAMES}, kind="import")
    folders = []
    for folder in (run, other):
        folders.append(str(tmp_path / f"{folder.name}-evaluation"))
        evaluate(folder, truth, tmp_path / f"{folder.name}-evaluation")
    output = tmp_path / "comparison"
    assert cli.run(["compare", *folders, "-o", str(output)]) == 0
    assert '"mean_deg.error_90"' in (output / "comparison.json").read_text()
    page = tmp_path / "page.html"
    assert cli.run(["report", *folders, "-o", str(page)]) == 0
    assert "All pixels pooled" in page.read_text()


def test_normals_that_point_the_other_way_are_refused_with_advice(truth, tmp_path):
    turned = {name: -wall(SIZE, 10) for name in NAMES} | {"b.png": wall(SIZE, 100)}
    summary = evaluate(write_run(tmp_path / "run", turned), truth, tmp_path / "evaluation")
    assert summary.coverage.by_status == {"invalid": 2, "ok": 1}
    reason = summary.not_scored[0].reason
    assert "170.0 degrees, and of 10.0 turned around" in reason
    assert "sign = away_from_camera" in reason


def test_truth_without_a_sign_or_an_image_is_refused(run, tmp_path):
    arrays = {name: wall(SIZE) for name in NAMES}
    unsigned = write_truth(tmp_path / "unsigned", arrays, sign=None)
    with pytest.raises(DepthFileError, match="which way"):
        evaluate(run, unsigned, tmp_path / "evaluation")
    lacking = write_truth(tmp_path / "lacking", {"a.png": wall(SIZE)})
    with pytest.raises(NormalsTruthError, match="lacks the normals of 2 of 3 images"):
        evaluate(run, lacking, tmp_path / "evaluation")
    (lacking / "normals.toml").write_text('sign = "up"\n')
    with pytest.raises(NormalsTruthError, match="sign = 'up'"):
        evaluate(run, lacking, tmp_path / "evaluation")


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_png_holds_red_green_blue_and_zeros_where_nothing_is_known(dtype, tmp_path):
    most = np.iinfo(dtype).max
    red_green_blue = np.zeros((1, 3, 3), dtype)
    red_green_blue[0, 0] = most // 2, 0, most // 2
    red_green_blue[0, 1] = most // 2, most // 2, most // 2
    cv2.imwrite(str(tmp_path / "a.png"), red_green_blue[..., ::-1])
    array = read_normals(tmp_path / "a.png", Declaration(sign="away_from_camera"))
    units, known = array.at(np.array([0, 0, 0]), np.array([0, 1, 2]))
    assert known.tolist() == [True, False, False]
    assert units[0] == pytest.approx([0, 1, 0], abs=0.01)


@pytest.mark.parametrize(
    "values", [np.zeros((4, 8)), np.zeros((4, 8, 4)), np.zeros((4, 8, 3), np.int64)]
)
def test_an_array_of_another_shape_or_type_is_refused(values, tmp_path):
    np.save(tmp_path / "a.npy", values)
    with pytest.raises(DepthFileError, match=r"\(height, width, 3\)"):
        read_normals(tmp_path / "a.npy", Declaration(sign="towards_camera"))


def test_a_sign_that_a_file_and_the_folder_state_differently_is_refused(tmp_path):
    np.savez(tmp_path / "a.npz", values=wall(SIZE), sign=np.array("away_from_camera"))
    assert read_normals(tmp_path / "a.npz", Declaration()).sign == "away_from_camera"
    with pytest.raises(DepthFileError, match="sign"):
        read_normals(tmp_path / "a.npz", Declaration(sign="towards_camera"))


def test_what_is_read_of_a_file_is_its_array_its_type_and_its_shape(tmp_path):
    np.save(tmp_path / "a.npy", wall(SIZE)[None].astype(">f4"))
    read = read_normals(tmp_path / "a.npy", Declaration(sign="away_from_camera"))
    assert read.values.shape == (4, 8, 3)
    assert read.values.dtype == np.dtype("=f4")
    np.savez(tmp_path / "a.npz", normals=wall(SIZE), format_version=np.array(1),
             sign=np.array("away_from_camera"))  # fmt: skip
    read = read_normals(tmp_path / "a.npz", Declaration())
    assert (read.stored.array, read.stored.dtype) == ("normals", "float64")
    assert read.stored.shape == (4, 8, 3)
    np.savez(tmp_path / "a.npz", normals=wall(SIZE), format_version=np.array(99))
    with pytest.raises(DepthFileError, match="unknown format version"):
        read_normals(tmp_path / "a.npz", Declaration(sign="away_from_camera"))
    np.save(tmp_path / "b.npy", np.stack([wall(SIZE)] * 2))
    with pytest.raises(DepthFileError, match=r"shape \(2, 4, 8, 3\)"):
        read_normals(tmp_path / "b.npy", Declaration(sign="away_from_camera"))


@pytest.mark.parametrize(("known", "status"), [(10, "ok"), (9, "invalid")])
def test_ten_known_pixels_are_enough(known, status, tmp_path):
    values = wall(SIZE).reshape(-1, 3)
    values[known:] = np.nan
    run = write_run(tmp_path / "run", {"a.png": values.reshape(wall(SIZE).shape)})
    truth = write_truth(tmp_path / "truth", {"a.png": wall(SIZE)})
    evaluate(run, truth, tmp_path / "evaluation")
    row = json.loads((tmp_path / "evaluation/per_image.jsonl").read_text())
    assert row["status"] == status


def test_an_evaluation_s_lines_to_the_last_word(run, truth, tmp_path, capsys):
    evaluate(run, truth, tmp_path / "evaluation")
    summary = decode(NormalsSummary, (tmp_path / "evaluation/summary.json").read_bytes())
    first, pixels, *_ = short_normals(summary).splitlines()
    assert first.endswith(": 3 images attempted, 2 scored, 3 with truth")
    shown = pixels.removeprefix("48 pixels pooled: ").split(", ")
    names = [text.split(" ")[0] for text in shown]
    assert names[:3] == ["mean_deg", "median_deg", "rmse_deg"]
    assert {*names[3:]} == {f"below_{x}" for x in ("5", "7_5", "11_25", "22_5", "30")}
    assert shown[1].endswith(f" {summary.pooled['median_deg']['error_90']:.3f}"), shown
    pooled, means = normals_metrics(summary)
    assert (pooled.title, means.title) == ("All pixels pooled", "Means over images")
    assert "error_90 (primary) counts each as 90 degrees" in pooled.note
    assert means.note == ""
    over = {(row.name, row.policy): row.over for row in pooled.rows}
    assert over["mean_deg", "error_90"] == "48 pixels"
    assert over["mean_deg", "exclude"] == over["below_5", "exclude"] == "40 pixels"
    assert over["below_5", "fails"] == "48 pixels"
