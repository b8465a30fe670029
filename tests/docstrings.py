"""Public functions whose docstring says too little: python tests/docstrings.py lists them.

Two things are asked of the public functions and methods of legoworld/ (no part of the name begins
with an underscore):

- One that takes or returns an array states a shape, `(n, 3)` or in words such as "one per image",
  in its docstring or in that of its class. Names that stand for an array type are seen through.
- One whose own body raises an error class of legoworld, ValueError or TypeError names that class or
  a base of it in its docstring. Functions within it are not its own body.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from annotations import Names, last_name, modules

#: Modules whose errors are not the package's: click has a UsageError, too.
FOREIGN = frozenset({"click"})
BUILTIN_ERRORS = {"ValueError": "Exception", "TypeError": "Exception"}
_DIMENSION = r"(?:\d+ )?(?:\.\.\.|[A-Z]{1,2}|[A-Z]+_[A-Z_]+|\d+|[a-z]\w*)(?: ?[-+*/] ?\w+)*"
SHAPE = re.compile(
    rf"\({_DIMENSION}(?:,|(?:, {_DIMENSION})+)\)|\(\.\.\.\)"
    r"|\b[Oo]ne\b[\w ,-]* (?:per|for each|for every|of each|of every)\b"
    r"|\b\d-d\b|\bx, y, w, h\b|\b[Ss]hapes?\b"
)


#: Errors that a with statement turns into the one that the docstring names.
CONVERTED = {
    f"legoworld.depth_files.read_depth {name}": "_npz_errors raises DepthFileError in its place"
    for name in ("npz_arrays", "npz_contents", "read_npz_array")
}


class Function(NamedTuple):
    """A public function or method, and the docstring of the class that it stands in."""

    module: str
    name: str
    node: ast.FunctionDef | ast.AsyncFunctionDef
    class_doc: str

    @property
    def doc(self) -> str:
        return ast.get_docstring(self.node) or ""


def without_shape(trees: Mapping[str, ast.Module]) -> tuple[int, list[Function]]:
    """How many public functions have an array, and those of them that state no shape."""
    names = Names(trees)
    found = [
        one
        for one in public_functions(trees)
        if any(names.has_array(one.module, note) for note in annotation_nodes(one.node))
    ]
    return len(found), [one for one in found if not SHAPE.search(f"{one.doc}\n{one.class_doc}")]


def without_error(trees: Mapping[str, ast.Module]) -> tuple[int, list[tuple[Function, str]]]:
    """How many public functions raise, and errors that one of them raises and does not name."""
    bases = error_bases(trees)
    raising = [(one, raised_errors(one.node, bases)) for one in public_functions(trees)]
    raising = [(one, errors) for one, errors in raising if errors]
    unnamed = [
        (one, error)
        for one, errors in raising
        for error in sorted(errors)
        if not bases[error] & set(re.findall(r"\w+", one.doc))
        and f"{one.module} {one.name}" not in CONVERTED
    ]
    return len(raising), unnamed


def public_functions(trees: Mapping[str, ast.Module]) -> Iterator[Function]:
    """Those of modules and of public classes, not those within functions."""
    for module, tree in sorted(trees.items()):
        yield from _public(module, tree, "", "")


def _public(module: str, node: ast.AST, prefix: str, class_doc: str) -> Iterator[Function]:
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef):
            overload = any(last_name(one) == "overload" for one in child.decorator_list)
            if not child.name.startswith("_") and not overload:
                yield Function(module, prefix + child.name, child, class_doc)
        elif isinstance(child, ast.ClassDef):
            if not child.name.startswith("_"):
                doc = ast.get_docstring(child) or ""
                yield from _public(module, child, f"{prefix}{child.name}.", doc)
        elif isinstance(child, ast.stmt):
            yield from _public(module, child, prefix, class_doc)


def annotation_nodes(node: ast.FunctionDef | ast.AsyncFunctionDef) -> Iterator[ast.expr]:
    """What a function says of its parameters and of what it returns."""
    a = node.args
    every = (*a.posonlyargs, *a.args, *a.kwonlyargs, a.vararg, a.kwarg)
    yield from (one.annotation for one in every if one is not None and one.annotation is not None)
    if node.returns is not None:
        yield node.returns


def raised_errors(node: ast.AST, bases: Mapping[str, set[str]]) -> set[str]:
    """The errors of `bases` that leave a function's own body by a raise statement."""
    errors: set[str] = set()
    if isinstance(node, ast.Raise) and node.exc is not None:
        exc = node.exc.func if isinstance(node.exc, ast.Call) else node.exc
        foreign = isinstance(exc, ast.Attribute) and last_name(exc.value) in FOREIGN
        errors = {last_name(exc)} & bases.keys() if not foreign else set()
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef | ast.expr):
            continue
        inner = raised_errors(child, bases)
        if isinstance(node, ast.Try) and child in node.body:
            caught = {last_name(n) for h in node.handlers if h.type for n in _parts(h.type)}
            inner = {error for error in inner if not bases[error] & caught}
        errors |= inner
    return errors


def _parts(types: ast.expr) -> list[ast.expr]:
    return types.elts if isinstance(types, ast.Tuple) else [types]


def error_bases(trees: Mapping[str, ast.Module]) -> dict[str, set[str]]:
    """Each error class of the package, ValueError and TypeError, with the class and its bases."""
    parents = {name: {base} for name, base in BUILTIN_ERRORS.items()} | {
        node.name: {last_name(base) for base in node.bases}
        for tree in trees.values()
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
    }

    def lineage(name: str) -> set[str]:
        return {name}.union(*(lineage(base) for base in parents.get(name, ()) if base != name))

    every = {name: lineage(name) for name in parents}
    return {name: bases for name, bases in every.items() if "Exception" in bases}


if __name__ == "__main__":
    package = modules()
    n_arrays, shapeless = without_shape(package)
    n_raising, unnamed_errors = without_error(package)
    for function in shapeless:
        print(f"{function.module}:{function.node.lineno} {function.name}: no shape")
    for function, error in unnamed_errors:
        print(f"{function.module}:{function.node.lineno} {function.name}: {error} not named")
    print(f"{len(shapeless)} of {n_arrays} functions with arrays state no shape")
    print(f"{len(unnamed_errors)} errors of {n_raising} functions that raise are not named")
