"""Shipped baselines through the command line, by name, on tiny untrained checkpoints.

Needs a Python with torch and transformers in LEGOWORLD_BASELINE_PYTHON, as `make test-baselines`
sets it; nothing is downloaded.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
from pathlib import Path

import pytest
from baselines.tracks import call, make_photos, make_track, results, rows, run_document

from legoworld.plugin.evidence import read_evidence

ROOT = Path(__file__).parents[2]
PYTHON = os.environ.get("LEGOWORLD_BASELINE_PYTHON")
NAMES = ["a.jpg", "b.jpg"]
CATEGORIES = [
    {"id": 3, "name": "car_(automobile)", "synonyms": ["car"]},
    {"id": 9, "name": "sofa", "synonyms": ["sofa", "couch"]},
]

pytestmark = pytest.mark.skipif(
    not PYTHON, reason="LEGOWORLD_BASELINE_PYTHON names no Python with torch: make test-baselines"
)

#: Run by the baselines' Python, with the checkpoints of the baselines' own tests.
BUILD = """
import sys
from pathlib import Path
sys.path.insert(0, "tests")
from baseline_programs import tiny_depth, tiny_sam3
out = Path(sys.argv[1])
tiny_depth.save_tiny("depth_anything", out / "hf-depth")
tiny_sam3.save_tiny(out / "sam3")
"""


@pytest.fixture(scope="module")
def checkpoints(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("checkpoints")
    done = subprocess.run(
        [str(PYTHON), "-c", BUILD, folder], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return folder


@pytest.mark.parametrize(("name", "task"), [("sam3", "lvis"), ("hf-depth", "eth3d")])
def test_it_runs_by_name_and_goes_on_where_it_stopped(name, task, checkpoints, tmp_path):
    photos = make_photos(tmp_path / "photos", NAMES)
    track = make_track(tmp_path / "track.json", NAMES, categories=CATEGORIES)
    run = tmp_path / "run"
    arguments = [
        "baseline", "run", name, "--task", task, "--track", track, "--photos", photos,
        "--weights", checkpoints / name, "-o", run, "--offline",
    ]  # fmt: skip
    assert call(arguments) == 0
    assert {row["status"] for row in rows(run).values()} == {"ok"}
    document = run_document(run)
    configuration = document["configuration"]
    assert (configuration["baseline"], configuration["weights"]) == (name, name)
    assert str(checkpoints) not in json.dumps(document)
    assert str(tmp_path) not in json.dumps(document)
    hashes = json.dumps(configuration["provenance"])
    assert "model.safetensors" in hashes
    before = results(run)
    last = "predictions.json" if task == "lvis" else "depth/b.npz"
    (run / last).unlink()
    assert call(arguments) == 0
    assert results(run) == before


#: Run by the baselines' Python: a checkpoint of the stand-in, and where its own packages are.
STANDIN = """
import json, sys, sysconfig
from pathlib import Path
import torch
from safetensors.torch import save_file
sys.path.insert(0, "tests/baseline_programs/vggt_standin")
from vggt.models.vggt import VGGT
sizes, out = {"embed_dim": 8, "img_size": 518, "patch_size": 14}, Path(sys.argv[1])
torch.manual_seed(0)
network = VGGT(**sizes)
branch = network.camera_head.pose_branch
torch.nn.init.zeros_(branch.weight)
branch.bias.data = torch.tensor([0, 0, 0, 0, 0, 0, 1, 0.8, 1.0])
save_file(network.state_dict(), out / "model.safetensors")
(out / "config.json").write_text(json.dumps(sizes))
print(sysconfig.get_path("purelib"))
"""


@pytest.fixture(scope="module")
def vggt(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A Python that has the stand-in for VGGT's package, and a checkpoint of it."""
    folder = tmp_path_factory.mktemp("vggt")
    (folder / "vggt-weights").mkdir()
    made = [str(PYTHON), "-c", STANDIN, folder / "vggt-weights"]
    done = subprocess.run(made, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    venv = [str(PYTHON), "-m", "venv", "--without-pip", folder / "venv"]
    subprocess.run(venv, check=True, capture_output=True)
    packages = next((folder / "venv").glob("lib/python*/site-packages"))
    standin = ROOT / "tests" / "baseline_programs" / "vggt_standin"
    (packages / "vggt.pth").write_text(f"{done.stdout.strip()}\n{standin}\n")
    return folder / "venv" / "bin" / "python", folder / "vggt-weights"


def test_vggt_gives_evidence_its_camera_and_depth(vggt, tmp_path, capsys):
    python, weights = vggt
    photo = tmp_path / "room.png"
    shutil.copy(ROOT / "examples" / "coffee" / "final.png", photo)
    arguments = [
        "plugin", "evidence", "--photo", photo, "--provider", "vggt", "--python", python,
        "--weights", weights, "--offline", "-o", tmp_path / "evidence",
    ]  # fmt: skip
    code = call(arguments)
    said = capsys.readouterr()
    assert code == 0, said.err
    known = read_evidence(tmp_path / "evidence", photo)
    camera, record = known.file.camera, known.file.provider
    assert record
    files = record.provenance["weight_files"]
    assert [f["name"] for f in files] == ["model.safetensors"]
    assert len(record.provenance["package"]["sha256"]) == 64
    assert known.file.depth is not None
    assert known.file.depth.source == "vggt 1.0.0"
    assert "provider vggt 1.0.0: fx " in said.out
    width, height = known.size_wh
    rows = round(height * 518 / width / 14) * 14
    expected = 0.5 * min(rows, 518) / math.tan(0.4) * height / rows
    stored = json.loads((tmp_path / "evidence" / "camera.json").read_text())
    assert stored["fx"] == pytest.approx(0.5 * width / math.tan(0.5), rel=1e-5)
    assert stored["fy"] == pytest.approx(expected, rel=1e-5)
    assert (camera.hfov_deg is None) == (abs(stored["fx"] / stored["fy"] - 1) > 0.02)


def test_a_folder_that_is_no_checkpoint_is_a_refusal(tmp_path, capfd):
    photos = make_photos(tmp_path / "photos", NAMES)
    track = make_track(tmp_path / "track.json", NAMES, categories=CATEGORIES)
    (tmp_path / "empty").mkdir()
    arguments = [
        "baseline", "run", "hf-depth", "--task", "eth3d", "--track", track, "--photos", photos,
        "--weights", tmp_path / "empty", "-o", tmp_path / "run", "--offline",
    ]  # fmt: skip
    assert call(arguments) == 2
    assert "hf-depth:" in capfd.readouterr().err
    assert not (tmp_path / "run" / "run.json").exists()
