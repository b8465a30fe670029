"""A table as a value: columns, and rows of cells that still hold their numbers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from msgspec import Struct


class Number(Struct, frozen=True, kw_only=True, tag=True):
    """A measured number; None is undefined.

    ends: of its confidence interval; sd: a standard deviation, shown where there is no interval;
    digits: decimal places; signed: with a plus sign; below: what it is over, shown under it.
    """

    value: float | None
    ends: tuple[float, float] | None = None
    sd: float | None = None
    digits: int = 4
    signed: bool = False
    below: str = ""

    @property
    def without_interval(self) -> Number:
        """The value without its interval."""
        return Number(value=self.value, digits=self.digits, signed=self.signed)

    @property
    def interval_text(self) -> str:
        """The interval, or the standard deviation; empty without either."""
        if self.ends:
            low, high = map(self._spelt, self.ends)
            return f"[{low}, {high}]"
        return "" if self.sd is None else f"sd {self.sd:.{self.digits}f}"

    def __str__(self) -> str:
        """The value alone."""
        return "-" if self.value is None else self._spelt(self.value)

    def _spelt(self, value: float) -> str:
        return f"{value + 0.0:{'+' if self.signed else ''}.{self.digits}f}"  # + 0.0: no -0.0


class Spread(Struct, frozen=True, kw_only=True, tag=True):
    """The interval of a number that stands in another column."""

    of: Number

    def __str__(self) -> str:
        """The interval or standard deviation, "-" for none."""
        return self.of.interval_text or "-"


class Count(Struct, frozen=True, kw_only=True, tag=True):
    """A count, and what it is out of."""

    n: int
    of: int | None = None

    def __str__(self) -> str:
        """Such as "3 of 7", or the count alone."""
        return str(self.n) if self.of is None else f"{self.n} of {self.of}"


class Text(Struct, frozen=True, kw_only=True, tag=True):
    """Words with a second line below, or a link within a page."""

    text: str
    below: str = ""
    link: str = ""

    def __str__(self) -> str:
        """The first line."""
        return self.text


Cell = Number | Spread | Count | Text | str | int


class Column(Struct, frozen=True, kw_only=True):
    """A column. group: the heading that it shares with its neighbours; key: sorts a page's rows."""

    name: str
    group: str = ""
    key: str = ""


class Table(Struct, frozen=True, kw_only=True):
    """Rows under their columns. notes: sentences below; folded: a page shows the title first.

    key: by which a page's scripts find the table.
    """

    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    title: str = ""
    notes: tuple[str, ...] = ()
    folded: bool = False
    key: str = ""

    @property
    def header(self) -> tuple[str, ...]:
        """The names of the columns."""
        return tuple(column.name for column in self.columns)

    @property
    def numeric(self) -> tuple[bool, ...]:
        """Which columns hold single numbers alone, besides empty cells: they align right."""
        cells = [[row[k] for row in self.rows] for k in range(len(self.columns))]
        return tuple(bool(column) and all(map(_aligns_right, column)) for column in cells)


def table(
    header: Iterable[str],
    rows: Iterable[Sequence[Cell]],
    *,
    title: str = "",
    notes: Sequence[str] = (),
    folded: bool = False,
) -> Table:
    """A table whose columns have names alone."""
    return Table(
        columns=tuple(Column(name=name) for name in header),
        rows=tuple(map(tuple, rows)),
        title=title,
        notes=tuple(notes),
        folded=folded,
    )


def line(cell: Cell) -> str:
    """A cell in one line: "0.2500 [0.1250, 0.5000]", "0.5000 (sd 0.0625)", "3 of 7"."""
    if not isinstance(cell, Number) or cell.value is None or not cell.interval_text:
        return str(cell)
    return f"{cell} {cell.interval_text}" if cell.ends else f"{cell} ({cell.interval_text})"


def _aligns_right(cell: Cell) -> bool:
    if isinstance(cell, Number):
        return not cell.interval_text
    return not isinstance(cell, str | Text) or cell in ("", "-")
