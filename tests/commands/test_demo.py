"""`legoworld demo`: the examples as files, and from scene to page."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

from legoworld import cli

pytestmark = pytest.mark.blender


def test_the_demo_ends_with_the_address_of_its_page(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.run(["demo"]) == 0
    said = capsys.readouterr().out.splitlines()
    assert [line.split()[2] for line in said if line.startswith("$ ")] == [
        "readout", "evaluate", "report",
    ]  # fmt: skip
    page = Path(unquote(urlsplit(said[-1].removeprefix("open ")).path))
    assert page == tmp_path / "legoworld-demo" / "report.html"
    assert page.stat().st_size > 1_000_000
    summary = json.loads((page.parent / "evals" / "coco" / "summary.json").read_text())
    assert summary["coverage"]["scored"] == 4
    assert summary["metrics"]["AP"] > 0.9


def test_the_files_of_the_demo_without_scikit_image(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(importlib.util, "find_spec", lambda _name: None)
    assert cli.run(["demo", "--files", "-o", str(tmp_path / "x")]) == 0
    said = capsys.readouterr()
    assert said.out == f"scenes, tracks and truth -> {tmp_path / 'x'}\n"
    assert said.err.startswith("no photos: pip install 'scikit-image")
    made = {path.relative_to(tmp_path / "x").as_posix() for path in tmp_path.rglob("*.*")}
    assert {"tracks/coco.json", "truth/lvis.json", "scenes/coffee/scene.blend"} <= made
    assert not [name for name in made if name.startswith("photos")]
