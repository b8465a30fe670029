"""Who is timed: the kernel, the floor, and two ray tracers. Each callable does the whole job.

Outputs, rays and results are allocated beforehand; a ray tracer's time is its build and its trace.
"""

from __future__ import annotations

import ctypes
import hashlib
import importlib
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from legoworld.visibility import compilation, kernel
from legoworld.visibility.kernel import Surfaces
from legoworld.visibility.library import library
from legoworld.visibility.projection import Projection


@dataclass(frozen=True, kw_only=True)
class Contender:
    """`run` does one whole render into `depth` ((H, W) float32, +inf = nothing)."""

    run: Callable[[], None]
    depth: NDArray[np.float32]
    digest: Callable[[], str]


def _digest(*arrays: NDArray[Any]) -> str:
    return hashlib.sha256(b"".join(a.tobytes() for a in arrays)).hexdigest()[:12]


def our_kernel(surfaces: Surfaces, projection: Projection, size_wh: tuple[int, int]) -> Contender:
    """The kernel's C call; its checks of small arrays and its outputs are made beforehand."""
    width, height = size_wh
    call = kernel._prepare(surfaces, projection, size_wh, 1.0, None)
    instance = kernel._on_cache_lines(height, width).view(np.int32)
    depth = kernel._on_cache_lines(height, width).view(np.float32)
    loaded, level = library(), ctypes.c_int32(kernel._level())

    def run() -> None:
        status = loaded.lw_render(
            ctypes.byref(call.surfaces),
            ctypes.byref(call.view),
            ctypes.c_int32(call.threads),
            level,
            ctypes.c_void_p(instance.ctypes.data),
            ctypes.c_void_p(depth.ctypes.data),
        )
        kernel._raise_for(status)

    return Contender(run=run, depth=depth, digest=lambda: _digest(instance, depth))


def floor(surfaces: Surfaces, size_wh: tuple[int, int]) -> Contender:
    """floor.cpp, compiled as the kernel is but free to contract and, on x86-64, to use AVX2."""
    source = Path(__file__).with_name("floor.cpp")
    output = Path(tempfile.mkdtemp()) / "floor.so"
    command = [*compilation.compiler(), "-std=c++17", "-O3", "-march=native", "-shared", "-fPIC"]
    subprocess.run([*command, str(source), "-o", str(output)], check=True)
    loaded = ctypes.CDLL(str(output))
    loaded.floor_pass.restype = ctypes.c_double
    width, height = size_wh
    instance, depth = np.zeros((height, width), np.int32), np.zeros((height, width), np.float32)
    arrays = (
        surfaces.vertices,
        surfaces.triangles,
        surfaces.vertex_start,
        surfaces.triangle_start,
        surfaces.placement_mesh,
        surfaces.cam_from_mesh,
    )

    def run() -> None:
        loaded.floor_pass(
            *(ctypes.c_void_p(a.ctypes.data) for a in arrays),
            ctypes.c_int64(len(surfaces.placement_mesh)),
            ctypes.c_int64(width * height),
            ctypes.c_void_p(instance.ctypes.data),
            ctypes.c_void_p(depth.ctypes.data),
        )

    return Contender(run=run, depth=depth, digest=lambda: _digest(depth))


def flat(surfaces: Surfaces) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Every placement as its own triangles in the camera's frame, as a ray tracer is given them."""
    points, faces, offset = [], [], 0
    for mesh, matrix in zip(surfaces.placement_mesh, surfaces.cam_from_mesh, strict=True):
        v = surfaces.vertices[surfaces.vertex_start[mesh] : surfaces.vertex_start[mesh + 1]]
        t = surfaces.triangles[surfaces.triangle_start[mesh] : surfaces.triangle_start[mesh + 1]]
        points.append((v @ matrix[:, :3].T + matrix[:, 3]).astype(np.float32))
        faces.append(t + np.int32(offset))
        offset += len(v)
    return np.concatenate(points), np.concatenate(faces)


def directions(projection: Projection, size_wh: tuple[int, int]) -> NDArray[np.float32]:
    """(H * W, 3) rays with z = 1, so that their length parameter is planar z."""
    width, height = size_wh
    x = (np.arange(width) + 0.5 - projection.cx) / projection.fx
    y = (np.arange(height) + 0.5 - projection.cy) / projection.fy
    grid = np.stack([*np.meshgrid(x, y), np.ones((height, width))], axis=-1)
    return grid.reshape(-1, 3).astype(np.float32)


def embree(surfaces: Surfaces, projection: Projection, size_wh: tuple[int, int]) -> Contender:
    """embreex: flatten, build, trace."""
    from embreex import rtcore_scene
    from embreex.mesh_construction import TriangleMesh

    rays = directions(projection, size_wh)
    origins = np.zeros_like(rays)
    depth = np.full(len(rays), np.inf, np.float32)

    def run() -> None:
        points, faces = flat(surfaces)
        scene = rtcore_scene.EmbreeScene()
        TriangleMesh(scene, points, faces)
        for begin in range(0, len(rays), 1 << 20):
            part = slice(begin, begin + (1 << 20))
            hit = scene.run(origins[part], rays[part], output=True)
            depth[part] = np.where(hit["primID"] >= 0, hit["tfar"], np.inf)

    width, height = size_wh
    return Contender(run=run, depth=depth.reshape(height, width), digest=lambda: _digest(depth))


def open3d(surfaces: Surfaces, projection: Projection, size_wh: tuple[int, int]) -> Contender:
    """Open3D's RaycastingScene: flatten, build, trace."""
    import open3d as o3d

    width, height = size_wh
    dirs = directions(projection, size_wh)
    rays = np.concatenate([np.zeros_like(dirs), dirs], axis=1)
    depth = np.full(len(rays), np.inf, np.float32)

    def run() -> None:
        points, faces = flat(surfaces)
        scene = o3d.t.geometry.RaycastingScene()
        scene.add_triangles(o3d.core.Tensor(points), o3d.core.Tensor(faces.astype(np.uint32)))
        depth[:] = scene.cast_rays(o3d.core.Tensor.from_numpy(rays))["t_hit"].numpy()

    return Contender(run=run, depth=depth.reshape(height, width), digest=lambda: _digest(depth))


def why_absent(module: str) -> str:
    """Why a competitor's package cannot be imported here; empty where it can."""
    try:
        importlib.import_module(module)
    except ImportError as error:
        return str(error)
    return ""
