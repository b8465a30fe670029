"""How many parameters are open (`annotations.py`): a bound, and that the count sees them."""

from __future__ import annotations

import ast
from collections import Counter

import pytest
from annotations import Names, counted, parameters

MOST = 0.02


def test_few_parameters_are_open():
    total, open_ones = counted()
    worst = Counter(one.module for one in open_ones).most_common(5)
    assert total > 6000
    assert len(open_ones) / total < MOST, f"python tests/annotations.py -v lists them: {worst}"


ELSEWHERE = """
from typing import Any, TypeAlias
Entry = dict[str, Any]
Entries = list[Entry]
Check = Callable[[object], str]
Array = NDArray[Any]
Json: TypeAlias = "str | Sequence[Json] | Mapping[str, Json]"
Loose: TypeAlias = "str | Sequence[Loose] | Mapping[str, Any]"
"""


@pytest.mark.parametrize(
    ("annotation", "is_open"),
    [
        ("Any", True), ("object", True), ("Any | None", True), ("Sequence[object]", True),
        ("Mapping[str, Any]", True), ("dict", True), ("Mapping", True), ("dict[str, int]", True),
        ("Callable[[Any], None]", True), ("'Entry'", True), ("Entries", True), ("Check", True),
        ("Renamed", True), ("Own", True), ("typing.Any", True),
        ("int", False), ("Mapping[str, int]", False), ("NDArray[Any]", False), ("Array", False),
        ("Json", False), ("Literal['object', 'Any']", False), ("bpy.types.Collection", False),
        ("tuple[Json, ...]", False),
    ],
)  # fmt: skip
def test_the_count_sees_through_names(annotation, is_open):
    here = (
        "from p.elsewhere import Array, Check, Entries, Entry, Json, Loose as Renamed\n"
        f"Own = Entries | None\ndef f(x: {annotation}): ...\n"
    )
    trees = {"p.here": ast.parse(here), "p.elsewhere": ast.parse(ELSEWHERE)}
    (one,) = parameters("p.here", trees["p.here"])
    assert Names(trees).is_open("p.here", one.annotation) is is_open


def test_every_kind_of_parameter_is_counted():
    tree = ast.parse("def f(a: int, /, b: int, *c: int, d: int, f=1, **e: int): ...")
    assert [one.name for one in parameters("p", tree)] == ["a", "b", "d", "c", "e"]
