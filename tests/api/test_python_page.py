"""docs/python.md: the examples are one program, which runs and passes type checkers."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
import stranger
from checkout import CHECKOUT

import legoworld

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "python.md"


def examples() -> list[str]:
    return [text for _, language, text, _ in stranger.blocks(PAGE) if language == "python"]


@pytest.mark.blender
def test_the_page_runs_as_a_stranger_runs_it(tmp_path):
    assert len(examples()) > 8
    assert stranger.count_unmarked(PAGE) == 0
    printed = stranger.run_page(PAGE, tmp_path / "page")
    assert "coffee.png ok" in printed
    assert "missing" in printed
    folder = tmp_path / "page"
    assert sorted(p.name for p in (folder / "look").iterdir()) == [
        "buffers.npz", "depth.png", "instances.json", "overlay.png",
    ]  # fmt: skip
    assert (folder / "report.html").stat().st_size > 100_000
    assert (folder / "comparisons" / "coco" / "comparison.json").is_file()


#: What a checker must know of metrics after the page's last line.
TYPED = """
from typing import Any, assert_type

from legoworld.api.by_task import ByTask

Numbers = dict[str, float | None]
assert_type(evaluation.metrics, Numbers)
assert_type(near.metrics, dict[str, Numbers])
assert_type(legoworld.Evaluation.open("e", task="lvis").metrics, Numbers)
assert_type(legoworld.Evaluation.open("e", task="normals").metrics, dict[str, Numbers])
assert_type(legoworld.Evaluation.open("e").metrics, dict[str, Any])
assert_type(legoworld.evaluate("r", "e", truth={"coco": "t"}), ByTask[legoworld.Evaluation])
"""


def program(folder: Path) -> Path:
    path = folder / "python_page.py"
    path.write_text("\n".join([*examples(), TYPED]), encoding="utf-8")
    return path


def test_the_page_passes_mypy_strict(tmp_path):
    pytest.importorskip("mypy")
    # In the checkout's own cache: `make check` has just filled it.
    command = [sys.executable, "-m", "mypy", "--strict", "--config-file", "pyproject.toml"]
    command.append(str(program(tmp_path)))
    done = subprocess.run(command, cwd=CHECKOUT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_page_passes_pyright(tmp_path):
    pytest.importorskip("pyright")
    settings = {
        "include": [program(tmp_path).name],
        "extraPaths": [str(Path(legoworld.__file__).parents[1])],
        "reportMissingModuleSource": False,
    }
    (tmp_path / "pyrightconfig.json").write_text(json.dumps(settings))
    command = [sys.executable, "-m", "pyright", "-p", str(tmp_path), "--pythonpath", sys.executable]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize(
    "name", ["open_scene", "Reader", "readout", "evaluate", "compare", "score"]
)
def test_the_page_names_what_there_is(name):
    assert name in legoworld.__all__
    assert f"`{name}`" in PAGE.read_text(encoding="utf-8")
