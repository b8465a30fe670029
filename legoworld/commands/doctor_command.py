"""`legoworld doctor`."""

from __future__ import annotations

import platform
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path

import click

from legoworld.commands import options


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One thing looked at: what it is, whether it is well, and what to do where it is not."""

    name: str
    good: bool
    found: str
    next_step: str = ""


@click.command("doctor", context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
def command(as_json: bool) -> int:
    """Check that this machine has what legoworld needs, and say what to install.

    \b
    Examples:
      legoworld doctor
      legoworld doctor --json
    """
    findings = [_python(), _system_libraries(), _blender(), _kernel(), _cache(), _baselines()]
    bad = [f for f in findings if not f.good]
    if as_json:
        options.print_json({"ok": not bad, "findings": [f.__dict__ for f in findings]})
    else:
        rows = [("ok" if f.good else "MISSING", f.name, f.found) for f in findings]
        click.echo(options.table(("", "what", "found"), rows))
        for finding in bad:
            click.echo(f"{finding.name}: {finding.next_step}")
    return 1 if bad else 0


def _python() -> Finding:
    good = sys.version_info[:2] == (3, 11)
    return Finding(
        name="Python",
        good=good,
        found=f"{platform.python_version()} on {platform.system()} {platform.machine()}",
        next_step="bpy 5.0 is built for Python 3.11 only: make the environment with python3.11",
    )


def _system_libraries() -> Finding:
    from legoworld.system_libraries import install_line, missing_libraries

    missing = missing_libraries()
    return Finding(
        name="system libraries",
        good=not missing,
        found=f"without {', '.join(missing)}" if missing else "all that bpy links",
        next_step=install_line(missing) if missing else "",
    )


def _blender() -> Finding:
    """Start Blender's Python module in a process of its own."""
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
            next_step="pip install bpy==5.0.1, and the system libraries above",
        )


def _kernel() -> Finding:
    from legoworld.errors import LegoWorldError
    from legoworld.visibility.library import library

    try:
        name = Path(library()._name).name
        return Finding(name="visibility kernel", good=True, found=f"{name}, of these sources")
    except LegoWorldError as error:
        return Finding(
            name="visibility kernel", good=False, found=error.found, next_step=error.next_step
        )


def _cache() -> Finding:
    from legoworld.scene.cache import default_cache_folder

    folder = default_cache_folder()
    files = [p for p in folder.rglob("*") if p.is_file()] if folder.is_dir() else []
    place: Path = folder
    while not place.exists():
        place = place.parent
    size = sum(p.stat().st_size for p in files) / 1e6
    free = shutil.disk_usage(place).free / 1e9
    return Finding(
        name="snapshot cache",
        good=free > 1,
        found=f"{len(files)} files, {size:,.0f} MB in {folder}; {free:,.0f} GB free",
        next_step="free some space, delete the cache folder, or set LEGOWORLD_CACHE",
    )


def _baselines() -> Finding:
    from legoworld import catalog

    names = sorted(p.parent.name for p in catalog.folder("baselines").glob("*/pyproject.toml"))
    return Finding(name="baselines", good=True, found=", ".join(names) or "none in this version")
