"""The bench's section: its pictures are the score's own, and troubles are said."""

from __future__ import annotations

import base64
import json
import re
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from evaluation.reconstruction.datasets import Dataset, Submission
from msgspec.structs import replace
from report.bench_pages import bench_dataset, bench_evaluation, troubled_submissions
from report.chromium import browser
from report.pages import HOSTILE, Tables, document_of, embedded_json, page_of, write

from legoworld import cli
from legoworld.records.reconstruction import ObjectRow, PrecisionRecall, Registration
from legoworld.records.report_page import BenchPageView
from legoworld.records.run_rows import RunRow
from legoworld.report.depth_images import NO_DEPTH
from legoworld.report.page_content import PageDocument
from legoworld.report.reconstruction_advice import bench_advice
from legoworld.report.reconstruction_case import BOTH, EXTRA, HIT, MISSED, NOTHING, OUTSIDE
from legoworld.report.reconstruction_pictures import OUTCOMES, drawn_points, error_steps
from legoworld.report.sources import read_sources

NAMES = [o.name for o in OUTCOMES]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("bench")


@pytest.fixture(scope="module")
def dataset(folder: Path) -> Dataset:
    return bench_dataset(folder)


@pytest.fixture(scope="module")
def evaluations(folder: Path, dataset: Dataset) -> list[Path]:
    """A troubled submission, and one a little too far away in one case."""
    far = {3: Submission(depth_z_m=dataset.cases[3].depth_z_m * 1.04)}
    return [
        bench_evaluation(folder, dataset, "one", troubled_submissions(dataset)),
        bench_evaluation(folder, dataset, "two", far),
    ]


@pytest.fixture(scope="module")
def document(evaluations: list[Path]) -> PageDocument:
    return document_of(*evaluations)


def view_of(document: PageDocument, image_id: int) -> BenchPageView:
    (found,) = [v for v in document.views if v.id == image_id]
    assert isinstance(found, BenchPageView)
    return found


def outcomes_of(document: PageDocument, at: int | None) -> np.ndarray:
    """The outcome of each pixel, read back from the picture's colours."""
    assert at is not None
    picture = cv2.imdecode(np.frombuffer(document.overlays[at], np.uint8), cv2.IMREAD_UNCHANGED)
    found = np.zeros(picture.shape[:2], int)
    for code, outcome in enumerate(OUTCOMES):
        same = (picture[..., 2::-1] == list(bytes.fromhex(outcome.colour[1:]))).all(-1)
        found[same & (picture[..., 3] > 0)] = code
    return found


def rows_of(evaluation: Path) -> dict[int, Any]:
    lines = (evaluation / "per_image.jsonl").read_bytes().splitlines()
    return {row["image_id"]: row for row in map(json.loads, lines)}


def test_the_picture_of_r_has_the_score_s_own_counts(
    document: PageDocument, dataset: Dataset, evaluations: list[Path]
) -> None:
    for side, evaluation in enumerate(evaluations):
        for image_id, row in rows_of(evaluation).items():
            answer = view_of(document, image_id).sides[side]
            if row["status"] != "ok":
                assert answer.hit_picture is None
                continue
            codes = outcomes_of(document, answer.hit_picture)
            instance = dataset.cases[image_id].instance
            for scored in row["objects"]:
                mine = codes[instance == scored["id"]]
                missed = np.isin(mine, (MISSED, BOTH)).sum()
                extra = np.isin(mine, (EXTRA, BOTH)).sum()
                assert missed == scored["n_reference"] - round(
                    scored["recall"] * scored["n_reference"]
                )
                assert extra == scored["n_submitted"] - round(
                    scored["precision"] * scored["n_submitted"]
                )
            assert set(codes[instance <= 0].tolist()) <= {NOTHING, OUTSIDE}


def test_the_picture_of_a_counts_a_s_pixels(
    document: PageDocument, evaluations: list[Path]
) -> None:
    row = rows_of(evaluations[0])[5]
    picture = document.overlays[view_of(document, 5).sides[0].error_picture or 0]
    colours = cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    within = list(bytes.fromhex(error_steps(30)[0].colour[1:]))
    assert (colours == within).all(-1).sum() == row["appearance"]["n_hits"]
    assert 0 < row["appearance"]["n_hits"] < colours.shape[0] * colours.shape[1]


def test_points_lie_on_the_rays_of_the_pixels_they_are_of(
    document: PageDocument, dataset: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    view = view_of(document, 4)
    assert view.raster is not None
    assert view.raster.step == 1
    depth = dataset.cases[4].depth_z_m
    codes = np.frombuffer(base64.b64decode(view.raster.reference), "<u2").reshape(depth.shape)
    known = np.isfinite(depth)
    assert np.array_equal(codes != NO_DEPTH, known)
    z = view.raster.z0_m * np.exp(view.raster.depth_step * codes[known])
    assert np.abs(z / depth[known] - 1).max() <= view.raster.depth_step / 2 * (1 + 1e-6) + 1e-6
    outcome = base64.b64decode(view.sides[0].points.reference_outcome)  # type: ignore[union-attr]
    scored = dataset.cases[4].instance.ravel() > 0
    assert {NAMES[o] for o in np.frombuffer(outcome, np.uint8)[scored]} == {"hit", "missed"}
    _thinned_rays(dataset, monkeypatch)


def _thinned_rays(dataset: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every third pixel each way, and its ray is that of the pixel it is."""
    from evaluation.reconstruction.datasets import small_raster

    from legoworld.evaluation.reconstruction.reference import Reference

    raster, case = small_raster(), dataset.cases[4]
    reference = Reference(
        raster=raster, depth_z_m=case.depth_z_m, label=case.instance, sampled=True
    )
    monkeypatch.setattr("legoworld.report.reconstruction_pictures.MOST_POINTS", 150)
    grid, _ = drawn_points(reference, [])
    assert grid.step == 3
    assert grid.size_wh == (16, 9)
    rows, columns = np.mgrid[0:9, 0:16]
    x = (columns + 0.5 - grid.cx) / grid.fx
    assert np.allclose(x, (3 * columns + 1.5 - raster.cx) / raster.fx)
    y = (rows + 0.5 - grid.cy) / grid.fy
    assert np.allclose(y, (3 * rows + 1.5 - raster.cy) / raster.fy)


def test_checks_flags_objects_and_camera_are_findings(
    document: PageDocument, evaluations: list[Path]
) -> None:
    failed, invalid, shifted = (view_of(document, i).sides[0] for i in (1, 2, 4))
    assert failed.advice[0].what.startswith("no output (failed)")
    assert failed.why_no_picture == "it was not compared: failed"
    first = invalid.advice[0]
    assert first.what == f"not valid, scene.glb: empty {HOSTILE}; expected a mesh"
    assert first.do == "export it again"
    assert [c.ok for c in invalid.checks] == [True, True, True, False, True]
    said = " ".join(a.what for a in shifted.advice)
    assert "its field of view is off by +5.0 degrees" in said
    worst = min(rows_of(evaluations[0])[4]["objects"], key=lambda o: o["f1"])
    (finding,) = [a for a in shifted.advice if a.what.startswith(f"{worst['name']}:")]
    assert view_of(document, 4).objects[finding.truths[0]].n == worst["name"]


def test_what_a_case_s_cell_its_objects_and_its_facts_say(
    document: PageDocument, evaluations: list[Path]
) -> None:
    (section,) = document.sections
    for side, evaluation in enumerate(evaluations):
        rows = rows_of(evaluation)
        for line in section.images:
            row, view = rows[line.id], view_of(document, line.id)
            cell, answer = line.cells[side], view.sides[side]
            assert (cell.status, cell.valid) == (row["status"], row["valid"])
            assert (row["R"], row["A"], row["S"]) == (cell.R, cell.A, cell.S)
            assert cell.flags == tuple(sorted({flag["kind"] for flag in row["flags"]}))
            assert cell.findings == sum(a.level == "bad" for a in answer.advice)
            assert cell.advice == (answer.advice[0].what if answer.advice else "")
            assert (line.family, line.tier) == (row["family"], row["tier"])
            assert line.file_name == view.file_name == row["file_name"]
            assert document.views[line.view] is view
            assert line.n_truth == len(view.objects)
            names = ("f1", "precision", "recall", "eligible", "n_reference", "n_submitted")
            assert [tuple(getattr(o, n) for n in names) for o in answer.objects] == [
                tuple(o[n] for n in names) for o in row["objects"]
            ]
            facts = dict(answer.facts)
            assert facts["status"] == row["status"]
            assert facts["V"] == str(int(row["valid"]))
            for name in ("R", "A", "S"):
                assert facts[name] == ("-" if row[name] is None else f"{row[name]:.4f}")
            for name, value in row["R_at"].items():
                assert facts[name] == f"{value:.4f}"
    row, facts = rows_of(evaluations[0])[4], dict(view_of(document, 4).sides[0].facts)
    seen, moved = row["appearance"], row["camera"]["registration"]
    assert facts["pixels of A"] == f"{seen['n_hits']:,} of {seen['n_px']:,} within the tolerance"
    for name, key in (("A where geometry agrees", "agrees"), ("A where it differs", "differs")):
        over = f"{seen[f'n_geometry_{key}_px']:,} px"
        assert facts[name] == f"{seen[f'where_geometry_{key}']:.4f} over {over}"
    assert facts["A by delta"].startswith(f"0: {seen['curve']['0']:.3f}, 5: ")
    noise = seen["noise"]
    assert facts["A of the reference itself"] == (
        f"{noise['reference_mean']:.4f}, sd {noise['reference_sd']:.4f} between seeds"
    )
    assert facts["field of view, error"] == f"{row['camera']['fov_deg']:+.3f} degrees"
    assert facts["surfaces, best rigid fit"] == (
        f"{moved['rotation_deg']:.2f} degrees, {moved['translation_m']:.3f} m, "
        f"rms {moved['trimmed_rms_m']:.3f} m"
    )
    found = row["diagnostics"]
    for name in ("R_rigid", "R_median_scale", "voxel_iou_5cm"):
        assert facts[name.replace("_", " ")] == f"{found[name]:.4f}"
    assert facts["visible scene"] == f"{found['visible_scene']['f1']:.4f}"
    surface = next(name for name in facts if name.startswith("surface, "))
    assert re.fullmatch(r"surface, [\d,]+ bytes", surface)
    assert re.fullmatch(r"sha256 [0-9a-f]{64}", facts[surface])
    assert facts["in the scene"] == "0 image textures, 0 drivers, 0 texts"
    assert dict(view_of(document, 6).sides[0].facts)["in the scene"].endswith("2 drivers, 0 texts")


@pytest.fixture(scope="module")
def compared(evaluations: list[Path]) -> Any:
    """A case that was compared, and a camera and a registration to change."""
    row = next(r for r in read_sources(evaluations[:1])[0].sides[0].rows if r.image_id == 4)
    still = Registration(rotation_deg=0, translation_m=0, iterations=1, trimmed_rms_m=0)
    camera = replace(row.camera, fov_deg=0.0, registration=still)
    tried = replace(row.diagnostics, R_rigid=None, R_median_scale=None)
    return replace(row, objects=(), flags=(), warnings=(), camera=camera, diagnostics=tried)


RUN_ROW = RunRow(image_id=4, file_name="4.png", status="ok")


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("off", "said"), [(0.5, 0), (0.51, 1)])
def test_a_lens_is_off_from_half_a_degree(compared: Any, off: float, sign: int, said: int) -> None:
    row = replace(compared, camera=replace(compared.camera, fov_deg=sign * off))
    assert len(bench_advice(row, RUN_ROW)) == said


@pytest.mark.parametrize(
    ("rigid", "scaled", "said"),
    [
        (0.7, 0.7, ""),
        (0.709, None, ""),
        (0.6, 0.5, ""),
        (None, None, ""),
        (0.8, 0.7, "R 0.700 would be 0.800 with the surfaces moved by 2.0 degrees and 0.50 m"),
        (0.8, 0.9, "R 0.700 would be 0.900 with the surfaces scaled to the reference's median"),
    ],
)
def test_a_motion_or_a_scale_is_advised_only_where_r_gains(
    compared: Any, rigid: float | None, scaled: float | None, said: str
) -> None:
    moved = replace(compared.camera.registration, rotation_deg=2, translation_m=0.5)
    tried = replace(compared.diagnostics, R_rigid=rigid, R_median_scale=scaled)
    camera = replace(compared.camera, registration=moved)
    row = replace(compared, R=0.7, camera=camera, diagnostics=tried)
    found = bench_advice(row, RUN_ROW)
    assert [a.what.startswith(said) for a in found] == [True] * bool(said)


def test_the_exact_pose_is_tried_and_told_where_it_gains_most(compared: Any) -> None:
    camera = replace(compared.camera, world_rotation_deg=1.15, world_translation_m=0.335)
    row = replace(compared, R=0.957, camera=camera)
    (said,) = bench_advice(row, RUN_ROW, 0.999)
    assert said.what == (
        "R 0.957 would be 0.999 with the surfaces seen from the reference camera's pose, "
        "1.1 degrees and 0.34 m from its own"
    )
    assert said.do == "correct the camera's pose by as much"
    assert bench_advice(row, RUN_ROW, 0.9) == ()


@pytest.mark.parametrize(
    ("f1", "precision", "recall", "f10", "do", "level"),
    [
        (0.89, 0.5, 0.9, 0.89, "", "warn"),
        (0.5, 0.9, 0.5, 0.75, "", "bad"),
        (0.51, 0.5, 0.5, None, "", "warn"),
        (0.5, 0.5, 0.9, 0.76, "near: F 0.76 at 10 %", "bad"),
        (0.0, 0.0, 0.0, 0.2, "", "bad"),
        (0.0, 0.0, 0.1, None, "", "bad"),
    ],
)
def test_what_an_object_loses_on(
    compared: Any,
    f1: float,
    precision: float,
    recall: float,
    f10: float | None,
    do: str,
    level: str,
) -> None:
    at = {} if f10 is None else {"F10": PrecisionRecall(f1=f10, precision=1, recall=1)}
    one = ObjectRow(id=1, name="cup", category="cup", eligible=True, n_reference=9, n_submitted=9,
                    f1=f1, precision=precision, recall=recall, at=at)  # fmt: skip
    others = (
        replace(one, f1=0.9),
        replace(one, eligible=False),
        replace(one, n_submitted=0, f1=0, name="table"),
    )
    found = bench_advice(replace(compared, objects=(*others, one)), RUN_ROW)
    assert {a.truths for a in found} == {(2,), (3,)}
    said = {a.truths[0]: a for a in found}
    assert said[3].do.startswith(do)
    assert bool(said[3].do) == bool(do), "what was not tried is not advised"
    assert said[3].level == level
    assert said[3].what == f"cup: F {f1:.2f} (precision {precision:.2f}, recall {recall:.2f})"
    assert said[2].what == "table: nothing stands where it is seen"


def test_the_leaderboard_losses_and_tiers(document: PageDocument, evaluations: list[Path]) -> None:
    (section,) = document.sections
    assert section.bench is not None
    assert [row.agent for row in section.bench.board.rows] == ["two", "one"]
    summary = json.loads((evaluations[0] / "summary.json").read_text())
    of_r, perfect, of_a, _ = section.first.costs
    failed, balls = of_r.most
    means = {name: mean["value"] for name, mean in summary["metrics"].items()}
    assert (failed.n, failed.gain) == (2, pytest.approx(means["R_valid"] - means["R"]))
    assert means["R"] + 2 / 8 + balls.gain == pytest.approx(1)
    assert balls.text.startswith("ball: ")
    assert means["A"] + 2 / 8 + sum(c.gain for c in of_a.most[1:]) == pytest.approx(1)
    assert perfect.most == ()
    bars = {(b.label, b.metric): b for b in section.bench.tiers}
    assert bars["one", "S"].tiers == ("easy", "hard")
    assert {label for label, _ in bars} == {"one", "two"}
    assert {row.tier for row in section.images} == {"easy", "hard"}
    assert bars["one", "S"].values[0] == pytest.approx(
        summary["groups"]["tier"]["easy"]["metrics"]["S"]["value"]
    )
    assert [p.name for p in section.first.coverage[0].parts] == ["scored", "not valid", "failed"]
    assert section.first.verdicts[0].sentence.startswith("Highest S of 2: two, 1.000")


def test_the_list_of_cases_without_a_valid_submission_has_all_of_them(
    tmp_path: Path, document: PageDocument
) -> None:
    (section,) = document.sections
    failed = section.first.costs[0].most[0]
    path = write(document, tmp_path / "page.html")
    count = "document.querySelector('[data-count=photos]').textContent"
    with browser(viewport={"width": 1200, "height": 900}) as page:
        for of, n in (("&of=0", failed.n), ("&of=1", 0)):
            page.open(path, f"#/{section.key}{failed.link.replace('&of=0', of)}")
            page.until(f"{count} === '{n} of 8 cases'")


def test_the_tables_hold_both_averages_and_every_denominator(
    tmp_path: Path, evaluations: list[Path]
) -> None:
    page = page_of(tmp_path / "r.html", *evaluations)
    summary = json.loads((evaluations[0] / "summary.json").read_text())["metrics"]
    cells = Tables(page).row("S_valid")
    assert cells[:3] == [f"{summary['S_valid']['value']:.4f}", cells[1], "6 cases, valid"]
    text = page.read_text(encoding="utf-8")
    tables = text.split('id="data"')[0]
    assert "<img" not in tables
    assert "no specialist was run" not in tables
    assert {
        o["name"] for o in embedded_json(page, "data")[0]["sections"][0]["bench"]["outcomes"]
    } == {*NAMES}


def test_the_same_again_is_the_same_bytes(
    tmp_path: Path, evaluations: list[Path], document: PageDocument
) -> None:
    first = write(document, tmp_path / "a" / "r.html")
    second = write(document_of(*evaluations), tmp_path / "b" / "r.html")
    assert first.read_bytes() == second.read_bytes()


def test_a_comparison_brings_its_evaluations(tmp_path: Path, evaluations: list[Path]) -> None:
    out = tmp_path / "compared"
    assert cli.run(["compare", *map(str, evaluations), "-o", str(out), "--draws", "20"]) == 0
    (section,) = document_of(out).sections
    assert section.comparison is not None
    assert [s.label for s in section.sides] == ["scene (one)", "scene (two)"]
    assert section.first.forest[0].differences[0] is not None


class TestWhatIsNotThere:
    """Numbers stay; pictures say why they are not there."""

    @pytest.fixture
    def moved(self, tmp_path: Path, folder: Path, evaluations: list[Path]) -> Path:
        for name in ("bench", "run-one", "one"):
            shutil.copytree(folder / name, tmp_path / name)
        assert evaluations
        return tmp_path

    def said(self, moved: Path) -> tuple[BenchPageView, str]:
        view = view_of(document_of(moved / "one"), 5)
        return view, view.sides[0].why_no_picture

    def test_the_run(self, moved: Path) -> None:
        shutil.rmtree(moved / "run-one")
        view, why = self.said(moved)
        assert why == "its run is not where the evaluation found it, so there are no pictures"
        assert view.sides[0].objects
        assert view.raster is None

    def test_the_private_half(self, moved: Path) -> None:
        shutil.rmtree(moved / "bench" / "private")
        view, why = self.said(moved)
        assert why.startswith("the private half of its dataset is not where")
        assert view.photo is None

    def test_a_reference_that_changed(self, moved: Path) -> None:
        (moved / "bench" / "private" / "raster" / "room1__easy__view_00.npz").write_bytes(b"x")
        view, why = self.said(moved)
        assert why
        assert view.raster is None
        assert view.sides[0].hit_picture is None

    def test_a_surface_that_changed(self, moved: Path) -> None:
        (moved / "run-one" / "surface" / "room1__easy__view_00.npz").write_bytes(b"x")
        view, why = self.said(moved)
        assert why == "surface/room1__easy__view_00.npz is not the one the run wrote"
        assert view.sides[0].error_picture is not None

    def test_a_render_that_changed(self, moved: Path) -> None:
        (moved / "run-one" / "render" / "room1__easy__view_00.png").write_bytes(b"x")
        view, why = self.said(moved)
        assert why == "its render is not the one the run wrote"
        assert view.sides[0].hit_picture is not None


def test_nothing_is_hit_where_nothing_stands(document: PageDocument) -> None:
    codes = outcomes_of(document, view_of(document, 4).sides[0].hit_picture)
    assert (codes[:3] != HIT).all()


def test_flags_are_listed_with_their_measurement(document: PageDocument) -> None:
    (section,) = document.sections
    assert section.bench is not None
    _, systems, flags = section.overview
    assert (systems.title, len(systems.rows)) == ("Systems", 2)
    assert (flags.title, flags.folded) == ("1 integrity flag", True)
    ((case, side, kind, _, measured, _),) = flags.rows
    assert (case.link, side, kind, measured.value) == ("#/bench/6", "one", "drivers", 2)
    (row,) = [r for r in section.images if r.id == 6]
    assert [cell.flags for cell in row.cells] == [("drivers",), ()]  # type: ignore[attr-defined]
    said = [a.what for a in view_of(document, 6).sides[0].advice]
    assert any(s.startswith("flag, drivers: ") and "flagged from 1" in s for s in said)


def test_repeats_have_a_deviation_and_many_rows_no_plot_of_intervals(
    tmp_path: Path, folder: Path, dataset: Dataset, evaluations: list[Path]
) -> None:
    worse = {3: Submission(depth_z_m=dataset.cases[3].depth_z_m * 1.2)}
    repeats = [
        bench_evaluation(folder, dataset, "again-1", {}, agent="twice"),
        bench_evaluation(folder, dataset, "again-2", worse, agent="twice"),
    ]
    (section,) = document_of(*evaluations, *repeats).sections
    assert section.bench is not None
    assert section.first.forest == ()
    (twice,) = [r for r in section.bench.board.rows if r.agent == "twice"]
    assert twice.evaluations == ("again-1", "again-2")
    found = twice.groups[0].metrics["R"]
    assert found.sd == pytest.approx(np.std([r or 0 for r in found.runs], ddof=1))
    page = page_of(tmp_path / "r.html", *evaluations, *repeats)
    assert f"sd {found.sd:.3f}" in page.read_text(encoding="utf-8").split('id="data"')[0]


def test_a_run_without_renders_has_r_alone(tmp_path: Path, folder: Path, dataset: Dataset) -> None:
    bare = {i: Submission(no_render=True) for i in dataset.cases}
    evaluation = bench_evaluation(folder, dataset, "bare", bare)
    view = view_of(document_of(evaluation), 5)
    assert view.sides[0].error_picture is None
    assert view.sides[0].why_no_picture == "the run made no render of it"
    assert view.sides[0].hit_picture is not None
    assert Tables(page_of(tmp_path / "r.html", evaluation)).row("A")[0] == "-"


def test_without_renders_the_worst_surface_comes_first(folder: Path, dataset: Dataset) -> None:
    far = {
        i: Submission(no_render=True, depth_z_m=case.depth_z_m * (1.3 if i == 5 else 1))
        for i, case in dataset.cases.items()
    }
    evaluation = bench_evaluation(folder, dataset, "bare-and-far", far)
    (section,) = document_of(evaluation).sections
    assert section.images[0].id == 5


def test_many_cases_lie_beside_the_page_with_their_pictures(
    tmp_path: Path, document: PageDocument, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("legoworld.report.page_file.EMBEDDED_VIEWS", 3)
    page = write(document, tmp_path / "r.html")
    beside = sorted(p.name for p in (tmp_path / "r_files").iterdir())
    assert sum(name.startswith("overlay-") for name in beside) == len(document.overlays) > 0
    assert 'id="overlay-0"' not in page.read_text(encoding="utf-8")
    write(document, tmp_path / "r.html")
    assert sorted(p.name for p in (tmp_path / "r_files").iterdir()) == beside


def test_evaluate_ends_with_the_report_s_command(
    tmp_path: Path,
    folder: Path,
    dataset: Dataset,
    evaluations: list[Path],
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert evaluations
    out = tmp_path / "eval"
    truth = ["--truth", str(dataset.private), "--draws", "20"]
    assert cli.run(["evaluate", str(folder / "run-two"), *truth, "-o", str(out)]) == 0
    said = capsys.readouterr().out
    assert said.endswith(f"look at it: legoworld report {out} -o report.html\n")
