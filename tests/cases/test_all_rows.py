"""Every row of docs/cases.md has a test that is named after it."""

from __future__ import annotations

import ast
import re
from collections import Counter
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "cases.md"


def rows_of_the_page() -> list[int]:
    text = PAGE.read_text(encoding="utf-8")
    return [int(number) for number in re.findall(r"^\| (\d+) \|", text, re.M)]


def named_rows() -> Counter[int]:
    """How many test functions of this folder begin with `test_row_<number>_`, by number."""
    found: Counter[int] = Counter()
    for path in Path(__file__).parent.glob("test_*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef):
                match = re.match(r"test_row_(\d\d)_", node.name)
                if match:
                    found[int(match[1])] += 1
    return found


def test_every_row_has_a_test_and_no_test_is_of_another_row():
    assert sorted(named_rows()) == rows_of_the_page() == list(range(1, 44))
