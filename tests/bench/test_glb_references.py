"""A .glb as a reference, and what a later tier hides."""

from __future__ import annotations

import json

import pytest
from bench.stage import PROGRAM

from legoworld import cli
from legoworld.records.base import decode
from legoworld.records.bench_dataset import BenchTrackFile, BenchTruthFile

pytestmark = pytest.mark.blender

SCENES = (
    PROGRAM
    + """
def deliver_glb(name):
    (OUT / name).mkdir(parents=True)
    bpy.ops.export_scene.gltf(
        filepath=str(OUT / name / "scene.glb"), export_cameras=True, export_lights=True,
        export_extras=True,
    )

scene = stage()
scene["environment"] = "indoor"
scene.camera["view"] = 0
box("Green", 1.0, 0.5, 0.0, 0.5, category="box", tier="medium")
box("Wall", 1.0, -1.5, 0.0, 0.9, category="wall", tier="hard")
deliver_glb("lit")
bpy.data.objects.remove(bpy.data.objects["Sun"])
deliver_glb("dark")
"""
)


def test_a_glb_is_a_reference_and_what_a_later_tier_hides_is_told(build_scenes, tmp_path, capsys):
    build_scenes(SCENES, tmp_path / "references")
    made = tmp_path / "bench"
    arguments = ["bench", "make", str(tmp_path / "references"), "-o", str(made), "--size", "96x54",
                 "--samples", "2", "--noise-seeds", "0", "--json"]  # fmt: skip
    assert cli.run(arguments) == 1
    families = {one["family"]: one for one in json.loads(capsys.readouterr().out)["families"]}
    assert "the .glb has no light" in families["dark"]["reason"]
    stems = [f"lit__{tier}__view_00" for tier in ("easy", "medium", "hard")]
    assert families["lit"]["cases"] == [f"{stem}.png" for stem in stems]
    assert families["lit"]["hidden"] == {"lit__hard__view_00.png": ["Green"]}
    track = decode(BenchTrackFile, (made / "public" / "track.json").read_bytes())
    truth = decode(BenchTruthFile, (made / "private" / "truth.json").read_bytes())
    assert {image.environment for image in track.images} == {"indoor"}
    scored = {i.tier: {o.name for o in truth.images[str(i.id)].scored} for i in track.images}
    assert scored == {"easy": {"Red"}, "medium": {"Red", "Green"}, "hard": {"Red", "Wall"}}
    # The camera of `stage`: (0, -6, 3), 68 degrees up from looking down, a lens of 30 of 36 mm.
    pose = truth.images["1"].camera.world_from_cam
    assert [row[3] for row in pose[:3]] == pytest.approx([0.0, -6.0, 3.0], abs=1e-5)
    assert track.images[0].hfov_deg == pytest.approx(61.9275, abs=1e-3)
    assert truth.images["1"].snapshot_sha256 != truth.images["2"].snapshot_sha256
    # The sentence, of the same dataset made again out of the cache.
    assert cli.run([*arguments[:-1], "--overwrite", "-q"]) == 1
    assert (
        "lit__hard__view_00.png: hidden here and not scored, though in an earlier tier: Green"
    ) in capsys.readouterr().out
