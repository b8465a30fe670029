"""Shipped baselines through the command line, by name, on tiny untrained checkpoints.

Needs a Python with torch and transformers in LEGOWORLD_BASELINE_PYTHON, as `make test-baselines`
sets it; nothing is downloaded.
"""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import pytest
from specialists.tracks import call, make_photos, make_track, results, rows, run_document

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
from baselines import tiny_depth, tiny_sam3
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
