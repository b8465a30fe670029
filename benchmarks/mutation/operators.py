"""The single changes that `mutate.py` makes to a source file, one at a time.

Not changed: annotations, decorators, docstrings, text inside f-strings and `raise`, strings with a
space (prose), `zip(strict=...)` and `encoding=...` (guards that a correct program never reaches).
Nor is what no caller can see:
- the 1 of a -1 in `reshape`: NumPy takes any negative size as the one to work out. Its sign is;
- the prefix of a scratch folder's random name in the system's temporary folder: nothing reads it.
  In a user's folder its dot hides it from listings, and it is changed;
- the seconds of a `sleep`: when, not what. The call itself is left out as any other is.
"""

from __future__ import annotations

import ast
import copy
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

_COMPARED: Final[dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]]] = {
    ast.Lt: (ast.LtE,),
    ast.LtE: (ast.Lt,),
    ast.Gt: (ast.GtE,),
    ast.GtE: (ast.Gt,),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
_COMPUTED: Final[dict[type[ast.operator], type[ast.operator]]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.FloorDiv,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
}
_SWAPPED: Final = {
    "min": "max", "max": "min", "any": "all", "all": "any", "minimum": "maximum",
    "maximum": "minimum", "floor": "ceil", "ceil": "floor", "argmin": "argmax",
    "argmax": "argmin", "startswith": "endswith", "endswith": "startswith",
    "logical_and": "logical_or", "logical_or": "logical_and",
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Change:
    """Bytes [start, end) of a file become `after`; `function` is the qualified name of the def
    around it, empty at module level."""

    operator: str
    line: int
    function: str
    start: int
    end: int
    before: str
    after: str


def changes(source: bytes) -> list[Change]:
    """Every change of a file, in the order of the file."""
    finder = _Finder(source)
    finder.visit(ast.parse(source))
    return sorted(finder.found, key=lambda change: (change.start, change.end, change.after))


class _Finder(ast.NodeVisitor):
    def __init__(self, source: bytes) -> None:
        self.source = source
        self.found: list[Change] = []
        self.starts = [0]
        for line in source.splitlines(keepends=True):
            self.starts.append(self.starts[-1] + len(line))
        self.function = ""
        self.scope = ""

    def visit(self, node: ast.AST) -> None:
        for operator, after in _of(node):
            self._add(node, operator, after)
        for name, value in ast.iter_fields(node):
            if name in {"annotation", "returns", "decorator_list", "type_comment"}:
                continue
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST) and not _left_alone(node, child):
                    self._enter(child)

    def _enter(self, node: ast.AST) -> None:
        before = self.function, self.scope
        if isinstance(node, ast.ClassDef):
            self.scope += f"{node.name}."
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            self.function = self.scope + node.name
            self.scope = f"{self.function}.<locals>."
        self.visit(node)
        self.function, self.scope = before

    def _add(self, node: ast.AST, operator: str, after: str) -> None:
        assert isinstance(node, ast.expr | ast.stmt)
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        start = self.starts[node.lineno - 1] + node.col_offset
        end = self.starts[node.end_lineno - 1] + node.end_col_offset
        self.found.append(
            Change(
                operator=operator,
                line=node.lineno,
                function=self.function,
                start=start,
                end=end,
                before=self.source[start:end].decode(),
                after=after,
            )
        )


def _left_alone(node: ast.AST, child: ast.AST) -> bool:
    """Whether a child of a node is not looked into."""
    if isinstance(child, ast.JoinedStr | ast.Assert | ast.Import | ast.ImportFrom):
        return True
    if isinstance(node, ast.Raise) or _is_unseen(node, child):
        return True
    if isinstance(child, ast.Expr) and isinstance(child.value, ast.Constant):
        return True  # a docstring
    if isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING":
        return True
    if isinstance(child, ast.Assign) and ast.unparse(child.targets[0]) == "__all__":
        return True
    if isinstance(child, ast.Subscript) and ast.unparse(child.value) == "Literal":
        return True
    if isinstance(node, ast.Call) and ast.unparse(node.func) in {"cast", "TypeVar"}:
        return node.args[:1] == [child]
    return isinstance(child, ast.keyword) and child.arg in {"strict", "encoding"}


def _is_unseen(node: ast.AST, child: ast.AST) -> bool:
    """Whether no caller can see a change of this child: the rules of the module's docstring."""
    if isinstance(node, ast.UnaryOp):
        return getattr(node, "is_size", False)
    if not isinstance(node, ast.Call):
        return False
    name = node.func.attr if isinstance(node.func, ast.Attribute) else ast.unparse(node.func)
    if name == "reshape" and isinstance(child, ast.UnaryOp) and ast.unparse(child) == "-1":
        child.is_size = True  # type: ignore[attr-defined]
    if name == "scratch_folder":
        return node.args == [child] and isinstance(child, ast.Constant)
    return name == "sleep" and isinstance(child, ast.Constant)


def _of(node: ast.AST) -> Iterator[tuple[str, str]]:
    """(operator, text that takes the node's place) for a node, its children left as they are."""
    if isinstance(node, ast.Compare):
        for place, compared in enumerate(node.ops):
            for other in _COMPARED[type(compared)]:
                ops = [*node.ops[:place], other(), *node.ops[place + 1 :]]
                yield "comparison", _text(node, ops=ops)
    elif isinstance(node, ast.BinOp) and type(node.op) in _COMPUTED:
        yield "arithmetic", _text(node, op=_COMPUTED[type(node.op)]())
    elif isinstance(node, ast.AugAssign) and type(node.op) in _COMPUTED:
        yield "arithmetic", _bare(node, op=_COMPUTED[type(node.op)]())
    elif isinstance(node, ast.BoolOp):
        yield "boolean", _text(node, op=ast.Or() if isinstance(node.op, ast.And) else ast.And())
    elif isinstance(node, ast.UnaryOp):
        yield "unary", f"({ast.unparse(node.operand)})"
    elif isinstance(node, ast.Constant):
        yield from _of_constant(node)
    elif isinstance(node, ast.Call):
        yield from _of_call(node)
    elif isinstance(node, ast.IfExp):
        yield "condition", _text(node, body=node.orelse, orelse=node.body)
    elif isinstance(node, ast.Return):
        if node.value is not None and ast.unparse(node.value) != "None":
            yield "return", "return None"
    elif isinstance(node, ast.Expr):
        if isinstance(node.value, ast.Call):
            yield "statement", "pass"
    elif isinstance(node, ast.Continue):
        yield "loop", "break"
    elif isinstance(node, ast.Break):
        yield "loop", "continue"
    elif isinstance(node, ast.Raise):
        yield "raise", "pass"
    if isinstance(node, ast.expr) and getattr(node, "is_condition", False):
        yield "condition", f"(not ({ast.unparse(node)}))"
    if isinstance(node, ast.If | ast.While):
        node.test.is_condition = True  # type: ignore[attr-defined]
    elif isinstance(node, ast.comprehension):
        for test in node.ifs:
            test.is_condition = True  # type: ignore[attr-defined]


def _of_constant(node: ast.Constant) -> Iterator[tuple[str, str]]:
    value = node.value
    if isinstance(value, bool):
        yield "constant", str(not value)
    elif isinstance(value, int | float):
        yield (
            "constant",
            f"({value + 1!r})" if isinstance(value, int) else f"({value * 1.1 + 0.1!r})",
        )
    elif isinstance(value, str) and value and not any(sign.isspace() for sign in value):
        yield "string", repr(f"XX{value}")


def _of_call(node: ast.Call) -> Iterator[tuple[str, str]]:
    for place, keyword in enumerate(node.keywords):
        if keyword.arg not in {None, "strict", "encoding"}:
            kept = [*node.keywords[:place], *node.keywords[place + 1 :]]
            yield "keyword", _text(node, keywords=kept)
    function = copy.copy(node.func)
    if isinstance(function, ast.Name) and function.id in _SWAPPED:
        function.id = _SWAPPED[function.id]
        yield "function", _text(node, func=function)
    elif isinstance(function, ast.Attribute) and function.attr in _SWAPPED:
        function.attr = _SWAPPED[function.attr]
        yield "function", _text(node, func=function)


def _text(node: ast.expr, **fields: object) -> str:
    return f"({_bare(node, **fields)})"


def _bare(node: ast.AST, **fields: object) -> str:
    changed = copy.copy(node)
    for name, value in fields.items():
        setattr(changed, name, value)
    return ast.unparse(changed)
