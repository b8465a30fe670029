"""Which test reaches which function, in whatever process; see mutate.py.

A tracer does not follow into worker processes, whose environment is emptied. So the sources are
instrumented for one run of the tests: each function first sets a byte of a file that every process
maps.
"""

from __future__ import annotations

import ast
import json
import mmap
import multiprocessing
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

_MODULE = """
import mmap, os

def _mapped():
    try:
        fd = os.open({path!r}, os.O_RDWR)
    except OSError:  # in a sandbox
        return bytearray({size})
    try:
        return mmap.mmap(fd, {size})
    finally:
        os.close(fd)

REACHED = _mapped()
"""
_MOST = 1 << 16  # functions
#: What runs before it has this tree on its path, or cannot see it, does without.
_IMPORT = """
try:
    from legoworld._reached import REACHED as _REACHED
except ImportError:
    _REACHED = bytearray({size})
"""


class Recorder:
    """A pytest plugin: one row for each test that passes, written when it ends."""

    def __init__(self, reached: Path, rows: Path) -> None:
        with reached.open("r+b") as file:
            self._reached = mmap.mmap(file.fileno(), 0)
        self._rows = rows
        self._failed: set[str] = set()
        self._prepared: list[int] = []

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: Any) -> Iterator[None]:
        """A test from its first fixture to its last."""
        self._reached[:] = bytes(len(self._reached))
        started, own = time.perf_counter(), time.process_time()
        result = yield
        if item.nodeid not in self._failed:
            row = {
                "test": item.nodeid,
                "seconds": time.process_time() - own,
                "wall": time.perf_counter() - started,
                "prepared": self._prepared,
                "reached": self._places(),
            }
            with self._rows.open("a") as file:
                file.write(json.dumps(row) + "\n")
        return result

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_setup(self) -> Iterator[None]:
        """What fixtures reach counts for every test of the file: they may share them."""
        result = yield
        self._prepared = self._places()
        return result

    def pytest_runtest_logreport(self, report: Any) -> None:
        """A test that fails or is skipped without any change tells nothing."""
        if not report.passed:
            self._failed.add(report.nodeid)

    def _places(self) -> list[int]:
        content = self._reached[:]
        return [place for place, value in enumerate(content) if value]


def reached_by_tests(
    path: Path, root: Path, words: list[str], longest: float
) -> dict[str, dict[str, Any]]:
    """What `calls_of_tests` gives, of all processes. It is kept in `path` until that is deleted.

    words: what pytest is started with. The sources below `root` are changed for the time.
    """
    if not path.is_file():
        with tempfile.TemporaryDirectory(prefix="legoworld-reach-") as name:
            reached, rows = Path(name) / "reached", Path(name) / "rows.jsonl"
            with _instrumented(root, reached) as functions:
                process = multiprocessing.get_context("fork").Process(
                    target=pytest.main, args=(words, [Recorder(reached, rows)])
                )
                process.start()
                process.join()
            found = [json.loads(line) for line in rows.read_text().splitlines()]
        path.write_text(json.dumps({"functions": functions, "rows": found}))
    known = json.loads(path.read_text())
    prepared: dict[str, set[int]] = defaultdict(set)
    for row in known["rows"]:
        prepared[row["test"].split("::")[0]].update(row["prepared"])
    return {
        row["test"]: {
            "calls": [
                known["functions"][place]
                for place in sorted({*row["reached"], *prepared[row["test"].split("::")[0]]})
            ],
            "seconds": row["seconds"],
            "wall": row["wall"],
        }
        for row in known["rows"]
        if row["wall"] <= longest
    }


@contextmanager
def _instrumented(root: Path, reached: Path) -> Iterator[list[tuple[str, str]]]:
    """(file, qualified name) of the function of each byte; the files are restored at the end."""
    originals = {path: path.read_bytes() for path in sorted((root / "legoworld").rglob("*.py"))}
    functions: list[tuple[str, str]] = []
    texts = {
        path: _marked(source, path.relative_to(root).as_posix(), functions)
        for path, source in originals.items()
    }
    module = root / "legoworld" / "_reached.py"
    try:
        reached.write_bytes(bytes(len(functions)))
        module.write_text(_MODULE.format(path=str(reached), size=len(functions)))
        for path, text in texts.items():
            path.write_text(text, encoding="utf-8")
        yield functions
    finally:
        module.unlink(missing_ok=True)
        for path, source in originals.items():
            path.write_bytes(source)


def _marked(source: bytes, path: str, functions: list[tuple[str, str]]) -> str:
    tree = ast.parse(source)

    def mark(node: ast.AST, scope: str) -> None:
        for child in ast.iter_child_nodes(node):
            inner = scope
            if isinstance(child, ast.ClassDef):
                inner += f"{child.name}."
            elif isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef):
                functions.append((path, scope + child.name))
                first = 1 if _is_text(child.body[0]) else 0
                child.body[first:first] = ast.parse(f"_REACHED[{len(functions) - 1}] = 1").body
                inner += f"{child.name}.<locals>."
            mark(child, inner)

    mark(tree, "")
    before = [n for n in tree.body if _is_text(n) or getattr(n, "module", "") == "__future__"]
    rest = [n for n in tree.body if n not in before]
    tree.body = [*before, *ast.parse(_IMPORT.format(size=_MOST)).body, *rest]
    return ast.unparse(ast.fix_missing_locations(tree))


def _is_text(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
