"""An option of several commands is declared once."""

from __future__ import annotations

import ast
from collections import Counter
from pathlib import Path
from typing import Final

import click
import pytest
from click.testing import CliRunner
from commands.every_command import OPTIONS

from legoworld.commands import options
from legoworld.commands.options import SHARED, long_name, off, option, together

SOURCES: Final = sorted(Path(options.__file__).parent.glob("*.py"))
ROWS: Final = {long_name(names) for names, _, _ in SHARED}
#: Names that mean something else in each command, and have no type in common.
OWN: Final = {"--task", "--depth", "--unit", "--scenes", "--root", "--format", "--port"}


def declarations() -> Counter[str]:
    """How often each long name is declared in the sources, outside the table."""
    return Counter(
        long_name(call.args[0].value)
        for path in SOURCES
        for call in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(call, ast.Call)
        and ast.unparse(call.func) in ("option", "flag", "off", "click.option")
        and call.args
        and isinstance(call.args[0], ast.Constant)
    )


def test_what_is_declared_twice_is_a_row_of_the_table():
    several = {name for name, n in declarations().items() if n > 1}
    assert several - ROWS == OWN


def test_a_row_of_the_table_is_of_several_commands():
    takers = Counter(name for _, names, _ in OPTIONS for name in names)
    assert [name for name in ROWS if takers[name] < 2] == []


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ([], {"pair": "1-7", "render": True, "seed": 0}),
        (["--right", "3", "--no-render", "--left", "2"], {"pair": "2-3", "render": False}),
        (["--seed", "5"], {"seed": 5}),
    ],
)
def test_what_a_command_is_called_with(words, expected):
    given = {}

    @click.command()
    @together(
        "pair",
        lambda left, right: f"{left}-{right}",
        option("--left", "The first.", default=1),
        option("--right", "The second.", default=7),
    )
    @off("--no-render render", "Not rendered.")
    @option("--seed", "RNG seed for a test.")
    def command(**values):
        given.update(values)

    result = CliRunner().invoke(command, words)
    assert result.exit_code == 0, result.output
    assert given == {"pair": "1-7", "render": True, "seed": 0} | expected


def test_the_help_has_the_order_and_the_defaults():
    @click.command()
    @together("both", lambda **both: both, option("--seed"), option("--limit", "Only N."))
    @option("--overwrite")
    def command(**_values):
        pass

    text = CliRunner().invoke(command, ["--help"]).output
    lines = [" ".join(line.split()) for line in text.splitlines() if line.startswith("  --")]
    assert [line.split()[0] for line in lines] == ["--seed", "--limit", "--overwrite", "--help"]
    assert "RNG seed for tie orders and bootstrap. [default: 0" in " ".join(text.split())
