"""The depth section: coded arrays within their stated precision, one scale, honest failures."""

from __future__ import annotations

import base64
import json
from pathlib import Path

import numpy as np
import pytest
from evaluation.depth.folders import evaluate_depth, plane, write_arrays, write_run
from report.pages import Tables, document_of, page_of

from legoworld.evaluation.pixels.resampling import decode_array
from legoworld.records import base as record
from legoworld.records.depth import DepthView
from legoworld.report.depth_images import NO_DEPTH, depth_view, encode_depth

NAMES = ("a.png", "b.png", "c.png")


def decode(codes: str, view: dict) -> np.ndarray:
    values = np.frombuffer(base64.b64decode(codes), "<u2").astype(np.float64)
    z = view.z0_m * np.exp(view.step * values)
    return np.where(values == NO_DEPTH, np.inf, z).reshape(view.size_wh[::-1])


@pytest.fixture(scope="module")
def evaluation(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A good depth with a hole, an inverted one, and a scene that failed."""
    folder = tmp_path_factory.mktemp("depth")
    truth = {name: plane((80, 60), seed=k) for k, name in enumerate(NAMES)}
    good = truth["a.png"] * 1.5
    good[:30, :40] = np.inf
    inverted = 1.0 / (0.8 - 1.0 / truth["b.png"])
    run = write_run(folder / "run", {"a.png": good, "b.png": inverted, "c.png": "failed"})
    evaluate_depth(run, write_arrays(folder / "truth", truth), folder / "eval", draws=20)
    return folder / "eval"


def test_codes_are_within_half_a_step(evaluation: Path) -> None:
    stored = record.decode(DepthView, (evaluation / "view" / "1.json").read_bytes())
    view = depth_view([stored])
    assert view is not None
    for text, codes in (
        (stored.truth_z_m, view.truth),
        (stored.aligned_z_m, view.aligned[0]),
    ):
        exact = decode_array(text, stored.size_wh)
        shown = decode(codes, view)
        known = np.isfinite(exact)
        assert np.array_equal(known, np.isfinite(shown))
        ratio = np.abs(np.log(shown[known] / exact[known]))
        assert ratio.max() <= view.step / 2 * (1 + 1e-9)
    assert view.step < 1e-4
    assert np.isinf(decode(view.aligned[0], view)[:30, :40]).all()


def test_one_scale_holds_truth_and_prediction(evaluation: Path) -> None:
    stored = record.decode(DepthView, (evaluation / "view" / "1.json").read_bytes())
    view = depth_view([stored])
    assert view is not None
    texts = (stored.truth_z_m, stored.aligned_z_m)
    both = np.concatenate([decode_array(text, stored.size_wh).ravel() for text in texts])
    low, high = np.percentile(1 / both[np.isfinite(both)].astype(np.float64), (2, 98))
    assert view.near_far_z_m == pytest.approx([1 / high, 1 / low])
    assert depth_view([None]) is None
    assert depth_view([None, stored]).aligned[0] is None


def test_a_single_value_is_coded_exactly() -> None:
    z = np.full((2, 3), 4.0, np.float32)
    z[0, 0] = np.inf
    codes = np.frombuffer(base64.b64decode(encode_depth(z, 4.0, 0.0)), "<u2")
    assert codes.tolist() == [NO_DEPTH, 0, 0, 0, 0, 0]


def test_numbers_policies_constant_and_denominators(evaluation: Path, tmp_path: Path) -> None:
    page = page_of(tmp_path / "r.html", evaluation)
    summary = json.loads((evaluation / "summary.json").read_text())
    rows = [r for r in Tables(page).rows if r and r[0] in summary["metrics"]]
    shown = {(r[0], r[1]): r[2:] for r in rows}
    for metric, by_policy in summary["metrics"].items():
        for policy, value in by_policy.items():
            mean, spread, constant, over = shown[metric, policy][:4]
            assert mean == f"{value:.4f}"
            interval = summary["intervals"][metric][policy]
            assert spread == f"[{interval['low']:.4f}, {interval['high']:.4f}]"
            assert constant == f"{summary['constant'][metric][policy]:.4f}"
            assert over == "2 of 3 images"
    every = [r for r in Tables(page).rows if r and r[0] == "abs_rel, all attempted"]
    assert every[0][2] == f"{summary['all_attempted']['abs_rel']['error_1']:.4f}"
    assert every[0][5] == "3 images with truth, 1 of them without a score at 1"
    assert "it was failed" in page.read_text()


def test_the_facts_of_a_photo_are_its_fit_its_holes_and_its_metrics(evaluation: Path) -> None:
    row = json.loads((evaluation / "per_image.jsonl").read_text().splitlines()[0])
    facts = dict(document_of(evaluation).views[0].sides[0].facts)
    assert facts["fit"] == f"1/z = {row['s']:.6g} x + {row['t']:.6g}, x in {row['space']}"
    assert facts["holes"] == f"{row['hole_share']:.2%} of the valid ground truth"
    for metric, values in row["metrics"].items():
        assert facts[metric] == ", ".join(f"{name} {value:.4f}" for name, value in values.items())


def test_what_is_wrong_and_what_to_do(evaluation: Path) -> None:
    document = document_of(evaluation)
    assert document.sections[0].images[0].id == 3
    said = {v.id: [a.what for a in v.sides[0].advice] for v in document.views}
    assert any("25.0% of the measured pixels have no geometry" in what for what in said[1])
    assert any("near and far are exchanged" in what for what in said[2])
    cells = {photo.id: photo.cells[0] for photo in document.sections[0].images}
    rows = map(json.loads, (evaluation / "per_image.jsonl").read_text().splitlines())
    for row in rows:
        scored = "metrics" in row
        error = row["metrics"]["abs_rel"]["error_1"] if scored else None
        constant = row["constant"]["abs_rel"]["error_1"] if scored else None
        cell = cells[row["image_id"]]
        assert (cell.status, cell.score, cell.constant) == (row["status"], error, constant)
    bad = {v.id: sum(a.level == "bad" for a in v.sides[0].advice) for v in document.views}
    assert {n: cell.findings for n, cell in cells.items()} == bad
    assert cells[3].advice == "no output (failed): it was failed"
    assert said[3] == ["no output (failed): it was failed"]
    assert document.views[2].depth is None
