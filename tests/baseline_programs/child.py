"""A baseline's process, asked as legoworld asks it, and the photos it is asked about."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import tomllib
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from PIL import Image

ROOT = Path(__file__).parents[2]
BASELINES = ROOT / "baselines"


def importable(name: str) -> None:
    """Make the modules of one baseline and of the shared package importable."""
    for folder in (BASELINES / "shared", BASELINES / name):
        if str(folder) not in sys.path:
            sys.path.insert(0, str(folder))


def resized_by_hand(values: np.ndarray, height: int, width: int) -> np.ndarray:
    """Bilinear at pixel centres, one pixel at a time, edges repeated."""
    rows, cols = values.shape
    found = np.zeros((height, width))
    for y in range(height):
        for x in range(width):
            u = min(max((x + 0.5) * cols / width - 0.5, 0), cols - 1)
            v = min(max((y + 0.5) * rows / height - 0.5, 0), rows - 1)
            left, top = int(u), int(v)
            right, bottom = min(left + 1, cols - 1), min(top + 1, rows - 1)
            upper = values[top, left] * (1 - u + left) + values[top, right] * (u - left)
            lower = values[bottom, left] * (1 - u + left) + values[bottom, right] * (u - left)
            found[y, x] = upper * (1 - v + top) + lower * (v - top)
    return found


def program(name: str) -> ModuleType:
    """A baseline's run.py as a module, without running it."""
    importable(name)
    path = BASELINES / name / "run.py"
    spec = importlib.util.spec_from_file_location(f"run_of_{name.replace('-', '_')}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def drawn_photo(path: Path, size_wh: tuple[int, int]) -> Path:
    """A photo of ramps and stripes: no two regions are alike."""
    rows, columns = np.mgrid[: size_wh[1], : size_wh[0]]
    red = columns * 255 // size_wh[0]
    rgb = np.stack((red, rows * 3 % 256, (rows ^ columns) % 256), -1)
    Image.fromarray(rgb.astype(np.uint8)).save(path)
    return path


def spread(network: Any, factor: float) -> Any:
    """The network with wider weights: drawn as usual (0.02), all its outputs are alike."""
    for parameter in network.parameters():
        if parameter.ndim > 1:
            parameter.data.mul_(factor)
    return network


def some_photo() -> Path:
    """A real photo where there are any, a picture that ships with the examples elsewhere."""
    real = os.environ.get("LEGOWORLD_REAL_DATA", ROOT.parent / "shared" / "data")
    photo = Path(real) / "coco" / "val2017" / "000000000139.jpg"
    return photo if photo.is_file() else ROOT / "examples" / "coffee" / "final.png"


@dataclass(frozen=True, kw_only=True)
class Said:
    """What a child said: its lines, its exit code, its log."""

    lines: list[dict[str, Any]]
    exit_code: int
    log: str

    @property
    def provenance(self) -> dict[str, Any]:
        return self.lines[0]["provenance"]

    @property
    def refused(self) -> dict[str, str]:
        assert self.exit_code == 2, self.log[-2000:]
        return self.lines[0]["refused"]

    @property
    def results(self) -> dict[int, dict[str, Any]]:
        assert self.exit_code == 0, self.log[-2000:]
        assert self.lines[-1] == {"done": True}
        return {line["image_id"]: line for line in self.lines if "image_id" in line}


def ask(name: str | Path, request: dict[str, Any], *packages: Path) -> Said:
    """Run baselines/<name>/run.py, or <name>/run.py at a full path, on a request until it ends.

    packages: folders of packages that it imports besides.
    """
    path = os.pathsep.join(map(str, (BASELINES / "shared", *packages)))
    environment = {**os.environ, "PYTHONPATH": path, "HF_HUB_OFFLINE": "1"}
    with tempfile.TemporaryFile("w+") as log:
        process = subprocess.Popen(
            [sys.executable, str(BASELINES / name / "run.py")],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=log,
            env=environment,
            text=True,
        )
        assert process.stdin is not None
        assert process.stdout is not None
        with process:
            process.stdin.write(json.dumps(request) + '\n{"begin": true}\n')
            process.stdin.flush()
            lines = [json.loads(line) for line in process.stdout if line.strip()]
            code = process.wait()
        log.seek(0)
        return Said(lines=lines, exit_code=code, log=log.read())


def ask_here(name: str, request: dict[str, Any]) -> Said:
    """What the process would say, by the same load and predict in this one: no import anew."""
    run = program(name)
    model, provenance = run.load(request)
    answers = [{"image_id": i["image_id"]} | run.predict(model, i) for i in request["images"]]
    lines = [{"provenance": provenance}, *answers, {"done": True}]
    return Said(lines=json.loads(json.dumps(lines)), exit_code=0, log="")


def refusal(name: str, request: dict[str, Any]) -> dict[str, str]:
    """The words of a baseline's refusal, in this process: what `Said.refused` is of another one."""
    from legoworld_baseline import Refused

    with pytest.raises(Refused) as caught:
        program(name).load(request)
    words: dict[str, str] = caught.value.reason
    return words


def defaults(name: str) -> dict[str, Any]:
    """The options of a baseline's card that have a default, as legoworld sends them."""
    card = tomllib.loads((BASELINES / name / "card.toml").read_text(encoding="utf-8"))
    return {key: option.get("default") for key, option in card.get("options", {}).items()}


def request(
    task: str, weights: Path, output: Path, photos: list[Path], **more: Any
) -> dict[str, Any]:
    """A request about photos, image ids from 1; `more` replaces fields."""
    images = []
    for number, path in enumerate(photos, 1):
        with Image.open(path) as picture:
            width, height = picture.size
        record = {"image_id": number, "file_name": path.name, "path": str(path), "batch": number}
        images.append({**record, "width": width, "height": height})
    return {
        "schema_version": 1,
        "task": task,
        "images": images,
        "categories": [],
        "label_map": None,
        "weights": str(weights),
        "device": "cpu",
        "dtype": "float32",
        "batch_size": 1,
        "offline": True,
        "options": {},
        "prompts": None,
        "output": str(output),
        **more,
    }
