"""Which functions and test files read a name that a module binds at its top level; see mutate.py.

No call leads to a constant, a table or a class body: the tests of one are those that call a
function that reads it, in its own file or in one that imports it, however often it is renamed or
becomes part of another constant on the way.
"""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Final

_DEFINITION: Final = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True, kw_only=True)
class _File:
    """reads: the functions that read a name; derives: top-level names whose statement reads one;
    imports: (name, module, its name there)."""

    reads: dict[str, set[str]] = field(default_factory=lambda: defaultdict(set))
    derives: dict[str, set[str]] = field(default_factory=lambda: defaultdict(set))
    imports: set[tuple[str, str, str]] = field(default_factory=set)


class Readers:
    """The readers of every top-level name below the folders legoworld/ and tests/ of `root`."""

    def __init__(self, root: Path) -> None:
        self._root = root

    @cached_property
    def _files(self) -> dict[str, _File]:
        folders = [self._root / "legoworld", self._root / "tests"]
        return {
            path.relative_to(self._root).as_posix(): _read(ast.parse(path.read_bytes()))
            for folder in folders
            for path in sorted(folder.rglob("*.py"))
        }

    @cached_property
    def _importers(self) -> dict[tuple[str, str], set[tuple[str, str]]]:
        importers: dict[tuple[str, str], set[tuple[str, str]]] = defaultdict(set)
        for name, file in self._files.items():
            for local, module, there in file.imports:
                importers[_file(module, self._files), there].add((name, local))
        return importers

    def of(self, path: str, source: bytes, start: int) -> tuple[set[tuple[str, str]], set[str]]:
        """((file, qualified name) of the functions, test files) that read what the top-level
        statement around byte `start` of `path` binds."""
        functions: set[tuple[str, str]] = set()
        tests: set[str] = set()
        left = [(path, name) for name in _bound(_statement(ast.parse(source), source, start))]
        seen = set(left)
        while left:
            place, name = left.pop()
            file = self._files[place]
            if place.startswith("tests/"):
                tests.add(place)
            functions |= {(place, reader) for reader in file.reads[name]}
            others = {(place, other) for other in file.derives[name]}
            others |= self._importers[place, name]
            left += sorted(others - seen)
            seen |= others
        return functions, tests


def _file(module: str, files: dict[str, _File]) -> str:
    path = module.replace(".", "/")
    return f"{path}.py" if f"{path}.py" in files else f"{path}/__init__.py"


def _read(tree: ast.Module) -> _File:
    file = _File()
    modules: dict[str, str] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                file.imports.add((alias.asname or alias.name, node.module, alias.name))
                modules[alias.asname or alias.name] = f"{node.module}.{alias.name}"
        elif isinstance(node, ast.Import):
            modules |= {alias.asname or alias.name: alias.name for alias in node.names}
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and ast.unparse(node.value) in modules:
            # A function reads `attr`, and that is the module's own.
            file.imports.add((node.attr, modules[ast.unparse(node.value)], node.attr))
    for statement in tree.body:
        bound = _bound(statement)
        for function, part in _functions(statement, ""):
            for name in _mentioned(part):
                file.reads[name].add(function)
            for name in bound if isinstance(statement, ast.ClassDef) else ():
                file.reads[name].add(function)
        if not isinstance(statement, _DEFINITION | ast.Import | ast.ImportFrom):
            for name in _mentioned(statement, functions=False):
                file.derives[name] |= bound
    return file


def _functions(node: ast.AST, scope: str) -> Iterator[tuple[str, ast.AST]]:
    """Each function of a statement with its qualified name, nested ones as well."""
    inner = scope
    if isinstance(node, _DEFINITION):
        yield scope + node.name, node
        inner = f"{scope}{node.name}.<locals>."
    elif isinstance(node, ast.ClassDef):
        inner = f"{scope}{node.name}."
    for child in ast.iter_child_nodes(node):
        yield from _functions(child, inner)


def _mentioned(node: ast.AST, *, functions: bool = True) -> Iterator[str]:
    """The names that a node reads. functions: those that functions within it read, too."""
    for child in ast.iter_child_nodes(node):
        if functions or not isinstance(child, _DEFINITION):
            yield from _mentioned(child, functions=functions)
    if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
        yield node.id
    elif isinstance(node, ast.Attribute):
        yield node.attr


def _statement(tree: ast.Module, source: bytes, start: int) -> ast.stmt:
    """The top-level statement around a byte."""
    line = source[:start].count(b"\n") + 1
    return next(s for s in tree.body if s.lineno <= line <= (s.end_lineno or s.lineno))


def _bound(statement: ast.stmt) -> set[str]:
    if isinstance(statement, ast.ClassDef | _DEFINITION):
        return {statement.name}
    return {
        node.id
        for node in ast.walk(statement)
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
    }
