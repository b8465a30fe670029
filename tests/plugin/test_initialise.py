"""initialize over a real endpoint: room and camera come together, or not at all."""

from __future__ import annotations

import json

import numpy as np
import pytest
from endpoint.clients import serve_session
from plugin.synthetic import SIZE, camera, evidence_with, region_of, room, seen_faces
from plugin.talking import called

from legoworld.plugin.case import Case
from legoworld.plugin.connection import Address, BlenderConnection
from legoworld.plugin.entities import Entities
from legoworld.plugin.initial_room import install_room
from legoworld.plugin.initialisation import recover
from legoworld.plugin.live import LiveBlender
from legoworld.plugin.measure import surface_view
from legoworld.plugin.room_install import CAMERA, NotInstalledError
from legoworld.plugin.server import plugin_server
from legoworld.records import plugin_requirements as kinds
from legoworld.records.base import decode
from legoworld.records.plugin_evidence import ConstructionPlan, Room
from legoworld.records.plugin_ledger import TransactionLimits
from legoworld.visibility.camera import projection

pytestmark = pytest.mark.blender

EMPTY = "import bpy; bpy.ops.wm.read_factory_settings(use_empty=True)"


@pytest.fixture(scope="module")
def endpoint(tmp_path_factory):
    with serve_session(tmp_path_factory.mktemp("endpoint")) as found:
        yield found


@pytest.fixture
def run(endpoint):
    """Runs code in the live scene, which is empty for every test."""
    live = BlenderConnection(Address(port=endpoint.server.port))
    live.run(EMPTY)
    return live.run


@pytest.fixture(scope="module")
def evidence():
    random = np.random.default_rng(5)
    world_from_cam, place = camera(random)
    faces = seen_faces(room(random), world_from_cam, place, 70)
    masks = {"wall": (faces >= 0) & (faces < 4), "floor": faces == 4, "ceiling": faces == 5,
             "box": (faces >= 12) & (faces < 18)}  # fmt: skip
    regions = [region_of(name, mask) for name, mask in masks.items()]
    photo = np.full((SIZE[1], SIZE[0], 3), 90, np.uint8)
    return evidence_with(regions, world_from_cam, 70, photo=photo)


@pytest.fixture
def case(tmp_path, endpoint, blender, evidence):
    store = tmp_path / "states"
    store.mkdir()
    live = LiveBlender(BlenderConnection(Address(port=endpoint.server.port)), blender, store)
    return Case(tmp_path, live, evidence, TransactionLimits())


def test_an_empty_scene_gets_the_room_and_the_camera_of_the_photo(
    case, run, evidence, tmp_path, endpoint
):
    empty = case.measure([kinds.Existence(entity="Room floor"), kinds.Visibility(entity="Cup")])
    assert [r.verdict for r in empty.results] == ["fail", "unknown"]
    found = recover(evidence, None, 1.6)
    kept = install_room(case, found)
    assert case.phase == "idle"
    assert [e.tool for e in case.ledger.entries] == ["measure", "begin", "initialize", "commit"]

    scene = case.live.read()[0]
    shot = scene.snapshot
    assert shot.camera.name == CAMERA
    camera_px = projection(shot.camera, shot.render, SIZE)
    assert camera_px.fx == pytest.approx(SIZE[0] / 2 / np.tan(np.radians(35)), rel=1e-5)
    assert shot.camera.world_from_camera[2][3] == pytest.approx(1.6, rel=1e-5)
    assert shot.render.size_wh == SIZE

    # The scene has no boxes yet: it shows all of the floor that the photo shows, and more.
    floor = evidence.mask(evidence.region("floor"))
    surfaces = np.append(Entities(shot).surfaces("Room floor"), False)
    assert surfaces[surface_view(scene, SIZE).instance][floor].mean() > 0.98

    initial = tmp_path / "initial"
    assert decode(Room, (initial / "room.json").read_bytes()) == found.room
    assert decode(ConstructionPlan, (initial / "plan.json").read_bytes()) == found.plan
    assert [o.region for o in found.plan.objects] == ["box"]
    assert set(kept) == {"room.json", "plan.json", "plan.md", "shell.png", "room_over_photo.png"}
    for name, sha256 in kept.items():
        assert case.artefacts.read(sha256, name.rsplit(".")[-1]) == (initial / name).read_bytes()


def test_a_scene_that_shows_another_room_is_rolled_back_to_its_signature(case, run, evidence):
    """A handler that moves every new camera, as an add-on might."""
    before = case.measure([]).scene_signature
    run(
        "import bpy\n"
        "class Twist:\n"
        "    def __call__(self, *_):\n"
        "        c = bpy.context.scene.camera\n"
        "        if c and c.location.x == 0: c.location.x = 1\n"
        "bpy.app.handlers.save_pre.append(Twist())"
    )
    with pytest.raises(NotInstalledError, match="place"):
        install_room(case, recover(evidence, None, 1.6))
    assert case.phase == "idle"
    assert case.measure([]).scene_signature == before
    run("import bpy; bpy.app.handlers.save_pre.clear()")


def test_a_second_room_is_refused_and_the_first_one_stays(case, run, evidence):
    install_room(case, recover(evidence, None, 1.6))
    signature = case.ledger.entries[-1].scene_signature
    with pytest.raises(NotInstalledError, match="room already"):
        install_room(case, recover(evidence, None, 1.6))
    assert case.ledger.entries[-1].tool == "rollback"
    assert case.ledger.entries[-1].scene_signature == signature


def test_the_tools_say_what_they_made_and_what_they_miss(case, run, evidence):
    answers = called(plugin_server(case, evidence), ("plan", {}), ("initialize", {}))
    plan, made = (json.loads(said) for failed, said in answers if not failed)
    assert plan["plan"]["objects"][0]["region"] == "box"
    assert made["room"]["agreement"] > 0.98
    assert made["scene_signature"] == case.ledger.entries[-1].scene_signature
    mistaken = [
        ("initialize", {"structures": {"floor": "roof"}}, "roof"),
        ("initialize", {"structures": {"carpet": "floor"}}, "carpet"),
        ("initialize", {"camera_height_m": 0}, "metres"),
    ]
    answers = called(plugin_server(case, evidence), *[(n, a) for n, a, _ in mistaken])
    for (failed, said), (_, _, why) in zip(answers, mistaken, strict=True):
        assert failed
        assert why in said
    ((failed, said),) = called(plugin_server(case, None), ("plan", {}))
    assert failed
    assert "no evidence" in said
