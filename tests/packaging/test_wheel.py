"""The wheel and the sdist, built as a publisher would and used where nothing else is installed."""

from __future__ import annotations

import importlib.metadata
import json
import os
import shlex
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from email import message_from_bytes
from email.message import Message
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from legoworld.visibility.compilation import compiler

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
    """A folder with the sdist, and the wheel built from that sdist.

    What building needs is installed once for both, not once for each as `build` would.
    """
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    tools = tmp_path_factory.mktemp("tools")
    run(sys.executable, "-m", "pip", "install", "--quiet", "--no-compile", "--target", tools,
        *project["build-system"]["requires"])  # fmt: skip
    folder = tmp_path_factory.mktemp("dist")
    # What the optimiser makes of the C++, the other tests see: here it would take ten seconds.
    quick = tools / "quick-c++"
    quick.write_text(f'#!/bin/sh\nexec {shlex.join(compiler())} "$@" -O0\n', encoding="utf-8")
    quick.chmod(0o755)
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", folder, ROOT,
        env={**os.environ, "PYTHONPATH": str(tools), "CXX": shlex.quote(str(quick))})  # fmt: skip
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
        "legoworld/evaluation/kernels/_kernel.so",
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
    assert any(n.endswith("legoworld/visibility/shared/exported.hpp") for n in names)
    assert any(n.endswith("legoworld/evaluation/kernels/accumulate.cpp") for n in names)
    assert any(n.endswith("legoworld/evaluation/kernels/api.hpp") for n in names)
    assert not any(n.endswith("_kernel.so") for n in names)


def requirements(metadata: Message) -> list[tuple[str, frozenset[str]]]:
    """Names and extras of what a package needs, its own extras left out."""
    found = [Requirement(line) for line in metadata.get_all("Requires-Dist", [])]
    wanted = [r for r in found if r.marker is None or r.marker.evaluate({"extra": ""})]
    return [(r.name, frozenset(r.extras)) for r in wanted]


def give(environment: Path, needed: list[tuple[str, frozenset[str]]]) -> set[str]:
    """Link these packages of the tests' environment into another one, and all that they need."""
    (place,) = environment.glob("lib/python*/site-packages")
    names: set[str] = set()
    while needed:
        name, extras = needed.pop()
        assert not extras, f"{name}{sorted(extras)}: extras are not followed here"
        if name in names:
            continue
        names.add(name)
        package = importlib.metadata.distribution(name)
        for file in package.files or []:
            if ".." not in file.parts and "__pycache__" not in file.parts:
                target = place / file
                target.parent.mkdir(parents=True, exist_ok=True)
                target.symlink_to(Path(package.locate_file(file)).resolve())
        needed += requirements(package.metadata)
    return names


def test_the_installed_wheel_reads_the_examples(wheel, tmp_path):
    """Beside nothing but what the wheel asks for; pip itself says that this is all there."""
    environment = tmp_path / "venv"
    run(sys.executable, "-m", "venv", "--without-pip", environment)
    with zipfile.ZipFile(wheel) as archive:
        (described,) = [n for n in archive.namelist() if n.endswith(".dist-info/METADATA")]
        metadata = message_from_bytes(archive.read(described))
    names = give(environment, requirements(metadata))
    assert {"bpy", "numpy", "opencv-python-headless"} <= names
    assert not names & {"torch", "opencv-python"}
    pip = [sys.executable, "-m", "pip", "--python", environment / "bin" / "python"]
    run(*pip, "install", "--quiet", "--no-compile", "--no-deps", "--no-index", wheel)
    assert "No broken requirements" in run(*pip, "check").stdout
    clean = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    done = run(
        environment / "bin" / "legoworld", "readout", "--task", "coco", "--json", "-o", "run",
        cwd=tmp_path, env=clean,
    )  # fmt: skip
    document = json.loads(done.stdout)
    assert document["summary"]["coverage"] == {
        "attempted": 4, "by_status": {"ok": 4}, "ok": 4, "ok_empty": 0
    }  # fmt: skip
