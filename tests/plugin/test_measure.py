"""Requirements on the room: what holds passes, what an edit breaks fails, the rest is unknown."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from msgspec.structs import replace
from plugin.live_room import shift

from legoworld.plugin.entities import Entities
from legoworld.plugin.evidence import Evidence
from legoworld.plugin.measure import measure, surface_pixels, surface_view
from legoworld.plugin.small_render import rec709_luma, upscale_nearest
from legoworld.records import plugin_requirements as kinds
from legoworld.records.base import decode, readable
from legoworld.records.plugin_evidence import CameraEvidence, EvidenceFile, PhotoEvidence, Region
from legoworld.records.plugin_requirements import Report
from legoworld.running.inspection import label, look, open_scene
from legoworld.scene.folder import SceneFolder
from legoworld.scene.instances import group
from legoworld.scene.labels import Labels
from legoworld.visibility.view import view

pytestmark = pytest.mark.blender

SIZE = (160, 120)


def evidence_of(masks, disparity=None):
    """Evidence whose regions are given masks, as a provider would have drawn them."""
    from pycocotools import mask as rle

    regions = []
    for name, mask in sorted(masks.items()):
        encoded = rle.encode(np.asfortranarray(mask, np.uint8))
        regions.append(
            Region(
                name=name,
                counts=encoded["counts"].decode(),
                area_px=int(mask.sum()),
                bbox_xywh_px=tuple(int(v) for v in rle.toBbox(encoded)),
                category=None,
                score=None,
                source="test",
            )
        )
    unknown = CameraEvidence(
        hfov_deg=None,
        hfov_source=None,
        world_from_cam_rotation=None,
        rotation_source=None,
        unknown="not asked",
    )
    photo = PhotoEvidence(file_name="p.png", sha256="0" * 64, width=SIZE[0], height=SIZE[1])
    file = EvidenceFile(photo=photo, regions=tuple(regions), depth=None, camera=unknown)
    return Evidence(file=file, disparity=disparity)


@pytest.fixture(scope="module")
def readout(room_folders, blender):
    """What `inspect` says of the room: masks by object name, and depth."""
    folder = SceneFolder(path=room_folders / "none", name="none")
    opened = open_scene(folder, source="blend", blender=blender, cache=None)
    seen = look(label(opened, None, None), size_wh=SIZE)
    names = {row.objects[0]: seen.view.buffers.instance == row.id for row in seen.entries}
    return names, seen.view.buffers.depth_z_m


@pytest.fixture(scope="module")
def evidence(readout):
    masks, depth = readout
    return evidence_of(masks, 0.7 / depth.astype(float) + 0.1)


def ask(scene, requirement, evidence=None):
    (result,) = measure(scene, [requirement], evidence, size_wh=SIZE).results
    return result


HOLD = {
    "existence": kinds.Existence(entity="Cup"),
    "valid_transform": kinds.ValidTransform(entity="Table"),
    "dimensions": kinds.Dimensions(entity="Cup", low_m=(0.19, 0.19, 0.2), high_m=(0.21, 0.21, 0.3)),
    "support": kinds.Support(entity="Cup", on="Table"),
    "stands": kinds.Support(entity="Chair"),
    "containment": kinds.Containment(entity="Table", inside="Floor", share=0.0),
    "collision": kinds.Collision(entity="Cup", other="Table"),
    "facing": kinds.Facing(entity="Table", towards="Chair"),
    "layout": kinds.Layout(entities=("Chair", "Table", "Cup"), tolerance=5.0),
    "visibility": kinds.Visibility(entity="Cup"),
    "centroid": kinds.Centroid(entity="Cup", region="Cup"),
    "extent": kinds.Extent(entity="Cup", region="Cup"),
    "overlap": kinds.Overlap(entity="Cup", region="Cup", tolerance=1e-12),
    "boundary": kinds.Boundary(entity="Cup", region="Cup"),
    "depth": kinds.Depth(
        entity="Table",
        matched=(("Table", "Table"), ("Chair", "Chair"), ("Floor", "Floor"), ("Crate", "Crate")),
    ),
    "depth_order": kinds.DepthOrder(matched=(("Chair", "Chair"), ("Table", "Table"))),
}

#: Which of them an edit breaks.
BROKEN = {
    "moved": {"centroid", "overlap", "boundary"},
    "hidden": {"existence"},
    "deleted": set(),
    "camera_turned": {"centroid", "overlap", "boundary"},
}


@pytest.mark.parametrize("name", HOLD)
def test_what_holds_passes(live, evidence, name):
    result = ask(live("none"), HOLD[name], evidence)
    assert result.verdict == "pass", result
    assert result.residual <= result.tolerance


@pytest.mark.parametrize("edit", BROKEN)
def test_an_edit_breaks_what_it_touches(live, evidence, edit):
    report = measure(live(edit), list(HOLD.values()), evidence)
    failed = {n for n, r in zip(HOLD, report.results, strict=True) if r.verdict == "fail"}
    assert BROKEN[edit] <= failed
    must_pass = [replace(r, accept="passes") for r in HOLD.values()]
    assert measure(live(edit), must_pass, evidence).blocked


def test_masks_and_depth_are_the_readouts_to_the_byte(live, readout):
    masks, depth = readout
    scene = live("none")
    buffers = surface_view(scene, SIZE)
    assert buffers.depth_z_m.tobytes() == depth.tobytes()
    from legoworld.plugin.entities import Entities

    entities = Entities(scene.snapshot)
    for name, mask in masks.items():
        if name not in ("Crate", "Lid"):  # the crate has its lid with it
            ours = np.append(entities.surfaces(name), False)[buffers.instance]
            assert (ours == mask).all(), name


def test_an_entity_is_an_object_with_its_children_or_a_collection(live):
    from legoworld.plugin.entities import Entities

    entities = Entities(live("none").snapshot)
    assert entities.surfaces("Crate").sum() == 2
    assert entities.surfaces("Lid").sum() == 1
    kitchen = Entities(live("collected").snapshot)
    assert (kitchen.surfaces("Kitchen") == kitchen.surfaces("Cup")).all()
    assert entities.surfaces("Nobody") is None


@pytest.mark.parametrize(
    ("requirement", "why"),
    [
        (kinds.Collision(entity="Cupp", other="Table"), "similar names: Cup"),
        (kinds.Visibility(entity="Lamp"), "no surface"),
        (kinds.Centroid(entity="Cup", region="Plate"), "no region 'Plate'"),
        (kinds.Depth(entity="Cup", matched=(("Table", "Table"),)), "not among the matched"),
        (kinds.Depth(entity="Table", matched=(("Table", "Table"),)), "over 1 matched"),
        (kinds.Luminance(region="Cup"), "serve with --photo"),
        (kinds.Collision(entity="Crate", other="Lid"), "share surfaces"),
    ],
)
def test_what_cannot_be_measured_is_unknown_with_a_reason_and_blocks(
    live, evidence, requirement, why
):
    report = measure(live("none"), [requirement], evidence)
    (result,) = report.results
    assert result.verdict == "unknown"
    assert result.residual is None
    assert why in result.reason
    assert report.blocked


def test_without_evidence_the_picture_is_unknown(live):
    assert ask(live("none"), HOLD["centroid"]).verdict == "unknown"


def test_nothing_below_is_a_fail_without_a_number(live):
    result = ask(live("none"), kinds.Support(entity="Floor", on="Cup"))
    assert (result.verdict, result.residual) == ("fail", None)


def test_a_soft_requirement_warns_and_does_not_block(live):
    soft = kinds.Existence(entity="Nobody", hard=False)
    report = measure(live("none"), [soft], None, size_wh=SIZE)
    assert report.results[0].verdict == "fail"
    assert not report.blocked


def test_a_gap_below_is_measured(live):
    scene = live("moved")  # half a metre aside, still on the table
    assert ask(scene, kinds.Support(entity="Cup", on="Table")).measurement == pytest.approx(
        0, abs=1e-6
    )
    assert ask(scene, kinds.Support(entity="Cup", on="Floor")).measurement == pytest.approx(0.75)
    assert ask(scene, kinds.Collision(entity="Table", other="Floor")).verdict == "pass"


@pytest.mark.parametrize(("by_m", "margin_m"), [(0, 0.1), (0.9, 0.1), (0.95, 0.05), (1.05, -0.05)])
def test_stability_is_the_way_from_the_centre_of_mass_to_the_edge_of_what_carries_it(
    live, by_m, margin_m
):
    """The cup is 0.2 m wide, and the table ends 1 m beside its middle."""
    result = ask(shift(live("none"), "Cup", (by_m, 0, 0)), kinds.Stability(entity="Cup"))
    assert result.measurement == pytest.approx(margin_m, abs=0.2 / 64)
    assert result.residual == max(0.0, -result.measurement)
    assert result.verdict == ("fail" if margin_m < 0 else "pass")


def test_what_floats_has_no_stability(live):
    result = ask(shift(live("none"), "Cup", (0, 0, 0.02)), kinds.Stability(entity="Cup"))
    assert (result.verdict, result.measurement) == ("fail", None)
    assert result.reason == "it rests on nothing: the gap below it is 0.02 m"


def test_what_hides_an_entity_is_named_with_its_pixels(live):
    """As the kernel's layers of all objects count them."""
    shot = live("none").snapshot
    grouping = group(shot, Labels(objects={}, collections={}, warnings=()))
    amodal = view(shot, grouping, SIZE).amodal()
    ids = {i.name: i.id for i in grouping.instances}
    by_id = amodal.occluders.by_hidden()[ids["Table"]]
    pixels = {name: by_id[i] for name, i in ids.items() if i in by_id}
    assert set(pixels) == {"Cup", "Chair"}
    area = int(amodal.in_frame_px[ids["Table"]])
    hidden = ask(live("none"), kinds.Hidden(entity="Table"))
    assert hidden.measurement == sum(pixels.values()) / area
    most_first = sorted(pixels, key=lambda name: -pixels[name])
    assert hidden.reason == ", ".join(f"{name} {pixels[name]} px" for name in most_first)
    for name, n in pixels.items():
        by_one = ask(live("none"), kinds.Hidden(entity="Table", other=name))
        assert (by_one.measurement, by_one.reason) == (n / area, f"{name} {n} px")
    free = ask(live("none"), kinds.Hidden(entity="Chair"))
    assert (free.measurement, free.reason) == (0.0, None)


def test_a_report_is_read_back_whole(live, evidence):
    report = measure(live("none"), list(HOLD.values()), evidence)
    assert decode(Report, readable(report)) == report
    assert report.scene_signature == live("none").state.scene_signature


def test_luminance_compares_a_render_with_the_photo(live, evidence, blender, room_folders):
    """The rendered room as its own photo passes; a photo a third brighter fails."""
    from legoworld.plugin.small_render import render_small

    blend = room_folders / "none" / "scene.blend"
    render = render_small(blend, blender, SIZE)
    assert (render == render_small(blend, blender, SIZE)).all()
    scene = dataclasses.replace(live("none"), render=render)
    gray = np.rint(rec709_luma(render) * 255).astype(np.uint8)
    requirement = kinds.Luminance(region="Table")
    for added, verdict in ((0, "pass"), (80, "fail")):
        photo = np.repeat(np.clip(gray.astype(int) + added, 0, 255)[..., None], 3, axis=2)
        seen = dataclasses.replace(evidence, photo=photo.astype(np.uint8))
        result = ask(scene, requirement, seen)
        assert result.verdict == verdict
        assert result.measurement == pytest.approx(-added / 255, abs=0.005)
    assert ask(live("none"), requirement, seen).reason == "nothing was rendered"


def test_colour_is_the_difference_of_two_means(live, evidence):
    """scikit-image's rgb2lab is asked; the entity's pixels and the region need not be the same."""
    from skimage.color import deltaE_cie76, rgb2lab

    render = np.full((30, 40, 3), (180, 90, 40), np.uint8)
    render[:, ::2] = (20, 120, 200)
    scene = dataclasses.replace(live("none"), render=render)
    mask = surface_pixels(Entities(scene.snapshot).surfaces("Cup"), surface_view(scene, SIZE))
    region = evidence.mask(evidence.region("Table"))
    photo = np.random.default_rng(3).integers(0, 256, (*region.shape, 3), np.uint8)
    seen = dataclasses.replace(evidence, photo=photo)
    means = [
        rgb2lab(pixels).mean(axis=0)
        for pixels in (upscale_nearest(render, SIZE)[mask], photo[region])
    ]
    requirement = kinds.Colour(entity="Cup", region="Table")
    result = ask(scene, requirement, seen)
    assert result.measurement == pytest.approx(deltaE_cie76(*means), rel=1e-3)
    photo[region] = render[0, 0]
    render[:] = render[0, 0]
    assert ask(scene, requirement, seen).residual == pytest.approx(0.0, abs=1e-9)
