"""How much of the package's parameters a type checker cannot see into: python tests/annotations.py.

Counted are the annotated parameters of all functions and methods of legoworld/, `*args` and
`**kwargs` too. One is open when its annotation is `Any` or `dict[...]` itself, or has somewhere
within it `dict[..., Any]` or a name that a module gives to one (`Entry = dict[str, Any]`). An array
is not open: `NDArray[Any]` says what it is, and the shape is in the docstring.
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import legoworld

PACKAGE = Path(legoworld.__file__).parent


def counted() -> tuple[int, Counter[str]]:
    """How many annotated parameters there are, and the open ones by file."""
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in PACKAGE.rglob("*.py")}
    aliases = {name for tree in trees.values() for name in _aliases(tree)}
    found = [(path, annotation) for path in trees for annotation in _annotations(trees[path])]
    open_ones = Counter(
        path.relative_to(PACKAGE).as_posix() for path, a in found if _is_open(a, aliases)
    )
    return len(found), open_ones


def _annotations(tree: ast.Module) -> Iterator[ast.expr]:
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            a = node.args
            for one in (*a.posonlyargs, *a.args, *a.kwonlyargs, a.vararg, a.kwarg):
                if one is not None and one.annotation is not None:
                    yield one.annotation


def _aliases(tree: ast.Module) -> Iterator[str]:
    for node in tree.body:
        if isinstance(node, ast.Assign) and _holds_any_dict(node.value):
            yield from (t.id for t in node.targets if isinstance(t, ast.Name))


def _is_open(annotation: ast.expr, aliases: set[str]) -> bool:
    whole = annotation.value if isinstance(annotation, ast.Subscript) else annotation
    if isinstance(whole, ast.Name) and whole.id in ("Any", "dict"):
        return True
    return _holds_any_dict(annotation) or not aliases.isdisjoint(_names(annotation))


def _holds_any_dict(node: ast.expr) -> bool:
    return any(
        isinstance(part, ast.Subscript)
        and isinstance(part.value, ast.Name)
        and part.value.id == "dict"
        and "Any" in _names(part.slice)
        and "NDArray" not in _names(part.slice)
        for part in ast.walk(node)
    )


def _names(node: ast.AST) -> set[str]:
    return {part.id for part in ast.walk(node) if isinstance(part, ast.Name)}


if __name__ == "__main__":
    total, by_file = counted()
    for name, n in by_file.most_common():
        print(f"{n:4} {name}")
    print(f"{by_file.total()} of {total} parameters, {by_file.total() / total:.2%}")
