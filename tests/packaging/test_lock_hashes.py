"""constraints/: a hash of every file of every locked package."""

from __future__ import annotations

import re

import pytest
from checkout import CHECKOUT

LOCKS = sorted(
    path.name for path in (CHECKOUT / "constraints").glob("*.txt") if ".hashes" not in path.name
)


@pytest.mark.parametrize("name", LOCKS)
def test_every_locked_version_has_its_hashes(name):
    lock = (CHECKOUT / "constraints" / name).read_text(encoding="utf-8").splitlines()[1:]
    hashed = (CHECKOUT / "constraints" / name.replace(".txt", ".hashes.txt")).read_text("utf-8")
    entries = re.findall(r"^(\S+==\S+)((?: \\\n    --hash=sha256:[0-9a-f]{64})+)$", hashed, re.M)
    assert [pin for pin, _ in entries] == lock
    assert len(re.findall("sha256", hashed)) == sum(e.count("sha256") for _, e in entries)


def test_there_are_locks():
    assert LOCKS == ["baselines.txt", "python-3.11.txt", "python-3.13.txt"]
