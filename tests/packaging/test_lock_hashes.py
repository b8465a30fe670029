"""constraints/: a hash of every file of every locked package."""

from __future__ import annotations

import re

import pytest
from checkout import CHECKOUT

REST = "# What checks and clusters need besides."
LOCKS = sorted(
    path.name for path in (CHECKOUT / "constraints").glob("*.txt") if ".hashes" not in path.name
)


@pytest.mark.parametrize("name", LOCKS)
def test_every_locked_version_has_its_hashes(name):
    lock = (CHECKOUT / "constraints" / name).read_text(encoding="utf-8").splitlines()[1:]
    hashed = (CHECKOUT / "constraints" / name.replace(".txt", ".hashes.txt")).read_text("utf-8")
    entries = re.findall(r"^(\S+==\S+)((?: \\\n    --hash=sha256:[0-9a-f]{64})+)$", hashed, re.M)
    first, _, rest = hashed.partition(REST)
    parts = [[pin for pin, _ in entries if f"{pin} " in part] for part in (first, rest)]
    assert sorted([*parts[0], *parts[1]]) == sorted(lock)
    assert [p for p in lock if p in parts[0]] == parts[0], "each part is in the lock's order"
    assert [p for p in lock if p in parts[1]] == parts[1]
    assert len(re.findall("sha256", hashed)) == sum(e.count("sha256") for _, e in entries)


def test_there_are_locks():
    assert LOCKS == ["baselines.txt", "python-3.11.txt", "python-3.13.txt"]


def test_what_tests_need_comes_before_what_only_checks_need():
    text = (CHECKOUT / "constraints" / "python-3.11.hashes.txt").read_text(encoding="utf-8")
    first = {name.lower() for name in re.findall(r"^([\w.-]+)==", text.partition(REST)[0], re.M)}
    assert {"bpy", "numpy", "pycocotools", "lvis", "trimesh", "pytest", "hypothesis"} <= first
    assert not {"mypy", "ruff", "ray", "moto"} & first
