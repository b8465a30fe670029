"""The versions in constraints/ are some that pyproject.toml allows, and all that there are."""

from __future__ import annotations

import re
import shlex
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name as canonical

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
PYTHONS = ["3.11", "3.13"]
THIS = f"python-{sys.version_info[0]}.{sys.version_info[1]}"


def locked_versions(name: str) -> dict[str, str]:
    """Package -> version. Nothing but names and versions may be written there."""
    found = {}
    for line in (ROOT / "constraints" / f"{name}.txt").read_text(encoding="utf-8").splitlines():
        if line.startswith("#"):
            continue
        match = re.fullmatch(r"([A-Za-z0-9._-]+)==([0-9][0-9a-z.]*)", line)
        assert match, f"{name}: {line!r} is no name==version"
        found[canonical(match[1])] = match[2]
    return found


def asked_for(python: str) -> list[Requirement]:
    """What the package and all its extras ask for under a Python, and what `make` adds."""
    extras = PROJECT["optional-dependencies"].values()
    lines = [*PROJECT["dependencies"], *(line for extra in extras for line in extra)]
    lines += re.findall(r"^LVIS := (.+)$", MAKEFILE, re.MULTILINE)
    found = [Requirement(line) for line in lines]
    return [r for r in found if r.marker is None or r.marker.evaluate({"python_version": python})]


def for_baselines() -> list[Requirement]:
    """What `make` puts into the baselines' environment."""
    (rule,) = re.findall(r"^\$\(BASELINES\)/installed:.*?@touch", MAKEFILE, re.M | re.S)
    words = [w for line in rule.replace("\\\n", " ").splitlines()[2:] for w in shlex.split(line)]
    return [Requirement(w) for w in words if w[0].isalpha()]


def check(wanted: list[Requirement], versions: dict[str, str]) -> None:
    assert wanted
    for requirement in wanted:
        version = versions.get(canonical(requirement.name))
        assert version is not None, f"{requirement} has no version; run `make lock`"
        assert requirement.specifier.contains(version), f"{requirement}: {version} is locked"


@pytest.mark.parametrize("python", PYTHONS)
def test_every_requirement_is_locked_at_a_version_that_it_allows(python):
    check(asked_for(python), locked_versions(f"python-{python}"))


def test_every_requirement_of_the_baselines_is_locked_at_a_version_that_it_allows():
    names = {r.name for r in for_baselines()}
    assert {"torch", "transformers", "numpy", "pytest-xdist", "depth-anything-3"} <= names
    check(for_baselines(), locked_versions("baselines"))


def installed_beneath(wanted: list[Requirement]) -> dict[str, str]:
    """The installed packages among these, and all that they need."""
    found: dict[str, str] = {}
    waiting = [(r.name, frozenset(r.extras)) for r in wanted]
    seen = set(waiting)
    while waiting:
        name, extras = waiting.pop()
        try:
            package = metadata.distribution(name)
        except metadata.PackageNotFoundError:
            continue  # of an extra that is not installed
        found[canonical(name)] = package.version
        for line in package.requires or []:
            needed = Requirement(line)
            here = [needed.marker is None or needed.marker.evaluate({"extra": e})
                    for e in ("", *extras)]  # fmt: skip
            following = (needed.name, frozenset(needed.extras))
            if any(here) and following not in seen:
                seen.add(following)
                waiting.append(following)
    return found


def test_an_environment_made_from_the_lock_holds_nothing_else():
    """A package that is installed and not locked would be another one next month."""
    if THIS.removeprefix("python-") not in PYTHONS:
        pytest.skip(f"there is no lock for {THIS}")
    versions = locked_versions(THIS)
    asked = asked_for(THIS.removeprefix("python-"))
    # lvis is installed without what it asks for.
    found = installed_beneath([r for r in asked if r.name != "lvis"])
    direct = {canonical(r.name) for r in asked} & found.keys()
    if others := {n: found[n] for n in direct if found[n] != versions.get(n)}:
        pytest.skip(f"made from other versions than the lock's: {others}")
    assert {name: versions.get(name) for name in found} == found
