"""Every option of every command is used by a test, generated from the commands themselves."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import click
import pytest

from legoworld import cli

TESTS = Path(__file__).parents[1]
#: Of every command alike; `-h` and `--version` are click's.
SHARED = {"--help", "--version"}


def commands(command: click.Command, words: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    if isinstance(command, click.Group):
        context = click.Context(command)
        for name in command.list_commands(context):
            found = command.get_command(context, name)
            assert found is not None
            yield from commands(found, (*words, name))
    else:
        yield words


def command_of(words: tuple[str, ...]) -> click.Command:
    found: click.Command = cli.main
    for word in words:
        assert isinstance(found, click.Group)
        found = found.get_command(click.Context(found), word)
    return found


OPTIONS = [
    (" ".join(words), option.opts, option.secondary_opts)
    for words in commands(cli.main)
    for option in command_of(words).params
    if isinstance(option, click.Option) and not SHARED & set(option.opts)
]


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
