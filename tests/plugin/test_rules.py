"""The plugin's pure rules at their edges: states, declarations, what is left, shapes, rooms."""

from __future__ import annotations

import ast
import json
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from legoworld.plugin import (
    acceptance,
    case,
    corrections,
    hooks,
    measure,
    residuals,
    result_pictures,
    room,
    room_fit,
    room_install,
)
from legoworld.plugin import vanishing_points as vanishing
from legoworld.plugin.diff import changes
from legoworld.plugin.plan import plan_markdown
from legoworld.plugin.remaining_work import list_unfinished, standing_requirements
from legoworld.plugin.transactions import judge, members, unknown_names
from legoworld.records.plugin_evidence import (
    ConstructionPlan,
    PlannedObject,
    Room,
    RoomFace,
)
from legoworld.records.plugin_ledger import Declaration, Entry, HookMark
from legoworld.records.plugin_requirements import (
    Centroid,
    Collision,
    Containment,
    Correction,
    DepthOrder,
    Existence,
    Facing,
    Layout,
    Overlap,
    Report,
    Result,
    Support,
)
from legoworld.records.plugin_state import Change, EntityState, SceneState

NONE = "0" * 64


def part(name: str, parent: str | None = None, *collections: str, **changes: Any) -> EntityState:
    known: dict[str, Any] = {
        "name": name, "library": None, "type": "MESH", "parent": parent, "collections": collections,
        "transform": (0.0,) * 32, "data": name, "data_sha256": "d", "mesh_sha256": "m",
        "materials": (), "material_sha256": "a", "modifiers_sha256": "o", "visibility_sha256": "v",
        "properties_sha256": "p", "placement_sha256": "w",
    }  # fmt: skip
    return EntityState(**known | changes)


def scene(*things: EntityState, camera: str | None = "Camera", **changes: Any) -> SceneState:
    known: dict[str, Any] = {
        "camera_sha256": "c", "render_sha256": "r", "world_sha256": "w", "collections_sha256": "t",
        "geometry_signature": NONE, "scene_signature": "s",
    }  # fmt: skip
    return SceneState(objects=things, camera=camera, **known | changes)


CUP = part("cup")


@pytest.mark.parametrize(
    ("field", "value", "kind"),
    [
        ("transform", (1.0,) * 32, "transform"), ("mesh_sha256", "n", "mesh"),
        ("materials", ("red",), "material"), ("material_sha256", "n", "material"),
        ("parent", "table", "parent"), ("collections", ("c",), "collection"),
        ("visibility_sha256", "n", "visibility"), ("modifiers_sha256", "n", "modifier"),
        ("type", "CURVE", "data"), ("data", "n", "data"), ("data_sha256", "n", "data"),
        ("properties_sha256", "n", "property"), ("placement_sha256", "n", "transform"),
    ],
)  # fmt: skip
def test_each_field_of_an_object_is_a_kind_of_change(field, value, kind):
    other = replace(CUP, **{field: value})
    assert changes(scene(CUP), scene(other)) == (Change(entity="cup", kind=kind),)
    assert changes(scene(other), scene(CUP)) == (Change(entity="cup", kind=kind),)
    also = replace(CUP, placement_sha256="elsewhere", **({field: value} if field[0] != "p" else {}))
    moved = kind not in ("transform", "mesh", "modifier", "data") and field[0] != "p"
    kinds = [change.kind for change in changes(scene(CUP), scene(also))]
    assert kinds == (["transform"] if field[0] == "p" else ["transform"] * moved + [kind])


def test_an_object_that_is_seen_for_the_first_time_has_not_moved():
    unseen = replace(CUP, placement_sha256=None)
    assert changes(scene(CUP), scene(unseen)) == changes(scene(unseen), scene(CUP)) == ()


@pytest.mark.parametrize(
    ("name", "value", "change"),
    [
        ("camera", None, ("camera", "camera")), ("camera_sha256", "n", ("camera", "camera")),
        ("render_sha256", "n", ("render", "render")), ("world_sha256", "n", ("world", "world")),
        ("collections_sha256", "n", ("collections", "collection")),
        ("scene_signature", "n", ("scene", "data")),
    ],
)  # fmt: skip
def test_what_objects_share_changes_by_its_own_name(name, value, change):
    found = changes(scene(CUP), replace(scene(CUP), **{name: value}))
    assert [(one.entity, one.kind) for one in found] == [change]
    named = replace(scene(part("mug")), **{name: value})
    kinds = [(one.entity, one.kind) for one in changes(scene(CUP), named)]
    assert kinds == [("cup", "removed"), ("mug", "added"), *[change] * (name[0] != "s")]


FURNITURE = (part("table"), part("cup", "table"), part("tea", "cup"), part("lamp", None, "lit"),
             part("bulb", "lamp"), part("Camera", "rig"), part("rig"),
             part("far", None, library="//a.blend"))  # fmt: skip


@pytest.mark.parametrize(
    ("name", "keys"),
    [
        ("table", {"table", "cup", "tea"}),
        ("tea", {"tea"}),
        ("lit", {"lamp", "bulb"}),
        ("rig", {"rig", "Camera", "camera"}),
        ("camera", {"camera"}),
        ("world", {"world"}),
        ("far", {"far [//a.blend]"}),
        ("nobody", set()),
    ],
)
def test_a_name_stands_for_what_is_below_it(name, keys):
    assert members((name,), [scene(*FURNITURE)]) == keys
    assert members((), [scene(*FURNITURE)]) == set()


def test_parents_in_a_circle_end():
    looped = scene(part("a", "b"), part("b", "a"), part("c", "a"))
    assert members(("a",), [looped]) == {"a", "b", "c"}
    assert members(("z",), [looped]) == set()


def test_protected_names_that_are_not_there_are_told():
    declared = Declaration(
        editable=("new",), protected=("cup", "lit", "world", "ghost", "b"), kinds=("mesh",)
    )
    assert unknown_names(declared, scene(*FURNITURE)) == ["b", "ghost"]


def report(signature: str = "s", *, blocked: bool = False) -> Report:
    return Report(
        scene_signature=signature, geometry_signature=NONE, photo_sha256=None, size_wh=(4, 3),
        results=(), blocked=blocked,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("editable", "protected", "kinds", "why"),
    [
        (("cup",), (), ("mesh",), None),
        (("table",), (), ("mesh",), None),
        (("table",), ("cup",), ("mesh",), "protected"),
        (("lamp",), (), ("mesh",), "undeclared"),
        (("cup",), (), ("material",), "kind not declared"),
        (("lamp",), ("table",), ("material",), "protected"),
    ],
)
def test_a_change_is_allowed_where_it_was_declared(editable, protected, kinds, why):
    before = scene(*FURNITURE)
    after = scene(*(replace(one, mesh_sha256="n") if one.name == "cup" else one
                    for one in FURNITURE))  # fmt: skip
    declared = Declaration(editable=editable, protected=protected, kinds=kinds)
    found = judge(before, after, declared, report())
    assert [violation.why for violation in found.violations] == ([] if why is None else [why])
    assert (found.accepted, found.blocked) == (why is None, False)
    assert [change.entity for change in found.allowed] == ["cup"] * (why is None)
    held = judge(before, after, declared, report(blocked=True))
    assert (held.accepted, held.blocked) == (False, True)
    cup = Existence(entity="cup")
    worse: Any = (acceptance.Worse(requirement=cup, before=0.0, after=1.0),)
    assert (judge(before, after, declared, report(), worse).accepted) is False
    assert judge(before, after, declared, report(), worse).blocked
    with pytest.raises(ValueError, match="another state"):
        judge(before, after, declared, report("old"))


def test_nothing_changed_is_nothing_to_commit():
    declared = Declaration(editable=("cup",), kinds=("mesh",))
    found = judge(scene(CUP), scene(CUP), declared, report())
    assert (found.allowed, found.violations, found.accepted, found.blocked) == (
        (),
        (),
        False,
        False,
    )


def test_what_is_brought_under_an_editable_name_does_not_become_editable():
    before = scene(part("table"), part("lamp"), camera=None)
    declared = Declaration(editable=("table",), kinds=("parent", "added", "camera"))
    after = scene(part("table"), part("lamp", "table"), part("vase", "table"), camera=None)
    found = judge(before, after, declared, report())
    assert [(v.change.entity, v.why) for v in found.violations] == [("lamp", "undeclared")]
    assert [change.entity for change in found.allowed] == ["vase"]
    seen = scene(part("table"), part("lamp"), part("Eye", "table"), camera="Eye")
    found = judge(before, seen, declared, report())
    assert sorted(change.entity for change in found.allowed) == ["Eye", "camera"]


def entry(seq: int, tool: str, answer: Any = None, **changes: Any) -> Entry:
    known: dict[str, Any] = {
        "previous": NONE, "request": {}, "error": None, "phase": "idle", "transaction": None,
        "geometry_signature": NONE, "scene_signature": NONE, "base_sha256": None,
    }  # fmt: skip
    return Entry(seq=seq, tool=tool, answer=answer, **known | changes)


def begin(seq: int, *names: str, **changes: Any) -> Entry:
    required = [{"kind": "existence", "entity": name} for name in names]
    request = {"editable": ["x"], "kinds": ["mesh"], "requirements": required}
    return entry(seq, "begin", request=request, phase="open", transaction=1, **changes)


GOOD, BAD = {"blocked": False}, {"blocked": True}
SEEN = {"findings": ["fine"], "render_sha256": "abc"}
EDIT = HookMark(ledger_seq=2, what="edit")


@pytest.mark.parametrize(
    ("entries", "marks", "said"),
    [
        ([], [], []),
        ([], [HookMark(ledger_seq=0, what="block")], []),
        ([], [HookMark(ledger_seq=0, what="edit")], ["Nothing was validated", "No render shows"]),
        ([entry(1, "serve")], [], []),
        ([begin(1)], [], ["Transaction 1 is open"]),
        ([entry(1, "validate", GOOD), entry(2, "review", SEEN)], [], []),
        ([entry(1, "validate", BAD), entry(2, "review", SEEN)], [],
         ["A hard requirement of entry 1"]),
        ([entry(1, "validate", GOOD, error="no"), entry(2, "review", SEEN)], [],
         ["Nothing was validated"]),
        ([entry(1, "validate", GOOD), entry(2, "review", SEEN)], [EDIT],
         ["The report of entry 1 is stale", "No render shows the scene as it is"]),
        ([entry(3, "validate", GOOD), entry(4, "review", SEEN)], [EDIT], []),
        ([entry(2, "validate", GOOD), entry(3, "review", SEEN)], [EDIT],
         ["The report of entry 2 is stale"]),
        ([entry(1, "validate", GOOD), entry(2, "review", SEEN, scene_signature="1" * 64)], [],
         ["The report of entry 1 is stale"]),
        ([entry(1, "validate", GOOD), entry(2, "review", SEEN | {"findings": None})], [],
         ["The render abc is not reviewed"]),
    ],
)  # fmt: skip
def test_what_is_left_before_an_agent_may_finish(entries, marks, said):
    found = list_unfinished(entries, marks)
    assert [text.startswith(start) for text, start in zip(found, said, strict=True)] == (
        [True] * len(said)
    )


def test_a_commit_that_measured_all_that_stands_is_a_report():
    first = [begin(1, "cup"), entry(2, "commit", [{}, GOOD], transaction=1)]
    second = [begin(3, "vase"), entry(4, "commit", [{}, GOOD], transaction=2)]
    both = [begin(3, "vase", "cup"), entry(4, "commit", [{}, GOOD], transaction=2)]
    cup, vase = Existence(entity="cup"), Existence(entity="vase")
    assert standing_requirements(first) == (cup,)
    assert standing_requirements([*first, *second]) == (cup, vase)
    assert standing_requirements([*first, *both]) == (cup, vase)
    refused = [begin(3, "vase"), entry(4, "commit", [{}, BAD], phase="open", transaction=2)]
    failed = [begin(3, "vase"), entry(4, "commit", None, error="no", transaction=2)]
    for later in (refused, failed):
        assert standing_requirements([*first, *later]) == (cup,)
    picture = entry(5, "review", SEEN)
    assert list_unfinished([*first, picture], []) == ()
    assert list_unfinished([*first, *both, picture], []) == ()
    assert list_unfinished([*first, *second, picture], []) == (), "the first commit's still holds"
    moved = [replace(one, scene_signature="1" * 64) for one in (*second, picture)]
    assert list_unfinished([*first, *moved], []) == (
        "The report of entry 2 is stale, the scene was edited: call validate.",
    )
    bad = [begin(1, "cup"), entry(2, "commit", [GOOD, BAD], transaction=1), picture]
    assert list_unfinished(bad, []) == ("A hard requirement of entry 2 does not pass: correct it.",)


def test_changes_are_told_five_at_most():
    edits = [Change(entity=f"o{n}", kind="mesh") for n in range(7)]
    assert case.told_changes(edits[:5]).endswith("o4 (mesh)")
    assert case.told_changes(edits).endswith("o4 (mesh) and 2 more")
    assert case.told_changes(edits[:1]) == "o0 (mesh)"


def result(requirement: Any, residual: float | None, verdict: Any = "pass") -> Result:
    return Result(requirement=requirement, verdict=verdict, measurement=residual,
                  residual=residual, tolerance=0.5)  # fmt: skip


@pytest.mark.parametrize(("rise", "worse"), [(1e-9, 0), (2e-9, 1), (-2e-9, 0)])
def test_a_residual_is_the_same_to_the_ninth_digit(rise, worse):
    one = Centroid(entity="cup", region="cup")
    pair = [result(one, 0.0)], [result(one, rise)]
    (made, found) = acceptance.list_worse(*pair, 1), acceptance.list_worse(*pair, 0)
    assert (len(made), found) == (worse, ())
    if made:
        assert (made[0].requirement, made[0].before, made[0].after) == (one, 0.0, rise)


@pytest.mark.parametrize(("after", "n"), [(0.29, 0), (0.31, 1)])
def test_an_edit_may_cost_others_a_tenth_of_iou(after, n):
    other = Overlap(entity="table", region="table")
    found = acceptance.list_worse([result(other, 0.2)], [result(other, after)], 0)
    assert len(found) == n
    soft = Overlap(entity="table", region="table", hard=False)
    assert acceptance.list_worse([result(soft, 0.2)], [result(soft, 0.9)], 0) == ()


def test_what_is_worse_is_in_the_order_of_the_requirements():
    a, b = (Centroid(entity=name, region=name) for name in "ab")
    c = Overlap(entity="c", region="c", accept="not_worse")
    before, after = [result(one, 0.1) for one in (b, c, a)], [result(x, 0.2) for x in (b, c, a)]
    assert [one.requirement for one in acceptance.list_worse(before, after, 3)] == [b, c, a]


@pytest.mark.parametrize("side", ["left", "top", "right", "bottom"])
def test_a_shape_at_the_picture_s_edge_is_cut(side):
    free = residuals.Shape(area_px=4, centroid_uv=(2, 2), extent_xywh=(1, 1, 2, 2))
    assert not corrections.is_cut(free, (4, 4))
    xywh = {"left": (0, 1, 2, 2), "top": (1, 0, 2, 2), "right": (2, 1, 2, 2),
            "bottom": (1, 2, 2, 2)}[side]  # fmt: skip
    assert corrections.is_cut(replace_shape(free, xywh), (4, 4))


def replace_shape(shape: residuals.Shape, xywh: Any) -> residuals.Shape:
    return residuals.Shape(area_px=shape.area_px, centroid_uv=shape.centroid_uv, extent_xywh=xywh)


def test_a_shape_is_its_pixels():
    mask = np.zeros((6, 9), bool)
    mask[2:4, 3:7] = True
    shape = residuals.measure_shape(mask)
    assert shape is not None
    assert (shape.area_px, shape.centroid_uv, shape.extent_xywh) == (8, (5.0, 3.0), (3, 2, 4, 2))
    assert residuals.measure_shape(np.zeros((2, 2), bool)) is None
    assert residuals.overlap(np.zeros((2, 2), bool), np.zeros((2, 2), bool)) == 0.0
    assert residuals.overlap(mask, np.roll(mask, 2, axis=1)) == 4 / 12
    assert residuals.boundary_distance_px(mask, np.roll(mask, 1, axis=1)) == pytest.approx(
        (2 / 8 + 2 / 8) / 2
    )


@pytest.mark.parametrize("count", [15, 16])
def test_sixteen_pixels_have_a_median(count):
    depth, disparity = np.full((5, 5), 2.0, np.float32), np.full((5, 5), 0.25)
    both = np.zeros((5, 5), bool)
    both.ravel()[:count] = True
    fit = residuals.DepthFit(a=1.0, b=0.25)
    pair = residuals.median_pair(depth, disparity, both)
    residual = residuals.depth_residual(fit, depth, disparity, both)
    assert (pair, residual) == (((0.5, 0.25), 0.0) if count == 16 else (None, None))
    for array, value in ((depth, np.inf), (depth, 0.0), (disparity, np.nan)):
        spoilt = array.copy()
        spoilt.ravel()[0] = value
        given = (spoilt, disparity) if array is depth else (depth, spoilt)
        assert residuals.median_pair(*given, both) is None


def test_a_fit_gives_depth_where_it_is_positive():
    fit = residuals.DepthFit(a=2.0, b=-1.0)
    found = fit.depth_m(np.array([1.0, 0.75, 0.5, 0.25]))
    assert found.tolist()[:2] == [1.0, 2.0]
    assert np.isnan(found[2:]).all()
    assert residuals.fit_depth([(1.0, 1.0), (2.0, 1.5)]) is None
    made = residuals.fit_depth([(1.0, 1.0), (2.0, 1.5), (5.0, 3.0)])
    assert made is not None
    assert (made.a, made.b) == pytest.approx((2.0, -1.0))
    assert residuals.fit_depth([(1.0, 3.0), (2.0, 1.5), (5.0, 1.0)]) is None


PLANNED = PlannedObject(
    region="a|b", category=None, centroid_uv=(0.5, 0.25), extent_wh=(0.125, 0.0625),
    relative_depth=None, depth_rank=None, cut_by=("left", "top"), small=True, touches=("x", "y"),
)  # fmt: skip


def test_a_plan_is_a_table():
    far = replace(PLANNED, region="far", category="cup", relative_depth=0.5, depth_rank=2,
                  cut_by=(), small=False, touches=())  # fmt: skip
    plan = ConstructionPlan(
        photo_sha256="0123456789abcdef", width=8, height=6, depth_source=None,
        objects=(far, PLANNED),
    )  # fmt: skip
    lines = plan_markdown(plan).splitlines()
    assert lines[2].startswith("Photo 8x6, sha256 0123456789ab.")
    assert lines[-2] == "| 2 | far | cup | 0.500, 0.250 | 0.125 x 0.062 | 0.500 |  |"
    assert lines[-1] == (
        r"| unknown | a\|b |  | 0.500, 0.250 | 0.125 x 0.062 | unknown "
        "| cut by the photo's left edge; cut by the photo's top edge; small; touches x, y |"
    )


def box_room(**distances: float | None) -> Room:
    known = {"floor": 1.0, "ceiling": 0.5, "left": 2.0, "right": 3.0, "far": 4.0, "near": 5.0}
    faces = tuple(
        RoomFace(name=name, distance=value, at_least=0.25 if value is None else value,
                 at_most=None, agreement=None, unknown=None if value else "unseen")
        for name, value in (known | distances).items()
    )  # fmt: skip
    return Room(
        photo_sha256="p", width=40, height=30, hfov_deg=90.0,
        world_from_cam_rotation=((1, 0, 0), (0, 0, 1), (0, -1, 0)), camera_height_m=2.0,
        faces=faces, structures=(), labelled_px=9, agreement=1.0,
    )  # fmt: skip


def test_a_shell_reaches_to_its_faces_in_camera_heights():
    low, high = room.bounds_m(box_room()).tolist()
    assert (low, high) == ([-4.0, -10.0, 0.0], [6.0, 8.0, 3.0])
    low, high = room.bounds_m(box_room(left=None, far=None)).tolist()
    assert (low[0], high[1]) == (-2.0, 2.0), "an open side is at least one camera height away"
    assert {face.name for face in room.known_faces(box_room(left=None))} == {
        "floor", "ceiling", "right", "far", "near",
    }  # fmt: skip


@pytest.mark.parametrize("size", [(8, 4), (3, 9), (1, 1)])
def test_a_ray_goes_through_the_middle_of_its_pixel(size):
    (width, height), fov = size, 70.0
    found = room_fit.rays(np.eye(3).tolist(), fov, size)
    assert found.shape == (height, width, 3)
    assert found.sum((0, 1)) == pytest.approx([0.0, 0.0, width * height])
    pixel = 2 * math.tan(math.radians(fov / 2)) / width
    assert found[0, 0] == pytest.approx([-(width - 1) / 2 * pixel, -(height - 1) / 2 * pixel, 1.0])
    turned = room_fit.rays([[0, 0, 1], [1, 0, 0], [0, 1, 0]], fov, size)
    assert (turned == found[..., [2, 0, 1]]).all()


@pytest.mark.parametrize("index", range(6))
def test_a_face_s_corners_lie_on_it_and_turn_to_the_inside(index):
    name, made = room_fit.FACES[index], box_room()
    corners = room.corners_m(made, name)
    low, high = room.bounds_m(made)
    normal = room_fit.NORMALS[index]
    axis = int(np.abs(normal).argmax())
    assert set(corners[:, axis]) == {(high if normal[axis] > 0 else low)[axis]}
    others = [i for i in range(3) if i != axis]
    assert {tuple(c) for c in corners[:, others].tolist()} == {
        (a, b) for a in (low[others[0]], high[others[0]]) for b in (low[others[1]], high[others[1]])
    }
    turned = np.cross(corners[1] - corners[0], corners[2] - corners[1])
    assert float(turned @ normal) < 0, "counter-clockwise from inside"


def test_a_room_is_installed_with_its_lens_and_faces():
    made = box_room(near=None)
    declared = room_install.installation(made)
    names = ["Room floor", "Room ceiling", "Room left wall", "Room right wall", "Room far wall"]
    assert [one.entity for one in declared.requirements] == names  # type: ignore[union-attr]
    code = room_install.install_code(made)
    compile(code, "code", "exec")
    given: Any = eval_given(code)
    assert given["lens_mm"] == pytest.approx(18.0)
    assert (given["size_wh"], given["place_m"]) == ([40, 30], [0.0, 0.0, 2.0])
    assert [face["name"] for face in given["faces"]] == names
    assert given["world_from_camera"] == [
        [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0],
    ]  # fmt: skip
    room_install.refuse_taken_names(made, {"Room near wall", "cup"})
    with pytest.raises(room_install.NotInstalledError, match="found: Room floor, Room shell"):
        room_install.refuse_taken_names(made, {"Room shell", "Room floor", "cup"})


def eval_given(code: str) -> Any:
    (line,) = (line for line in code.splitlines() if line.startswith("given = "))
    return json.loads(ast.literal_eval(line.removeprefix("given = json.loads(")[:-1]))


def room_scene(**changes: Any) -> Any:
    """A scene whose camera is the reference room's."""
    made = box_room()
    pose = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0], [0, -1.0, 0, 4.0]])
    known = {"fx": 20.0, "fy": 20.0, "cx": 20.0, "cy": 15.0, "orthographic": False, "pose": pose,
             "name": "Reference camera"} | changes  # fmt: skip
    camera = SimpleNamespace(name=known["name"], world_from_camera=known["pose"])
    shot = SimpleNamespace(camera=camera, render=SimpleNamespace(unit_scale=0.5))
    return (
        made,
        SimpleNamespace(snapshot=shot),
        SimpleNamespace(**{name: known[name] for name in ("fx", "fy", "cx", "cy", "orthographic")}),
    )


def turned_pose(row: int, column: int, by: float) -> Any:
    pose = room_scene()[1].snapshot.camera.world_from_camera.copy()
    pose[row, column] += by
    return pose


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({}, None),
        ({"fx": 20 * (1 + 9e-6)}, None),
        ({"fx": 20 * (1 + 2e-5)}, "focal length"),
        ({"fy": 20 * (1 - 2e-5)}, "focal length"),
        ({"cx": 20 + 8e-4}, "principal point"),
        ({"cy": 15 - 6e-4}, "principal point"),
        ({"cx": 20 + 2e-4}, None),
        ({"fx": math.nan}, "focal length"),
        ({"pose": turned_pose(0, 1, 2e-5)}, "rotation"),
        ({"pose": turned_pose(2, 2, -2e-5)}, "rotation"),
        ({"pose": turned_pose(0, 3, 4e-5)}, "place"),
        ({"pose": turned_pose(2, 3, -4e-5)}, "place"),
        ({"pose": turned_pose(2, 3, 1e-5)}, None),
        ({"name": "Camera"}, "another camera"),
        ({"orthographic": True}, "another camera"),
    ],
)
def test_the_installed_camera_is_the_room_s_to_32_bits(changes, said, monkeypatch):
    made, live, camera = room_scene(**changes)
    monkeypatch.setattr(room_install, "projection", lambda *_: camera)
    monkeypatch.setattr(room_install, "_refuse_another_view", lambda *_: None)
    if said is None:
        room_install.refuse_another(made, live)
        return
    with pytest.raises(room_install.NotInstalledError, match=f": {said}"):
        room_install.refuse_another(made, live)


@pytest.mark.parametrize(("away", "refused"), [(12, False), (13, True)])
def test_a_hundredth_of_the_pixels_may_show_another_face(away, refused, monkeypatch):
    made, live, _ = room_scene()
    live.snapshot.surface_mesh = np.zeros(7)
    expected = room.shell_view(made)
    hit = expected.copy()
    hit.ravel()[:away] = (hit.ravel()[:away] + 1) % 6
    hit.ravel()[100:200] = 6  # a piece of furniture before the walls
    hit.ravel()[200:300] = -1
    monkeypatch.setattr(room_install, "surface_view", lambda *_: SimpleNamespace(instance=hit))
    of_face = [(name, np.arange(7) == k) for k, name in enumerate(room_fit.FACES)]
    monkeypatch.setattr(room_install, "face_entities", lambda *_: of_face)
    if not refused:
        room_install._refuse_another_view(made, live)
        return
    with pytest.raises(room_install.NotInstalledError, match="13 of 1200 pixels"):
        room_install._refuse_another_view(made, live)


@pytest.mark.parametrize(
    ("low", "high", "middle"),
    [(1.0, 4.0, 2.0), (2.0, 2000.0, 2.5), (2.0, 1000.0, math.sqrt(2000)), (0.0, 1e-3, 1e-3),
     (0.0, 0.1, 0.01), (0.0, 1e9, 1e-3)],
)  # fmt: skip
def test_between_two_distances_is_their_geometric_mean(low, high, middle):
    assert room_fit._middle(low, high) == pytest.approx(middle)


def test_the_tilt_of_an_upright_camera_is_none_and_roll_counts_twice():
    def up(pitch_deg: float = 0.0, roll_deg: float = 0.0) -> Any:
        pitch, roll = math.radians(pitch_deg), math.radians(roll_deg)
        return np.array([math.sin(roll) * math.cos(pitch), -math.cos(roll) * math.cos(pitch),
                         math.sin(pitch)])  # fmt: skip

    assert vanishing._tilt_deg(up()) == 0.0
    assert vanishing._tilt_deg(up(pitch_deg=20)) == pytest.approx(20)
    assert vanishing._tilt_deg(up(roll_deg=-10)) == pytest.approx(20)
    assert vanishing._tilt_deg(-up(3, 4)) == pytest.approx(math.hypot(3, 8))


@pytest.mark.parametrize("degrees", [0.0, 14.0, -30.0])
def test_directions_are_named_by_up_and_right(degrees):
    turn = vanishing._rotation(np.array([0.0, math.radians(degrees), 0.0]))
    axes = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]) @ turn.T
    made = vanishing._upright(axes)
    assert made[2].tolist() == pytest.approx([0, -1, 0])
    assert made[0, 0] > abs(made[1, 0])
    assert np.linalg.det(made) == pytest.approx(1.0)
    half = vanishing._rotation(np.array([math.radians(45), 0.0, 0.0]))
    with pytest.raises(vanishing.UndeterminedError, match="could be up"):
        vanishing._upright(np.eye(3) @ half.T)
    assert vanishing._rotation(np.zeros(3)).tolist() == np.eye(3).tolist()


def draw_result(requirement: Any, *, region: bool = True) -> Any:
    """The picture of a requirement about "cup" and "table", side by side on grey 90."""
    masks = {"cup": np.s_[20:24, 20:24], "table": np.s_[20:24, 24:28]}
    view: Any = SimpleNamespace(
        _ground=np.full((60, 80, 3), 90, np.uint8), _buffers=None,
        _entities=SimpleNamespace(surfaces=lambda name: masks.get(name)),
        _evidence=SimpleNamespace(
            region=lambda name: name if region else None,
            mask=lambda _: mask_of(np.s_[30:34, 20:24]),
        ),
    )  # fmt: skip
    return result_pictures._View.picture(view, requirement)


def mask_of(place: Any) -> Any:
    mask = np.zeros((60, 80), bool)
    mask[place] = True
    return mask


def test_a_small_picture_has_the_entity_what_it_is_measured_against_and_the_outline(monkeypatch):
    monkeypatch.setattr(result_pictures, "surface_pixels", lambda place, _: mask_of(place))
    picture = draw_result(Support(entity="cup", on="table"))
    margin = round(0.25 * 7) + 8
    assert picture.shape == (4 + 2 * margin, 8 + 2 * margin, 3)
    at = picture[margin, margin], picture[margin, margin + 4], picture[0, 0]
    assert [colour.tolist() for colour in at] == [[56, 110, 200], [70, 156, 90], [90, 90, 90]]
    outlined = draw_result(Centroid(entity="nobody", region="r"))
    orange = (outlined == (255, 120, 0)).all(axis=2)
    assert int(orange.sum()) == 16 - 1 + 8, "the rim of 4 x 4 pixels, grown"
    assert draw_result(Centroid(entity="nobody", region="r"), region=False) is None


def test_a_small_picture_is_never_larger_than_240_pixels_nor_scaled_up():
    picture, shown = np.zeros((900, 1200, 3), np.uint8), np.zeros((900, 1200), bool)
    shown[100:800, 200:1000] = True
    assert max(result_pictures._crop_picture(picture, shown).shape) == 240
    shown[:] = False
    shown[0, 0] = True
    assert result_pictures._crop_picture(picture, shown).shape == (9, 9, 3)
    shown[0, :] = True
    assert result_pictures._crop_picture(picture, shown).shape[:2] == (round(309 / 5), 240)


def test_near_is_light_and_nothing_is_black():
    depth = np.array([[1.0, 2.0, 4.0, np.inf, 0.0]])
    shade = result_pictures._shade_depth(SimpleNamespace(depth_z_m=depth))  # type: ignore[arg-type]
    assert shade[0, :, 0].tolist() == [220, 140, 100, 0, 0]
    assert (shade == shade[..., :1]).all()
    empty = result_pictures._shade_depth(SimpleNamespace(depth_z_m=depth[:, 3:]))  # type: ignore[arg-type]
    assert not empty.any()


@pytest.mark.parametrize(("in_plane_m", "found"), [(1.0, (3.0, 4.0, 0.0)), (0.999, None)])
def test_a_move_on_the_ground_is_at_most_five_times_as_long(in_plane_m, found):
    viewed: Any = None
    jacobian = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    move = corrections.ViewedEntity._on_ground(viewed, jacobian, np.array([3.0, 4.0]), in_plane_m)
    assert move == found
    assert (
        corrections.ViewedEntity._on_ground(viewed, jacobian * 0, np.zeros(2), in_plane_m) is None
    )


@pytest.mark.parametrize(
    ("residual", "verdict", "corrected"),
    [(0.0, "pass", False), (1e-9, "pass", True), (0.02, "pass", True), (0.0201, "fail", True)],
)
def test_a_result_has_a_correction_from_any_residual_on(residual, verdict, corrected, monkeypatch):
    monkeypatch.setattr(measure, "_tolerance", lambda _: 0.02)
    asked = Centroid(entity="cup", region="cup")
    stood_in: Any = SimpleNamespace(
        _values=lambda _: (0.5, residual, None), _correction=lambda *_: Correction(scale=2.0)
    )
    found = measure._Measurement.result(stood_in, asked)
    assert (found.verdict, found.measurement, found.residual) == (verdict, 0.5, residual)
    assert (found.tolerance, found.correction is not None) == (0.02, corrected)


def test_the_longest_300_segments_are_kept():
    noise = np.random.default_rng(1).integers(0, 255, (60, 80), np.uint8)
    picture = np.kron(noise, np.ones((16, 16), np.uint8))
    found = vanishing._segments(picture)
    lengths = np.hypot(found[:, 2] - found[:, 0], found[:, 3] - found[:, 1])
    assert len(found) == 300
    assert (np.diff(lengths) <= 0).all()
    assert lengths.min() >= 0.02 * math.hypot(*picture.shape)


@pytest.mark.parametrize("call", ["{}", "mcp__blender__{}", "blender:{}", "mcp__a:b__{}"])
def test_a_tool_edits_whatever_server_it_is_of(call):
    assert hooks.edits(call.format("execute_blender_code"))
    assert not hooks.edits(call.format("get_scene_info"))
    assert not hooks.edits(call.format("execute_blender_code") + "__look")


@pytest.mark.parametrize(
    ("requirement", "names", "regions"),
    [
        (Support(entity="cup", on="table"), ["cup", "table"], []),
        (Support(entity="cup"), ["cup"], []),
        (Centroid(entity="cup", region="r"), ["cup"], ["r"]),
        (Facing(entity="chair", towards="desk"), ["chair", "desk"], []),
        (Containment(entity="pen", inside="cup", share=0.5), ["pen", "cup"], []),
        (Collision(entity="a", other="b"), ["a", "b"], []),
        (Layout(entities=("a", "b", "a", "c")), ["a", "b", "c"], []),
        (DepthOrder(matched=(("a", "r"), ("b", "s"), ("a", "t"))), ["a", "b"], ["r", "s", "t"]),
    ],
)
def test_what_a_requirement_names_is_drawn_the_measured_one_first(requirement, names, regions):
    assert result_pictures._names(requirement) == names
    assert [*result_pictures._regions(requirement)] == regions
