"""Every option of every command is used by a test, generated from the commands themselves."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest
from commands.every_command import OPTIONS

TESTS = Path(__file__).parents[1]
TAKERS = {
    name: {command for command, names, _ in OPTIONS if name in names}
    for _, names, _ in OPTIONS
    for name in names
}


@cache
def words() -> tuple[frozenset[str], ...]:
    """The words and options of every test file but this one."""
    return tuple(
        frozenset(re.findall(r"(?<=[\"' ])--?[\w-]+|\b\w+\b", path.read_text(encoding="utf-8")))
        for path in TESTS.rglob("*.py")
        if path != Path(__file__)
    )


@pytest.mark.parametrize(("command", "names", "off"), OPTIONS, ids=lambda x: str(x))
def test_an_option_is_used_by_a_test(command, names, off):
    users = [found for found in words() if not found.isdisjoint([*names, *off])]
    if len(TAKERS[names[-1]]) <= 2:  # what several commands take alike is one decorator
        users = [found for found in users if command.split()[-1] in found]
    assert users, f"no test uses {' or '.join(names)} of `legoworld {command}`"
