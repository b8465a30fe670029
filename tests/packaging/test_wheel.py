"""The wheel and the sdist, built as a publisher would and used from an empty environment."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

pytestmark = pytest.mark.packaging


def run(*command: object, **options) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(
        [str(part) for part in command], capture_output=True, text=True, check=False, **options
    )
    assert done.returncode == 0, f"{command}\n{done.stdout[-2000:]}\n{done.stderr[-4000:]}"
    return done


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the sdist, and the wheel built from that sdist."""
    folder = tmp_path_factory.mktemp("dist")
    run(sys.executable, "-m", "build", "--outdir", folder, ROOT)
    return folder


@pytest.fixture(scope="module")
def wheel(built: Path) -> Path:
    (found,) = built.glob("*.whl")
    return found


def test_the_wheel_is_for_one_platform_and_any_python_3(wheel):
    assert wheel.name.startswith("legoworld-")
    assert "-py3-none-" in wheel.name
    assert not wheel.name.endswith("-any.whl")


def test_the_wheel_holds_the_library_and_the_catalogue_and_nothing_else(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    tops = {name.split("/")[0] for name in names}
    assert {t for t in tops if not t.endswith(".dist-info")} == {"legoworld"}
    for needed in (
        "legoworld/py.typed",
        "legoworld/visibility/_kernel.so",
        "legoworld/evaluation/_kernel.so",
        "legoworld/_catalog/readouts/coco.toml",
        "legoworld/_catalog/datasets/lvis/categories.json",
        "legoworld/_catalog/datasets/skimage_examples/track_coco.json",
        "legoworld/_catalog/examples/coffee/scene.blend",
    ):
        assert needed in names
    assert not [n for n in names if "/tests/" in n or "look_at" in n]


def test_the_sdist_holds_the_sources_of_the_kernel(built):
    (sdist,) = built.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        names = archive.getnames()
    assert any(n.endswith("legoworld/visibility/kernel.cpp") for n in names)
    assert any(n.endswith("legoworld/evaluation/accumulate.cpp") for n in names)
    assert any(n.endswith("legoworld/evaluation/api.hpp") for n in names)
    assert not any(n.endswith("_kernel.so") for n in names)


def test_the_installed_wheel_reads_the_examples(wheel, tmp_path):
    environment = tmp_path / "venv"
    run(sys.executable, "-m", "venv", environment)
    python = environment / "bin" / "python"
    run(python, "-m", "pip", "install", "--quiet", "--no-compile", wheel)
    clean = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    done = run(
        environment / "bin" / "legoworld", "readout", "--task", "coco", "--json", "-o", "run",
        cwd=tmp_path, env=clean,
    )  # fmt: skip
    document = json.loads(done.stdout)
    assert document["summary"]["coverage"] == {
        "attempted": 4, "by_status": {"ok": 4}, "ok": 4, "ok_empty": 0
    }  # fmt: skip
    listed = run(python, "-m", "pip", "list", "--format", "freeze").stdout
    assert "torch" not in listed
    assert "opencv-python==" not in listed
