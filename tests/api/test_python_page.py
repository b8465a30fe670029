"""docs/python.md: the examples are one program, which runs and passes type checkers."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from checkout import CHECKOUT

import legoworld
from legoworld import cli

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "python.md"
DATA = ROOT / "datasets" / "skimage_examples"


def examples() -> list[str]:
    text = PAGE.read_text(encoding="utf-8")
    return re.findall(r"^<!-- run -->\n```python\n(.*?)^```$", text, re.M | re.S)


def test_every_block_is_marked_to_be_run():
    assert len(examples()) == PAGE.read_text(encoding="utf-8").count("```python\n") > 5


def test_the_page_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    scenes = tmp_path / "examples"
    for name in ("astronaut", "chelsea", "coffee", "motorcycle"):
        shutil.copytree(ROOT / "examples" / name, scenes / name)
    data = tmp_path / "datasets" / "skimage_examples"
    shutil.copytree(DATA, data)
    images = json.loads((data / "track_coco.json").read_text())["images"]
    results = [
        {"image_id": images[0]["id"], "category_id": 1, "bbox": [10, 20, 100, 80], "score": 0.5}
    ]
    (tmp_path / "results.json").write_text(json.dumps(results))
    track = str(data / "track_coco.json")
    imported = ["results.json", "--task", "coco", "--track", track, "-o", "runs/baseline"]
    assert cli.run(["baseline", "import", *imported]) == 0
    names: dict[str, Any] = {}
    for code in examples():
        exec(compile(code, str(PAGE), "exec"), names)
    assert names["depth"].shape == (400, 600)
    assert names["masks"].shape == (len(names["view"].labelled), 400, 600)
    assert names["picture"].shape == (400, 600, 3)
    assert sorted(p.name for p in Path("look").iterdir()) == [
        "buffers.npz", "depth.png", "instances.json", "overlay.png",
    ]  # fmt: skip
    assert names["comparison"].folder == Path("comparisons/coco")
    shown = capsys.readouterr().out
    assert "coffee.png ok" in shown
    assert "missing" in shown


def program(folder: Path) -> Path:
    path = folder / "python_page.py"
    path.write_text("\n".join(examples()), encoding="utf-8")
    return path


def test_the_page_passes_mypy_strict(tmp_path):
    pytest.importorskip("mypy")
    command = [sys.executable, "-m", "mypy", "--strict", "--config-file", "pyproject.toml"]
    command += ["--cache-dir", str(tmp_path / "cache"), str(program(tmp_path))]
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
