"""What several test folders share: scenes built by Blender in a process of their own."""

from __future__ import annotations

import fcntl
import functools
import gc
import importlib.metadata
import importlib.util
import os
import signal
import tempfile
import textwrap
from collections.abc import Callable, Generator, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest
from building import SceneBuilder
from checkout import CHECKOUT
from skips import SkipAudit
from warm_blender import HandedOn, handing_on

import legoworld
from legoworld.workers.processors import usable_cores

#: Real scenes and photos that are not part of the repo; tests of marker `real_data` need them.
REAL_DATA = Path(os.environ.get("LEGOWORLD_REAL_DATA", CHECKOUT.parent / "shared" / "data"))

# The laws draw the same examples everywhere: a failure is there again, on any machine. (The
# environment of the baselines has no hypothesis, and its tests no laws.)
if importlib.util.find_spec("hypothesis"):
    from hypothesis import HealthCheck, settings

    settings.register_profile(
        "legoworld",
        derandomize=True,
        deadline=None,
        database=None,
        print_blob=True,
        suppress_health_check=list(HealthCheck),  # some are about time
    )
    settings.load_profile("legoworld")

_IDLE_BLENDERS = HandedOn()

BuildScenes = Callable[[str, Path], None]

_PRELUDE = """
import sys, bpy
from pathlib import Path
OUT = Path(sys.argv[-1])

def fresh():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = 64, 48
    return scene

def camera(z=10.0, lens=36.0, **settings):
    data = bpy.data.cameras.new("Camera")
    data.lens = lens
    for key, value in settings.items():
        setattr(data, key, value)
    made = bpy.data.objects.new("Camera", data)
    made.location.z = z
    bpy.context.scene.collection.objects.link(made)
    bpy.context.scene.camera = made
    return made

def mesh(name, vertices, faces, **properties):
    data = bpy.data.meshes.new(name)
    data.from_pydata(vertices, [], faces)
    made = bpy.data.objects.new(name, data)
    for key, value in properties.items():
        made[key] = value
    bpy.context.scene.collection.objects.link(made)
    return made

def quad(name, x=0.0, y=0.0, z=0.0, half=1.0, **properties):
    corners = [(x-half, y-half, z), (x+half, y-half, z), (x+half, y+half, z), (x-half, y+half, z)]
    return mesh(name, corners, [(0, 1, 2, 3)], **properties)

def save(name):
    folder = OUT / name
    folder.mkdir(parents=True, exist_ok=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"), check_existing=False)
"""


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--fail-on-skip`, for the gate."""
    parser.addoption(
        "--fail-on-skip", action="store_true", help="fail when a skip is not one of tests/skips.py"
    )


def pytest_configure(config: pytest.Config) -> None:
    """Audit skips where all workers report to; refuse to test the sources for the wheel."""
    if config.getoption("--fail-on-skip") and not hasattr(config, "workerinput"):
        config.pluginmanager.register(SkipAudit())
    package = Path(legoworld.__file__).parent
    if "LEGOWORLD_CHECKOUT" in os.environ and package.is_relative_to(CHECKOUT / "legoworld"):
        pytest.exit(f"the tests of the wheel import {package}, not an installation", returncode=3)


@pytest.hookimpl(wrapper=True)
def pytest_collection(session: pytest.Session) -> Generator[None, Any, Any]:
    """Collect without looking for garbage: thousands of tests stay, and are walked through no more.

    The first of several processes collects alone: it compiles the modules that all import.
    """
    gc.disable()
    try:
        with _once_compiled(session.config):
            return (yield)
    finally:
        gc.freeze()
        gc.enable()


@contextmanager
def _once_compiled(config: pytest.Config) -> Iterator[None]:
    """Wait while the first process collects, if this is a worker of xdist."""
    if not hasattr(config, "workerinput"):
        yield
        return
    own_folder = Path(config.option.basetemp)  # each worker's, in that of the whole run
    with own_folder.with_name("collected").open("a") as collected:
        fcntl.flock(collected, fcntl.LOCK_EX)
        if own_folder.with_name("collected").stat().st_size:
            fcntl.flock(collected, fcntl.LOCK_UN)
        yield
        collected.write("once\n")


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """A test of Blender's start meets no process that another test has left."""
    _IDLE_BLENDERS.active = item.get_closest_marker("own_blender") is None


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """One more than there are cores: five on two cores were no quicker than three."""
    return usable_cores() + 1


@pytest.fixture(scope="session")
def build_scenes() -> Iterator[BuildScenes]:
    """Run a bpy program in another process; it gets OUT, fresh(), camera(), quad(), save()."""
    with tempfile.TemporaryFile() as log, closing(SceneBuilder(log)) as builder:
        yield lambda program, folder: builder.run(_PRELUDE + textwrap.dedent(program), folder)


@pytest.fixture(scope="module")
def scenes(
    request: pytest.FixtureRequest,
    tmp_path_factory: pytest.TempPathFactory,
    build_scenes: BuildScenes,
) -> Path:
    """The folder of scenes that the test module's SCENES builds."""
    folder = tmp_path_factory.mktemp("scenes")
    build_scenes(request.module.SCENES, folder)
    return folder


@pytest.fixture(params=["bubblewrap", "limits"])
def confinement(request: pytest.FixtureRequest) -> str:
    """Each way a program is confined; one that this machine does not have is skipped."""
    from workers.confinements import bubblewrap_or_skip

    if request.param == "bubblewrap":
        bubblewrap_or_skip()
    return str(request.param)


@pytest.fixture(autouse=True, scope="session")
def _ctrl_c_is_heard() -> None:
    """A shell's background job ignores Ctrl-C, and so would every command that a test stops."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True, scope="session")
def _no_disk_is_waited_for() -> Iterator[None]:
    """What a power cut takes no test can see, and a busy disk takes its time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda _descriptor: None)
        yield


@pytest.fixture(autouse=True, scope="session")
def _versions_are_read_once() -> Iterator[None]:
    """An evaluation names its packages' versions: 20 ms of parsing for what stays the same."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(importlib.metadata, "version", functools.cache(importlib.metadata.version))
        yield


@pytest.fixture(autouse=True, scope="session")
def _blender_is_handed_on() -> Iterator[None]:
    """One Blender reads for many tests, unless they are marked `own_blender`."""
    with handing_on(_IDLE_BLENDERS):
        yield


@pytest.fixture(autouse=True, scope="session")
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """No test reads or fills the user's snapshot cache, nor does what whole files share."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LEGOWORLD_CACHE", str(tmp_path_factory.getbasetemp() / "cache"))
        yield


@pytest.fixture(autouse=True, scope="session")
def _what_is_written_can_be_read() -> Iterator[None]:
    """No test writes a record that its own type refuses: `replace` checks no value."""
    if not importlib.util.find_spec("msgspec"):  # the environment of the baselines has no records
        yield
        return
    from legoworld.records import base

    def checked(record: Any) -> Any:
        written = plain(record)
        if isinstance(record, base.Record):
            base.to_record(type(record), written)
        return written

    plain = base.as_json
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(base, "as_json", checked)
        yield


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real scenes and photos; skips where it is absent."""
    if not REAL_DATA.is_dir():
        pytest.skip("real scenes and photos are not here; set LEGOWORLD_REAL_DATA to their folder")
    return REAL_DATA
