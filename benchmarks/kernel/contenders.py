"""Who is timed: the kernel, the floor, and two ray tracers. Each callable does the whole job.

Outputs, rays and results are allocated beforehand; a ray tracer's time is its build and its trace.
It may trace only some of the rows, spread evenly over the picture: the time that its trace took is
then scaled to all of them.
"""

from __future__ import annotations

import ctypes
import hashlib
import importlib
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from legoworld.visibility import compilation, kernel
from legoworld.visibility.kernel import Surfaces
from legoworld.visibility.library import library
from legoworld.visibility.projection import Projection


@dataclass
class Rest:
    """What the rows that were left out of the last run would have taken, by those that were not."""

    rows_left_out: float  # by rows traced
    wall_s: float = 0.0
    cpu_s: float = 0.0

    @contextmanager
    def tracing(self) -> Iterator[None]:
        """Around the trace, without the build."""
        wall, cpu = time.perf_counter(), time.process_time()
        yield
        self.wall_s = (time.perf_counter() - wall) * self.rows_left_out
        self.cpu_s = (time.process_time() - cpu) * self.rows_left_out


@dataclass(frozen=True, kw_only=True)
class Contender:
    """`run` does one whole render into `depth` ((H, W) float32, +inf = nothing).

    step: it has every step-th row of the picture; rest: the time that the others would take.
    """

    run: Callable[[], None]
    depth: NDArray[np.float32]
    digest: Callable[[], str]
    step: int = 1
    rest: Rest = field(default_factory=lambda: Rest(rows_left_out=0.0))


def _digest(*arrays: NDArray[Any]) -> str:
    return hashlib.sha256(b"".join(a.tobytes() for a in arrays)).hexdigest()[:12]


def our_kernel(surfaces: Surfaces, projection: Projection, size_wh: tuple[int, int]) -> Contender:
    """The kernel's C call; its checks of small arrays and its outputs are made beforehand."""
    width, height = size_wh
    call = kernel.prepare(surfaces, projection, size_wh, 1.0, None)
    instance = kernel.on_cache_lines(height, width).view(np.int32)
    depth = kernel.on_cache_lines(height, width).view(np.float32)
    loaded, level = library(), ctypes.c_int32(kernel.level())

    def run() -> None:
        status = loaded.lw_render(
            ctypes.byref(call.surfaces),
            ctypes.byref(call.view),
            ctypes.c_int32(call.threads),
            level,
            ctypes.c_void_p(instance.ctypes.data),
            ctypes.c_void_p(depth.ctypes.data),
            None,
        )
        kernel.raise_for(status)

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


def directions(projection: Projection, size_wh: tuple[int, int], step: int) -> NDArray[np.float32]:
    """(rows, W, 3) rays with z = 1, so that their length parameter is planar z."""
    width, height = size_wh
    x = (np.arange(width) + 0.5 - projection.cx) / projection.fx
    y = (np.arange(0, height, step) + 0.5 - projection.cy) / projection.fy
    grid = np.stack([*np.meshgrid(x, y), np.ones((len(y), width))], axis=-1)
    return grid.astype(np.float32)


def step_of(size_wh: tuple[int, int], most_rows: int | None) -> int:
    """Every which row is traced, so that there are not more than that many."""
    return 1 if most_rows is None else -(-size_wh[1] // most_rows)


def embree(
    surfaces: Surfaces, projection: Projection, size_wh: tuple[int, int], most_rows: int | None
) -> Contender:
    """embreex: flatten, build, trace."""
    from embreex import rtcore_scene
    from embreex.mesh_construction import TriangleMesh

    step = step_of(size_wh, most_rows)
    grid = directions(projection, size_wh, step)
    rays = grid.reshape(-1, 3)
    origins = np.zeros_like(rays)
    depth = np.full(len(rays), np.inf, np.float32)
    rest = Rest(rows_left_out=size_wh[1] / len(grid) - 1)

    def run() -> None:
        points, faces = flat(surfaces)
        scene = rtcore_scene.EmbreeScene()
        TriangleMesh(scene, points, faces)
        scene.run(origins[:1], rays[:1], output=True)  # the first question builds
        with rest.tracing():
            for begin in range(0, len(rays), 1 << 20):
                part = slice(begin, begin + (1 << 20))
                hit = scene.run(origins[part], rays[part], output=True)
                depth[part] = np.where(hit["primID"] >= 0, hit["tfar"], np.inf)

    seen = depth.reshape(grid.shape[:2])
    return Contender(run=run, depth=seen, digest=lambda: _digest(depth), step=step, rest=rest)


def open3d(
    surfaces: Surfaces, projection: Projection, size_wh: tuple[int, int], most_rows: int | None
) -> Contender:
    """Open3D's RaycastingScene: flatten, build, trace."""
    import open3d as o3d

    step = step_of(size_wh, most_rows)
    grid = directions(projection, size_wh, step)
    dirs = grid.reshape(-1, 3)
    rays = np.concatenate([np.zeros_like(dirs), dirs], axis=1)
    depth = np.full(len(rays), np.inf, np.float32)
    rest = Rest(rows_left_out=size_wh[1] / len(grid) - 1)

    def run() -> None:
        points, faces = flat(surfaces)
        scene = o3d.t.geometry.RaycastingScene()
        scene.add_triangles(o3d.core.Tensor(points), o3d.core.Tensor(faces.astype(np.uint32)))
        scene.cast_rays(o3d.core.Tensor.from_numpy(rays[:1]))  # the first question builds
        with rest.tracing():
            depth[:] = scene.cast_rays(o3d.core.Tensor.from_numpy(rays))["t_hit"].numpy()

    seen = depth.reshape(grid.shape[:2])
    return Contender(run=run, depth=seen, digest=lambda: _digest(depth), step=step, rest=rest)


def why_absent(module: str) -> str:
    """Why a competitor's package cannot be imported here; empty where it can."""
    try:
        importlib.import_module(module)
    except ImportError as error:
        return str(error)
    return ""
