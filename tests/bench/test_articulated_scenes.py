"""Joints from .blend files and URDF files through make, readout and evaluate."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest
from bench.stage import PROGRAM, picture

from legoworld import cli
from legoworld.records.base import UNSET, decode, decode_lines
from legoworld.records.bench_dataset import Articulation, BenchTruthFile
from legoworld.records.reconstruction import ReconstructionRow, ReconstructionSummary
from legoworld.records.submission import BenchRow

#: The door hangs from an empty at its left edge, 30 degrees about the vertical and half its size.
SCENES = (
    PROGRAM
    + """
import math
def room(door="revolute", drawer=True):
    scene = stage()
    bpy.data.objects["Red"].name = "Cupboard"
    hinge = bpy.data.objects.new("Hinge", None)
    scene.collection.objects.link(hinge)
    hinge.location, hinge.rotation_euler = (-1.6, -0.6, 0.0), (0, 0, math.radians(30))
    hinge.scale = (0.5, 0.5, 0.5)
    hinge.parent = bpy.data.objects["Cupboard"]
    panel = mesh("Panel", [(0, 0, 0), (2, 0, 0), (2, 0, 2), (0, 0, 2)], [(0, 1, 2, 3)])
    panel.parent = hinge
    if door:
        hinge["joint"] = door
    box("Desk", 1.2, 0.0, 0.0, 0.5, category="desk")
    if drawer:
        tray = box("Tray", 1.2, -0.7, 0.4, 0.2)
        tray.parent = bpy.data.objects["Desk"]
    return scene

room(); deliver("reference/room")
room(door={"type": "revolute", "axis": [1.0, 0.0, 0.0]}); deliver("answers/tilted")
room(door=None); deliver("answers/still")
room(door="revolvent"); deliver("answers/misspelt")
"""
)
URDF = """<robot name="desk"><link name="desk"/><link name="tray"/>
<joint name="slide" type="prismatic"><parent link="desk"/><child link="tray"/>
<axis xyz="0 -1 0"/><limit lower="0" upper="0.3"/></joint></robot>"""


@pytest.fixture(scope="module")
def made(build_scenes, tmp_path_factory):
    folder = tmp_path_factory.mktemp("articulated")
    build_scenes(SCENES, folder)
    (folder / "reference" / "room" / "desk.urdf").write_text(URDF)
    quick = ["--size", "96x54", "--samples", "1", "--noise-seeds", "0", "-q"]
    place = ["-o", str(folder / "bench"), "--keep-scenes", str(folder / "itself")]
    assert cli.run(["bench", "make", str(folder / "reference"), *place, *quick]) == 0
    return folder


@pytest.fixture(scope="module")
def read(made):
    """Rows of the run and of its evaluation, and the summary, of a submission by its name."""

    def evaluated(name: str) -> tuple[BenchRow, Articulation, ReconstructionSummary]:
        place = made / "runs" / name
        scenes = made / "itself"
        if name != "itself":
            scene = place / "scenes" / "room__view_00"
            shutil.copytree(made / "answers" / name, scene)
            picture(scene / "final.png")
            scenes = scene.parent
        track = made / "bench" / "public" / "track.json"
        arguments = ["readout", str(scenes), "--task", "bench", "--track", str(track), "-q"]
        assert cli.run([*arguments, "-o", str(place / "run"), "--no-render"]) == 0
        private = str(made / "bench" / "private")
        out = place / "eval"
        command = ["evaluate", str(place / "run"), "--truth", private, "-o", str(out), "-q"]
        assert cli.run([*command, "--draws", "1"]) == 0
        (run,) = decode_lines(BenchRow, (place / "run" / "per_image.jsonl").read_bytes())
        (row,) = decode_lines(ReconstructionRow, (out / "per_image.jsonl").read_bytes())
        assert row.articulation
        return (
            run,
            row.articulation,
            decode(ReconstructionSummary, (out / "summary.json").read_bytes()),
        )

    return evaluated


def test_the_reference_s_joints_are_private_and_in_the_camera_s_frame(made):
    truth = decode(BenchTruthFile, (made / "bench" / "private" / "truth.json").read_bytes())
    (one,) = truth.images.values()
    assert one.joints
    hinge, tray = one.joints
    assert hinge.object_id is not None
    assert tray.object_id is not None
    assert hinge.box_cam_m
    names = {scored.id: scored.name for scored in one.scored}
    assert (hinge.part, names[hinge.object_id], hinge.source) == ("Hinge", "Cupboard", "property")
    assert (tray.part, names[tray.object_id], tray.source) == ("Tray", "Desk", "desk.urdf")
    cam_from_world = np.linalg.inv(np.array(one.camera.world_from_cam))
    # The hinge's own z is the world's; the tray slides to the world's -y, from the desk's place.
    assert hinge.axis_cam == pytest.approx(tuple(cam_from_world[:3, 2]), abs=1e-6)
    assert tray.axis_cam == pytest.approx(tuple(-cam_from_world[:3, 1]), abs=1e-6)
    # The cupboard's own place is the world's origin: its mesh is built where it stands.
    at = cam_from_world @ np.array([-1.6, -0.6, 0.0, 1.0])
    assert hinge.origin_cam_m == pytest.approx(tuple(at[:3]), abs=1e-5)
    corners = [(0, 0), (np.cos(np.pi / 6), np.sin(np.pi / 6))]
    door = np.array([[x - 1.6, y - 0.6, z, 1.0] for x, y in corners for z in (0.0, 1.0)])
    seen = (cam_from_world @ door.T).T[:, :3]
    assert np.allclose(hinge.box_cam_m, [seen.min(axis=0), seen.max(axis=0)], atol=1e-5)
    assert (tray.lower, tray.upper) == (0.0, 0.3)
    public = (made / "bench" / "public" / "track.json").read_text("utf-8")
    assert "joint" not in public
    assert "Hinge" not in public


def test_the_reference_submitted_as_itself_has_all_joints(read):
    run, pilot, summary = read("itself")
    assert run.joints
    assert summary.articulation
    assert [joint.part for joint in run.joints] == ["Hinge", "Tray"]
    assert (pilot.C, pilot.score) == (2, 1.0)
    assert [joint.box_iou for joint in pilot.joints] == [1.0, 1.0]
    assert summary.articulation.score == 1.0


def test_a_hinge_about_another_axis_is_wrong_and_a_missing_slide_is_missing(read):
    _, pilot, summary = read("tilted")
    hinge, tray = pilot.joints
    assert (hinge.outcome, tray.outcome) == ("wrong", "joint_missing")
    assert hinge.axis_deg == pytest.approx(90.0, abs=1e-4)
    assert pilot.score == 0.0
    assert summary.articulation
    assert (summary.articulation.W, summary.articulation.J) == (1, 1)
    assert summary.metrics["R"].value == 1.0  # in no score


def test_no_joints_and_a_property_that_says_nothing(read):
    run, pilot, _ = read("still")
    assert run.joints is UNSET
    assert pilot.J == 2
    run, pilot, _ = read("misspelt")
    assert pilot.J == 2
    (told,) = [w for w in run.warnings if "joint" in w]
    assert "'revolvent'" in told
    assert "revolute, continuous or prismatic" in told


def test_a_urdf_file_that_is_no_file_of_the_scene_is_told_and_not_read(made, tmp_path, track_for):
    scenes = tmp_path / "scenes"
    shutil.copytree(made / "answers" / "still", scenes / "links")
    picture(scenes / "links" / "final.png")
    (tmp_path / "outside.urdf").write_text(URDF)
    (scenes / "links" / "a.urdf").symlink_to(tmp_path / "outside.urdf")
    laughs = '<!DOCTYPE r [<!ENTITY a "b">]><robot name="&a;"/>'
    (scenes / "links" / "b.urdf").write_text(laughs)
    track = track_for(tmp_path / "track.json", ["links"])
    arguments = ["readout", str(scenes), "--task", "bench", "--track", str(track), "-q"]
    assert cli.run([*arguments, "-o", str(tmp_path / "run"), "--no-render"]) == 0
    (row,) = decode_lines(BenchRow, (tmp_path / "run" / "per_image.jsonl").read_bytes())
    told = " ".join(row.warnings)
    assert "a link that leads out of the scene folder" in told
    assert "a document type" in told
    assert row.joints is UNSET


def test_a_urdf_file_is_frozen_with_the_scene(made, tmp_path):
    scene = tmp_path / "scenes" / "room"
    shutil.copytree(made / "itself" / "room__view_00", scene)
    assert cli.run(["freeze", str(scene.parent), "-q"]) == 0
    assert "desk.urdf" in json.loads((scene / "frozen.json").read_text("utf-8"))["files"]
    (scene / "desk.urdf").write_text(URDF.replace("0.3", "0.4"))
    assert cli.run(["inspect", str(scene), "--size", "32x18", "-q"]) != 0
