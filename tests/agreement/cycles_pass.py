"""The judge: what Cycles' own data passes say about a .blend, through Blender's render operator.

Run as a program, in a process of its own: one JSON request per line on standard input ({"blend",
"size_wh", "output"}), one JSON answer per line. It shares no code with the package it judges: the
file is opened, its settings are turned into one sample at each pixel centre, and it is rendered.

The output .npz holds object_index (H, W) int32 into names (-1: nothing), depth_z (H, W) float32 in
scene units (+inf: nothing), normal_world (H, W, 3) float32 (NaN: nothing), unit_scale, and names,
"name|library path" of every object of the file.

Transparency needs more than one render. Cycles' threshold is sharp on one side only: from a surface
of alpha 0.5 and more the first sample is final, but below it a path still ends there with the
probability alpha, or is scattered inside a volume, and then what it met last stays written. The
surface behind is what the farthest of several renders with different seeds shows; and so that there
always is one behind, a backdrop stands just before the far clip plane, and is nothing.
"""

from __future__ import annotations

import json
import os
import sys
import traceback
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import cycles  # type: ignore[import-not-found]
import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int32]
Floats = NDArray[np.float32]

#: Cycles stores an object's pass index in 15 bits.
MOST_OBJECTS = 32767
#: Renders in a row that must change nothing before transparency is taken as settled, and in all.
CALM_RENDERS = 6
MOST_RENDERS = 96

WANTED = ("Object Index", "Depth", "Normal")


@dataclass(frozen=True, kw_only=True)
class UsedCamera:
    """The camera of a render as it was evaluated; world_from_camera has no scale."""

    world_from_camera: Any
    clip_end: float
    ortho_scale: float


_passes: dict[str, Floats] = {}
_cameras: list[UsedCamera] = []
_cycles_render = cycles.CyclesRender.render


def _render_and_keep_passes(engine: Any, depsgraph: Any) -> None:
    """Cycles' render(), then a copy of its passes while they can be reached from Python."""
    shown = depsgraph.scene_eval.camera
    _cameras.append(
        UsedCamera(
            world_from_camera=shown.matrix_world.normalized(),
            clip_end=shown.data.clip_end,
            ortho_scale=shown.data.ortho_scale,
        )
    )
    name = depsgraph.view_layer.name  # Cycles frees what it has copied: read before
    _cycles_render(engine, depsgraph)
    layer = engine.get_result().layers[name]
    for name in WANTED:
        rect = layer.passes[name].rect
        _passes[name] = np.empty((len(rect), layer.passes[name].channels), np.float32)
        rect.foreach_get(_passes[name].ravel())


def judge(blend: str, size_wh: tuple[int, int], output: str) -> dict[str, Any]:
    """Render one file and write its passes; returns a few facts about how it was done."""
    bpy.context.preferences.filepaths.use_scripts_auto_execute = False
    try:
        bpy.ops.wm.open_mainfile(filepath=blend, load_ui=False, use_scripts=False)
    except RuntimeError as error:  # raised for a missing texture too, with the file open
        if Path(bpy.data.filepath) != Path(blend):
            raise
        print(f"opened with complaints: {error}", file=sys.stderr)
    scene = bpy.context.scene
    layer = _saved_layer(scene)
    plain = _set_up(scene, layer, size_wh)
    objects = list(bpy.data.objects)
    if len(objects) > MOST_OBJECTS:
        raise RuntimeError(f"{len(objects)} objects, Cycles tells {MOST_OBJECTS} apart")
    for number, block in enumerate(objects, start=1):
        block.pass_index = number
    names = [f"{o.name}|{o.library.filepath if o.library else ''}" for o in objects]
    backdrop = None if plain else _add_backdrop(scene, len(objects) + 1)
    index, depth, normal, renders = _first_render(scene) if plain else _farthest(scene)
    nothing = (index == 0) | (index == (backdrop or 0))
    np.savez(
        output,
        object_index=np.where(nothing, -1, index - 1).astype(np.int32),
        depth_z=np.where(nothing, np.float32(np.inf), depth),
        normal_world=np.where(nothing[..., None], np.float32(np.nan), normal),
        unit_scale=scene.unit_settings.scale_length,
        names=np.array(names),
    )
    return {"view_layer": layer.name, "plain": plain, "renders": renders}


def _saved_layer(scene: Any) -> Any:
    """The view layer a saved picture shows: the first that renders, the active one or not."""
    if scene.render.use_single_layer:
        return bpy.context.view_layer
    return next(layer for layer in scene.view_layers if layer.use)


def _render(scene: Any, seed: int) -> tuple[Ints, Floats, Floats]:
    """Object index (H, W) int32, 0 where nothing was written, depth (H, W), normal (H, W, 3)."""
    scene.cycles.seed = seed
    _passes.clear()
    bpy.ops.render.render(write_still=False, use_viewport=False)
    size = (scene.render.resolution_y, scene.render.resolution_x)
    # Passes are stored bottom row first.
    index, depth = (_passes[name].reshape(size)[::-1] for name in WANTED[:2])
    normal = _passes["Normal"].reshape(*size, 3)[::-1]
    if np.any(index != np.rint(index)):
        raise RuntimeError("an object index is a mean of several: not one sample a pixel")
    return index.astype(np.int32), depth, normal


def _first_render(scene: Any) -> tuple[Ints, Floats, Floats, int]:
    return (*_render(scene, 0), 1)


def _farthest(scene: Any) -> tuple[Ints, Floats, Floats, int]:
    """What the farthest of enough renders shows; what none has written stays so."""
    index, depth, normal = _render(scene, 0)
    depth = np.where(index == 0, -np.inf, depth)
    unchanged = renders = 0
    while unchanged < CALM_RENDERS:
        renders += 1
        if renders > MOST_RENDERS:
            raise RuntimeError(f"transparency did not settle in {MOST_RENDERS} renders")
        again, farther, behind = _render(scene, renders)
        farther = np.where(again == 0, -np.inf, farther)
        # Another seed moves the sample by a thousandth of a pixel: the same surface is not farther.
        changed = farther > np.where(again == index, depth + 1e-3 * np.abs(depth), depth)
        unchanged = 0 if changed.any() else unchanged + 1
        index, depth = np.where(changed, again, index), np.where(changed, farther, depth)
        normal = np.where(changed[..., None], behind, normal)
    return index, depth, normal, renders + 1


def _add_backdrop(scene: Any, pass_index: int) -> int:
    """A plane across the view just before the far clip plane; returns its pass index."""
    _render(scene, 0)  # tells which camera a render uses, markers and constraints applied
    camera = _cameras[-1]
    half = 50 * max(camera.clip_end, camera.ortho_scale)
    z = camera.clip_end * (1 - 1e-5)
    mesh = bpy.data.meshes.new("judge backdrop")
    corners = [(x * half, y * half, -z) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    backdrop = bpy.data.objects.new("judge backdrop", mesh)
    backdrop.matrix_world = camera.world_from_camera
    backdrop.pass_index = pass_index
    scene.collection.objects.link(backdrop)
    return pass_index


def _set_up(scene: Any, layer: Any, size_wh: tuple[int, int]) -> bool:
    """One sample at each pixel's centre; True when one plain material serves for all."""
    render = scene.render
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y = size_wh
    render.resolution_percentage = 100
    render.threads_mode, render.threads = "FIXED", 2
    for other in scene.view_layers:
        other.use = other == layer
    for switch in ("use_border", "use_compositing", "use_sequencer", "use_motion_blur",
                   "use_multiview", "use_freestyle", "use_persistent_data"):  # fmt: skip
        setattr(render, switch, False)
    settings = scene.cycles
    for name, value in {
        "device": "CPU",
        "samples": 1,
        "use_layer_samples": "IGNORE",
        "use_sample_subset": False,
        "time_limit": 0.0,
        "use_adaptive_sampling": False,
        "use_denoising": False,
        "use_animated_seed": False,
        "pixel_filter_type": "GAUSSIAN",
        "filter_width": 0.01,
        "tile_size": 8192,
        "use_camera_cull": False,
        "use_distance_cull": False,
        "rolling_shutter_type": "NONE",
        "max_bounces": 0,
        "transparent_max_bounces": 1024,
        "use_guiding": False,
        "use_fast_gi": False,
    }.items():
        setattr(settings, name, value)
    layer.use_pass_object_index = layer.use_pass_z = layer.use_pass_normal = True
    layer.pass_alpha_threshold = 0.5
    for camera in bpy.data.cameras:
        camera.dof.use_dof = False
    scene.world = None
    plain = layer.material_override is None and not any(_needs_its_shader(m) for m in _materials())
    if plain:
        layer.material_override = _plain_material()
    return plain


def _materials() -> list[Any]:
    return [m for m in bpy.data.materials if not m.is_grease_pencil]


def _needs_its_shader(material: Any) -> bool:
    """Whether anything but an opaque, undisplaced surface could come of a material."""
    tree = material.node_tree
    return tree is None or _tree_needs_its_shader(tree)


#: Shader nodes that leave the surface there.
_HARMLESS = ("BSDF_DIFFUSE", "BSDF_GLOSSY", "EMISSION")


def _tree_needs_its_shader(tree: Any) -> bool:
    outputs = [n for n in tree.nodes if n.type == "OUTPUT_MATERIAL"]
    if len(outputs) != 1 or not outputs[0].inputs["Surface"].is_linked:
        return True
    if outputs[0].inputs["Volume"].is_linked or outputs[0].inputs["Displacement"].is_linked:
        return True
    for node in tree.nodes:
        if node.type == "BSDF_PRINCIPLED":
            alpha = node.inputs["Alpha"]
            if alpha.is_linked or alpha.default_value < 1.0:
                return True
        elif node not in outputs and not _is_harmless(node):
            return True
    return False


def _is_harmless(node: Any) -> bool:
    if node.type in ("GROUP", "SCRIPT"):
        return False
    shades = any(socket.type == "SHADER" for socket in (*node.inputs, *node.outputs))
    return not shades or node.type in _HARMLESS


def _plain_material() -> Any:
    material = bpy.data.materials.new("judge plain")
    tree = material.node_tree
    tree.nodes.clear()
    shader = tree.nodes.new("ShaderNodeBsdfDiffuse")
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    return material


def main() -> None:
    """Serve requests until the input ends; whatever Blender prints goes to standard error."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    cycles.CyclesRender.render = _render_and_keep_passes
    for line in sys.stdin:
        request = json.loads(line)
        try:
            facts = judge(request["blend"], tuple(request["size_wh"]), request["output"])
            answer = {"ok": True, **facts}
        except Exception as error:  # noqa: BLE001  the asker is told, and decides
            traceback.print_exc()
            answer = {"ok": False, "error": f"{type(error).__name__}: {error}"}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()
    os._exit(0)  # Cycles and some caches abort in Blender's own exit code


if __name__ == "__main__":
    main()
