"""Writes docs/commands.md from the commands' own help; --check only says whether it is current."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from legoworld import exit_codes
from legoworld.cli import main

PAGE = Path(__file__).with_name("commands.md")

_OVERWRITING = """Results (runs, evaluations, comparisons, tables, tracks, datasets, exports) are
replaced only with `--overwrite`, and a folder of another kind never. What is made again from its
inputs (pages, pictures, the scene of `execute`, reward.json) replaces an earlier one.
"""

_COMPLETION = """Shell completion of commands, options and choices, in the shell's start-up file:

```sh
eval "$(_LEGOWORLD_COMPLETE=bash_source legoworld)"              # bash 4.4 or later, ~/.bashrc
eval "$(_LEGOWORLD_COMPLETE=zsh_source legoworld)"               # zsh, ~/.zshrc
_LEGOWORLD_COMPLETE=fish_source legoworld | source               # fish, ~/.config/fish/config.fish
```

To keep the call out of the start-up of a shell, write what it prints into a file once, and source
the file.
"""


def render() -> str:
    """The whole page."""
    context = click.Context(main, info_name="legoworld", terminal_width=96, max_content_width=96)
    codes = "".join(f"| {code} | {meaning} |\n" for code, meaning in exit_codes.MEANING.items())
    parts = [
        "# Commands\n\nGenerated from the program's own help by `python docs/commands_page.py`.\n\n"
        f"| exit code | meaning |\n|---:|---|\n{codes}",
        _OVERWRITING,
        _COMPLETION,
    ]
    for name in main.list_commands(context):
        command = main.get_command(context, name)
        assert command is not None
        parts += _sections(command, name, context)
    return "\n".join(parts)


def _sections(command: click.Command, name: str, parent: click.Context) -> list[str]:
    """The help of a command, and of the commands below it."""
    own = click.Context(
        command,
        info_name=name,
        parent=parent,
        terminal_width=96,
        max_content_width=96,
        help_option_names=["-h", "--help"],
    )
    sections = [f"## {own.command_path}\n\n```\n{command.get_help(own)}\n```\n"]
    if isinstance(command, click.Group):
        for below, each in sorted(command.commands.items()):
            sections += _sections(each, below, own)
    return sections


if __name__ == "__main__":
    if "--check" in sys.argv:
        sys.exit(PAGE.read_text(encoding="utf-8") != render())
    PAGE.write_text(render(), encoding="utf-8")
