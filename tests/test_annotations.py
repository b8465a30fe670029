"""What signatures and docstrings say, and that the counts see what is missing.

Open parameters: `annotations.py`, a bound. Shapes and errors in docstrings: `docstrings.py`, all.
"""

from __future__ import annotations

import ast
from collections import Counter

import pytest
from annotations import Names, count_parameters, modules, parameters
from docstrings import CONVERTED, without_error, without_shape

MOST = 0.02


def test_few_parameters_are_open():
    total, open_ones = count_parameters()
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


def test_every_public_function_with_an_array_states_a_shape():
    total, found = without_shape(modules())
    assert total > 300
    assert [f"{one.module} {one.name}" for one in found] == []


def test_every_public_function_that_raises_names_the_error():
    trees = modules()
    total, found = without_error(trees)
    assert total > 250
    assert [f"{one.module} {one.name}: {error}" for one, error in found] == []
    for name in CONVERTED:
        module, function = name.split()
        assert any(getattr(n, "name", "") == function for n in trees[module].body)


def plant_function(annotation: str, doc: str, class_doc: str = "Values.") -> dict[str, ast.Module]:
    method = f"def f(self, x: {annotation}) -> None:\n        {doc!r}"
    here = f"from p.elsewhere import Array\nclass C:\n    {class_doc!r}\n    {method}\n"
    return {"p.here": ast.parse(here), "p.elsewhere": ast.parse(ELSEWHERE)}


@pytest.mark.parametrize("annotation", ["NDArray[np.bool_]", "Array | None", "dict[str, 'Array']"])
@pytest.mark.parametrize(
    "said",
    [
        "(n, 3) points.",
        "x: (n,).",
        "(2 N, 3).",
        "(H, W, 3) uint8.",
        "(..., K) sums.",
        "One per image.",
    ],
)
def test_a_shape_is_looked_for_where_there_is_an_array(annotation, said):
    assert without_shape(plant_function(annotation, said)) == (1, [])
    assert without_shape(plant_function(annotation, "Some values.", said)) == (1, [])
    (one,) = without_shape(plant_function(annotation, "Values (of a picture, or none)."))[1]
    assert one.name == "C.f"
    assert without_shape(plant_function("int | Literal['a b']", "Some.")) == (0, [])


RAISING = """
class Base(Exception): ...
class Own(Base): ...
def f():
    {doc!r}
    {body}
"""


@pytest.mark.parametrize(
    ("body", "names"),
    [
        ("raise Own('no')", "Own"), ("if x: raise errors.Own from e", "Own"),
        ("raise TypeError('no')", "TypeError"), ("with x: raise Own()", "Own"),
        ("def g(): raise Own()", None), ("raise click.Own()", None), ("raise KeyError(x)", None),
        ("raise make(x)", None), ("raise", None),
    ],
)  # fmt: skip
def test_an_error_is_looked_for_where_it_is_raised(body, names):
    def found(doc: str) -> list[str]:
        tree = ast.parse(RAISING.format(doc=doc, body=body))
        return [error for _, error in without_error({"p": tree})[1]]

    assert found("Does. Ownership.") == ([names] if names else [])
    assert not found("Base for one, TypeError for another.")


@pytest.mark.parametrize(("caught", "leaves"), [("Base", []), ("KeyError", ["Own"])])
def test_an_error_that_the_function_catches_does_not_leave_it(caught, leaves):
    body = f"try: raise Own()\n    except (OSError, {caught}): pass"
    tree = ast.parse(RAISING.format(doc="Does.", body=body))
    assert [error for _, error in without_error({"p": tree})[1]] == leaves
