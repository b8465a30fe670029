"""Imported depth of every quantity and unit, through every command that reads its evaluation."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from baselines.tracks import call, rows
from comparison.evaluations import DEPTH_NAMES, SIZE_WH, depth_truth
from evaluation.depth.folders import stem, write_arrays
from PIL import Image

CAMERA = {"fx": 50.0, "fy": 50.0, "cx": SIZE_WH[0] / 2, "cy": SIZE_WH[1] / 2}
#: The space and unit declared, those in the evaluation, and what the file holds for depth z.
QUANTITIES = {
    "disparity": (("disparity", None), ("disparity", None), lambda z: 3.0 / z + 0.1),
    "depth up to scale": (("depth", None), ("depth", None), lambda z: 5.0 * z),
    "depth in metres": (("depth", "m"), ("depth", "m"), lambda z: z),
    "ray distance up to scale": (("ray_distance", None), ("depth", None), lambda z: z),
    "ray distance in metres": (("ray_distance", "m"), ("depth", "m"), lambda z: z),
}


@pytest.fixture
def track(tmp_path: Path) -> Path:
    path = tmp_path / "track.json"
    images = [
        {"id": n, "file_name": name, "width": SIZE_WH[0], "height": SIZE_WH[1]}
        for n, name in enumerate(DEPTH_NAMES, start=1)
    ]
    path.write_text(json.dumps({"info": {}, "images": images, "categories": []}))
    return path


def import_and_evaluate(folder: Path, track: Path, name: str, declared: list[object]) -> Path:
    """The evaluation of a folder of depth, imported with these options."""
    run, output = folder / f"{name}-run", folder / f"{name}-eval"
    source = ["baseline", "import", folder / name, "--task", "eth3d", "--track", track]
    assert call([*source, *declared, "-o", run]) == 0
    given = ["--truth", folder / "truth", "-o", output, "--draws", 5, "-q"]
    assert call(["evaluate", run, *given]) in (0, 1)  # one photo has no truth
    return output


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_every_command_reads_it(quantity, track, tmp_path, capfd):
    (space, unit), in_evaluation, stored = QUANTITIES[quantity]
    for name, z in depth_truth().items():
        for folder, values in (("depths", stored), ("scene", lambda z: (2 * z) ** 1.1)):
            path = tmp_path / folder / f"{stem(name)}.npy"
            path.parent.mkdir(parents=True, exist_ok=True)
            np.save(path, values(np.where(np.isfinite(z), z, 4.0)).astype(np.float32))
        photo = tmp_path / "photos" / name
        photo.parent.mkdir(parents=True, exist_ok=True)
        Image.new("RGB", SIZE_WH, "grey").save(photo)
    write_arrays(tmp_path / "truth", depth_truth())
    given = ["--space", space, *(["--unit", unit] if unit else [])]
    if space == "ray_distance":
        (tmp_path / "camera.json").write_text(json.dumps(CAMERA))
        given += ["--intrinsics", tmp_path / "camera.json"]
    metric = ["--space", "depth", "--unit", "m"]
    scene, theirs = (
        import_and_evaluate(tmp_path, track, *made)
        for made in (("scene", metric), ("depths", given))
    )
    scored = [row for row in rows(theirs).values() if row["status"] == "ok"]
    assert {(row["space"], row["unit"]) for row in scored} == {in_evaluation}
    comparison = tmp_path / "comparison"
    assert call(["compare", scene, theirs, "-o", comparison, "--draws", 5]) == 0
    assert call(["compare", scene, scene, theirs, "-o", tmp_path / "three", "--draws", 5]) == 0
    for number, folder in enumerate((theirs, comparison)):
        page = tmp_path / f"{number}.html"
        assert call(["report", folder, "--photos", tmp_path / "photos", "-o", page]) == 0
        assert page.stat().st_size > 10_000
        assert call(["evidence", "verify", folder, "--root", tmp_path]) == 0
    capfd.readouterr()
    assert call(["export", tmp_path / "depths-run", "-o", tmp_path / "coco.json"]) == 2
    assert "a run of eth3d has no boxes or masks" in capfd.readouterr().err
