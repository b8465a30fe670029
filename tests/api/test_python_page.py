"""docs/python.md: every example runs, in the order of the page."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest

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
    track = DATA / "track_coco.json"
    images = json.loads(track.read_text())["images"]
    results = [
        {"image_id": images[0]["id"], "category_id": 1, "bbox": [10, 20, 100, 80], "score": 0.5}
    ]
    (tmp_path / "results.json").write_text(json.dumps(results))
    imported = ["results.json", "--task", "coco", "--track", str(track), "-o", "runs/baseline"]
    assert cli.run(["baseline", "import", *imported]) == 0
    names = {
        "scenes": scenes,
        "track": track,
        "truth": DATA / "truth_coco.json",
        "baseline_run": "runs/baseline",
        "folders": [scenes / "coffee", scenes / "no such scene", "examples/chelsea"],
    }
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


@pytest.mark.parametrize("name", ["open_scene", "Reader", "readout", "evaluate", "compare"])
def test_the_page_names_what_there_is(name):
    import legoworld

    assert name in legoworld.__all__
    assert f"`{name}`" in PAGE.read_text(encoding="utf-8")
