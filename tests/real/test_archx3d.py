"""A real flat from an AI pipeline: 113 objects, labelled from outside, read from above.

The saved camera stands outside the flat and sees walls; a second copy is seen from above without
its ceiling, where every piece of furniture's box is known from its vertices alone.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from legoworld import cli

pytestmark = [pytest.mark.blender, pytest.mark.real_data]

#: What the pipeline calls things, and COCO's name for them.
CATEGORIES = {
    "armchair": "chair",
    "bed": "bed",
    "dining_chair": "chair",
    "plant": "potted plant",
    "sink": "sink",
    "toilet": "toilet",
}
WIDTH, HEIGHT = 1200, 900

SIZE = f"WIDTH, HEIGHT = {WIDTH}, {HEIGHT}\n"
FROM_ABOVE = """
import json, sys, bpy
source, target, truth = sys.argv[-3:]
bpy.ops.wm.open_mainfile(filepath=source, load_ui=False, use_scripts=False)
scene = bpy.context.scene
bpy.data.objects["Ceiling"].hide_render = True
bounds = {}
graph = bpy.context.evaluated_depsgraph_get()
for o in scene.objects:
    if o.type == "MESH" and o.visible_get():
        e = o.evaluated_get(graph)
        points = [e.matrix_world @ v.co for v in e.data.vertices]
        if points:
            bounds[o.name] = [f(p[i] for p in points) for i in (0, 1) for f in (min, max)]
x0 = min(b[0] for b in bounds.values()); x1 = max(b[1] for b in bounds.values())
y0 = min(b[2] for b in bounds.values()); y1 = max(b[3] for b in bounds.values())
data = bpy.data.cameras.new("Above"); data.type = "ORTHO"; data.clip_end = 1000
data.ortho_scale = 1.1 * max(x1 - x0, (y1 - y0) * WIDTH / HEIGHT)
camera = bpy.data.objects.new("Above", data)
camera.location = ((x0 + x1) / 2, (y0 + y1) / 2, 100)
scene.collection.objects.link(camera); scene.camera = camera
scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
px = WIDTH / data.ortho_scale
boxes = {n: [(b[0] - camera.location.x) * px + WIDTH / 2,
             (camera.location.y - b[3]) * px + HEIGHT / 2,
             (b[1] - camera.location.x) * px + WIDTH / 2,
             (camera.location.y - b[2]) * px + HEIGHT / 2] for n, b in bounds.items()}
json.dump(boxes, open(truth, "w"))
bpy.ops.wm.save_as_mainfile(filepath=target)
"""


def labels(names: list[str]) -> list[dict[str, str]]:
    entries = []
    for name in sorted(names):
        kind = name.split("_room_")[0]
        if "_room_" in name and kind in CATEGORIES:
            entries.append({"object": name, "category": CATEGORIES[kind]})
    return entries


def abs_difference(box_xywh: tuple[int, ...], extent: list[float]) -> float:
    """By how much the sides of a box are off an extent, px: pixel centres inside it, so below 1."""
    x, y, w, h = box_xywh
    return max(abs(a - b) for a, b in zip((x, y, x + w, y + h), extent, strict=True))


def reach_outside(box_xywh: tuple[int, ...], extent: list[float]) -> float:
    x, y, w, h = box_xywh
    x0, y0, x1, y1 = extent
    return max(x0 - x, y0 - y, x + w - x1, y + h - y1)


def overlap(a: list[float], b: list[float]) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


@pytest.fixture(scope="module")
def flats(real_data: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    """Scenes `saved` and `above` with the same labels, and each object's box from above."""
    folder = tmp_path_factory.mktemp("flats")
    source = real_data / "scenes" / "archx3d" / "scene.blend"
    for name in ("saved", "above"):
        (folder / name).mkdir()
    shutil.copyfile(source, folder / "saved" / "scene.blend")
    truth = folder / "truth.json"
    target = folder / "above" / "scene.blend"
    subprocess.run(
        [sys.executable, "-c", SIZE + FROM_ABOVE, str(source), str(target), str(truth)],
        check=True,
        capture_output=True,
    )
    boxes = json.loads(truth.read_text())
    for name in ("saved", "above"):
        document = {"version": 1, "labels": labels(list(boxes))}
        (folder / name / "labels.json").write_text(json.dumps(document))
    return folder, boxes


@pytest.fixture(scope="module")
def run(flats, tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("run") / "coco"
    assert cli.run(["readout", str(flats[0]), "--task", "coco", "-q", "-o", str(output)]) == 0
    return output


def test_from_outside_every_piece_of_furniture_is_hidden(run):
    rows = [json.loads(x) for x in (run / "per_image.jsonl").read_text().splitlines()]
    row = next(r for r in rows if r["scene"] == "saved")
    assert row["n_predictions"] == 0
    assert row["instances"]["labelled"] == 32
    assert {u["reason"] for u in row["unexported"]} == {"hidden"}
    assert len(row["unexported"]) == 32


def test_from_above_every_box_is_the_extent_of_its_vertices(flats, run):
    _, boxes = flats
    names = [entry["object"] for entry in labels(list(boxes))]
    predictions = json.loads((run / "predictions.json").read_text())
    found = sorted(tuple(p["bbox"]) for p in predictions)
    assert len(found) == len(names) == 32
    exact = 0
    for name in names:
        same = [box for box in found if abs_difference(box, boxes[name]) <= 1]
        inside = [box for box in found if reach_outside(box, boxes[name]) <= 1]
        overlapped = [
            n for n, b in boxes.items() if n not in ("Floor", name) and overlap(b, boxes[name])
        ]
        assert same or (overlapped and inside), name
        exact += bool(same)
    assert exact >= 26
