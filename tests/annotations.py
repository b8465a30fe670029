"""How many of the package's parameters a type checker cannot see into: python tests/annotations.py.

Counted are the annotated parameters of all functions and methods of legoworld/, `*args` and
`**kwargs` too. One is open when its annotation has `Any` or `object` anywhere within it, a
collection without its types (`dict`, `Sequence`), or is a `dict[...]` as a whole, which a record
should be. Names that stand for a type (`Entry = dict[str, Any]`, also imported ones) are replaced
by what they stand for first. An array is not open: `NDArray[Any]` says what it is, and the shape is
in the docstring. `-v` prints every open parameter.
"""

from __future__ import annotations

import ast
import sys
from collections import Counter
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import NamedTuple

import legoworld

PACKAGE = Path(legoworld.__file__).parent
#: Names that say nothing of what is inside; the second kind only without [...].
ANYTHING = frozenset({"Any", "object"})
COLLECTIONS = frozenset(
    {"dict", "list", "set", "frozenset", "tuple", "type", "Callable", "Collection", "Iterable",
     "Iterator", "Mapping", "MutableMapping", "Sequence"}
)  # fmt: skip
#: Of arrays the type of an element may be any.
ARRAYS = frozenset({"NDArray", "ndarray", "dtype", "signedinteger", "integer", "floating"})


class Parameter(NamedTuple):
    """A parameter of a function."""

    module: str
    function: str
    name: str
    annotation: ast.expr


def count_parameters() -> tuple[int, list[Parameter]]:
    """How many annotated parameters there are, and the open ones."""
    trees = modules()
    names = Names(trees)
    found = [one for module in trees for one in parameters(module, trees[module])]
    return len(found), [one for one in found if names.is_open(one.module, one.annotation)]


@cache
def modules() -> dict[str, ast.Module]:
    """The package's modules, parsed, by name."""
    # A wheel has the baselines' programs in _catalog.
    files = [path for path in PACKAGE.rglob("*.py") if "_catalog" not in path.parts]
    return {_module(path): ast.parse(path.read_text(encoding="utf-8")) for path in files}


class Names:
    """The types that the modules of a package give names to."""

    def __init__(self, trees: Mapping[str, ast.Module]) -> None:
        self._aliases = {
            (module, name): value for module in trees for name, value in aliases(trees[module])
        }
        self._imports = {
            (module, name.asname or name.name): (node.module, name.name)
            for module in trees
            for node in ast.walk(trees[module])
            if isinstance(node, ast.ImportFrom) and node.module
            for name in node.names
        }

    def is_open(self, module: str, annotation: ast.expr) -> bool:
        """Whether an annotation of a module is open, seen through the names it uses."""
        if isinstance(annotation, ast.Subscript) and last_name(annotation.value) == "dict":
            return True
        return self._open_within(module, annotation, frozenset())

    def _open_within(self, module: str, node: ast.expr, within: frozenset[tuple[str, str]]) -> bool:
        """within: the names that are being replaced; a recursive type names itself."""
        if isinstance(node, ast.Subscript):
            if last_name(node.value) in ARRAYS | {"Literal"}:
                return False
            outer = last_name(node.value) not in COLLECTIONS and self._open_within(
                module, node.value, within
            )
            return outer or self._open_within(module, node.slice, within)
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            return self._open_within(module, ast.parse(node.value, mode="eval").body, within)
        if isinstance(node, ast.Name | ast.Attribute):
            name = last_name(node)
            place = self._home(module, name)
            if name in ANYTHING or (name in COLLECTIONS and isinstance(node, ast.Name)):
                return True
            if place in within or place not in self._aliases:
                return False
            return self._open_within(place[0], self._aliases[place], within | {place})
        return any(
            self._open_within(module, child, within)
            for child in ast.iter_child_nodes(node)
            if isinstance(child, ast.expr)
        )

    def has_array(self, module: str, node: ast.expr) -> bool:
        """Whether an annotation of a module has an array anywhere, seen through names."""
        return self._array_within(module, node, frozenset())

    def _array_within(
        self, module: str, node: ast.expr, within: frozenset[tuple[str, str]]
    ) -> bool:
        if isinstance(node, ast.Subscript) and last_name(node.value) == "Literal":
            return False
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            return self._array_within(module, ast.parse(node.value, mode="eval").body, within)
        if isinstance(node, ast.Name | ast.Attribute):
            place = self._home(module, last_name(node))
            if last_name(node) in {"NDArray", "ndarray"}:
                return True
            if place in within or place not in self._aliases:
                return False
            return self._array_within(place[0], self._aliases[place], within | {place})
        return any(
            self._array_within(module, child, within)
            for child in ast.iter_child_nodes(node)
            if isinstance(child, ast.expr)
        )

    def _home(self, module: str, name: str) -> tuple[str, str]:
        """The module that gives a name its meaning, and the name there."""
        place = module, name
        while place not in self._aliases and place in self._imports:
            place = self._imports[place]
        return place


def parameters(module: str, tree: ast.Module) -> Iterator[Parameter]:
    """The annotated parameters of a module's functions."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            a = node.args
            for one in (*a.posonlyargs, *a.args, *a.kwonlyargs, a.vararg, a.kwarg):
                if one is not None and one.annotation is not None:
                    yield Parameter(module, node.name, one.arg, one.annotation)


def aliases(tree: ast.Module) -> Iterator[tuple[str, ast.expr]]:
    """The names that a module gives to expressions; those that are no types do no harm."""
    for node in tree.body:
        if isinstance(node, ast.Assign):
            yield from ((t.id, node.value) for t in node.targets if isinstance(t, ast.Name))
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and node.value:
            yield node.target.id, node.value


def _module(path: Path) -> str:
    return ".".join(("legoworld", *path.relative_to(PACKAGE).with_suffix("").parts))


def last_name(node: ast.expr) -> str:
    """The last part of a dotted name; "" for anything else."""
    if isinstance(node, ast.Attribute):
        return node.attr
    return node.id if isinstance(node, ast.Name) else ""


if __name__ == "__main__":
    total, open_ones = count_parameters()
    if "-v" in sys.argv[1:]:
        for one in open_ones:
            print(f"{one.module} {one.function}({one.name}: {ast.unparse(one.annotation)})")
    else:
        for name, n in Counter(one.module for one in open_ones).most_common():
            print(f"{n:4} {name}")
    print(f"{len(open_ones)} of {total} parameters, {len(open_ones) / total:.2%}")
