"""The plugin on every shipped example and on the bench's families: guarded, and as offline."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from endpoint.clients import ServedSession, serve_session
from plugin.guarded import check_scene

from legoworld.plugin.connection import Address, BlenderConnection
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.workers.sandbox import SandboxLimits

pytestmark = pytest.mark.blender

EXAMPLES = Path(__file__).parents[2] / "examples"
SHIPPED = sorted(path.parent.name for path in EXAMPLES.glob("*/scene.blend"))
FAMILIES = ("bedroom", "car_park", "crossing", "kitchen", "living_room", "restaurant", "street",
            "study")  # fmt: skip
LIMITS = SandboxLimits(time_s=3600.0, memory_bytes=6 << 30, disk_bytes=4 << 30)


@pytest.fixture(scope="module")
def blender() -> Iterator[BlenderProcess]:
    with BlenderProcess(Limits()) as process:
        yield process


@pytest.fixture(scope="module")
def endpoint(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServedSession]:
    with serve_session(tmp_path_factory.mktemp("endpoint"), limits=LIMITS) as found:
        yield found


def _check(blend: Path, endpoint: ServedSession, blender: BlenderProcess, folder: Path) -> None:
    copy = endpoint.workspace / f"{blend.parent.name}.blend"
    shutil.copyfile(blend, copy)
    connection = BlenderConnection(Address(port=endpoint.server.port))
    (folder / "case").mkdir()
    check_scene(copy, folder / "case", connection, blender)


def test_the_examples_are_there():
    assert SHIPPED == ["astronaut", "chelsea", "coffee", "motorcycle"]


@pytest.mark.parametrize("name", SHIPPED)
def test_an_example(name, endpoint, blender, tmp_path):
    _check(EXAMPLES / name / "scene.blend", endpoint, blender, tmp_path)


@pytest.mark.real_data
@pytest.mark.parametrize("name", FAMILIES)
def test_a_family(name, endpoint, blender, tmp_path):
    kaykit = os.environ.get("LEGOWORLD_KAYKIT")
    if not kaykit or not Path(kaykit).is_dir():
        pytest.skip("LEGOWORLD_KAYKIT names no folder of KayKit's packs")
    build = [sys.executable, str(EXAMPLES / "bench" / "build.py"), "--kaykit", kaykit]
    made = subprocess.run(
        [*build, "-o", str(tmp_path / "made"), "--family", name],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert made.returncode == 0, made.stderr[-2000:]
    _check(tmp_path / "made" / name / "scene.blend", endpoint, blender, tmp_path)
