"""How a reference becomes cases, rule by rule; Blender is not asked."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from scene.by_hand import CAMERA, RENDER

from legoworld.bench import case as case_module
from legoworld.bench import dataset, family
from legoworld.bench.admission import Admission
from legoworld.bench.case import CaseRefusedError, noise_floor, public_hfov_deg, reference_joints
from legoworld.bench.family import MadeCase, MadeFamily, MakeOptions
from legoworld.cards import load_card
from legoworld.errors import CatalogError
from legoworld.files import sha256_of_text
from legoworld.records.base import readable
from legoworld.records.bench_dataset import (
    BenchCamera,
    BenchHashes,
    BenchTruth,
    PictureCard,
    ScoredObject,
)
from legoworld.records.joints import SceneJoint
from legoworld.records.render_card import RenderCard


def png(values: Any) -> bytes:
    return cv2.imencode(".png", np.asarray(values, np.uint8))[1].tobytes()


def test_the_noise_of_a_is_the_spread_of_its_renders():
    picture = np.full((4, 4, 3), 100)
    off = picture.copy()
    off[0, :, 1] += 31
    found = noise_floor((5, 6, 7), [png(picture), png(off), png(picture)], png(picture), 30)
    assert (found.seeds, found.a_self) == ((5, 6, 7), (1.0, 0.75, 1.0))
    assert found.sd == pytest.approx(np.std([1, 0.75, 1], ddof=1))
    assert noise_floor((5,), [png(off)], png(picture), 31).a_self == (1.0,)
    assert noise_floor((5,), [png(off)], png(picture), 30).sd == 0.0
    half = np.full((2, 2, 3), 100)
    assert noise_floor((1,), [png(half)], png(picture), 0).a_self == (1.0,), "at the render's size"


def seen_through(camera: Any = CAMERA, **render: Any) -> Any:
    return SimpleNamespace(camera=camera, render=replace(RENDER, **render))


@pytest.mark.parametrize("lens", [18.0, 36.0])
def test_a_plain_pinhole_is_its_field_of_view(lens):
    found = public_hfov_deg(seen_through(replace(CAMERA, lens_mm=lens)), (640, 480))
    assert found == pytest.approx(math.degrees(2 * math.atan(18 / lens)))


@pytest.mark.parametrize(
    ("camera", "render", "said"),
    [
        ({"type": "ORTHO"}, {}, "it is orthographic"),
        ({}, {"pixel_aspect_x": 1.0001}, "its pixels are not square"),
        ({"shift_x": 0.1}, {}, r"its lens is shifted by 0\.1, 0"),
        ({"shift_y": -1e-6}, {}, "its lens is shifted by 0, -1e-06"),
    ],
)
def test_another_camera_is_refused(camera, render, said):
    with pytest.raises(CaseRefusedError, match=f"camera 'Camera': {said}"):
        public_hfov_deg(seen_through(replace(CAMERA, **camera), **render), (640, 480))


def instance(number: int, category: str | None = "box", text: str | None = "Boxes") -> Any:
    return SimpleNamespace(id=number, name=f"thing {number}", category=category, label_text=text)


def test_what_is_labelled_visible_and_not_left_out_is_scored():
    things = [instance(0), instance(1, None), instance(2, "box", ""), instance(3), instance(4),
              instance(5, "box", "Potted  Plant")]  # fmt: skip
    area = np.array([1, 9, 9, 0, 9, 9])
    grouping: Any = SimpleNamespace(instances=things)
    found = case_module._scored_objects(grouping, area, frozenset({"thing 4"}))
    assert [(o.id, o.name) for o in found] == [(0, "thing 0"), (5, "thing 5")]
    assert [o.category for o in found] == [
        case_module.normal_name("Boxes"), case_module.normal_name("Potted  Plant"),
    ]  # fmt: skip
    with pytest.raises(CaseRefusedError, match="found: 4 labelled instances, none visible"):
        case_module._scored_objects(grouping, np.zeros(6, np.int64), frozenset())


def joint(part: str, **more: Any) -> SceneJoint:
    known: dict[str, Any] = {
        "part": part, "source": "property", "type": "revolute", "axis_cam": (0.0, 1.0, 0.0),
        "origin_cam_m": (0.0, 0.0, 2.0), "lower": 0.0, "upper": 1.5,
        "box_cam_m": ((0.0, -0.5, 1.9), (0.5, 0.5, 2.1)),
    }  # fmt: skip
    return SceneJoint(**known | more)


def test_a_joint_is_of_the_scored_object_that_its_part_belongs_to(monkeypatch):
    surfaces = {"Door": [2, 0], "Lid": [1], "Gone": [], "Flat": [1]}
    monkeypatch.setattr(case_module, "part_surfaces", lambda _, part: np.array(surfaces[part], int))
    grouping: Any = SimpleNamespace(surface_instance=np.array([7, 8, 9]))
    joints = [joint("Door"), joint("Lid"), joint("Gone"), joint("Flat", box_cam_m=None)]
    scored = [ScoredObject(id=9, name="cupboard", category="cupboard")]
    found = reference_joints(None, grouping, scored, joints)  # type: ignore[arg-type]
    assert [(one.part, one.object_id) for one in found] == [("Door", 9), ("Lid", None)]
    assert found[0].box_cam_m == joints[0].box_cam_m


PICTURE = PictureCard(engine="CYCLES", device="CPU", samples=10, seed=3, denoised=True)
CARD: Any = SimpleNamespace(samples=32, seed=4, longest_side_px=512)


def options(**changes: Any) -> MakeOptions:
    known: dict[str, Any] = {
        "output": Path("out"), "size_wh": (1000, 500), "picture": PICTURE, "card": CARD,
        "delta": 30, "noise_seeds": 0, "scenes": None, "cache": None, "require_frozen": False,
        "threads": 1,
    }  # fmt: skip
    return MakeOptions(**known | changes)


@pytest.mark.parametrize(
    ("changes", "samples"),
    [
        ({}, 1000 * 500 * 10),
        ({"noise_seeds": 2}, 1000 * 500 * 10),
        ({"noise_seeds": 1, "size_wh": (200, 100)}, 512 * 256 * 32),
    ],
)
def test_a_render_is_given_the_time_of_its_samples(changes, samples):
    assert options(**changes).render_s == samples / 50_000


def test_a_family_that_was_lost_has_no_case_and_its_reason():
    folder: Any = SimpleNamespace(name="rooms/den")
    found = family.lost_family(folder, "the machine went away")
    assert (found.family, found.cases) == ("rooms-den", ())
    assert (found.environment, found.theme, found.split) == (None, None, None)
    assert found.status != "ok"
    assert "the machine went away" in (found.reason or "")


@pytest.mark.parametrize("tiers", [[None], ["easy", "hard"]])
def test_cases_are_called_after_their_family_tier_and_view(tiers):
    folder: Any = SimpleNamespace(name="a/b", path=Path("a/b"), artefacts=lambda: ["scene.blend"])
    made = family._Family(folder, options(), None)  # type: ignore[arg-type]
    said: Any = {"tiers": tiers, "views": ["First", "Second"]}
    found = [(one.stem, one.tier, one.view, one.camera) for one in made._list_requests(said)]
    assert found == [
        (f"a-b__{tier}__view_0{view}" if tier else f"a-b__view_0{view}", tier, view, camera)
        for tier in tiers
        for view, camera in enumerate(["First", "Second"])
    ]


def test_the_camera_of_a_truth_is_in_metres():
    snapshot: Any = SimpleNamespace(camera=CAMERA, render=replace(RENDER, unit_scale=0.5))
    lens = SimpleNamespace(fx=1.0, fy=2.0, cx=3.0, cy=4.0)
    found = family._camera(snapshot, SimpleNamespace(projection=lens))  # type: ignore[arg-type]
    assert (found.fx, found.fy, found.cx, found.cy) == (1, 2, 3, 4)
    assert found.world_from_cam[2][3] == 5.0


def made_family(name: str, *cases: tuple[str, str], split: str | None = None) -> MadeFamily:
    pose = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    camera = BenchCamera(fx=1.0, fy=1.0, cx=1.0, cy=1.0, world_from_cam=pose)
    hashes = BenchHashes(reference="a" * 64, depth="b" * 64, instances="c" * 64, raster="d" * 64)
    return MadeFamily(
        family=name, environment="indoor", theme="kitchen", split=split, status="ok", reason=None,
        cases=tuple(
            MadeCase(
                file_name=file_name, hfov_deg=50.0 + n, tier="easy", view=n, probe=None, x=None,
                truth=BenchTruth(
                    camera=camera, sha256=hashes, raster_wh=(8, 4), snapshot_sha256=file_name,
                    scored=(ScoredObject(id=1, name="x", category=category),), noise_floor=None,
                ),
            )
            for n, (file_name, category) in enumerate(cases)
        ),
    )  # fmt: skip


def test_ids_are_by_file_name_and_categories_by_name(monkeypatch):
    monkeypatch.setattr(dataset, "POINT_CAP", 77)
    card = load_card("bench")
    families = [made_family("b", ("b2.png", "sofa")),
                made_family("a", ("z.png", "cup"), ("a.png", "sofa"), split="test")]  # fmt: skip
    render = RenderCard(
        version="1", engine="CYCLES", device="CPU", samples=4, seed=0, longest_side_px=64,
        adaptive_sampling=False, denoiser=False, compositor=False, sequencer=False, border=False,
        film_transparent=False, resolution_percentage=100,
    )  # fmt: skip
    track, truth = dataset._files(families, options(card=render))
    assert [(i.id, i.file_name, i.family, i.split, i.view, i.hfov_deg) for i in track.images] == [
        (1, "a.png", "a", "test", 1, 51.0), (2, "b2.png", "b", None, 0, 50.0),
        (3, "z.png", "a", "test", 0, 50.0),
    ]  # fmt: skip
    assert {(i.width, i.height, i.tier) for i in track.images} == {(1000, 500, "easy")}
    assert {(i.environment, i.theme) for i in track.images} == {("indoor", "kitchen")}
    assert [(c.id, c.name) for c in track.categories] == [(1, "cup"), (2, "sofa")]
    assert (track.info.task, track.info.card_version, track.info.picture) == (
        "bench", card.version, PICTURE,
    )  # fmt: skip
    assert {n: one.snapshot_sha256 for n, one in truth.images.items()} == {
        "1": "a.png", "2": "b2.png", "3": "z.png",
    }  # fmt: skip
    assert (truth.task, truth.card_version, truth.point_cap) == ("bench", card.version, 77)
    assert (truth.track_sha256, truth.card) == (sha256_of_text(readable(track)), render)


def test_two_scenes_of_one_family_are_refused():
    dataset._refuse_equal_names([made_family("a"), made_family("b")])
    with pytest.raises(CatalogError, match="two reference scenes are of one family; found: b"):
        dataset._refuse_equal_names([made_family(name) for name in "abcb"])


def test_places_and_bytes_are_given_back_once(tmp_path):
    room = Admission(tmp_path, 2, 100)
    one = room.take(spool_bytes=60)
    assert one is not None
    assert room.take(spool_bytes=41) is None, "no room for its bytes"
    other = room.take(spool_bytes=40)
    assert other is not None
    assert one.folder != other.folder
    assert room.take() is None, "no place"
    assert (room.places, room.spool_bytes) == (2, 100)
    for _ in range(2):
        one.release()
        assert (room.places, room.spool_bytes) == (1, 40)
    assert room.take(2) is None
    alone = room.take()
    assert alone is not None
    assert alone.folder is None
