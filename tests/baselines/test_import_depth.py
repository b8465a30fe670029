"""Imports of depth: every format and label, ray distance made planar, and what is refused."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from baselines.tracks import call, make_track, results, rows, run_document

from legoworld.baselines.baseline_import import ImportRequest
from legoworld.baselines.depth import depth_source
from legoworld.baselines.depth_folder import planar_from_ray_distance
from legoworld.baselines.pixel_import import import_pixels
from legoworld.readouts.family import protocol
from legoworld.tracks.track import load_track

NAMES = ["hall/images/dslr_images/A.JPG", "hall/images/dslr_images/B.JPG"]
STEMS = [name.removesuffix(".JPG") for name in NAMES]
DEPTH = np.linspace(1, 9, 48 * 64, dtype=np.float32).reshape(48, 64)


@pytest.fixture
def track(tmp_path: Path) -> Path:
    return make_track(tmp_path / "track.json", NAMES)


@pytest.fixture
def source(tmp_path: Path) -> Path:
    (tmp_path / "depths" / STEMS[0]).parent.mkdir(parents=True)
    return tmp_path / "depths"


@pytest.fixture
def bring(track, source, tmp_path, capfd):
    def go(*options, name="run", folder=None):
        output = tmp_path / name
        arguments = ["baseline", "import", folder or source, "--task", "eth3d", "--track", track]
        code = call([*arguments, "-o", output, *options])
        return code, output, capfd.readouterr().err

    return go


def write_pfm(path: Path, values) -> None:
    height, width = values.shape
    header = f"Pf\n{width} {height}\n-1.0\n".encode()
    path.write_bytes(header + values[::-1].astype("<f4").tobytes())


def load_depth(run: Path, stem: str = STEMS[0]) -> dict:
    with np.load(run / "depth" / f"{stem}.npz") as arrays:
        return {name: arrays[name] for name in arrays.files}


WRITERS = {
    ".npy": lambda path: np.save(path, DEPTH),
    ".npz": lambda path: np.savez(path, values=DEPTH, space=np.array("depth"), unit=np.array("m")),
    ".pfm": lambda path: write_pfm(path, DEPTH),
}


@pytest.mark.parametrize("suffix", WRITERS)
def test_float_formats_come_back_bit_for_bit(bring, source, suffix):
    for stem in STEMS:
        WRITERS[suffix](source / f"{stem}{suffix}")
    code, run, _ = bring("--space", "depth", "--unit", "m")
    assert code == 0
    found = load_depth(run)
    assert (str(found["space"]), str(found["unit"])) == ("depth", "m")
    assert found["values"].dtype == np.float32
    assert np.array_equal(found["values"], DEPTH)
    row = rows(run)[1]
    assert row["rendered_wh"] == [64, 48]
    assert row["depth"]["finite_px"] == 48 * 64
    assert len(run_document(run)["scenes"]["1"]["source"]["sha256"]) == 64


def test_each_photo_is_told_once(track, source, tmp_path):
    WRITERS[".npy"](source / f"{STEMS[0]}.npy")
    loaded, told = load_track(track), []
    request = ImportRequest(
        protocol=protocol("eth3d", loaded.vocabulary), track=loaded, run=tmp_path / "run",
        name="mine", ran_on=None, subset=False, overwrite=False,
    )  # fmt: skip
    arrays = depth_source(source, {"space": "depth", "unit": "m", "suffix": ".npy"})
    assert arrays.suffix == ".npy"
    import_pixels(request, arrays, progress=told.append, notice=lambda _: None)
    assert [(row.image_id, row.status) for row in told] == [(1, "ok"), (2, "missing")]


def test_exr(bring, source):
    openexr = pytest.importorskip("OpenEXR", reason="EXR needs the package OpenEXR")
    for stem in STEMS:
        openexr.File({"type": openexr.scanlineimage}, {"Z": DEPTH}).write(f"{source}/{stem}.exr")
    code, run, _ = bring("--space", "depth", "--unit", "m")
    assert code == 0
    assert np.array_equal(load_depth(run)["values"], DEPTH)


def test_png_in_millimetres_is_metres(bring, source):
    millimetres = (DEPTH * 1000).astype(np.uint16)
    for stem in STEMS:
        cv2.imwrite(f"{source}/{stem}.png", millimetres)
    code, run, _ = bring("--space", "depth", "--unit", "mm")
    assert code == 0
    assert np.array_equal(load_depth(run)["values"], millimetres / 1000.0)
    assert str(load_depth(run)["unit"]) == "m"
    code, _, said = bring("--space", "depth", name="unitless")
    assert code == 2
    assert "integers without a declared unit" in said
    assert "next: say it with --space, and integers with --unit" in said


def test_undeclared_numbers_are_refused_before_anything_is_written(bring, source):
    np.save(source / f"{STEMS[0]}.npy", DEPTH)
    code, run, said = bring()
    assert code == 2
    assert "does not say what its numbers are" in said
    assert not run.exists()


def test_a_label_that_contradicts_the_file_is_refused(bring, source):
    WRITERS[".npz"](source / f"{STEMS[0]}.npz")
    code, _, said = bring("--space", "disparity")
    assert code == 2
    assert "contradictory declarations" in said


def camera(path: Path, **more) -> Path:
    path.write_text(json.dumps({"fx": 50.0, "fy": 55.0, "cx": 32.0, "cy": 20.0, **more}))
    return path


def test_ray_distance_becomes_planar_depth(bring, source, tmp_path):
    """A wall at z = 3: by hand, the distance through pixel (u, v) is 3 / cos of the ray's angle."""
    u, v = np.meshgrid(np.arange(64), np.arange(48))
    rays = np.stack([(u + 0.5 - 32.0) / 50.0, (v + 0.5 - 20.0) / 55.0, np.ones((48, 64))], -1)
    distance = 3.0 / (rays / np.linalg.norm(rays, axis=-1, keepdims=True))[..., 2]
    distance[5, 6] = np.inf
    for stem in STEMS:
        np.save(source / f"{stem}.npy", distance.astype(np.float32))
    given = ["--space", "ray_distance", "--unit", "m"]
    code, _, said = bring(*given, name="without")
    assert code == 2
    assert "no intrinsics" in said
    code, run, _ = bring(*given, "--intrinsics", camera(tmp_path / "camera.json"))
    assert code == 0
    found = load_depth(run)
    assert str(found["space"]) == "depth"
    finite = np.isfinite(found["values"])
    assert finite.sum() == 48 * 64 - 1
    np.testing.assert_allclose(found["values"][finite], 3.0, rtol=2e-7)


def test_planar_depth_never_exceeds_the_distance_and_touches_it_on_the_axis():
    distance = np.full((47, 63), 5.0)
    planar = planar_from_ray_distance(distance, (40.0, 40.0, 31.5, 23.5))
    assert planar[23, 31] == 5.0
    assert np.sum(planar == 5.0) == 1
    assert np.all(planar <= 5.0)
    np.testing.assert_array_equal(planar, planar[::-1, ::-1])


def test_intrinsics_of_another_size_are_refused(bring, source, tmp_path):
    np.save(source / f"{STEMS[0]}.npy", DEPTH)
    given = ["--space", "ray_distance", "--unit", "m", "--intrinsics"]
    code, _, said = bring(*given, camera(tmp_path / "c.json", width=128, height=96))
    assert code == 2
    assert "of another size than its intrinsics; found: 64x48; expected: 128x96" in said


NOT_INTRINSICS = {
    "NaN": '{"fx": NaN, "fy": 50, "cx": 32, "cy": 24}',
    "a centre that is infinite": '{"fx": 50, "fy": 50, "cx": Infinity, "cy": 24}',
    "a boolean": '{"fx": true, "fy": 50, "cx": 32, "cy": 24}',
    "a text": '{"fx": "50", "fy": 50, "cx": 32, "cy": 24}',
    "no focal length": '{"fx": 0, "fy": 50, "cx": 32, "cy": 24}',
    "a size without end": '{"fx": 9, "fy": 9, "cx": 32, "cy": 2, "width": Infinity, "height": 48}',
    "no size": '{"fx": 9, "fy": 9, "cx": 32, "cy": 2, "width": 0, "height": 48}',
    "half of a size": '{"fx": 50, "fy": 50, "cx": 32, "cy": 24, "width": 64}',
    "no cy": '{"fx": 50, "fy": 50, "cx": 32}',
    "a list": "[50, 50, 32, 24]",
    "brackets without end": "[" * 50_000,
}


@pytest.mark.parametrize("case", NOT_INTRINSICS)
def test_intrinsics_that_are_none_are_refused(bring, source, tmp_path, case):
    np.save(source / f"{STEMS[0]}.npy", DEPTH)
    path = tmp_path / "c.json"
    path.write_text(NOT_INTRINSICS[case])
    code, run, said = bring("--space", "ray_distance", "--unit", "m", "--intrinsics", path)
    assert code == 2
    assert "the intrinsics c.json cannot be used; found:" in said
    assert said.count("\n") == 1
    assert not run.exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--space", "depth", "--unit", "furlong"], "'furlong' is not one of"),
        (["--space", "disparity", "--unit", "m"], "disparity has an unknown scale"),
        (["--space", "depth", "--intrinsics"], "--intrinsics is for ray distance"),
    ],
)
def test_declarations_that_mean_nothing_are_wrong_usage(bring, source, tmp_path, options, words):
    np.save(source / f"{STEMS[0]}.npy", DEPTH)
    more = [camera(tmp_path / "c.json")] if options[-1] == "--intrinsics" else []
    code, run, said = bring(*options, *more)
    assert code == 2
    assert words in said
    assert not run.exists()


USELESS = {
    "another size": (DEPTH[:, :40], "of another size; found: 40x48"),
    "no number": (DEPTH * np.nan, "no prediction at any pixel; found: no finite number above 0"),
    "all behind the camera": (-DEPTH, "no prediction at any pixel"),
    "complex numbers": (DEPTH.astype(np.complex64), "the wrong number type"),
    "far too large": (
        np.lib.stride_tricks.as_strided(DEPTH, (4000, 4000), (0, 0)),
        "of anoth",
    ),
    "three channels": (np.dstack([DEPTH] * 3), "not one depth image"),
}


@pytest.mark.parametrize("case", USELESS)
def test_a_folder_without_one_array_that_can_be_scored_is_refused(bring, source, case):
    array, words = USELESS[case]
    for stem in STEMS:
        np.save(source / f"{stem}.npy", array)
    code, run, said = bring("--space", "depth", "--unit", "m")
    assert code == 2
    assert words in said
    assert said.count("\n") == 1
    assert not run.exists()


def test_a_disparity_may_be_of_any_sign(bring, source):
    for stem in STEMS:
        np.save(source / f"{stem}.npy", -DEPTH)
    code, run, _ = bring("--space", "disparity")
    assert code == 0
    assert rows(run)[1]["depth"]["finite_px"] == 48 * 64


def test_an_array_without_a_prediction_is_a_row(bring, source):
    np.save(source / f"{STEMS[0]}.npy", DEPTH * 0)
    np.save(source / f"{STEMS[1]}.npy", DEPTH)
    code, run, _ = bring("--space", "depth", "--unit", "m")
    assert code == 1
    assert (rows(run)[1]["status"], rows(run)[2]["status"]) == ("invalid", "ok")
    assert not (run / "depth" / f"{STEMS[0]}.npz").exists()


def test_files_of_other_photos_are_counted(bring, source):
    for stem in (*STEMS, f"{STEMS[0]}_other"):
        np.save(source / f"{stem}.npy", DEPTH)
    code, run, said = bring("--space", "depth", "--unit", "m")
    assert code == 0
    assert f"1 file is not matched to a photo of the track, such as {STEMS[0]}_other.npy" in said
    assert len(list(run.rglob("*.npz"))) == 2


def test_an_array_that_is_gone_leaves_the_run(bring, source):
    for stem in STEMS:
        np.save(source / f"{stem}.npy", DEPTH)
    _, run, _ = bring("--space", "depth", "--unit", "m")
    (source / f"{STEMS[0]}.npy").unlink()
    _, fresh, _ = bring("--space", "depth", "--unit", "m", name="fresh")
    code, _, _ = bring("--space", "depth", "--unit", "m")
    assert code == 1
    assert rows(run)[1]["status"] == "missing"
    assert results(run) == results(fresh)


def test_intrinsics_by_photo(bring, source, tmp_path):
    for stem in STEMS:
        np.save(source / f"{stem}.npy", np.full((48, 64), 2.0))
    path = tmp_path / "cameras.json"
    one = {"fx": 64.0, "fy": 64.0, "cx": 32.5, "cy": 24.5}
    path.write_text(json.dumps({NAMES[0]: one, NAMES[1]: {**one, "cx": 0.5}}))
    code, run, _ = bring("--space", "ray_distance", "--unit", "m", "--intrinsics", path)
    assert code == 0
    assert load_depth(run, STEMS[0])["values"][24, 32] == 2.0
    assert load_depth(run, STEMS[1])["values"][24, 0] == 2.0
    assert load_depth(run, STEMS[1])["values"][24, 32] == pytest.approx(2 / np.hypot(1, 0.5))


def test_an_absent_file_is_a_missing_image(bring, source):
    np.save(source / f"{STEMS[1]}.npy", DEPTH)
    code, run, _ = bring("--space", "disparity")
    assert code == 1
    found = rows(run)
    assert (found[1]["status"], found[2]["status"]) == ("missing", "ok")
    assert "A.npy" in found[1]["reason"]


def test_one_bad_array_is_one_bad_row(bring, source):
    np.save(source / f"{STEMS[0]}.npy", DEPTH.T)
    np.save(source / f"{STEMS[1]}.npy", DEPTH)
    code, run, _ = bring("--space", "depth", "--unit", "m")
    assert code == 1
    found = rows(run)
    assert found[1]["status"] == "invalid"
    assert "rotated by 90 degrees" in found[1]["reason"]
    assert found[2]["status"] == "ok"
    assert not (run / "depth" / f"{STEMS[0]}.npz").exists()


def test_two_files_of_one_photo_are_ambiguous(bring, source):
    for stem in STEMS:
        np.save(source / f"{stem}.npy", DEPTH)
    write_pfm(source / f"{STEMS[0]}.pfm", DEPTH)
    code, run, _ = bring("--space", "depth", "--unit", "m")
    assert code == 1
    assert "more than one depth file" in rows(run)[1]["reason"]


def test_a_folder_of_something_else_is_refused(bring, source):
    code, run, said = bring("--space", "depth")
    assert code == 2
    assert "no depth for the track's photos" in said
    assert not run.exists()


def test_the_same_import_again_is_the_same_bytes_and_a_changed_file_is_read_again(bring, source):
    for stem in STEMS:
        np.save(source / f"{stem}.npy", DEPTH)
    _, run, _ = bring("--space", "depth", "--unit", "m")
    before = results(run)
    times = {p: p.stat().st_mtime_ns for p in run.rglob("*.npz")}
    bring("--space", "depth", "--unit", "m")
    assert results(run) == before
    assert {p: p.stat().st_mtime_ns for p in run.rglob("*.npz")} == times
    np.save(source / f"{STEMS[1]}.npy", DEPTH + 1)
    bring("--space", "depth", "--unit", "m")
    assert np.array_equal(load_depth(run, STEMS[1])["values"], DEPTH + 1)
    assert results(run)[f"depth/{STEMS[0]}.npz"] == before[f"depth/{STEMS[0]}.npz"]


def test_a_full_disk_is_said_before_anything_is_written(bring, source, monkeypatch):
    for stem in STEMS:
        np.save(source / f"{stem}.npy", DEPTH)
    usage = shutil.disk_usage(source)._replace(free=1000)
    monkeypatch.setattr("shutil.disk_usage", lambda _path: usage)
    code, run, said = bring("--space", "depth", "--unit", "m")
    assert code == 4
    assert "the depth files will not fit on the disk" in said
    assert not list(run.rglob("*.npz"))
