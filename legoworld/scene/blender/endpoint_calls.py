"""Calls of an endpoint's Blender: run code, describe the scene, render, save, export."""

from __future__ import annotations

import contextlib
import os
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import bpy
import mathutils

from legoworld.records.base import canonical
from legoworld.records.endpoint import CodeError
from legoworld.scene.blender.programs import (
    BlenderQuitError,
    ReplacedOperator,
    export_scene,
    pack_images,
)
from legoworld.scene.blender.truncated_output import TruncatedOutput
from legoworld.scene.folder import BLEND

_MOST_OBJECTS: Final = 10
_SCREENSHOT_SAMPLES: Final = 8
#: Blender renders no narrower picture.
_LEAST_PX: Final = 4
#: The add-on's number for what 2.2.4 of mcp-for-blender asks of it.
_ADDON_PROTOCOL: Final = 15


def execute_code(code: str) -> dict[str, Any]:
    """Run code as the add-on does: a new namespace with bpy, and what it prints is the result.

    Raises RuntimeError with a `CodeError` as JSON where the code raises. Leaving with exit code 0,
    or asking Blender to quit, is an end like any other.
    """
    printed = TruncatedOutput()

    def no_quit(*_args: object, **_kwargs: object) -> set[str]:
        raise BlenderQuitError

    bpy.ops.wm = ReplacedOperator(bpy.ops.wm, "quit_blender", no_quit)
    host = os.getpid()
    try:
        with contextlib.redirect_stdout(printed):
            exec(compile(code, "<code>", "exec"), {"bpy": bpy, "__name__": "__main__"})
    except (BlenderQuitError, KeyboardInterrupt):
        pass
    except SystemExit as done:
        if os.getpid() != host:
            os._exit(0)
        if done.code not in (None, 0):
            raise RuntimeError(_code_error(done)) from done
    except Exception as error:
        raise RuntimeError(_code_error(error)) from error
    finally:
        vars(bpy.ops).pop("wm", None)
    return {"executed": True, "result": printed.text()}


def _code_error(error: BaseException) -> str:
    try:
        message = str(error)
    except Exception as worse:  # noqa: BLE001  agent code: report its failure instead
        message = f"an error whose text cannot be made: {type(worse).__name__}"
    frames = "".join(traceback.format_exception(error)).splitlines()
    # Below this file's own frame is the agent's.
    own = next((n for n, line in enumerate(frames) if 'File "<code>"' in line), 1)
    said = "\n".join([frames[0], *frames[own:]]) if frames else message
    record = CodeError(exception_type=type(error).__name__, message=message, traceback=said)
    return canonical(record)


def get_scene_info() -> dict[str, Any]:
    """The scene's name, its size, and its first objects."""
    scene = bpy.context.scene
    return {
        "name": scene.name,
        "object_count": len(scene.objects),
        "objects": [
            {"name": o.name, "type": o.type, "location": [round(float(x), 2) for x in o.location]}
            for o in scene.objects[:_MOST_OBJECTS]
        ],
        "materials_count": len(bpy.data.materials),
    }


def get_object_info(name: str) -> dict[str, Any]:
    """One object: its transform, mesh, materials and bounds. ValueError for an unknown name."""
    thing = bpy.data.objects.get(name)
    if thing is None:
        raise ValueError(f"Object not found: {name}")
    about: dict[str, Any] = {
        "name": thing.name,
        "type": thing.type,
        "location": list(thing.location),
        "rotation": list(thing.rotation_euler),
        "scale": list(thing.scale),
        "visible": thing.visible_get(),
        "materials": [slot.material.name for slot in thing.material_slots if slot.material],
    }
    if thing.type == "MESH":
        corners = [thing.matrix_world @ mathutils.Vector(corner) for corner in thing.bound_box]
        about["world_bounding_box"] = [
            [min(c[axis] for c in corners) for axis in range(3)],
            [max(c[axis] for c in corners) for axis in range(3)],
        ]
        mesh = thing.data
        about["mesh"] = {
            "vertices": len(mesh.vertices),
            "edges": len(mesh.edges),
            "polygons": len(mesh.polygons),
        }
    return about


def list_scene_items(query: str = "", limit: int = 30) -> dict[str, Any]:
    """Objects, materials and collections whose names match, beginnings of names first."""
    needle = query.strip().lower()
    named = [
        *(("object", o.name, o.type.title()) for o in bpy.context.scene.objects),
        *(("material", m.name, f"Material, {m.users} users") for m in bpy.data.materials),
        *(("collection", c.name, "Collection") for c in bpy.data.collections),
    ]
    matching = sorted(
        (entry for entry in named if needle in entry[1].lower()),
        key=lambda entry: not entry[1].lower().startswith(needle),
    )
    kept = matching[: max(1, min(int(limit), 100))]
    items = [{"kind": kind, "name": name, "detail": detail} for kind, name, detail in kept]
    return {"items": items, "total": len(matching)}


def get_addon_info() -> dict[str, Any]:
    """What this endpoint can do, in the add-on's words."""
    return {
        "name": "legoworld's headless Blender endpoint",
        "addon_version": [1, 8],
        "protocol_version": _ADDON_PROTOCOL,
        "capabilities": sorted(CLIENT_CALLS),
        "blender_version": bpy.app.version_string,
        "premium_generators": [],
    }


def get_viewport_screenshot(
    filepath: str, max_size: int = 800, **_others: object
) -> dict[str, Any]:
    """A render from the active camera: without a display there is no viewport to look at.

    PNG is what is written, whatever format is asked for. Cycles on the CPU with few samples, since
    EEVEE and Workbench need a display. Every setting it changes is put back.
    """
    scene = bpy.context.scene
    if scene.camera is None:
        return {"error": "the scene has no active camera: add one and set scene.camera to it"}
    render = scene.render
    width, height = _pixels(render, max(16, min(int(max_size), 2048)))
    wanted = [
        (render, "engine", "CYCLES"), (render, "resolution_x", width),
        (render, "resolution_y", height), (render, "resolution_percentage", 100),
        (render, "use_border", False), (render, "use_sequencer", False),
        (render, "use_compositing", False), (render, "filepath", filepath),
        (render.image_settings, "media_type", "IMAGE"),
        (render.image_settings, "file_format", "PNG"),
        (scene.cycles, "device", "CPU"), (scene.cycles, "samples", _SCREENSHOT_SAMPLES),
        (scene.cycles, "use_adaptive_sampling", False), (scene.cycles, "use_denoising", False),
        (scene.cycles, "max_bounces", 2),
    ]  # fmt: skip
    before = [(owner, name, getattr(owner, name)) for owner, name, _ in wanted]
    try:
        for owner, name, value in wanted:
            setattr(owner, name, value)
        bpy.ops.render.render(write_still=True)
    finally:
        for owner, name, value in before:
            setattr(owner, name, value)
    return {
        "success": True,
        "width": width,
        "height": height,
        "filepath": filepath,
        "method": "camera_render",
        "file": bpy.data.filepath,
        "scene": scene.name,
        "scene_count": len(bpy.data.scenes),
    }


def _pixels(render: bpy.types.RenderSettings, longest: int) -> tuple[int, int]:
    """The scene's own aspect, at most `longest` pixels long."""
    width = render.resolution_x * render.pixel_aspect_x
    height = render.resolution_y * render.pixel_aspect_y
    shrink = longest / max(width, height)
    return max(_LEAST_PX, round(width * shrink)), max(_LEAST_PX, round(height * shrink))


def export_file(
    filepath: str,
    format: str = "glb",  # noqa: A002  the protocol's name
    object_names: list[str] | None = None,
    selection_only: bool = False,
    apply_modifiers: bool = True,
) -> dict[str, Any]:
    """Export the scene, the selection or named objects with their children as GLB."""
    if format.lower() != "glb":
        return {"error": f"this endpoint exports glb, not {format!r}"}
    names = [name for name in object_names or [] if name]
    if missing := [name for name in names if name not in bpy.data.objects]:
        return {"error": "Objects not found in Blender: " + ", ".join(missing)}
    chosen = [bpy.data.objects[name] for name in names]
    exported = [o for first in chosen for o in (first, *first.children_recursive)]
    if exported:
        for other in bpy.context.scene.objects:
            other.select_set(other in exported)
    elif selection_only:
        exported = list(bpy.context.selected_objects)
        if not exported:
            return {"error": "Nothing is selected in Blender and no object_names were given"}
    Path(filepath).parent.mkdir(parents=True, exist_ok=True)
    bpy.ops.export_scene.gltf(
        filepath=filepath, export_format="GLB", use_selection=bool(exported),
        use_active_scene=True, export_apply=apply_modifiers, export_extras=True,
        export_cameras=True,
    )  # fmt: skip
    return {
        "path": filepath,
        "bytes": Path(filepath).stat().st_size,
        "selection_only": bool(exported),
        "exported": [o.name for o in exported or bpy.context.scene.objects],
    }


def save_copy(output: str) -> dict[str, Any]:
    """Save the open scene to a file without becoming it."""
    bpy.ops.wm.save_as_mainfile(
        filepath=output, copy=True, compress=True, check_existing=False, relative_remap=False
    )
    return {}


def finalise(output: str) -> dict[str, Any]:
    """Pack what the open scene shows, and export it as scene.blend and scene.glb into a folder."""
    packed = pack_images()
    return {"warnings": [*packed, *export_scene(Path(output))], "blend": BLEND}


#: What clients may ask for, by the protocol's names.
CLIENT_CALLS: Final[dict[str, Callable[..., dict[str, Any]]]] = {
    "execute_code": execute_code,
    "export_scene": export_file,
    "get_addon_info": get_addon_info,
    "get_object_info": get_object_info,
    "get_scene_info": get_scene_info,
    "get_viewport_screenshot": get_viewport_screenshot,
    "list_scene_items": list_scene_items,
}
#: And what the endpoint itself asks for.
CALLS: Final = {**CLIENT_CALLS, "save_copy": save_copy, "finalise": finalise}
