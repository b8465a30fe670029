"""Renders one benchmark scene with Cycles, tuned for one sample, each time a line comes in.

Run with a Python that has bpy: cycles_server.py ARRAYS.npz DEPTH.npy FD. A line "render" on
standard input renders once and answers "wall_s cpu_s" on file descriptor FD; "check" writes z to
DEPTH.npy.
"""

from __future__ import annotations

import os
import sys
import time
from typing import Any

import bpy
import numpy as np

CAPTURED: dict[str, Any] = {}


def build(arrays: Any) -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    to_blender = np.diag([1.0, -1.0, -1.0, 1.0])  # OpenCV's camera at the world's origin
    meshes = []
    for m in range(len(arrays["vertex_start"]) - 1):
        v = arrays["vertices"][arrays["vertex_start"][m] : arrays["vertex_start"][m + 1]]
        t = arrays["triangles"][arrays["triangle_start"][m] : arrays["triangle_start"][m + 1]]
        mesh = bpy.data.meshes.new(f"mesh {m}")
        mesh.vertices.add(len(v))
        mesh.attributes["position"].data.foreach_set("vector", v.ravel())
        mesh.loops.add(3 * len(t))
        mesh.loops.foreach_set("vertex_index", t.ravel())
        mesh.polygons.add(len(t))
        mesh.polygons.foreach_set("loop_start", np.arange(0, 3 * len(t), 3, dtype=np.int32))
        mesh.update(calc_edges=True)
        meshes.append(mesh)
    for p, (m, matrix) in enumerate(
        zip(arrays["placement_mesh"], arrays["cam_from_mesh"], strict=True)
    ):
        item = bpy.data.objects.new(f"item {p}", meshes[m])
        item.matrix_world = (to_blender @ np.vstack([matrix, [0, 0, 0, 1]])).T.tolist()
        item.pass_index = p % 32768
        scene.collection.objects.link(item)
    camera = bpy.data.cameras.new("camera")
    camera.lens, camera.sensor_width, camera.sensor_fit = 50.0, 36.0, "HORIZONTAL"
    camera.clip_start, camera.clip_end = 0.1, 1000.0
    scene.camera = bpy.data.objects.new("camera", camera)
    scene.collection.objects.link(scene.camera)


def tune(width: int, height: int) -> None:
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.render.resolution_percentage = 100
    scene.render.use_compositing = scene.render.use_sequencer = False
    cycles = scene.cycles
    cycles.device, cycles.samples, cycles.max_bounces = "CPU", 1, 0
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.pixel_filter_type, cycles.filter_width = "GAUSSIAN", 0.01
    cycles.use_auto_tile, cycles.tile_size = False, 8192
    cycles.transparent_max_bounces = 0
    layer = bpy.context.view_layer
    layer.use_pass_z = layer.use_pass_object_index = True


def depth_of_a_render() -> np.ndarray:
    """One render that is not timed; Cycles' own result is read before Blender converts it."""
    import cycles

    original = cycles.CyclesRender.render

    def render(self: Any, depsgraph: Any) -> None:
        original(self, depsgraph)
        result = self.get_result()
        depth = np.empty(result.resolution_x * result.resolution_y, np.float32)
        result.layers[0].passes["Depth"].rect.foreach_get(depth)
        CAPTURED["depth"] = depth

    cycles.CyclesRender.render = render
    try:
        bpy.ops.render.render()
    finally:
        cycles.CyclesRender.render = original
    return CAPTURED["depth"]


def main() -> None:
    arrays_path, depth_path, answers = sys.argv[-3], sys.argv[-2], int(sys.argv[-1])
    arrays = np.load(arrays_path)
    width, height = (int(n) for n in arrays["size_wh"])
    build(arrays)
    tune(width, height)
    for line in sys.stdin:
        if line.strip() == "check":
            depth = depth_of_a_render().reshape(height, width)[::-1]
            np.save(depth_path, np.where(depth > 1e9, np.inf, depth))
            os.write(answers, b"saved\n")
            continue
        wall, cpu = time.perf_counter(), time.process_time()
        bpy.ops.render.render()
        os.write(answers, f"{time.perf_counter() - wall} {time.process_time() - cpu}\n".encode())


main()
