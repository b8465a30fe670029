"""`legoworld evaluate` of a bench run: zeros and statuses, hashes, resume, workers, evidence."""

from __future__ import annotations

import json
import os
from collections import Counter

import numpy as np
import pytest
from evaluation.reconstruction import datasets
from evaluation.reconstruction.datasets import (
    OK,
    VALID,
    Submission,
    evaluate_bench,
    sha256,
    write_dataset,
    write_run,
)
from msgspec.structs import replace

from legoworld import cli
from legoworld.errors import ConfigurationMismatchError, UsageError
from legoworld.evaluation.evidence import verify
from legoworld.evaluation.reconstruction import case_tasks
from legoworld.evaluation.reconstruction.dataset import BenchTruthError
from legoworld.evaluation.run import RunUnusableError
from legoworld.records.submission import Check
from legoworld.workers.tasks import WorkerPool


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return write_dataset(tmp_path_factory.mktemp("bench"), views=2)


def evaluated(dataset, run, output, **options):
    summary = evaluate_bench(run, dataset.private, output, draws=100, **options)
    rows = [json.loads(line) for line in (output / "per_image.jsonl").read_text().splitlines()]
    return summary, {row["image_id"]: row for row in rows}


def test_the_reference_submitted_as_itself(dataset, tmp_path):
    run = write_run(tmp_path / "run", dataset)
    summary, rows = evaluated(dataset, run, tmp_path / "eval")
    for name in ("V", "R", "A", "S", "R_valid", "F2", "F10", "F_5cm", "F_10cm"):
        assert summary.metrics[name].value == 1.0, name
    assert summary.metrics["S"].n == 8
    for row in rows.values():
        assert {o["f1"] for o in row["objects"] if o["eligible"]} == {1.0}
        beside = row["diagnostics"]
        assert beside["chamfer_l1_half_sum_over_reference_visible_box_diagonal"] == 0
        assert beside["voxel_iou_5cm"] == beside["R_rigid"] == beside["R_median_scale"] == 1
        assert beside["voxel_iou_5_percent_of_median_depth"] == 1  # of the pixels that show any
        assert row["fov_error_deg"] == row["camera"]["fov_deg"] == 0
        assert row["camera"]["world_translation_m"] == 0
        assert row["flags"] == []
    assert not summary.flags


def test_what_was_not_made_counts_zero_by_name_and_stays_in_the_denominator(dataset, tmp_path):
    broken = replace(VALID, scene_glb=Check(ok=False, found="empty", expected="a mesh"))
    submissions = {1: Submission(status="missing"), 2: Submission(status="timeout"),
                   3: Submission(validity=broken)}  # fmt: skip
    run = write_run(tmp_path / "run", dataset, submissions)
    summary, rows = evaluated(dataset, run, tmp_path / "eval")
    assert summary.metrics["S"].value == pytest.approx(5 / 8)
    assert (summary.metrics["V"].n, summary.metrics["S_valid"].n) == (8, 5)
    assert summary.metrics["S_valid"].value == 1.0
    assert summary.coverage.by_status == {"missing": 1, "ok": 6, "timeout": 1}
    assert [(n.image_id, n.status) for n in summary.not_scored] == [
        (1, "missing"), (2, "timeout"), (3, "not_valid"),
    ]  # fmt: skip
    assert summary.not_scored[2].reason == "empty"
    for image_id in (1, 2, 3):
        row = rows[image_id]
        assert (row["valid"], row["R"], row["A"], row["S"]) == (False, 0, 0, 0)
    assert rows[3]["validity"]["scene_glb"]["expected"] == "a mesh"
    assert rows[3]["objects"]  # what was found is kept beside the zeros
    assert rows[3]["diagnostics"]["R_rigid"] == 1
    assert summary.diagnostics["R_rigid"].n == 5  # and enters no mean
    easy = summary.groups.tier["easy"].metrics
    assert (easy["S"].value, easy["S"].n, easy["S_valid"].n) == (0.5, 4, 2)


def test_low_quality_is_not_invalid(dataset, tmp_path):
    far = {i: Submission(depth_z_m=np.full_like(c.depth_z_m, 50.0), render=255 - c.render)
           for i, c in dataset.cases.items()}  # fmt: skip
    nothing = Submission(depth_z_m=np.full_like(dataset.cases[1].depth_z_m, np.inf))
    run = write_run(tmp_path / "run", dataset, far | {1: nothing})
    summary, rows = evaluated(dataset, run, tmp_path / "eval")
    assert summary.metrics["V"].value == 1.0
    assert summary.metrics["R"].value == 0.0
    assert rows[1]["diagnostics"]["R_rigid"] is None
    assert rows[1]["diagnostics"]["chamfer_l1_half_sum_over_reference_visible_box_diagonal"] is None


def test_without_a_render_there_is_r_alone(dataset, tmp_path):
    run = write_run(tmp_path / "run", dataset,
                    {i: Submission(no_render=True) for i in dataset.cases})  # fmt: skip
    summary, rows = evaluated(dataset, run, tmp_path / "eval")
    assert summary.metrics["R"].value == 1.0
    assert summary.metrics["A"].value is summary.metrics["S"].value is None
    assert rows[1]["A"] is rows[1]["S"] is rows[1]["appearance"] is None


def test_a_is_the_share_of_pixels_within_delta(dataset, tmp_path):
    render = dataset.cases[1].render.astype(int)
    sign = np.where(render > 127, -1, 1)
    exactly, beyond = render.copy(), render.copy()
    exactly[:, :, 1] += 30 * sign[:, :, 1]
    beyond[:9, :, 2] += 31 * sign[:9, :, 2]
    run = write_run(tmp_path / "one", dataset, {1: Submission(render=np.uint8(exactly))})
    _, rows = evaluated(dataset, run, tmp_path / "eval1")
    assert rows[1]["A"] == 1.0
    assert rows[1]["appearance"]["curve"]["25"] == 0.0
    run = write_run(tmp_path / "two", dataset, {1: Submission(render=np.uint8(beyond))})
    _, rows = evaluated(dataset, run, tmp_path / "eval2")
    assert rows[1]["A"] == 0.5
    assert rows[1]["S"] == (rows[1]["R"] + 0.5) / 2


def test_a_is_split_by_whether_the_geometry_agrees(dataset, tmp_path):
    case = dataset.cases[1]
    depth, render = case.depth_z_m.copy(), case.render.copy()
    depth[:, :24] = 40  # the left half is elsewhere, and of another colour
    render[:, :16] = 255 - render[:, :16]
    run = write_run(tmp_path / "run", dataset, {1: Submission(depth_z_m=depth, render=render)})
    _, rows = evaluated(dataset, run, tmp_path / "eval")
    seen = rows[1]["appearance"]
    assert seen["where_geometry_agrees"] == 1.0
    assert seen["where_geometry_differs"] < 0.5
    assert seen["n_geometry_agrees_px"] + seen["n_geometry_differs_px"] == seen["n_px"] == 32 * 18


def test_a_file_of_the_run_that_changed_is_that_case_s_zero(dataset, tmp_path):
    run = write_run(tmp_path / "run", dataset)
    (run / "surface" / "room0__easy__view_00.npz").write_bytes(b"PK")
    (run / "render" / "room0__hard__view_00.png").unlink()
    summary, rows = evaluated(dataset, run, tmp_path / "eval")
    assert summary.coverage.by_status == {"changed": 2, "ok": 6}
    assert "not the one the run wrote" in rows[1]["reason"]
    assert "cannot be read" in rows[2]["reason"]


@pytest.mark.parametrize(
    ("arrays", "what"),
    [
        ({"depth_z_m": np.zeros((3, 3), np.float32)}, "shape"),
        ({"depth_z_m": np.array([None, {}], object)}, "cannot be used"),
    ],
)
def test_a_surface_that_is_none_is_that_case_s_zero(dataset, tmp_path, arrays, what):
    submission = Submission(extra=arrays)
    run = write_run(tmp_path / "run", dataset, {1: submission})
    _, rows = evaluated(dataset, run, tmp_path / "eval")
    assert (rows[1]["status"], rows[1]["S"]) == ("changed", 0)
    assert what in rows[1]["reason"]


def test_code_in_a_surface_file_does_not_run(dataset, tmp_path):
    class Planted:
        def __reduce__(self):
            return os.mkdir, (str(tmp_path / "ran"),)

    planted = np.full(dataset.cases[1].depth_z_m.shape, None, object)
    planted[0, 0] = Planted()
    run = write_run(tmp_path / "run", dataset, {1: Submission(extra={"plane": planted})})
    _, rows = evaluated(dataset, run, tmp_path / "eval")
    assert not (tmp_path / "ran").exists()
    assert (rows[1]["status"], rows[1]["S"]) == ("changed", 0)


def test_nan_and_huge_depths_are_no_points_or_far_points(dataset, tmp_path):
    case = dataset.cases[1]
    depth = case.depth_z_m.copy()
    depth[::2] = np.nan
    depth[1::4] = 3e38
    run = write_run(tmp_path / "run", dataset, {1: Submission(depth_z_m=depth)})
    summary, rows = evaluated(dataset, run, tmp_path / "eval")
    assert 0 < rows[1]["R"] < 1
    assert "NaN" not in (tmp_path / "eval" / "per_image.jsonl").read_text()
    assert summary.metrics["S"].value is not None


def test_an_evaluator_error_is_tried_again_and_then_zero_by_name(dataset, tmp_path, monkeypatch):
    run = write_run(tmp_path / "run", dataset)
    scored, tried = case_tasks.score_case, []

    def sometimes(task):
        tried.append(task.row.image_id)
        if task.row.image_id == 1:
            raise ZeroDivisionError("a defect")
        return scored(task)

    monkeypatch.setattr(case_tasks, "score_case", sometimes)
    # The second attempt is in a fresh process, where the defect is gone.
    _, rows = evaluated(dataset, run, tmp_path / "eval1")
    assert rows[1]["status"] == "ok"
    assert tried.count(1) == 1
    monkeypatch.setattr(
        case_tasks, "_again", lambda _: case_tasks.CaseResult(row=None, error="ZeroDivisionError")
    )
    summary, rows = evaluated(dataset, run, tmp_path / "eval2")
    assert (rows[1]["status"], rows[1]["S"]) == ("evaluator_error", 0)
    assert summary.coverage.by_status == {"evaluator_error": 1, "ok": 7}


class TestRefusals:
    """Nothing is scored against the wrong private half."""

    def test_another_dataset_s_private_half(self, dataset, tmp_path):
        other = write_dataset(tmp_path / "other", views=2, seed=1, tiers=("easy", "medium"))
        run = write_run(tmp_path / "run", dataset)
        with pytest.raises(BenchTruthError, match="another dataset"):
            evaluate_bench(run, other.private, tmp_path / "eval")

    def test_a_track_edited_by_hand(self, tmp_path):
        dataset = write_dataset(tmp_path / "bench")
        run = write_run(tmp_path / "run", dataset)
        track = dataset.root / "public" / "track.json"
        track.write_text(track.read_text().replace('"indoor"', '"in door"'))
        with pytest.raises(BenchTruthError, match="track was edited"):
            evaluate_bench(run, dataset.private, tmp_path / "eval")
        assert not (tmp_path / "eval").exists()

    @pytest.mark.parametrize("kind", ["raster", "reference"])
    def test_a_private_file_that_changed(self, tmp_path, kind):
        dataset = write_dataset(tmp_path / "bench")
        run = write_run(tmp_path / "run", dataset)
        path = {
            "raster": dataset.private / "raster" / "room0__easy__view_00.npz",
            "reference": dataset.root / "public" / "images" / "room0__easy__view_00.png",
        }[kind]
        path.write_bytes(path.read_bytes() + b" ")
        with pytest.raises(BenchTruthError, match="on record"):
            evaluate_bench(run, dataset.private, tmp_path / "eval")

    @pytest.mark.parametrize("name", ["depth_z_m", "instance"])
    def test_a_stored_raster_of_another_size(self, tmp_path, name):
        dataset = write_dataset(tmp_path / "bench")
        run = write_run(tmp_path / "run", dataset)
        path = dataset.private / "raster" / "room0__easy__view_00.npz"
        recorded = sha256(path)
        with np.load(path) as stored:
            arrays = dict(stored)
        np.savez(path, **{**arrays, name: arrays[name][1:]})
        truth = dataset.private / "truth.json"
        truth.write_text(truth.read_text().replace(recorded, sha256(path)))
        with pytest.raises(BenchTruthError, match="is of another size"):
            evaluate_bench(run, dataset.private, tmp_path / "eval")

    def test_no_dataset_at_all(self, dataset, tmp_path):
        run = write_run(tmp_path / "run", dataset)
        with pytest.raises(BenchTruthError, match="cannot be read"):
            evaluate_bench(run, tmp_path, tmp_path / "eval")

    def test_a_run_that_lost_a_row(self, dataset, tmp_path):
        run = write_run(tmp_path / "run", dataset)
        rows = (run / "per_image.jsonl").read_text().splitlines(keepends=True)
        (run / "per_image.jsonl").write_text("".join(rows[1:]))
        with pytest.raises(RunUnusableError, match="does not cover"):
            evaluate_bench(run, dataset.private, tmp_path / "eval")

    @pytest.mark.parametrize("sampling", ["", "some", "random", "random:-1", "random:1.5"])
    def test_a_sampling_that_is_none(self, dataset, tmp_path, sampling):
        run = write_run(tmp_path / "run", dataset)
        with pytest.raises(UsageError, match="raster, all or random:SEED"):
            evaluate_bench(
                run, dataset.private, tmp_path / "eval", options={"reference_sampling": sampling}
            )

    def test_options_of_other_tasks(self, dataset, tmp_path, capsys):
        run = write_run(tmp_path / "run", dataset)
        words = ["evaluate", str(run), "--truth", str(dataset.private), "-o", str(tmp_path / "e")]
        for option in (["--evaluator", "fast"], ["--camera-model", "dataset"]):
            assert cli.run([*words, *option]) == 2
            assert option[0] in capsys.readouterr().err


def test_the_same_again_is_the_same_bytes_for_any_workers(dataset, tmp_path, monkeypatch):
    run = write_run(tmp_path / "run", dataset, {3: Submission(status="invalid")})
    evaluated(dataset, run, tmp_path / "one")
    monkeypatch.setattr(case_tasks, "_FEW", 2)
    evaluated(dataset, run, tmp_path / "two", pool=WorkerPool(engine="local", workers=2))
    evaluated(dataset, run, tmp_path / "one")  # over itself
    for name in ("summary.json", "per_image.jsonl", "evidence.json"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
    with pytest.raises(ConfigurationMismatchError, match="diagnostics"):
        evaluated(dataset, run, tmp_path / "one", options={"diagnostics": False})
    evaluated(dataset, run, tmp_path / "one", options={"diagnostics": False}, overwrite=True)


class TestEvidence:
    """`legoworld evidence verify`."""

    def test_holds(self, dataset, tmp_path):
        run = write_run(tmp_path / "run", dataset, {3: Submission(status="invalid")})
        evaluated(dataset, run, tmp_path / "eval")
        checks = verify(tmp_path / "eval", None)
        assert {c.status for c in checks} == {"ok"}
        assert sum(c.what.startswith("row of image") for c in checks) == 8
        assert cli.run(["evidence", "verify", str(tmp_path / "eval")]) == 0

    def test_finds_a_number_that_does_not_follow(self, dataset, tmp_path):
        run = write_run(tmp_path / "run", dataset)
        evaluated(dataset, run, tmp_path / "eval")
        for name, text in (("summary.json", '"value": 1.0'), ("per_image.jsonl", '"R":1.0')):
            path = tmp_path / "eval" / name
            kept = path.read_text()
            path.write_text(kept.replace(text, text.replace("1.0", "0.9"), 1))
            evidence = json.loads((tmp_path / "eval" / "evidence.json").read_text())
            before = evidence["files"][name]
            evidence["files"][name] = datasets.sha256(path)
            (tmp_path / "eval" / "evidence.json").write_text(json.dumps(evidence))
            assert {c.status for c in verify(tmp_path / "eval", None)} == {"ok", "DIFFERS"}
            path.write_text(kept)
            evidence["files"][name] = before
            (tmp_path / "eval" / "evidence.json").write_text(json.dumps(evidence))
        assert {c.status for c in verify(tmp_path / "eval", None)} == {"ok"}

    def test_finds_a_changed_input(self, dataset, tmp_path):
        run = write_run(tmp_path / "run", dataset)
        evaluated(dataset, run, tmp_path / "eval")
        path = run / "surface" / "room0__easy__view_00.npz"
        path.write_bytes(path.read_bytes() + b" ")
        assert {c.status for c in verify(tmp_path / "eval", None)} == {"ok", "CHANGED"}


def arrays_hashed(evaluation, dataset):
    """How many of the reference's arrays, by kind, the evidence depends on."""
    inputs = json.loads((evaluation / "evidence.json").read_text())["inputs"]
    hashed = [i["sha256"] for i in inputs if i["role"] == "truth_arrays"]
    known = {sha256(p): p.parent.name for p in dataset.private.glob("*/*.npz")}
    return dict(Counter(known[h] for h in hashed))


class TestImportedTruth:
    """Reference arrays at full size alone: the pixel that contains each raster centre."""

    def test_costs_silhouettes_a_little(self, tmp_path):
        with_raster = write_dataset(tmp_path / "with")
        without = write_dataset(tmp_path / "without", raster_kept=False)
        run = write_run(tmp_path / "run", without)
        summary, _ = evaluated(without, run, tmp_path / "eval")
        assert summary.protocol.reference_points == "full_resolution_pixels"
        assert arrays_hashed(tmp_path / "eval", without) == {"depth": 4, "instances": 4}
        assert 0.9 < summary.metrics["R"].value < 1.0
        run = write_run(tmp_path / "run2", with_raster)
        summary, _ = evaluated(with_raster, run, tmp_path / "eval2")
        assert summary.protocol.reference_points == "raster"
        assert arrays_hashed(tmp_path / "eval2", with_raster) == {"raster": 4}

    @pytest.mark.parametrize("sampling", ["all", "random:0", "random:7"])
    def test_the_paper_s_other_reading(self, dataset, tmp_path, sampling):
        run = write_run(tmp_path / "run", dataset)
        summary, rows = evaluated(dataset, run, tmp_path / "eval",
                                  options={"reference_sampling": sampling})  # fmt: skip
        assert summary.protocol.reference_sampling == sampling
        assert arrays_hashed(tmp_path / "eval", dataset) == {
            "raster": 8, "depth": 8, "instances": 8,
        }  # fmt: skip
        assert 0.95 < summary.metrics["R"].value <= 1.0
        assert sum(o["n_reference"] for o in rows[1]["objects"]) > sum(
            o["n_submitted"] for o in rows[1]["objects"]
        )
        assert {c.status for c in verify(tmp_path / "eval", None)} == {"ok"}


def test_the_terminal_shows_both_averages(dataset, tmp_path, capsys):
    run = write_run(tmp_path / "run", dataset, {1: Submission(status="failed")})
    words = ["evaluate", str(run), "--truth", str(dataset.private), "-o", str(tmp_path / "eval")]
    assert cli.run([*words, "--draws", "100"]) == 0
    out = capsys.readouterr().out
    assert "8 cases attempted, 7 compared, 7 valid" in out
    assert "over all 8 attempted, zeros included: V 0.8750" in out
    assert "over the 7 valid: R 1.0000, A 1.0000, S 1.0000" in out
    assert "A's noise floor" in out
    assert "0: failed: room0__easy__view_00.png" in out
    assert cli.run([*words, "--draws", "100", "-v"]) == 0
    out = capsys.readouterr().out
    for word in ("tier easy", "environment indoor", "R_rigid", "visible_scene"):
        assert word in out
    assert cli.run([*words, "--draws", "100", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["summary"]["metrics"]["V"]["value"] == 0.875


def test_only_checks_that_fail_make_a_submission_invalid():
    assert VALID.valid
    for name in VALID.__struct_fields__:
        assert not replace(VALID, **{name: Check(ok=False)}).valid
    assert OK.ok
