"""The wheel and the sdist, built as a publisher would and used where nothing else is installed."""

from __future__ import annotations

import importlib.metadata
import os
import re
import shlex
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from email import message_from_bytes
from email.message import Message
from pathlib import Path

import pytest
from checkout import CHECKOUT
from packaging.requirements import Requirement

from legoworld.visibility.compilation import compiler

ROOT = CHECKOUT

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


#: Files of the catalogue that stay in the checkout: programs that need data of others, and records.
NOT_SHIPPED = re.compile(
    r"legoworld/_catalog/(examples/(adapters|coco-val2017|environments|every-question|own-agent)/.*"
    r"|examples/bench/(README\.md|cheats/.*)"
    r"|.*/execution\.json|.*\.gitkeep)"
)
BUILT = {"legoworld/visibility/_kernel.so", "legoworld/evaluation/kernels/_kernel.so"}


def test_the_wheel_holds_every_file_of_the_package_and_the_catalogue_and_nothing_else(wheel):
    listed = run("git", "-C", ROOT, "ls-files", "-co", "--exclude-standard", "--deduplicate", "--",
                 "legoworld", "readouts", "datasets", "baselines", "examples")  # fmt: skip
    there = {name for name in listed.stdout.splitlines() if (ROOT / name).is_file()}
    shipped = {n if n.startswith("legoworld/") else f"legoworld/_catalog/{n}" for n in there}
    names = {n for n in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in n}
    assert len(shipped) > 500
    assert names == {n for n in shipped if not NOT_SHIPPED.fullmatch(n)} | BUILT


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


def link_or_copy(source: Path, target: Path) -> None:
    """A second name, and no symbolic link: the sandbox of `execute` shows the environment alone."""
    try:
        target.hardlink_to(source)
    except OSError:  # another file system
        shutil.copyfile(source, target)


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
                link_or_copy(Path(package.locate_file(file)).resolve(), target)
        needed += requirements(package.metadata)
    return names


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment of the wheel and what it requires; pip itself says that this is complete."""
    environment = tmp_path_factory.mktemp("installed") / "venv"
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
    return environment


#: Modules that need an extra, or run inside Blender alone.
IMPORT_ALL = """
import importlib, pkgutil, sys
import legoworld
count = 0
for module in pkgutil.walk_packages(legoworld.__path__, "legoworld."):
    parts = module.name.split(".")
    if "blender" in parts or "_catalog" in parts or parts[-1] in ("__main__", "_kernel"):
        continue
    try:
        importlib.import_module(module.name)
    except ModuleNotFoundError as error:
        if error.name.split(".")[0] not in (
            "mcp", "fcl", "ray", "fsspec", "pydantic", "anyio", "starlette", "uvicorn", "h11",
            "httpx2",
        ):
            raise
    count += 1
print(count)
"""


def clean_environment() -> dict[str, str]:
    return {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}


def test_every_module_of_the_installed_wheel_can_be_imported(installed, tmp_path):
    done = run(installed / "bin" / "python", "-c", IMPORT_ALL, cwd=tmp_path,
               env=clean_environment())  # fmt: skip
    assert int(done.stdout) > 400


def test_every_command_group_does_its_smallest_work_from_the_installed_wheel(installed, tmp_path):
    (catalog,) = installed.glob("lib/python*/site-packages/legoworld/_catalog")
    done = run(
        installed / "bin" / "python", Path(__file__).with_name("smallest_work.py"),
        installed / "bin" / "legoworld", catalog / "examples", catalog / "datasets",
        cwd=tmp_path, env=clean_environment(),
    )  # fmt: skip
    assert int(done.stdout) > 20
