"""Files of other Blenders, other machines and other habits, read one after another."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from scene.foreign.blend_file import blocks_of
from scene.foreign.sources import PROGRAM, sources

from legoworld import cli

pytestmark = pytest.mark.blender

HABITS = """
import os
fresh(); camera(); quad("Dog", category="dog")
other = bpy.data.scenes.new("Other"); bpy.context.window.scene = other
other.render.resolution_x, other.render.resolution_y = 64, 48
eye = bpy.data.objects.new("Eye", bpy.data.cameras.new("Eye")); eye.location.z = 5
other.collection.objects.link(eye); other.camera = eye
cat = quad("Cat", category="cat")
if cat.name not in other.collection.objects: other.collection.objects.link(cat)
save("two_scenes")

fresh(); camera(z=10).name = "First"; quad("Dog", category="dog")
bpy.context.scene.camera.data.name = "First"
second = camera(z=20); second.name = "Second"
save("two_cameras")

# Last, and without Blender's own exit: Mantaflow aborts when another file replaces its domain.
fresh(); camera(); quad("Dog", category="dog", z=3)
bpy.ops.mesh.primitive_cube_add(size=2)
settings = bpy.context.object.modifiers.new("Fluid", "FLUID")
settings.fluid_type = "DOMAIN"
settings.domain_settings.resolution_max = 16
settings.domain_settings.cache_directory = "//cache"
save("fluid_a")
os._exit(0)
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, build_scenes) -> Path:
    built = tmp_path_factory.mktemp("built")
    build_scenes(PROGRAM, built)
    scenes = tmp_path_factory.mktemp("scenes")
    build_scenes(HABITS, scenes)
    for name, data in _made_by_hand(sources(built, None)).items():
        (scenes / name).mkdir()
        (scenes / name / "scene.blend").write_bytes(data)
    shutil.copytree(scenes / "fluid_a", scenes / "fluid_b")
    output = tmp_path_factory.mktemp("run") / "coco"
    code = cli.run(["readout", str(scenes), "--task", "coco", "-q", "-o", str(output),
                    "--workers", "1", "--no-cache", "--time-limit", "600"])  # fmt: skip
    assert code == 1
    return output


def _made_by_hand(files: dict[str, bytes]) -> dict[str, bytes]:
    plain = files["plain"]
    content = plain[17:]
    ring = next(
        b for b in blocks_of(plain) if b.code == b"OB\0\0" and b"OBRing\0" in plain[b.body : b.end]
    )
    return {
        "plain": plain,
        "gzip": files["gzip"],
        "zstd": files["zstd"],
        "one_object_twice": plain[: ring.end] + plain[ring.start : ring.end] + plain[ring.end :],
        "newer_version": plain[:13] + b"0600" + content,
        "newer_format": plain[:10] + b"02" + plain[12:],
        "big_endian": b"BLENDER-V248" + content,
        "big_endian_32_bit": b"BLENDER_V236" + content,
        "header_of_2_48_32_bit": b"BLENDER_v248" + content,
        "header_of_2_49": b"BLENDER-v249" + content,
        "header_only": plain[:17],
        "magic_only": b"BLENDER",
        "empty": b"",
    }


@pytest.fixture(scope="module")
def rows(run: Path) -> dict[str, dict[str, Any]]:
    lines = (run / "per_image.jsonl").read_text().splitlines()
    return {row["scene"]: row for row in map(json.loads, lines)}


@pytest.mark.parametrize("name", ["gzip", "zstd"])
def test_the_same_scene_however_it_is_packed(rows: dict[str, dict[str, Any]], name: str):
    assert rows[name]["status"] == rows["plain"]["status"] == "ok"
    assert rows[name]["snapshot_sha256"] == rows["plain"]["snapshot_sha256"]


def test_a_file_of_a_later_version_is_read_and_said(rows: dict[str, dict[str, Any]]):
    assert rows["newer_version"]["status"] == "ok"
    assert [w for w in rows["newer_version"]["warnings"] if "newer Blender" in w]
    assert rows["plain"]["warnings"] == []
    assert rows["newer_version"]["geometry_px"] == rows["plain"]["geometry_px"] > 0
    assert rows["newer_version"]["instances"] == rows["plain"]["instances"]


@pytest.mark.parametrize(
    ("name", "word"),
    [
        ("big_endian", "Big Endian"),
        ("big_endian_32_bit", "Big Endian"),
        ("newer_format", "newer version"),
        ("header_of_2_48_32_bit", "Missing DNA"),
        ("header_of_2_49", "Missing DNA"),
        ("header_only", "Missing DNA"),
        ("magic_only", "not a blend file"),
        ("empty", "not supported"),
    ],
)
def test_what_blender_refuses_is_a_verdict_in_its_words(
    rows: dict[str, dict[str, Any]], name: str, word: str
):
    row = rows[name]
    assert (row["status"], row["code"]) == ("invalid", "unreadable_blend")
    assert word in row["reason"]
    assert "\n" not in row["reason"]


def test_a_file_blender_complains_about_and_loads_is_read_with_the_complaint(
    rows: dict[str, dict[str, Any]],
):
    row = rows["one_object_twice"]
    assert row["status"] == "ok"
    assert any("corruption" in w for w in row["warnings"])
    assert row["instances"] == rows["plain"]["instances"]


def test_of_several_scenes_the_active_one_is_read_and_said(
    run: Path, rows: dict[str, dict[str, Any]]
):
    row = rows["two_scenes"]
    assert row["status"] == "ok"
    assert row["warnings"] == ["the file holds 2 scenes; read: 'Other'"]
    predictions = _predictions(run, row)
    # The cat at 5 units, 50 mm on 36 mm: half a side is 64 * 50 / 36 / 5 = 17.8 px.
    assert [(p["category_id"], p["bbox"]) for p in predictions] == [(17, [14, 6, 36, 36])]


def test_of_several_cameras_the_active_one_is_used(run: Path, rows: dict[str, dict[str, Any]]):
    row = rows["two_cameras"]
    scenes = json.loads((run / "run.json").read_text())["scenes"]
    assert scenes[str(row["image_id"])]["camera"]["name"] == "Second"
    # At 20 units and fx 64, half a side is 3.2 px around (32, 24).
    assert [p["bbox"] for p in _predictions(run, row)] == [[29, 21, 6, 6]]


def test_fluid_domains_one_after_another_do_not_end_the_run(rows: dict[str, dict[str, Any]]):
    for name in ("fluid_a", "fluid_b"):
        assert rows[name]["status"] == "ok"
        assert rows[name]["n_predictions"] == 1
    assert rows["plain"]["status"] == "ok"


def _predictions(run: Path, row: dict[str, Any]) -> list[dict[str, Any]]:
    found = json.loads((run / "predictions.json").read_text())
    return [p for p in found if p["image_id"] == row["image_id"]]
