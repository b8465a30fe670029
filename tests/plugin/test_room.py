"""The room of a photo, against rooms of known camera and walls; and the construction plan."""

from __future__ import annotations

import numpy as np
import pytest
from plugin.synthetic import (
    SIZE,
    camera,
    evidence_with,
    picture,
    region_of,
    room,
    seen_faces,
    true_distances,
)

from legoworld.plugin.evidence import EvidenceInvalidError
from legoworld.plugin.plan import construction_plan, plan_markdown
from legoworld.plugin.residuals import SMALLEST_PX
from legoworld.plugin.room import RoomUnknownError, assign_structures, recover_room, shell_view
from legoworld.plugin.room_fit import FACES, NORMALS, _best_scales, fit_box, rays, seen_face
from legoworld.plugin.vanishing_points import UndeterminedError, manhattan_camera

W, H = SIZE


def labels_of(faces):
    """What `seen_faces` shows of the room, behind its boxes."""
    return {"wall": (faces >= 0) & (faces < 4), "floor": faces == 4, "ceiling": faces == 5}


def test_walls_of_known_rooms_are_found_and_unseen_ones_are_unknown():
    """The camera's rotation is estimated, too: the whole way from a picture to its room."""
    errors = []
    for seed in range(8):
        random = np.random.default_rng(seed)
        world_from_cam, place = camera(random)
        hfov = random.uniform(45, 85)
        triangles = room(random)
        gray = picture(triangles, world_from_cam, place, hfov, random)
        try:
            estimate = manhattan_camera(gray, hfov).world_from_cam
        except UndeterminedError:
            continue
        labels = labels_of(seen_faces(triangles, world_from_cam, place, hfov))
        fit = fit_box(rays(tuple(map(tuple, estimate)), hfov, SIZE), labels)
        truth = true_distances(estimate, world_from_cam, place)
        assert fit.agreement > 0.98
        for face in fit.faces:
            if face.distance is None:
                assert face.unknown
                assert face.at_least <= truth[face.name] * 1.05
            else:
                errors.append(abs(face.distance / truth[face.name] - 1))
        assert {f.name: f.distance for f in fit.faces}["near"] is None  # behind the camera
    assert len(errors) > 20
    assert np.median(errors) <= 0.01, errors
    assert max(errors) <= 0.08, errors


def test_each_ray_leaves_through_the_face_it_meets_first():
    directions = np.array([[0, 0, -1], [0, 0, 1], [-1, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0]])
    assert seen_face(directions, np.ones(6)).tolist() == list(range(6))
    slanted = np.array([0.0, 2.0, -1.0])  # falls one while it goes two ahead
    assert FACES[seen_face(slanted, np.array([1.0, 1, 1, 1, 3, 1]))] == "floor"
    assert FACES[seen_face(slanted, np.array([1.0, 1, 1, 1, 1.9, 1]))] == "far"


@pytest.fixture(scope="module")
def known():
    """Evidence of one room, with the true rotation and a disparity of its boxes."""
    random = np.random.default_rng(0)
    world_from_cam, place = camera(random)
    faces = seen_faces(room(random), world_from_cam, place, 70)
    regions = [region_of(name, mask) for name, mask in labels_of(faces).items()]
    boxes = [(faces >= 6 * n) & (faces < 6 * n + 6) for n in range(1, 7)]
    disparity = np.full(faces.shape, np.nan)
    for n, mask in enumerate(boxes):
        if mask.sum() > 100:
            regions.append(region_of(f"box {n}", mask, "box"))
            disparity[mask] = 10 - n
    return evidence_with(regions, world_from_cam, 70, disparity)


def test_a_room_is_recovered_by_the_names_of_its_regions(known):
    structures = assign_structures(known, None)
    assert structures == {"ceiling": "ceiling", "floor": "floor", "wall": "wall"}
    made = recover_room(known, structures, camera_height_m=1.5)
    assert made.agreement > 0.98
    assert recover_room(known, structures, camera_height_m=1.5) == made
    seen, labelled = shell_view(made), known.mask(known.region("floor"))
    assert (seen[labelled] == FACES.index("floor")).mean() > 0.98


@pytest.mark.parametrize(
    ("name", "category", "shows"),
    [("Back wall", None, "far"), ("left_wall", None, "left"), ("wall 2", "wall", "wall"),
     ("floor 1", "floor", "floor"), ("chair 1", "chair", None), ("x", "Ceiling", "ceiling"),
     ("flooring", None, None)],
)  # fmt: skip
def test_names_and_categories_say_what_a_region_shows(name, category, shows):
    mask = np.ones((H, W), bool)
    said = assign_structures(evidence_with([region_of(name, mask, category)]), None)
    assert said == ({} if shows is None else {name: shows})


def test_a_region_that_is_not_there_is_refused(known):
    with pytest.raises(EvidenceInvalidError, match="plinth"):
        assign_structures(known, {"plinth": "floor"})


@pytest.mark.parametrize(
    ("keep", "structures", "why"),
    [
        (("wall",), {"wall": "wall"}, "no region shows the floor"),
        (("floor",), {"floor": "floor"}, "no labelled pixel"),
        (("floor", "wall"), {"floor": "wall", "wall": "floor"}, "box explains|shows no floor"),
    ],
)
def test_a_photo_that_does_not_tell_its_room_is_unknown(known, keep, structures, why):
    kept = [known.region(name) for name in keep]
    rotation = np.array(known.file.camera.world_from_cam_rotation)
    with pytest.raises(RoomUnknownError, match=why):
        recover_room(evidence_with(kept, rotation, 70), structures, 1.5)


def test_without_a_camera_there_is_no_room(known):
    with pytest.raises(RoomUnknownError, match="not asked"):
        recover_room(evidence_with(known.file.regions), {"floor": "floor"}, 1.5)


def test_a_plan_orders_objects_by_depth_and_says_what_is_hidden(known):
    plan = construction_plan(known, assign_structures(known, None))
    assert [o.depth_rank for o in plan.objects] == list(range(1, len(plan.objects) + 1))
    assert (plan.objects[0].relative_depth, plan.objects[-1].relative_depth) == (0.0, 1.0)
    assert all(0 <= o.relative_depth <= 1 for o in plan.objects)
    assert not {o.region for o in plan.objects} & {"floor", "wall", "ceiling"}
    text = plan_markdown(plan)
    assert text.count("\n| ") == len(plan.objects) + 1


def test_a_plan_without_depth_says_unknown_and_flags_cut_and_touching_objects():
    left, middle = np.zeros((H, W), bool), np.zeros((H, W), bool)
    left[10:50, :30] = middle[20:40, 30:80] = True
    dot = np.zeros((H, W), bool)
    dot[200, 200:203] = True
    regions = [region_of("a|b", left), region_of("b", middle), region_of("dot", dot)]
    plan = construction_plan(evidence_with(regions), {})
    cut, touching, small = plan.objects
    assert cut.cut_by == ("left",)
    assert cut.touches == ("b",)
    assert touching.touches == ("a|b",)
    assert (small.small, cut.small) == (True, False)
    assert cut.centroid_uv == pytest.approx((15 / W, 30 / H))
    assert cut.extent_wh == (30 / W, 40 / H)
    assert {o.relative_depth for o in plan.objects} == {None}
    rows = [line for line in plan_markdown(plan).splitlines() if line.startswith("| unknown")]
    assert [row.split(" | ", 1)[1] for row in rows] == [
        f"a\\|b |  | {15 / W:.3f}, {30 / H:.3f} | {30 / W:.3f} x {40 / H:.3f} | unknown "
        "| cut by the photo's left edge; touches b |",
        f"b |  | {55 / W:.3f}, {30 / H:.3f} | {50 / W:.3f} x {20 / H:.3f} | unknown "
        "| touches a\\|b |",
        f"dot |  | {201.5 / W:.3f}, {200.5 / H:.3f} | {3 / W:.3f} x {1 / H:.3f} | unknown "
        "| small |",
    ]


@pytest.mark.parametrize(
    ("where", "sides"),
    [
        (np.s_[0, 5], ("top",)),
        (np.s_[H - 1, 5], ("bottom",)),
        (np.s_[5, W - 1], ("right",)),
        (np.s_[:, 5], ("top", "bottom")),
        (np.s_[1, 1], ()),
    ],
)
def test_an_object_is_cut_by_the_edges_it_reaches(where, sides):
    mask = np.zeros((H, W), bool)
    mask[where] = True
    (planned,) = construction_plan(evidence_with([region_of("a", mask)]), {}).objects
    assert planned.cut_by == sides


@pytest.mark.parametrize(("pixels", "small"), [(SMALLEST_PX - 1, True), (SMALLEST_PX, False)])
def test_an_object_is_small_below_the_smallest_area(pixels, small):
    mask = np.zeros((H, W), bool)
    mask[5, 5 : 5 + pixels] = True
    (planned,) = construction_plan(evidence_with([region_of("a", mask)]), {}).objects
    assert planned.small == small


@pytest.mark.parametrize(("away", "touch"), [(0, True), (1, False)])
def test_objects_touch_where_no_pixel_lies_between_them(away, touch):
    one, two, corner = (np.zeros((H, W), bool) for _ in range(3))
    one[5:9, 5:9] = True
    two[5:9, 9 + away : 12] = True
    corner[9:12, 2:5] = True  # diagonal to the first
    regions = [region_of("one", one), region_of("two", two), region_of("corner", corner)]
    found = {o.region: o.touches for o in construction_plan(evidence_with(regions), {}).objects}
    assert found == {
        "one": ("two",) if touch else (), "two": ("one",) if touch else (), "corner": (),
    }  # fmt: skip


def test_each_face_looks_outward_along_one_axis():
    """x right, y ahead, z up, as a room is seen."""
    outward = {"floor": (0, 0, -1), "ceiling": (0, 0, 1), "left": (-1, 0, 0), "right": (1, 0, 0),
               "far": (0, 1, 0), "near": (0, -1, 0)}  # fmt: skip
    assert dict(zip(FACES, map(tuple, NORMALS.tolist()), strict=True)) == outward


@pytest.mark.parametrize("seed", range(6))
def test_the_best_scale_of_moved_faces_is_what_every_scale_says(seed):
    """Against counting the rays that leave through an allowed face, scale by scale."""
    random = np.random.default_rng(seed)
    towards = random.uniform(0.05, 1, (9, 6))
    distances = random.uniform(0.5, 3, 6)
    allowed = random.random((9, 6)) < 0.5
    moved = [[0], [2, 5], [1, 3]][seed % 3]
    low, high, best = _best_scales(tuple(moved), distances, towards, allowed, as_well=1)

    def score(scale):
        scaled = distances.copy()
        scaled[moved] *= scale
        return int(allowed[np.arange(9), (scaled / towards).argmin(axis=1)].sum())

    scales = np.geomspace(1e-4, 1e4, 4001)
    scores = np.array([score(scale) for scale in scales])
    assert best == scores.max()
    within = scales[(scales > low) & (scales < high)]
    assert min(map(score, within)) >= best - 1
    for end, step in ((low, 0.999), (high, 1.001)):
        if 1e-4 < end < 1e4:  # else open
            assert score(end * step) < best - 1
