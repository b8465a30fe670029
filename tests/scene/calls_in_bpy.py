"""Run with a Python that has bpy: what walks, renders, programs and endpoint calls do to scenes.

Prints one JSON object; `test_calls_in_bpy.py` says what belongs in it.
"""

from __future__ import annotations

import hashlib
import json
import struct
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import bpy
from cases.stage import (
    box,
    camera,
    collection,
    fresh,
    instance_of,
    link,
    material,
    pixel_camera,
    polygons,
    square,
)
from scene.by_hand import CAMERA

from legoworld.errors import LegoWorldError
from legoworld.scene.artefacts import without_metadata
from legoworld.scene.blender import endpoint_calls as calls
from legoworld.scene.blender.card_depth import surface_by_card
from legoworld.scene.blender.occurrences import Walk, walk
from legoworld.scene.blender.programs import _run, render_picture
from legoworld.scene.blender.reference_cases import _Tiers, _views, read_cases, write_case
from legoworld.scene.blender.render_state import visit_render_state


def main() -> int:
    """See the module's docstring."""
    told = {
        "camera visibility": _camera_visibility(),
        "pictures": _pictures(),
        "programs": {name: _program(text) for name, text in _PROGRAMS.items()},
        "endpoint": _endpoint(),
        "cases": _cases(),
        "depth": _depth(),
    }
    print("\n" + json.dumps(told))
    return 0


def _walked() -> Walk:
    walks: list[Walk] = []
    visit_render_state(bpy.context.scene, lambda graph: walks.append(walk(graph, CAMERA)))
    return walks[0]


def _shown() -> list[str]:
    """The top of each entry that shows a surface, and whether it is held out."""
    return sorted(
        entry.top[0].split(".")[0] + (" held out" if entry.holdout_mesh >= 0 else "")
        for entry in _walked().graph_entries
        if entry.mesh >= 0 or entry.holdout_mesh >= 0
    )


def _camera_visibility() -> list[str]:
    """A square in four collections, each instanced by an empty that the camera sees, or not."""
    fresh()
    pixel_camera()
    for part in (True, False):
        for whole in (True, False):
            name = f"part {part}, whole {whole}"
            source = collection(name, None)
            square(name, 2, source).visible_camera = part
            instance_of(source, name, 0, 0).visible_camera = whole
    layer = bpy.context.view_layer.layer_collection
    for held in (True, False):
        for indirect in (True, False):
            name = f"holdout {held}, indirect {indirect}"
            box(name, 0, 0, 1, 1, collection=collection(name))
            layer.children[name].holdout = held
            layer.children[name].indirect_only = indirect
    return _shown()


def _pictures() -> dict[str, Any]:
    """Size and content of final.png: of scenes of a size, and of others with a setting changed."""
    sizes = ((6, 4, 100), (16, 12, 50), (4096, 32, 100), (32, 4096, 50))
    told = [_picture(partial(_resize, *size))[0] for size in sizes]
    return {"sizes": told, "contents": {n: _picture(c)[1] for n, c in _CHANGES.items()}}


def _resize(x: int, y: int, percentage: int) -> None:
    render = bpy.context.scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = x, y, percentage


def _border() -> None:
    render = bpy.context.scene.render
    render.use_border, render.border_max_x = True, 0.5


def _black_compositor() -> None:
    tree = bpy.data.node_groups.new("compositor", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    tree.nodes.new("NodeGroupOutput")
    bpy.context.scene.compositing_node_group = tree
    bpy.context.scene.render.use_compositing = True


def _set(path: str, value: Any) -> Callable[[], None]:
    def change() -> None:
        *owners, name = path.split(".")
        held: Any = bpy.context.scene
        for owner in owners:
            held = getattr(held, owner)
        setattr(held, name, value)

    return change


_CHANGES: dict[str, Callable[[], None]] = {
    "": lambda: None,
    "engine": _set("render.engine", "BLENDER_WORKBENCH"),
    "file": lambda: setattr(bpy.context.scene.render.image_settings, "file_format", "BMP"),
    "border": _border,
    "compositor": _black_compositor,
    "samples": _set("cycles.samples", 1),
    "seed": _set("cycles.seed", 7),
    "denoiser": _set("cycles.use_denoising", True),
    "strength of the light": lambda: setattr(bpy.data.lights[0], "energy", 300),
}


def _picture(change: Callable[[], None]) -> tuple[tuple[int, ...], str]:
    fresh()
    camera((0, 0, 5))
    square("Square", 2)
    light = bpy.data.lights.new("Light", "POINT")
    light.energy, light.shadow_soft_size = 100, 2
    link(bpy.data.objects.new("Light", light)).location = (1, 1, 1)
    _resize(12, 8, 100)
    bpy.context.scene.render.engine = "CYCLES"
    change()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"))
        render_picture(folder)
        picture = without_metadata((folder / "final.png").read_bytes())
    assert picture.startswith(b"\x89PNG")
    return struct.unpack(">II", picture[16:24]), hashlib.sha256(picture).hexdigest()


_PROGRAMS = {
    "its words": """
import sys, os
assert sys.argv == ["blender", "--background", "--python", __file__], sys.argv
assert sys.path[0] == os.path.dirname(__file__), sys.path
assert __name__ == "__main__"
""",
    "renders": "import bpy\nbpy.ops.render.render()\nbpy.ops.render.render()\n",
    "quits": "import bpy\nbpy.ops.wm.quit_blender()\n1 / 0\n",
    "exits": "exit()",
    "exits with 0": "raise SystemExit(0)",
    "exits with 3": "\nraise SystemExit(3)",
    "exits with words": "\n\nraise SystemExit('no light')",
    "raises": "def build():\n    raise ValueError('far ' + __file__)\n\n\nbuild()\n",
    "does not compile": "\nx = = 1\n",
    "has no words": "class E(Exception):\n    __str__ = None\n\nraise E",
}


def _program(text: str) -> Any:
    """What stopped a program, which of its calls were skipped, and whether all is as before."""
    skipped: list[str] = []
    before = sys.argv, sys.stdin, list(sys.path)
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "program.py"
        program.write_text(text)
        error = _run(program, skipped)
    assert (sys.argv, sys.stdin, sys.path) == before
    assert not {"render", "wm"} & set(vars(bpy.ops))
    return [error and [error.type, error.message, error.line], skipped]


def _endpoint() -> Any:
    """Answers about a table with a knob, a hidden lamp, and more materials than are listed."""
    fresh()
    scene = bpy.context.scene
    told: dict[str, Any] = {"no camera": calls.get_viewport_screenshot("/none.png")}
    table = box("Table", 0, 0, 4, 2)
    table.location, table.scale = (1.234, 0, 5), (2, 1, 1)
    table.data.materials.append(bpy.data.materials.new("Oak"))
    table.data.materials.append(None)
    knob = square("Knob of the table", 1)
    knob.parent = table
    camera((0, 0, 9))
    lamp = link(bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "SUN")), collection("Kit"))
    lamp.hide_set(True)
    scene.name = "Room"
    bpy.context.view_layer.update()
    told["table"] = calls.get_object_info("Table")
    told["lamp"] = calls.get_object_info("Lamp")
    told["found"] = [calls.list_scene_items(query) for query in ("", " TABLE ", "k", "none")]
    told["least"] = calls.list_scene_items("", limit=0)
    told["scene"] = calls.get_scene_info()
    for n in range(120):
        bpy.data.materials.new(f"m{n}")
        link(bpy.data.objects.new(f"e{n}", None))
    many = calls.list_scene_items("", limit=500)
    told["many"] = [len(many["items"]), many["total"], len(calls.list_scene_items()["items"])]
    told["first"] = len(calls.get_scene_info()["objects"])
    with tempfile.TemporaryDirectory() as folder:
        told |= {"looks": _looks(folder), "exports": _exports(folder)}
    return told


def _looks(folder: str) -> Any:
    """Sizes of renders of 128 x 4 pixels of twice the width, and the settings after one."""
    render = bpy.context.scene.render
    _resize(128, 4, 25)
    render.pixel_aspect_x, render.filepath, render.engine = 2, "/mine", "BLENDER_WORKBENCH"
    render.use_border = True
    settings = bpy.context.scene.cycles.samples, bpy.context.scene.cycles.device

    def look(**asked: Any) -> Any:
        path = Path(folder) / "look.png"
        told = calls.get_viewport_screenshot(str(path), **asked)
        written = struct.unpack(">II", path.read_bytes()[16:24])
        return [told.pop("width"), told.pop("height"), *written,
                told.pop("filepath") == str(path), told.pop("method"), told]  # fmt: skip

    looks = [look(), look(max_size=3), look(max_size=9999)]
    assert (bpy.context.scene.cycles.samples, bpy.context.scene.cycles.device) == settings
    kept = (render.resolution_x, render.resolution_percentage, render.filepath, render.engine,
            render.use_border)  # fmt: skip
    return [looks, kept]


def _exports(folder: str) -> Any:
    """What is exported, and the nodes that the file has, for each way to choose."""
    path = Path(folder) / "in" / "scene.glb"
    told = {}
    for name, asked in {
        "format": {"format": "FBX"},
        "absent": {"object_names": ["Table", "Sofa", "Bed"]},
        "named": {"object_names": ["", "Table"], "format": "GLB"},
        "selected": {"selection_only": True},
        "unselected": {"selection_only": True},
        "all": {},
    }.items():
        if name == "unselected":
            bpy.ops.object.select_all(action="DESELECT")
        answer = calls.export_file(str(path), **asked)
        if "error" not in answer:
            content = path.read_bytes()
            size = struct.unpack("<I", content[12:16])[0]
            nodes = sorted(node["name"] for node in json.loads(content[20 : 20 + size])["nodes"])
            assert answer.pop("path") == str(path)
            assert answer.pop("bytes") == len(content)
            answer |= {"exported": sorted(answer["exported"])[-3:], "nodes": nodes[-3:]}
        told[name] = answer
    return told


def _depth() -> Any:
    """Depth and objects of a wall beside nothing, behind two cards of which one is there."""
    fresh()
    lens = camera((0, 0, 5)).data
    lens.type, lens.ortho_scale, lens.shift_x = "ORTHO", 4, 0
    lens.dof.use_dof, lens.dof.aperture_fstop, lens.dof.focus_distance = True, 0.01, 1
    polygons("Wall", [(-2, -2, 1), (1, -2, 1), (1, 2, 1), (-2, 2, 1)], [(0, 1, 2, 3)])
    for name, z, alpha in (("Card", 2, 0.6), ("Faint card", 3, 0.4)):
        card = polygons(name, [(-2, -2, z), (-1, -2, z), (-1, 2, z), (-2, 2, z)], [(0, 1, 2, 3)])
        material(name, card, Alpha=alpha)
    wanted: Any = {"size_wh": (4, 4), "samples": 9, "seed": 1, "denoise": False, "threads": 1}
    with tempfile.TemporaryDirectory() as name:
        blend = Path(name) / "scene.blend"
        bpy.ops.wm.save_as_mainfile(filepath=str(blend))
        read = surface_by_card(blend, wanted)
    names = json.loads(read["object_names"].tobytes())
    met = [[names[i][0] for i in row] for row in read["object"][:, :3].tolist()]
    return [[list(map(str, row)) for row in read["depth_z"].round(4).tolist()], met]


def _cases() -> Any:
    """What a reference scene declares, two of its cases, and what is wrong with six others."""
    fresh()
    scene = bpy.context.scene
    for name, view in {"Side": 10, "Top": "2", "Odd": "x", "Plain": None, "Also": 2}.items():
        camera((0, 0, 5)).name = name
        if view is not None:
            bpy.data.objects[name]["view"] = view
    later, kit = collection("Later", tier="medium", scored=0), collection("Kit", None, tier="hard")
    square("Base", scored="No")
    square("Second", collection=later, scored="yes")
    square("Knob", tier="hard", scored=False).parent = bpy.data.objects["Second"]
    square("Deep", collection=kit)
    instance_of(kit, "Place", 0, 0)
    bpy.data.objects["Knob"]["joint"] = "hinge"
    kinds = {
        "Light": bpy.data.lights.new("l", "POINT"), "Probe": bpy.data.lightprobes.new("p", "PLANE"),
        "Speaker": bpy.data.speakers.new("s"),
    }  # fmt: skip
    for name, data in kinds.items():
        link(bpy.data.objects.new(name, data))["tier"] = "hard"
    scene.timeline_markers.new("cut", frame=1).camera = bpy.data.objects["Side"]
    scene["environment"], scene["theme"], scene["split"] = "indoor", " ", 3
    scene.render.resolution_percentage = 50
    with tempfile.TemporaryDirectory() as name:
        blend = Path(name) / "scene.blend"
        bpy.ops.wm.save_as_mainfile(filepath=str(blend))
        told = {"declared": read_cases(blend)}
        for number, (tier, glb) in enumerate((("medium", True), (None, False))):
            output = Path(name) / str(number)
            output.mkdir()
            wanted: Any = {"tier": tier, "view": "Top", "size_wh": (7, 5), "glb": glb}
            write_case(blend, output, wanted)
            bpy.ops.wm.open_mainfile(filepath=str(output / "scene.blend"))
            told[str(tier)] = _case(output)
    wrong = {
        "no medium": {"A": "easy", "B": "hard"}, "no hard": {"A": None, "B": "medium"},
        "unknown": {"A": "huge"}, "number": {"A": 1}, "none": {"A": None}, "no view": {},
    }  # fmt: skip
    return told | {"wrong": {name: _refused(tiers) for name, tiers in wrong.items()} | {
        "earlier than its parent": _refused({"A": "easy", "B": "medium", "C": "hard"}, child=True)
    }}  # fmt: skip


def _case(output: Path) -> Any:
    scene = bpy.context.scene
    render = scene.render
    return {
        "hidden": sorted(o.name for o in bpy.data.objects if o.hide_render),
        "camera": [scene.camera.name, [m.camera for m in scene.timeline_markers]],
        "size": [render.resolution_x, render.resolution_y, render.resolution_percentage],
        "files": sorted(path.name for path in output.iterdir()),
        "scenes": len(bpy.data.scenes),
    }


def _refused(tiers: dict[str, Any], *, child: bool = False) -> Any:
    """What is found wrong with squares of these tiers; the views, where none are given."""
    fresh()
    for name, tier in tiers.items():
        square(name, **({} if tier is None else {"tier": tier}))
    if child:
        bpy.data.objects["A"].parent = bpy.data.objects["C"]
    try:
        return _Tiers(bpy.context.scene).names() if tiers else _views(bpy.context.scene)
    except LegoWorldError as error:
        return [error.code, error.found]


if __name__ == "__main__":
    sys.exit(main())
