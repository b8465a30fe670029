"""Every command with its options, from the commands themselves."""

from __future__ import annotations

from collections.abc import Iterator

import click

from legoworld import cli

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
