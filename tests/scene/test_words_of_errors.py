"""What an error of a scene says: people mend hundreds of scenes by these sentences alone."""

from __future__ import annotations

import ast
from pathlib import Path

from legoworld import errors, scene

SCENE = Path(scene.__file__).parent
SAYS = {"found", "expected", "next_step"}


def silent(module: ast.Module, names: set[str]) -> list[str]:
    """The constructions of these errors that leave out what was found, expected or to be done."""
    calls = [node for node in ast.walk(module) if isinstance(node, ast.Call)]
    return [
        ast.unparse(call)[:100]
        for call in calls
        if ast.unparse(call.func).split(".")[-1] in names
        and not {keyword.arg for keyword in call.keywords} >= SAYS
    ]


def test_every_error_of_a_scene_says_what_was_found_what_was_expected_and_what_to_do():
    files = sorted(SCENE.rglob("*.py"))
    modules = {file: ast.parse(file.read_text(encoding="utf-8")) for file in files}
    names = {name for name in vars(errors) if name.endswith("Error")}
    for node in (node for module in modules.values() for node in ast.walk(module)):
        if isinstance(node, ast.ClassDef) and names & {ast.unparse(base) for base in node.bases}:
            names.add(node.name)
    found = {file.name: silent(module, names) for file, module in modules.items()}
    assert {name: calls for name, calls in found.items() if calls} == {}
