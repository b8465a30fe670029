"""What a command prints, and when: documents or text by --json, notices by -q and -v."""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from legoworld.conventions import SCHEMA_VERSION
from legoworld.errors import escape_json
from legoworld.pluralize import plural
from legoworld.tables.table import Cell
from legoworld.tables.table import table as of_cells
from legoworld.tables.terminal import terminal

if TYPE_CHECKING:
    from legoworld.api.listener import Listener
    from legoworld.records.base import Storable

    Document = Mapping[str, Storable]


@dataclass(frozen=True, kw_only=True)
class Output:
    """The values of --json, -q and -v, and how a command prints by them."""

    as_json: bool = False
    quiet: bool = False
    verbose: bool = False

    @property
    def says_steps(self) -> bool:
        """Whether notices of each step are printed: on a terminal or with -v."""
        return not self.quiet and (self.verbose or on_terminal())

    def notice(self, text: str) -> None:
        """Print a notice on standard error, unless --quiet."""
        if not self.quiet:
            click.echo(text, err=True)

    def step(self, text: str) -> None:
        """Print a notice of a step on standard error, on a terminal or with -v."""
        if self.says_steps:
            click.echo(text, err=True)

    def trace(self, text: str) -> None:
        """Print a traceback on standard error with --verbose, regardless of -q."""
        if self.verbose:
            click.echo(text, err=True)

    def listener(self) -> Listener:
        """Notices and warnings on standard error, unless --quiet; tracebacks with --verbose."""
        from legoworld.api.listener import Listener

        return Listener(notice=self.notice, warn=self.warn, trace=self.trace)

    def warn(self, text: str) -> None:
        """Print a warning on standard error, unless --quiet."""
        self.notice(f"warning: {text}")

    def show(self, document: Document | Callable[[], Document], text: str | Iterable[str]) -> None:
        """Print the document with --json, otherwise the text, or its lines as they come."""
        if self.as_json:
            print_json(document() if callable(document) else document)
            return
        for line in [text] if isinstance(text, str) else text:
            click.echo(line)


def print_json(document: Document) -> None:
    """Print one JSON document with schema_version on standard output; records are converted."""
    from legoworld.records.base import as_json

    whole = {"schema_version": SCHEMA_VERSION, **document}
    text = json.dumps(whole, sort_keys=True, ensure_ascii=False, default=as_json)
    click.echo(escape_json(text))


def table(header: Sequence[str], rows: Iterable[Sequence[Cell]]) -> str:
    """A text table of words and numbers."""
    return terminal(of_cells(header, rows))


def outside_the_vocabulary(label: str, count: int, nearest: list[str]) -> str:
    """The line about a label outside the vocabulary: how many owners, and similar categories."""
    near = f"; near: {', '.join(nearest)}" if nearest else ""
    return f"label {label!r} is not in the vocabulary ({plural(count, 'owner', 'owners')}){near}"


def report_hint(folder: Path, *, photos: bool) -> str:
    """The last line of what evaluate and compare print: how to look at the result.

    photos: whether the page has to be told where they are; a bench's are found without.
    """
    more = " --photos PHOTOS" if photos else ""
    return f"look at it: legoworld report {shlex.quote(str(folder))}{more} -o report.html"


def on_terminal() -> bool:
    """Whether standard error is a terminal."""
    return sys.stderr.isatty()
