"""`legoworld doctor`."""

from __future__ import annotations

import os
import platform
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, get_args

import click

from legoworld import extras
from legoworld.commands import options
from legoworld.commands.output import Output, table
from legoworld.pluralize import plural

if TYPE_CHECKING:
    from legoworld.baselines.cards import BaselineCard

#: The bpy release for each supported Python; the same pairs as in pyproject.toml.
BPY_OF_PYTHON: Final = {(3, 11): "5.0.1", (3, 13): "5.2.3"}


@dataclass(frozen=True, kw_only=True)
class Finding:
    """The result of one check, with the next step if it failed.

    needed: whether legoworld cannot work without it.
    """

    name: str
    good: bool
    found: str
    next_step: str = ""
    needed: bool = True


@click.command("doctor")
@options.printing_json
def command(out: Output) -> int:
    """Check that this machine has what legoworld needs, and say what to install.

    Baselines are checked in the environments that `legoworld baseline install` created, or in the
    Python that LEGOWORLD_BASELINE_PYTHON names, with torch's build and the GPUs it sees. A baseline
    that is not ready does not count as a failure.

    \b
    Examples:
      legoworld doctor
      legoworld doctor --json
    """
    findings = [
        _python(),
        _system_libraries(),
        _blender(),
        _kernel(),
        _lvis(),
        _cache(),
        _sandbox(),
        *_extras(),
        *_tasks(),
        _agents_server(),
        *_baselines(),
    ]
    bad = [f for f in findings if not f.good and f.needed]
    rows = [(_state(f), f.name, f.found) for f in findings]
    steps = [f"{f.name}: {f.next_step}" for f in findings if not f.good]
    out.show(
        {"ok": not bad, "findings": [f.__dict__ for f in findings]},
        [table(("", "what", "found"), rows), *steps],
    )
    return 1 if bad else 0


def _state(finding: Finding) -> str:
    if finding.good:
        return "ok"
    return "MISSING" if finding.needed else "not ready"


def _python() -> Finding:
    return Finding(
        name="Python",
        good=sys.version_info[:2] in BPY_OF_PYTHON,
        found=f"{platform.python_version()} on {platform.system()} {platform.machine()}",
        next_step="Blender's Python module exists for Python 3.11 and 3.13 only: create the "
        "environment with python3.11",
    )


def _system_libraries() -> Finding:
    from legoworld.system_libraries import install_line, missing_libraries

    missing = missing_libraries()
    return Finding(
        name="system libraries",
        good=not missing,
        found=f"missing: {', '.join(missing)}" if missing else "all that bpy links",
        next_step=install_line(missing) if missing else "",
    )


def _tasks() -> list[Finding]:
    """Tasks of installed packages that cannot be asked for."""
    from legoworld.tasks.registry import broken_tasks

    return [
        Finding(name="task", good=False, found=e.what, next_step=str(e), needed=False)
        for e in broken_tasks()
    ]


def _blender() -> Finding:
    """Start Blender's Python module in a separate process."""
    from legoworld.errors import LegoWorldError
    from legoworld.scene.blender_process import BlenderProcess, Limits
    from legoworld.scene.cache import bpy_version

    try:
        with BlenderProcess(Limits(time_s=120)) as blender:
            answer = blender.request({"kind": "version"})
        return Finding(
            name="Blender",
            good=True,
            found=f"bpy {bpy_version()} (Blender {answer['blender']}) starts",
        )
    except LegoWorldError as error:
        return Finding(
            name="Blender",
            good=False,
            found=f"bpy {bpy_version()} does not start: {error.found}",
            next_step=f"pip install bpy=={BPY_OF_PYTHON.get(sys.version_info[:2], '5.0.1')}, "
            "and the system libraries above",
        )


def _kernel() -> Finding:
    from legoworld.errors import LegoWorldError
    from legoworld.visibility.library import library

    try:
        name = Path(library()._name).name
        return Finding(
            name="visibility kernel", good=True, found=f"{name}, built from these sources"
        )
    except LegoWorldError as error:
        return Finding(
            name="visibility kernel", good=False, found=error.found, next_step=error.next_step
        )


def _sandbox() -> Finding:
    """Whether `execute` can sandbox a program; without bubblewrap it only applies limits."""
    from legoworld.workers.bubblewrap import how_to_have
    from legoworld.workers.protections import protections

    held = protections("auto")
    by = "the kernel" if held.task_group else "looking 20 times a second"
    description = f"bubblewrap {held.bubblewrap}" if held.bubblewrap else str(held.why_not)
    return Finding(
        name="sandbox",
        good=held.bubblewrap is not None,
        found=f"{description}; processes counted by {by}",
        next_step="programs run by `execute` are limited but not sandboxed: "
        + how_to_have(held.why_not or ""),
        needed=False,
    )


def _lvis() -> Finding:
    from legoworld.evaluation.detection.lvis_package import HOW_TO_INSTALL, is_installed

    return Finding(
        name="LVIS evaluator",
        good=is_installed(),
        found="the official lvis package"
        if is_installed()
        else "the lvis package is not installed",
        next_step=f"{HOW_TO_INSTALL} (to score --task lvis)",
        needed=False,
    )


def _extras() -> list[Finding]:
    """One finding per optional extra: whether its packages are installed."""
    return [
        Finding(
            name=f"extra {extra}",
            good=not (lacking := extras.lacking(extra)),
            found=f"not installed: {', '.join(lacking)}" if lacking else "installed",
            next_step=extras.install_command(extra),
            needed=False,
        )
        for extra in get_args(extras.Extra)
    ]


def _agents_server() -> Finding:
    """The server through which agents reach Blender, in its own environment."""
    from legoworld.agents.mcp_server import server_problems

    problems = server_problems()
    return Finding(
        name="agents' server",
        good=not problems,
        found="; ".join(problems) or "mcp-for-blender is installed",
        next_step="legoworld agent install (for `reconstruct` and `blender mcp`)",
        needed=False,
    )


def _cache() -> Finding:
    from legoworld.scene.cache import default_cache_folder, why_unwritable

    folder = default_cache_folder()
    why = why_unwritable(folder)
    if why:
        return Finding(
            name="snapshot cache",
            good=False,
            found=f"{folder} cannot be written: {why}",
            next_step="set LEGOWORLD_CACHE or pass --cache DIR; commands work without one, as "
            "with --no-cache, and read each scene again",
            needed=False,
        )
    files = [p for p in folder.rglob("*") if p.is_file()] if folder.is_dir() else []
    size = sum(p.stat().st_size for p in files) / 1e6
    free = shutil.disk_usage(folder).free / 1e9
    return Finding(
        name="snapshot cache",
        good=free > 1,
        found=f"{plural(len(files), 'file', 'files')}, {size:,.0f} MB in {folder}; "
        f"{free:,.0f} GB free",
        next_step="free some space, delete the cache folder, or set LEGOWORLD_CACHE",
    )


def _baselines() -> list[Finding]:
    """One finding per baseline: whether its Python has the requirements of its pyproject.toml."""
    from legoworld.baselines.cards import baseline_cards
    from legoworld.errors import CatalogError

    try:
        cards = baseline_cards()
    except CatalogError as error:
        return [Finding(name="baselines", good=False, found=str(error), next_step=error.next_step)]
    given = os.environ.get("LEGOWORLD_BASELINE_PYTHON")
    return [_baseline(card, Path(given) if given else None) for card in cards]


def _baseline(card: BaselineCard, given: Path | None) -> Finding:
    from legoworld.baselines import environments
    from legoworld.baselines.accelerators import inspect_torch, needs_torch
    from legoworld.errors import LegoWorldError

    name, install = f"baseline {card.name}", f"legoworld baseline install {card.name}"
    python = given or environments.installed_python(card)
    if python is None:
        return Finding(
            name=name, good=False, found="no environment", next_step=install, needed=False
        )
    build = ""
    try:
        lacking = environments.problems(card, python)
        build = f"; {inspect_torch(python)}" if needs_torch(card) else ""
    except LegoWorldError as error:
        lacking = [f"{error.what}: {error.found}"]
    return Finding(
        name=name,
        good=not lacking,
        found=("; ".join(lacking) or f"ready, {python}") + build,
        next_step=f"pip install the rest into {python}" if given else install,
        needed=False,
    )
