"""A scene program cut into the steps that an agent would take: each a call of its own."""

from __future__ import annotations

import ast
import itertools
from pathlib import Path
from typing import Final

from legoworld.errors import LegoWorldError
from legoworld.records.agents import RecordedStep

MOST_STEPS: Final = 24
EXECUTE: Final = "execute_blender_code"
#: Statements that show in the scene; what is between them only prepares the next.
_ACTS: Final = (ast.Expr, ast.For, ast.While, ast.With, ast.If, ast.Try)
#: Every call has a namespace of its own, and a program has one: it is kept in a module.
_WITHIN: Final = """import sys, types
program = vars(sys.modules.setdefault("program", types.ModuleType("program")))
program.update(__name__="__main__", __file__="scene.py")
exec(compile({source}, "scene.py", "exec"), program)
"""


class ProgramNotCutError(LegoWorldError):
    """A scene program cannot be read as Python."""

    code = "program_not_cut"


def cut_program(path: Path, most: int = MOST_STEPS) -> list[RecordedStep]:
    """The steps of a scene program, at most `most`; played in order they are the program.

    A step ends with each statement that acts. The body of a main() that the program ends with
    counts as its own statements. A step that fails is the last, as it would be in the program.
    ProgramNotCutError for a file that is not Python.
    """
    try:
        module = ast.parse(path.read_bytes())
    except (SyntaxError, ValueError) as error:
        raise ProgramNotCutError(
            f"{path.name} cannot be cut into steps",
            found=str(error),
            expected="a Python program",
            next_step="correct the program, or record its steps as JSON Lines",
        ) from error
    statements = _unfold_main(module.body)
    future = [s for s in statements if isinstance(s, ast.ImportFrom) and s.module == "__future__"]
    groups: list[list[ast.stmt]] = [[]]
    for statement in statements:
        if statement in future or _is_text(statement):
            continue
        groups[-1].append(statement)
        if isinstance(statement, _ACTS):
            groups.append([])
    sources = [
        _source([*future, *group]) for group in _merge_groups([g for g in groups if g], most)
    ]
    return [
        RecordedStep(
            tool=EXECUTE,
            arguments={"code": _WITHIN.format(source=repr(source))},
            must_succeed=True,
        )
        for source in sources
    ]


def saving_step(workspace: Path) -> RecordedStep:
    """The last step of every agent: the scene saved where the prompt asks for it."""
    path = str(workspace / "scene.blend")
    code = f"bpy.ops.wm.save_as_mainfile(filepath={path!r}, compress=True, relative_remap=False)"
    return RecordedStep(tool=EXECUTE, arguments={"code": f"import bpy\n{code}\n"})


def _source(statements: list[ast.stmt]) -> str:
    return "\n".join(ast.unparse(statement) for statement in statements) + "\n"


def _is_text(statement: ast.stmt) -> bool:
    return isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)


def _merge_groups(groups: list[list[ast.stmt]], most: int) -> list[list[ast.stmt]]:
    """At most `most` groups, of neighbours put together evenly."""
    parts = min(most, len(groups))
    cuts = [round(part * len(groups) / parts) for part in range(parts + 1)] if parts else [0]
    return [
        [statement for group in groups[begin:end] for statement in group]
        for begin, end in itertools.pairwise(cuts)
    ]


def _unfold_main(body: list[ast.stmt]) -> list[ast.stmt]:
    """The statements, with the final call of main() replaced by its body."""
    last = body[-1] if body else None
    if isinstance(last, ast.If) and not last.orelse and _asks_for_main(last.test):
        called = last.body[-1] if len(last.body) == 1 else None
    else:
        called = last
    if not (
        isinstance(called, ast.Expr)
        and isinstance(called.value, ast.Call)
        and isinstance(called.value.func, ast.Name)
        and not called.value.args
        and not called.value.keywords
    ):
        return body
    name = called.value.func.id
    defined = [s for s in body if isinstance(s, ast.FunctionDef) and s.name == name]
    if len(defined) != 1 or not _is_plain(defined[0]):
        return body
    return [*body[:-1], *defined[0].body]


def _asks_for_main(test: ast.expr) -> bool:
    return ast.unparse(test) in ("__name__ == '__main__'", "'__main__' == __name__")


def _is_plain(function: ast.FunctionDef) -> bool:
    """True if a function's statements mean the same at module level."""
    arguments = function.args
    if function.decorator_list or any(
        (arguments.args, arguments.posonlyargs, arguments.kwonlyargs, arguments.vararg,
         arguments.kwarg)
    ):  # fmt: skip
        return False
    pending: list[ast.AST] = list(function.body)
    while pending:
        node = pending.pop()
        if isinstance(node, ast.Return | ast.Yield | ast.YieldFrom | ast.Global | ast.Nonlocal):
            return False
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda | ast.ClassDef):
            pending += ast.iter_child_nodes(node)
    return True
