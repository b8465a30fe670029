"""A whole depth evaluation: statuses, denominators, means, intervals, and the same bytes again."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from depth_files.array_files import npy, npz
from evaluation.depth.folders import (
    Predictions,
    evaluate_depth,
    plane,
    rows_of,
    stem,
    write_arrays,
    write_eth3d,
    write_run,
)

from legoworld import cli
from legoworld.cards import load_card
from legoworld.comparison.depth import COMPARISON
from legoworld.errors import CatalogError, ConfigurationMismatchError, UsageError
from legoworld.evaluation.depth.arrays import DepthTruthError
from legoworld.evaluation.depth.eth3d import parse_scene_name, training_images
from legoworld.evaluation.depth.protocol import depth_protocol
from legoworld.evaluation.depth.scoring import score_image
from legoworld.evaluation.evidence import verify
from legoworld.evaluation.pixels.resampling import decode_array
from legoworld.evaluation.run import RunUnusableError, read_family_run
from legoworld.evaluation.stored import read_evaluation
from legoworld.records.base import as_json, decode
from legoworld.records.depth import DepthView
from legoworld.tasks.shipped import DEPTH

SIZE = (32, 20)


def eth3d_name(scene: str, number: int) -> str:
    return f"{scene}/images/dslr_images/DSC_{number:04}.JPG"


def score(tmp_path: Path, predictions: Predictions, truth: dict[str, Any], **options: Any) -> Any:
    run = write_run(tmp_path / "run", predictions, kind=options.pop("kind", "scene"))
    folder = write_arrays(tmp_path / "truth", truth)
    summary = evaluate_depth(run, folder, tmp_path / "evaluation", draws=50, **options)
    return summary, rows_of(tmp_path / "evaluation")


@pytest.mark.parametrize(("draws", "seed"), [(0, 0), (1, -1)])
def test_settings_that_cannot_be_are_refused_though_nothing_is_drawn(
    draws: int, seed: int, tmp_path: Path
) -> None:
    z = plane(SIZE)
    run = write_run(tmp_path / "run", {"one.jpg": z})
    truth = write_arrays(tmp_path / "truth", {"one.jpg": z})
    with pytest.raises(UsageError, match=f"found: {draws} draws?, seed {seed}; expected: at least"):
        evaluate_depth(run, truth, tmp_path / "e", draws=draws, seed=seed)
    assert not (tmp_path / "e").exists()
    assert evaluate_depth(run, truth, tmp_path / "e", draws=1).coverage.scored == 1


def test_what_an_image_is_warned_of(tmp_path: Path) -> None:
    z = plane(SIZE)
    holed = z.copy()
    holed[0, :3] = np.nan
    holed[1, 0] = -1.0
    noise = z * np.random.default_rng(0).choice([0.05, 1.0], z.shape)
    noise[2:] = np.inf  # a hole is an error of 1, a constant is not
    names = [eth3d_name("courtyard", n) for n in (1, 2)]
    run = write_run(tmp_path / "run", {names[0]: z, names[1]: noise}, size_wh=SIZE)
    root = write_eth3d(tmp_path / "truth", {names[0]: holed, names[1]: z})
    evaluate_depth(run, root, tmp_path / "a", draws=5)
    rows = rows_of(tmp_path / "a")
    assert rows[0]["warnings"] == ["invalid truth left out: 3 NaN, 1 not positive"]
    (worse,) = [w for w in rows[1]["warnings"] if "AbsRel" in w]
    assert worse.startswith("AbsRel is above that of a constant under ")
    assert worse.endswith(", ".join(rows[1]["worse_than_constant"]))
    for name in ("cameras.txt", "images.txt"):
        (root / "courtyard" / "dslr_calibration_jpg" / name).unlink()
    evaluate_depth(run, root, tmp_path / "b", draws=5)
    rows = rows_of(tmp_path / "b")
    said = "no cameras.txt: the truth's size is the track's, held to its bytes"
    assert [row["warnings"][0] for row in rows] == [said, said]


def test_every_status(tmp_path: Path) -> None:
    z = plane(SIZE)
    few = np.full(z.shape, np.inf)
    few.flat[:9] = 1.0
    nothing = np.full(z.shape, np.inf)
    predictions: Predictions = {
        "ok.jpg": z,
        "inverted.jpg": 1 / z,
        "degenerate.jpg": np.full(z.shape, 3.0),
        "no_gt.jpg": z,
        "missing.jpg": "missing",
        "timeout.jpg": "timeout",
        "all_holes.jpg": nothing,
        "wrong_size.jpg": plane((20, 32)),
        "unlabelled.jpg": {"values": z.astype(np.float32)},
        "gone.jpg": z,
    }
    truth = {name: few if name == "no_gt.jpg" else z for name in predictions}
    run = write_run(tmp_path / "run", predictions, size_wh=SIZE)
    (run / "depth/gone.npz").unlink()
    summary = evaluate_depth(run, write_arrays(tmp_path / "truth", truth), tmp_path / "e", draws=9)
    rows = {stem(row["file_name"]): row for row in rows_of(tmp_path / "e")}
    statuses = {name: row["status"] for name, row in rows.items()}
    assert statuses == {
        "ok": "ok", "inverted": "inverted", "degenerate": "degenerate", "no_gt": "no_gt",
        "missing": "missing", "timeout": "timeout", "all_holes": "invalid",
        "wrong_size": "invalid", "unlabelled": "invalid", "gone": "missing",
    }  # fmt: skip
    assert summary.coverage.attempted == 10
    assert summary.coverage.scored == 3
    assert summary.coverage.with_truth == 9
    assert rows["ok"]["metrics"]["abs_rel"]["error_1"] < 1e-6
    assert rows["timeout"]["reason"] == "it was timeout"
    assert "0 of 640 valid truth pixels" in rows["all_holes"]["reason"]
    assert "rotated" in rows["wrong_size"]["reason"]
    assert "does not say what its numbers are" in rows["unlabelled"]["reason"]
    assert "is its space declared right" in rows["inverted"]["warnings"][0]
    listed = {stem(entry.file_name) for entry in summary.not_scored}
    assert listed == set(rows) - {"ok", "inverted", "degenerate"}
    scored = [rows[n]["metrics"]["abs_rel"]["error_1"] for n in ("ok", "inverted", "degenerate")]
    assert summary.metrics["abs_rel"]["error_1"] == pytest.approx(np.mean(scored), rel=1e-14)
    everything = summary.all_attempted
    assert (everything.images, everything.missing) == (9, 6)
    assert everything.abs_rel["error_1"] == pytest.approx((sum(scored) + 6) / 9, rel=1e-14)
    names = sorted(p.name for p in (tmp_path / "e/view").iterdir())
    assert names == ["1.json", "2.json", "3.json", "run.json"]


def test_the_row_says_how_it_was_scored(tmp_path: Path) -> None:
    z = plane(SIZE)
    truth = np.where(np.random.default_rng(0).random(z.shape) < 0.5, np.inf, z)
    holes = z.copy()
    holes[:5] = np.inf
    summary, (row,) = score(tmp_path, {"a.jpg": holes}, {"a.jpg": truth})
    n_valid = int(np.isfinite(truth).sum())
    n_hole = int(np.isfinite(truth[:5]).sum())
    assert (row["n_valid"], row["n_predicted"]) == (n_valid, n_valid - n_hole)
    assert row["hole_share"] == pytest.approx(n_hole / n_valid, rel=1e-14)
    assert summary.mean_hole_share == row["hole_share"]
    assert row["s"] == pytest.approx(1.0, rel=1e-5)  # float32 predictions of float64 truth
    assert row["t"] == pytest.approx(0.0, abs=1e-6)
    assert row["metrics"]["abs_rel"]["error_1"] == pytest.approx(n_hole / n_valid, abs=1e-6)
    assert (row["space"], row["resampled"], row["truth_wh"]) == ("depth", False, [32, 20])
    assert row["truth_inf_px"] == 640 - n_valid
    assert set(row["constant"]["rmse_m"]) == {"exclude"}
    for key in ("space", "solver", "disparity_floor", "resolution", "policies", "camera_model"):
        assert getattr(summary.protocol, key)


def test_a_run_s_own_depth_as_truth_scores_zero(tmp_path: Path) -> None:
    predictions: Predictions = {f"{i}/p.jpg": plane(SIZE, i) for i in range(3)}
    run = write_run(tmp_path / "run", predictions)
    summary = evaluate_depth(run, run / "depth", tmp_path / "e", draws=50)
    assert summary.metrics["abs_rel"]["error_1"] < 1e-13
    assert summary.metrics["delta1"] == {"error_1": 1.0, "exclude": 1.0, "far": 1.0}
    assert summary.coverage.scored == 3


def test_baselines_in_each_space_score_alike(tmp_path: Path) -> None:
    z = plane(SIZE)
    rows, cols = np.mgrid[:20, :32] + 0.5
    lengths = np.sqrt(1 + ((cols - 16) / 30) ** 2 + ((rows - 10) / 30) ** 2)
    noisy = z * np.random.default_rng(3).uniform(0.8, 1.25, z.shape)
    intrinsics = np.array([30.0, 30, 16, 10])
    predictions: Predictions = {
        "depth.jpg": {"values": noisy, "space": "depth"},
        "unit.jpg": {"values": noisy * 1000, "space": "depth", "unit": "mm"},
        "disparity.jpg": {"values": 7 / noisy - 3, "space": "disparity"},
        "rays.jpg": {"values": noisy * lengths, "space": "ray_distance",
                     "intrinsics_px": intrinsics},
    }  # fmt: skip
    _, rows_found = score(tmp_path, predictions, dict.fromkeys(predictions, z), kind="baseline")
    values = [row["metrics"]["abs_rel"]["error_1"] for row in rows_found]
    assert 0.05 < values[0] < 0.2
    assert values == pytest.approx([values[0]] * 4, rel=1e-9)
    assert [row["space"] for row in rows_found][2:] == ["disparity", "ray_distance"]


def test_a_smaller_prediction_is_resampled_and_says_so(tmp_path: Path) -> None:
    y, x = np.mgrid[:80, :120] + 0.5
    truth = 1 / (0.2 + 0.3 * x / 120 + 0.2 * y / 80)
    y, x = np.mgrid[:20, :30] + 0.5
    small = 1 / (0.2 + 0.3 * x / 30 + 0.2 * y / 20)
    summary, (row,) = score(tmp_path, {"a.jpg": small}, {"a.jpg": truth})
    assert row["resampled"] is True
    assert (row["prediction_wh"], summary.resampled) == ([30, 20], 1)
    run = json.loads((tmp_path / "run/run.json").read_text())
    run["configuration"]["max_side"] = 30
    (tmp_path / "run/run.json").write_text(json.dumps(run))
    evaluate_depth(tmp_path / "run", tmp_path / "truth", tmp_path / "e", draws=1)
    assert COMPARISON.facts(read_evaluation(tmp_path / "evaluation")).max_side is None
    assert COMPARISON.facts(read_evaluation(tmp_path / "e")).max_side == 30
    assert row["metrics"]["abs_rel"]["exclude"] < 2e-3  # half a source pixel at the edges


def test_a_scene_of_another_size_than_it_rendered_is_invalid(tmp_path: Path) -> None:
    z = plane(SIZE)
    run = write_run(tmp_path / "run", {"a.jpg": z})
    rows = (run / "per_image.jsonl").read_text()
    (run / "per_image.jsonl").write_text(
        rows.replace('"rendered_wh": [32, 20]', '"rendered_wh": [64, 40]')
    )
    truth = write_arrays(tmp_path / "truth", {"a.jpg": z})
    evaluate_depth(run, truth, tmp_path / "e", draws=9)
    assert "not of the size the run recorded" in rows_of(tmp_path / "e")[0]["reason"]


def test_a_depth_file_changed_after_the_run_is_invalid(tmp_path: Path) -> None:
    z = plane(SIZE)
    run = write_run(tmp_path / "run", {"a.jpg": z})
    np.savez(run / "depth/a.npz", depth_z_m=z.astype(np.float32) * 2, space="depth")
    truth = write_arrays(tmp_path / "truth", {"a.jpg": z})
    evaluate_depth(run, truth, tmp_path / "e", draws=9)
    assert "not the one the run wrote" in rows_of(tmp_path / "e")[0]["reason"]


def eth3d_case(tmp_path: Path, n_per_scene: dict[str, int]) -> tuple[Path, Path]:
    """Runs whose error is the scene's: all photos of a scene are off alike."""
    predictions: Predictions = {}
    truth = {}
    for level, (scene, n) in enumerate(n_per_scene.items()):
        for i in range(n):
            name = eth3d_name(scene, i)
            z = plane(SIZE, i)
            random = np.random.default_rng(i)
            predictions[name] = z * random.uniform(1 - 0.1 * level, 1 + 0.1 * level, z.shape)
            z[random.random(z.shape) < 0.9] = np.inf
            truth[name] = z
    run = write_run(tmp_path / "run", predictions, size_wh=SIZE)
    return run, write_eth3d(tmp_path / "truth", truth)


def test_intervals_are_over_scenes(tmp_path: Path) -> None:
    run, truth = eth3d_case(tmp_path, {"courtyard": 2, "facade": 9, "office": 1})
    summary = evaluate_depth(run, truth, tmp_path / "e", draws=400, seed=3)
    assert as_json(summary.bootstrap) == {
        "draws": 400, "seed": 3, "unit": "scene", "groups": 3, "level": 0.95
    }  # fmt: skip
    found = summary.intervals["abs_rel"]["error_1"]
    rows = rows_of(tmp_path / "e")
    by_scene: dict[str, list[float]] = {}
    for row in rows:
        by_scene.setdefault(row["group"], []).append(row["metrics"]["abs_rel"]["error_1"])
    scenes = list(by_scene.values())
    random = np.random.default_rng(0)
    draws = [
        np.mean(np.concatenate([scenes[k] for k in random.integers(0, 3, 3)])) for _ in range(4000)
    ]
    assert found.low == pytest.approx(np.quantile(draws, 0.025), abs=2e-3)
    assert found.high == pytest.approx(np.quantile(draws, 0.975), abs=2e-3)
    assert found.low < summary.metrics["abs_rel"]["error_1"] < found.high
    assert found.unit == "scene"
    mean = np.mean([row["metrics"]["abs_rel"]["error_1"] for row in rows])  # images weigh alike
    assert summary.metrics["abs_rel"]["error_1"] == pytest.approx(mean, rel=1e-14)


def test_one_scene_has_no_interval(tmp_path: Path) -> None:
    run, truth = eth3d_case(tmp_path, {"courtyard": 3})
    summary = evaluate_depth(run, truth, tmp_path / "e", draws=20)
    assert summary.intervals["abs_rel"]["error_1"].low is None
    assert summary.bootstrap.groups == 1


def test_photos_outside_eth3d_are_their_own_groups(tmp_path: Path) -> None:
    z = plane(SIZE)
    names = ["a.jpg", "b.jpg"]
    summary, _ = score(tmp_path, dict.fromkeys(names, z), dict.fromkeys(names, z))
    assert (summary.bootstrap.unit, summary.bootstrap.groups) == ("image", 2)


def test_the_same_bytes_again_and_nothing_else_over_it(tmp_path: Path) -> None:
    run, truth = eth3d_case(tmp_path, {"courtyard": 2, "office": 2})
    evaluate_depth(run, truth, tmp_path / "a", draws=30)
    evaluate_depth(run, truth, tmp_path / "b", draws=30)
    evaluate_depth(run, truth, tmp_path / "b", draws=30)
    contents = [
        {p.relative_to(f).as_posix(): p.read_bytes() for p in sorted(f.rglob("*")) if p.is_file()}
        for f in (tmp_path / "a", tmp_path / "b")
    ]
    assert contents[0] == contents[1]
    with pytest.raises(ConfigurationMismatchError, match="draws"):
        evaluate_depth(run, truth, tmp_path / "b", draws=31)
    evaluate_depth(run, truth, tmp_path / "b", draws=31, overwrite=True)


def test_evidence_names_every_input(tmp_path: Path) -> None:
    run, truth = eth3d_case(tmp_path, {"courtyard": 1, "office": 2})
    evaluate_depth(run, truth, tmp_path / "e", draws=9)
    evidence = json.loads((tmp_path / "e/evidence.json").read_text())
    roles = [entry["role"] for entry in evidence["inputs"]]
    counts = {role: roles.count(role) for role in roles}
    assert counts == {"run": 1, "run_rows": 1, "prediction": 3, "truth": 3, "calibration": 4}
    assert evidence["evaluator"] == {"name": "legoworld", "version": "1.0.0"}
    assert evidence["configuration"]["camera_model"] == "none"


def test_the_dataset_s_camera_changes_what_is_read(tmp_path: Path) -> None:
    # A bent camera. The truth is what it sees of the pinhole's slanted plane.
    from legoworld.evaluation.depth.rows import pinhole_from_distorted
    from legoworld.tracks.colmap import Camera

    words = "300 200 170 170 151 99 0.2 0.2 0 0.0005 -0.15 0.4 0 0.0008"
    numbers = [float(w) for w in words.split()]
    camera = Camera(model="THIN_PRISM_FISHEYE", size_wh=(300, 200), params=tuple(numbers[2:]))
    y, x = np.mgrid[:200, :300] + 0.5
    at = pinhole_from_distorted(camera, np.stack([x.ravel(), y.ravel()], axis=1))
    truth = 1 / (0.2 + at @ [1e-3, 2e-3])
    inside = ((at > 1) & (at < [299, 199])).all(axis=1)
    truth = np.where(inside & (truth > 0), truth, np.inf).reshape(200, 300)
    name = eth3d_name("courtyard", 1)
    run = write_run(tmp_path / "run", {name: 1 / (0.2 + 1e-3 * x + 2e-3 * y)}, size_wh=(300, 200))
    folder = write_eth3d(tmp_path / "truth", {name: truth}, camera=words)
    plain = evaluate_depth(run, folder, tmp_path / "a", draws=9)
    warped = evaluate_depth(run, folder, tmp_path / "b", draws=9, camera_model="dataset")
    assert plain.metrics["abs_rel"]["error_1"] > 5e-4
    assert warped.metrics["abs_rel"]["error_1"] < 1e-6
    assert warped.protocol.camera_model == "dataset"
    assert rows_of(tmp_path / "b")[0]["warped"] is True
    for name in "ab":  # rows scored again read as the summary says
        assert {check.status for check in verify(tmp_path / name, None)} == {"ok"}


def test_the_dataset_s_camera_is_for_scenes_with_calibration_only(tmp_path: Path) -> None:
    z = plane(SIZE)
    name = eth3d_name("courtyard", 1)
    run = write_run(tmp_path / "run", {name: z}, kind="baseline")
    folder = write_eth3d(tmp_path / "truth", {name: z})
    with pytest.raises(UsageError, match="only a scene"):
        evaluate_depth(run, folder, tmp_path / "e", camera_model="dataset")
    run = write_run(tmp_path / "scene", {name: z})
    arrays = write_arrays(tmp_path / "arrays", {name: z})
    with pytest.raises(DepthTruthError, match="needs the camera of every photo"):
        evaluate_depth(run, arrays, tmp_path / "e", camera_model="dataset")
    with pytest.raises(UsageError, match="unknown camera model"):
        evaluate_depth(run, folder, tmp_path / "e", camera_model="opencv")
    assert not (tmp_path / "e").exists()


def test_runs_that_cannot_be_scored(tmp_path: Path) -> None:
    z = plane(SIZE)
    run = write_run(tmp_path / "run", {"a.jpg": z, "b.jpg": z})
    truth = write_arrays(tmp_path / "truth", {"a.jpg": z, "b.jpg": z})
    rows = (run / "per_image.jsonl").read_text().splitlines()
    (run / "per_image.jsonl").write_text(rows[0] + "\n")
    with pytest.raises(RunUnusableError, match="does not cover its own track"):
        evaluate_depth(run, truth, tmp_path / "e")
    document = json.loads((run / "run.json").read_text())
    document["configuration"] |= {"task": "coco", "attempted": 1}
    (run / "run.json").write_text(json.dumps(document))
    with pytest.raises(UsageError, match="not a depth run"):
        read_family_run(run, DEPTH, "a depth run")
    with pytest.raises(RunUnusableError):
        evaluate_depth(tmp_path / "nowhere", truth, tmp_path / "e")


def test_the_view_shows_real_pixels(tmp_path: Path) -> None:
    truth = np.full((300, 700), np.inf)
    random = np.random.default_rng(0)
    points = random.random(truth.shape) < 0.02
    truth[points] = plane((700, 300))[points]
    prediction = plane((700, 300))
    prediction[:, 350:] = np.inf
    score(tmp_path, {"a.jpg": prediction}, {"a.jpg": truth})
    view = decode(DepthView, (tmp_path / "evaluation/view/1.json").read_bytes())
    shown, aligned = (decode_array(a, view.size_wh) for a in (view.truth_z_m, view.aligned_z_m))
    assert view.size_wh == (256, 109)
    assert shown.shape == (109, 256)
    valid = np.isfinite(shown)
    assert np.isin(shown[valid], truth.astype(np.float32)).all()
    both = valid & np.isfinite(aligned)
    assert both.sum() > 1000
    np.testing.assert_allclose(aligned[both], shown[both], rtol=1e-5)
    # A block without truth shows its middle pixel.
    row, col = (np.arange(n + 1) * side // n for n, side in ((109, 300), (256, 700)))
    middle = plane((700, 300))[np.ix_((row[:-1] + row[1:]) // 2, (col[:-1] + col[1:]) // 2)]
    bare = ~valid & np.isfinite(aligned)
    np.testing.assert_allclose(
        aligned[bare], np.minimum(middle, truth[points].max())[bare], rtol=1e-5
    )
    assert np.isinf(aligned[:, 129:]).all()
    assert np.isfinite(aligned[:, :127]).all()


def test_a_small_picture_is_shown_whole(tmp_path: Path) -> None:
    z = plane(SIZE)
    score(tmp_path, {"a.jpg": z}, {"a.jpg": z})
    view = decode(DepthView, (tmp_path / "evaluation/view/1.json").read_bytes())
    assert np.array_equal(decode_array(view.truth_z_m, view.size_wh), z.astype(np.float32))


def test_a_view_shows_nothing_beyond_the_deepest_truth(tmp_path: Path) -> None:
    z = plane(SIZE)
    far = z.copy()
    far[5, 5] = 1e6
    _, (row,) = score(tmp_path, {"a.jpg": far}, {"a.jpg": z})
    assert row["clamped_share"] == 1 / z.size
    view = decode(DepthView, (tmp_path / "evaluation/view/1.json").read_bytes())
    shown = decode_array(view.aligned_z_m, view.size_wh)
    assert shown[5, 5] == shown.max() == pytest.approx(z.max(), rel=1e-6)


def test_coverage_says_how_much_of_eth3d_was_attempted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = [image.file_name for image in training_images()[36:40]]
    assert len({parse_scene_name(name) for name in names}) == 2
    z = plane(SIZE)
    run = write_run(tmp_path / "run", dict.fromkeys(names, z), size_wh=SIZE)
    truth = write_eth3d(tmp_path / "truth", dict.fromkeys(names, z))
    assert cli.run(["evaluate", str(run), "--truth", str(truth), "-o", str(tmp_path / "e")]) == 0
    coverage = json.loads((tmp_path / "e/summary.json").read_text())["coverage"]
    assert coverage["eth3d"] == {
        "images": 4, "of_images": 454, "scenes": 2, "of_scenes": 13
    }  # fmt: skip
    assert "with truth (4 of ETH3D's 454, in 2 of 13 scenes)" in capsys.readouterr().out
    again = ["evaluate", str(run), "--truth", str(truth), "-o", str(tmp_path / "f"), "-v"]
    assert cli.run(again) == 0
    assert "with truth (4 of ETH3D's 454, in 2 of 13 scenes)" in " ".join(
        capsys.readouterr().out.split()
    )
    summary, _ = score(tmp_path / "own", {"a.jpg": z}, {"a.jpg": z})
    assert not summary.coverage.eth3d


def test_files_that_claim_too_much_are_rows(tmp_path: Path) -> None:
    z = plane(SIZE)
    names = ["ok.jpg", "claims.jpg", "larger.jpg"]
    run = write_run(tmp_path / "run", dict.fromkeys(names, z))
    replace_depth(run, "claims.jpg", npz(npy((200_000, 200_000)), name="depth_z_m.npy"))
    bomb = npz(npy((4000, 4000), data=bytes(4 * 4000 * 4000)), name="depth_z_m.npy")
    replace_depth(run, "larger.jpg", bomb)
    truth = write_arrays(tmp_path / "truth", dict.fromkeys(names, z))
    summary = evaluate_depth(run, truth, tmp_path / "e", draws=9)
    by_name = {row["file_name"]: row for row in rows_of(tmp_path / "e")}
    assert summary.coverage.by_status == {"invalid": 2, "ok": 1}
    assert "truncated, or its header is damaged" in by_name["claims.jpg"]["reason"]
    assert "4000x4000" in by_name["larger.jpg"]["reason"]


def replace_depth(run: Path, name: str, content: bytes) -> None:
    """Another depth file in a run, with its hash on record and no size."""
    (run / f"depth/{stem(name)}.npz").write_bytes(content)
    rows = rows_of(run)
    for row in rows:
        if row["file_name"] == name:
            row["depth"]["sha256"] = hashlib.sha256(content).hexdigest()
            del row["rendered_wh"]
    (run / "per_image.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))


def test_no_memory_for_one_image_is_its_row(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    z = plane(SIZE)
    names = ["a.jpg", "b.jpg"]
    run = write_run(tmp_path / "run", dict.fromkeys(names, z))
    truth = write_arrays(tmp_path / "truth", dict.fromkeys(names, z))
    calls: list[int] = []

    def full_once(*arguments: Any) -> Any:
        calls.append(1)
        if len(calls) == 1:
            raise MemoryError
        return score_image(*arguments)

    monkeypatch.setattr("legoworld.evaluation.depth.rows.score_image", full_once)
    evaluate_depth(run, truth, tmp_path / "e", draws=9)
    rows = rows_of(tmp_path / "e")
    assert [(row["status"], row["code"]) for row in rows] == [("invalid", "memory"), ("ok", None)]

    def full(*_arguments: Any) -> Any:
        raise MemoryError

    monkeypatch.setattr("legoworld.evaluation.depth.truth.planar_metres", full)
    with pytest.raises(DepthTruthError, match=r"a\.npz does not fit into memory"):
        evaluate_depth(run, truth, tmp_path / "f", draws=9)


@pytest.mark.parametrize("value", [1e-320, 1e-200, 1e200, 1.7e308])
@pytest.mark.parametrize("space", ["depth", "disparity"])
def test_numbers_that_float64_cannot_square_are_holes(
    tmp_path: Path, value: float, space: str
) -> None:
    z = plane(SIZE)
    values = z.copy()
    values[0, :5] = value
    huge = {"values": values, "space": np.array(space), "unit": np.array("")}
    truth = z.copy()
    truth[1, :7] = value
    _, (row,) = score(tmp_path, {"a.jpg": huge}, {"a.jpg": truth})
    assert row["n_valid"] == z.size - 7
    # A tiny disparity is a number like 0; a depth of it is as far from one as none.
    kept = space == "disparity" and value < 1
    assert row["n_predicted"] == row["n_valid"] - (0 if kept else 5)
    assert all(np.isfinite(v) for p in row["metrics"].values() for v in p.values())


def test_a_card_of_another_protocol_is_refused() -> None:
    card = depth_protocol(load_card("eth3d")).card
    alignment = {**card.values["alignment"], "solver": "median"}
    other = replace(card, values={**card.values, "alignment": alignment})
    with pytest.raises(CatalogError, match=r"alignment\.solver"):
        depth_protocol(other)
