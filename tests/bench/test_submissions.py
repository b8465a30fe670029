"""`legoworld readout --task bench`: V from the artefacts, the surface and the render."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from bench.quick_renders import few_samples

from legoworld import cli
from legoworld.records.base import decode
from legoworld.records.submission import BenchRow

NAMES = [
    "good", "narrow", "blind", "flat_camera", "empty", "nan", "renamed", "cheat", "flat_picture",
    "bare", "damaged", "not_a_glb", "nothing", "absent",
]  # fmt: skip
#: What each submission fails; all others pass every check.
FAILS = {
    "blind": {"camera"},
    "empty": {"geometry"},
    "nan": {"geometry"},
    "flat_picture": {"final_png"},
    "bare": {"final_png", "scene_glb"},
    "damaged": {"scene_blend", "geometry", "camera"},
    "not_a_glb": {"scene_glb"},
}


def read(scenes: Path, run: Path, track: Path, *more: str) -> int:
    return cli.run(
        ["readout", str(scenes), "--task", "bench", "--track", str(track), "-o", str(run), "-q",
         *more]
    )  # fmt: skip


def rows_of(run: Path) -> dict[str, BenchRow]:
    lines = (run / "per_image.jsonl").read_bytes().splitlines()
    rows = [decode(BenchRow, line) for line in lines]
    return {row.scene: row for row in rows}


@pytest.fixture(scope="module")
def run(submissions, track_for, tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench-run")
    track = track_for(folder / "track.json", NAMES)
    assert read(submissions, folder / "run", track, "--no-render", "--workers", "2") == 1
    return folder / "run"


def test_v_is_decided_by_the_artefacts_alone(run):
    rows = rows_of(run)
    assert set(rows) == set(NAMES)
    for name in set(NAMES) - {"nothing", "absent"}:
        validity = rows[name].validity
        failed = {n for n in validity.__struct_fields__ if not getattr(validity, n).ok}
        assert failed == FAILS.get(name, set()), name
        assert rows[name].valid is (not failed)
        for check in failed:
            assert getattr(validity, check).found, (name, check)


def test_every_image_has_a_row_with_its_verdict(run):
    rows = rows_of(run)
    statuses = {name: rows[name].status for name in NAMES}
    unread = {"blind", "empty", "nan", "damaged"}
    assert {n for n, s in statuses.items() if s == "invalid"} == unread
    assert {n for n, s in statuses.items() if s == "missing"} == {"nothing", "absent"}
    assert rows["nan"].code == "non_finite_geometry"
    for name in unread | {"nothing", "absent"}:
        assert rows[name].reason
    summary = json.loads((run / "summary.json").read_text("utf-8"))
    assert summary["validity"]["valid"] == sum(r.valid is True for r in rows.values())
    assert summary["validity"]["failed"]["final_png"] == 2


def test_the_surface_is_seen_through_the_reference_s_pinhole(run):
    rows = rows_of(run)
    good = np.load(run / rows["good"].surface.file)
    narrow = np.load(run / rows["narrow"].surface.file)
    assert good["depth_z_m"].shape == (237, 421)
    assert good["depth_z_m"].dtype == np.float32
    # Another lens at the same pose: the reference's view is the same, its own is not.
    assert (good["depth_z_m"] == narrow["depth_z_m"]).all()
    assert "own_depth_z_m" not in good
    assert (narrow["own_depth_z_m"] != narrow["depth_z_m"]).any()
    assert np.isclose(rows["good"].camera.hfov_deg, 61.927513064147)
    assert np.isclose(narrow["own_intrinsics_px"][0] / narrow["intrinsics_px"][0], 4 / 3)
    warned = " ".join(rows["flat_camera"].warnings)
    assert "orthographic" in warned
    assert rows["flat_camera"].camera.hfov_deg is None


def test_what_may_be_a_picture_of_the_photo_is_on_record(run):
    integrity = rows_of(run)["cheat"].integrity
    (photo,) = integrity.images
    assert (photo.name, photo.size_wh, photo.packed, photo.users) == (
        "photo", (32, 18), True, ("material",)
    )  # fmt: skip
    (plane,) = integrity.planes
    assert plane.object == "Card"
    assert plane.images == ("photo",)
    assert plane.tilt_deg < 1
    assert [t.name for t in integrity.texts] == ["run.py"]
    assert json.loads(integrity.joints[0].text) == {"axis": [0, 0, 1], "type": "revolute"}
    arrays = np.load(run / rows_of(run)["cheat"].surface.file)
    assert np.isclose((arrays["plane"] == 0).mean(), plane.share)
    thumbnail = arrays["textures"][photo.thumbnail]
    assert thumbnail.shape == (36, 64, 3)
    assert (thumbnail == [255, 0, 0]).all()
    assert rows_of(run)["good"].integrity.planes == ()


def test_a_glb_of_another_scene_is_told(run):
    rows = rows_of(run)
    assert not rows["good"].warnings
    told = " ".join(rows["nan"].warnings + rows["renamed"].warnings)
    assert "another scene" not in told


def test_bytes_are_the_same_from_one_worker_and_two_and_again(
    submissions, track_for, tmp_path, monkeypatch
):
    few_samples(monkeypatch)
    track = track_for(tmp_path / "track.json", ["good", "bare"])
    assert read(submissions, tmp_path / "a", track, "--workers", "1", "--no-cache") == 0
    assert read(submissions, tmp_path / "b", track, "--workers", "2") == 0
    assert read(submissions, tmp_path / "b", track) == 0
    files = {p.relative_to(tmp_path / "a") for p in (tmp_path / "a").rglob("*") if p.is_file()}
    assert {p.name for p in files} >= {"good.npz", "good.png", "per_image.jsonl"}
    for file in files - {Path("run.json")}:
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes(), file
    row = rows_of(tmp_path / "b")["good"]
    assert row.render.size_wh == (512, 288)
    png = (tmp_path / "b" / row.render.file).read_bytes()
    chunks = [c for c in (b"tEXt", b"zTXt", b"iTXt", b"eXIf", b"tIME") if c in png]
    assert chunks == []
    assert cv2.imread(str(tmp_path / "b" / row.render.file)).shape == (288, 512, 3)


def test_a_file_that_was_touched_is_made_again(submissions, track_for, tmp_path):
    track = track_for(tmp_path / "track.json", ["good"])
    assert read(submissions, tmp_path / "run", track, "--no-render") == 0
    surface = tmp_path / "run" / "surface" / "good.npz"
    before = surface.read_bytes()
    surface.write_bytes(b"touched")
    assert read(submissions, tmp_path / "run", track, "--no-render") == 0
    assert surface.read_bytes() == before
    surface.unlink()
    assert read(submissions, tmp_path / "run", track, "--no-render") == 0
    assert surface.read_bytes() == before


def test_shards_together_are_the_whole_run(submissions, track_for, tmp_path):
    track = track_for(tmp_path / "track.json", ["good", "narrow", "bare"])
    assert read(submissions, tmp_path / "whole", track, "--no-render") == 0
    for shard in ("1/2", "2/2"):
        place = tmp_path / shard[0]
        assert read(submissions, place, track, "--no-render", "--shard", shard) == 0
    merged = tmp_path / "merged"
    assert cli.run(["merge", str(tmp_path / "1"), str(tmp_path / "2"), "-o", str(merged)]) == 0
    for file in ("per_image.jsonl", "summary.json", "surface/narrow.npz"):
        assert (merged / file).read_bytes() == (tmp_path / "whole" / file).read_bytes()


def test_what_a_bench_needs_is_asked_for(submissions, tmp_path, capsys):
    arguments = ["readout", str(submissions), "--task", "bench", "-o", str(tmp_path / "r")]
    assert cli.run(arguments) == 2
    assert "hfov_deg" in capsys.readouterr().err
    plain = [
        "readout",
        str(submissions),
        "--task",
        "coco",
        "-o",
        str(tmp_path / "r"),
        "--no-render",
    ]
    assert cli.run(plain) == 2
    assert "bench alone" in capsys.readouterr().err


def test_two_seeds_tell_how_far_noise_reaches(submissions, track_for, tmp_path, monkeypatch):
    few_samples(monkeypatch)
    track = track_for(tmp_path / "track.json", ["good"])
    assert read(submissions, tmp_path / "run", track, "--render-noise") == 0
    noise = rows_of(tmp_path / "run")["good"].render.noise
    assert noise.seeds == (0, 1)
    assert 0 <= noise.share_over_delta < 0.05
    assert noise.mean_largest_difference > 0
