"""The judge: what Cycles' own data passes say about a .blend, through Blender's render operator.

Run as a program, in a process of its own: one JSON request per line on standard input ({"blend",
"size_wh", "output"}), one JSON answer per line. It shares no code with the package it judges: the
file is opened, its settings are turned into one sample at each pixel centre, and it is rendered.

The output .npz holds object_index (H, W) int32 into names (-1: nothing), depth_z (H, W) float32 in
scene units (+inf: nothing), unit_scale, and names, "name|library path" of every object of the file.
"""

from __future__ import annotations

import json
import os
import sys
import traceback
from pathlib import Path
from typing import Any

import bpy
import cycles
import numpy as np

#: Cycles stores an object's pass index in 15 bits.
MOST_OBJECTS = 32767
#: What Cycles writes into the depth pass where a ray meets nothing.
NOTHING_Z = 1e9

WANTED = ("Object Index", "Depth")

_passes: dict[str, np.ndarray] = {}
_cycles_render = cycles.CyclesRender.render


def _render_and_keep_passes(engine: Any, depsgraph: Any) -> None:
    """Cycles' render(), then a copy of its passes while they can be reached from Python."""
    _cycles_render(engine, depsgraph)
    layer = engine.get_result().layers[depsgraph.view_layer.name]
    for name in WANTED:
        rect = layer.passes[name].rect
        _passes[name] = np.empty(len(rect), np.float32)
        rect.foreach_get(_passes[name])


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
    overridden = _set_up(scene, layer, size_wh)
    objects = list(bpy.data.objects)
    if len(objects) > MOST_OBJECTS:
        raise RuntimeError(f"{len(objects)} objects, Cycles tells {MOST_OBJECTS} apart")
    for index, block in enumerate(objects):
        block.pass_index = index + 1
    names = [f"{o.name}|{o.library.filepath if o.library else ''}" for o in objects]
    _passes.clear()
    bpy.ops.render.render(write_still=False, use_viewport=False)
    width, height = size_wh
    index = _picture(_passes["Object Index"], width, height)
    depth = _picture(_passes["Depth"], width, height)
    rounded = np.rint(index).astype(np.int32) - 1
    if np.abs(index - np.rint(index)).max() > 0:
        raise RuntimeError("an object index is a mean of several: not one sample a pixel")
    np.savez(
        output,
        object_index=rounded,
        depth_z=np.where(depth >= NOTHING_Z, np.float32(np.inf), depth),
        unit_scale=scene.unit_settings.scale_length,
        names=np.array(names),
    )
    return {"view_layer": layer.name, "material_override": overridden}


def _saved_layer(scene: Any) -> Any:
    """The view layer a saved picture shows: the first that renders, the active one or not."""
    if scene.render.use_single_layer:
        return bpy.context.view_layer
    return next(layer for layer in scene.view_layers if layer.use)


def _picture(rect: np.ndarray, width: int, height: int) -> np.ndarray:
    """A pass, stored bottom row first, as (H, W), top row first."""
    return rect.reshape(height, width)[::-1]


def _set_up(scene: Any, layer: Any, size_wh: tuple[int, int]) -> bool:
    """One sample per pixel, at its centre, of the first surface; True with a plain material."""
    render = scene.render
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y = size_wh
    render.resolution_percentage = 100
    render.threads_mode, render.threads = "FIXED", 2
    for other in scene.view_layers:
        other.use = other == layer
    for switch in ("use_border", "use_compositing", "use_sequencer", "use_motion_blur",
                   "use_multiview", "use_freestyle", "use_persistent_data", "film_transparent"):  # fmt: skip
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
        "seed": 0,
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
    layer.use_pass_object_index = layer.use_pass_z = True
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


#: Nodes that say nothing of whether the surface is there.
_HARMLESS = ("BSDF_DIFFUSE", "BSDF_GLOSSY", "EMISSION", "RGB", "VALUE", "FRAME", "REROUTE")


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
        elif node.type.startswith("BSDF_T") or node.type in ("HOLDOUT", "GROUP", "SCRIPT"):
            return True
        elif node.type not in _HARMLESS and any(
            s.type == "SHADER" for s in (*node.inputs, *node.outputs)
        ):
            if node not in outputs:
                return True
    return False


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
