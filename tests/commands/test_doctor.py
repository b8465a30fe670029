"""Every finding of the doctor, good and bad, with what helps; nothing of this machine is asked."""

from __future__ import annotations

import platform
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from legoworld import extras
from legoworld.commands import doctor_command
from legoworld.commands.doctor_command import Finding
from legoworld.errors import CatalogError, LegoWorldError

BAD = LegoWorldError("it broke", found="a crack", next_step="glue it")


def patch(monkeypatch: pytest.MonkeyPatch, **values: Any) -> None:
    """Answers in place of functions, by module and name with dots as __."""
    for name, value in values.items():
        monkeypatch.setattr(f"legoworld.{name.replace('__', '.')}", value)


def raising(error: Exception) -> Any:
    def fail(*_given: Any, **_named: Any) -> None:
        raise error

    return fail


@pytest.mark.parametrize(("version", "good"), [((3, 11), True), ((3, 13), True), ((3, 12), False)])
def test_python(version, good, monkeypatch):
    monkeypatch.setattr(doctor_command, "sys", SimpleNamespace(version_info=(*version, 4)))
    found = doctor_command._python()
    assert (found.name, found.good, found.needed) == ("Python", good, True)
    assert found.found == f"{platform.python_version()} on {platform.system()} {platform.machine()}"
    assert "Python 3.11 and 3.13 only" in found.next_step


def test_system_libraries(monkeypatch):
    patch(monkeypatch, system_libraries__missing_libraries=list)
    assert doctor_command._system_libraries() == Finding(
        name="system libraries", good=True, found="all that bpy links", next_step=""
    )
    patch(monkeypatch, system_libraries__missing_libraries=lambda: ["libX.so", "libY.so"],
        system_libraries__install_line=lambda names: f"install {len(names)}")  # fmt: skip
    assert doctor_command._system_libraries() == Finding(
        name="system libraries", good=False, found="missing: libX.so, libY.so",
        next_step="install 2",
    )  # fmt: skip


def test_broken_tasks_are_not_needed(monkeypatch):
    patch(monkeypatch, tasks__registry__broken_tasks=lambda: [BAD])
    assert doctor_command._tasks() == [
        Finding(name="task", good=False, found="it broke", next_step=str(BAD), needed=False)
    ]


def test_blender(monkeypatch):
    asked = []

    class Process:
        def __init__(self, limits: Any) -> None:
            asked.append(limits.time_s)

        def __enter__(self) -> Any:
            return SimpleNamespace(request=lambda what: asked.append(what) or {"blender": "5.0.9"})

        def __exit__(self, *_: object) -> None:
            asked.append("closed")

    patch(monkeypatch, scene__blender_process__BlenderProcess=Process,
        scene__cache__bpy_version=lambda: "5.0.1")  # fmt: skip
    assert doctor_command._blender() == Finding(
        name="Blender", good=True, found="bpy 5.0.1 (Blender 5.0.9) starts"
    )
    assert asked == [120, {"kind": "version"}, "closed"]
    patch(monkeypatch, scene__blender_process__BlenderProcess=raising(BAD))
    found = doctor_command._blender()
    assert (found.name, found.good, found.needed) == ("Blender", False, True)
    assert found.found == "bpy 5.0.1 does not start: a crack"
    own = doctor_command.BPY_OF_PYTHON[sys.version_info[:2]]
    assert found.next_step == f"pip install bpy=={own}, and the system libraries above"


def test_the_kernel(monkeypatch):
    patch(monkeypatch, visibility__library__library=lambda: SimpleNamespace(_name="/a/_kernel.so"))
    assert doctor_command._kernel() == Finding(
        name="visibility kernel", good=True, found="_kernel.so, built from these sources"
    )
    patch(monkeypatch, visibility__library__library=raising(BAD))
    assert doctor_command._kernel() == Finding(
        name="visibility kernel", good=False, found="a crack", next_step="glue it"
    )


@pytest.mark.parametrize(
    ("held", "found"),
    [
        ({"bubblewrap": "0.9"}, "bubblewrap 0.9; processes counted by looking 20 times a second"),
        ({"task_group": True, "why_not": "no bwrap"}, "no bwrap; processes counted by the kernel"),
    ],
)
def test_the_sandbox(held, found, monkeypatch):
    wanted = []
    held = SimpleNamespace(**{"bubblewrap": None, "task_group": False, "why_not": None} | held)
    patch(monkeypatch, workers__protections__protections=lambda how: wanted.append(how) or held,
        workers__bubblewrap__how_to_have=lambda why: f"mend {why!r}")  # fmt: skip
    assert doctor_command._sandbox() == Finding(
        name="sandbox", good=held.bubblewrap is not None, found=found, needed=False,
        next_step="programs run by `execute` are limited but not sandboxed: "
        f"mend {held.why_not or ''!r}",
    )  # fmt: skip
    assert wanted == ["auto"]


@pytest.mark.parametrize("there", [True, False])
def test_packages_that_are_not_needed(there, monkeypatch):
    patch(monkeypatch, evaluation__detection__lvis_package__is_installed=lambda: there)
    found = doctor_command._lvis()
    assert (found.name, found.good, found.needed) == ("LVIS evaluator", there, False)
    said = "the official lvis package" if there else "the lvis package is not installed"
    assert found.found == said
    assert found.next_step.endswith(" (to score --task lvis)")
    problems = [] if there else ["no folder", "no python"]
    patch(monkeypatch, agents__mcp_server__server_problems=lambda: problems)
    assert doctor_command._agents_server() == Finding(
        name="agents' server", good=there, needed=False,
        found="mcp-for-blender is installed" if there else "no folder; no python",
        next_step="legoworld agent install (for `reconstruct` and `blender mcp`)",
    )  # fmt: skip
    monkeypatch.setattr(extras, "lacking", lambda extra: [] if there else [extra, "other"])
    found = {one.name: one for one in doctor_command._extras()}
    ray = found["extra ray"]
    assert (ray.good, ray.found, ray.needed) == (
        there, "installed" if there else "not installed: ray, other", False,
    )  # fmt: skip
    assert ray.next_step == extras.install_command("ray")


@pytest.mark.parametrize(("free_gb", "good"), [(1.0, False), (1.001, True), (5.4, True)])
def test_the_cache(free_gb, good, tmp_path, monkeypatch):
    folder = tmp_path / "cache"
    patch(monkeypatch, scene__cache__default_cache_folder=lambda: folder,
        scene__cache__why_unwritable=lambda _: "")  # fmt: skip
    usage = SimpleNamespace(free=free_gb * 1e9)
    monkeypatch.setattr(doctor_command.shutil, "disk_usage", lambda _: usage)
    found = doctor_command._cache()
    assert found.found == f"0 files, 0 MB in {folder}; {free_gb:,.0f} GB free"
    (folder / "a").mkdir(parents=True)
    (folder / "a" / "b").write_bytes(bytes(1_600_000))
    found = doctor_command._cache()
    assert found.found == f"1 file, 2 MB in {folder}; {free_gb:,.0f} GB free"
    assert (found.name, found.good, found.needed) == ("snapshot cache", good, True)
    assert found.next_step.startswith("free some space, delete the cache folder")
    patch(monkeypatch, scene__cache__why_unwritable=lambda path: f"no {path.name}")
    found = doctor_command._cache()
    assert (found.name, found.good, found.needed) == ("snapshot cache", False, False)
    assert found.found == f"{folder} cannot be written: no cache"
    assert found.next_step.startswith("set LEGOWORLD_CACHE or pass --cache DIR")


CARD: Any = SimpleNamespace(name="yolox")


@pytest.mark.parametrize("given", [None, Path("/given/python")])
def test_a_baseline(given, monkeypatch):
    lacking: list[str] = []
    patch(monkeypatch, baselines__environments__installed_python=lambda _: Path("/own/python"),
        baselines__environments__problems=lambda *_: lacking,
        baselines__accelerators__needs_torch=lambda _: True,
        baselines__accelerators__inspect_torch=lambda python: f"torch of {python}")  # fmt: skip
    python = given or "/own/python"
    found = doctor_command._baseline(CARD, given)
    step = f"pip install the rest into {given}" if given else "legoworld baseline install yolox"
    assert found == Finding(
        name="baseline yolox", good=True, found=f"ready, {python}; torch of {python}",
        next_step=step, needed=False,
    )  # fmt: skip
    patch(monkeypatch, baselines__accelerators__needs_torch=lambda _: False)
    assert doctor_command._baseline(CARD, given).found == f"ready, {python}"
    lacking += ["no numpy", "no cv2"]
    found = doctor_command._baseline(CARD, given)
    assert (found.good, found.found, found.next_step) == (False, "no numpy; no cv2", step)
    patch(monkeypatch, baselines__environments__problems=raising(BAD))
    found = doctor_command._baseline(CARD, given)
    assert (found.good, found.found, found.needed) == (False, "it broke: a crack", False)


def test_baselines_without_an_environment_and_cards_that_cannot_be_read(monkeypatch):
    patch(monkeypatch, baselines__environments__installed_python=lambda _: None)
    assert doctor_command._baseline(CARD, None) == Finding(
        name="baseline yolox", good=False, found="no environment",
        next_step="legoworld baseline install yolox", needed=False,
    )  # fmt: skip
    asked = []
    patch(monkeypatch, baselines__cards__baseline_cards=lambda: [CARD])
    monkeypatch.setattr(doctor_command, "_baseline", lambda *given: asked.append(given) or "it")
    monkeypatch.delenv("LEGOWORLD_BASELINE_PYTHON", raising=False)
    assert doctor_command._baselines() == ["it"]
    monkeypatch.setenv("LEGOWORLD_BASELINE_PYTHON", "/given")
    assert doctor_command._baselines() == ["it"]
    assert asked == [(CARD, None), (CARD, Path("/given"))]
    error = CatalogError("a card is broken", found="x", next_step="mend it")
    patch(monkeypatch, baselines__cards__baseline_cards=raising(error))
    assert doctor_command._baselines() == [
        Finding(name="baselines", good=False, found=str(error), next_step="mend it")
    ]
