"""Times the labels of many views of one scene beside Cycles, Embree, Open3D and trimesh.

    python benchmarks/labels/views.py [--scenes coffee,motorcycle,5k,100k,1m] [--views 1,10,100]
        [--rounds 3] [--cycles-python PYTHON] [--against embreex,open3d,trimesh,cycles]

CPU time of one thread at 640x480, the least of --rounds. A view is (N, H, W) masks, (N, 4) boxes
and (H, W) planar depth of the labelled instances; the kernel's calls are timed alone and with those
masks and boxes. The ray tracers build once, from flattened
triangles that are made beforehand, and then trace every pixel of each view; their masks and boxes
are made by NumPy. Cycles renders its object-index and depth passes with one sample and keeps them:
its masks and boxes would come on top. What is absent is named.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "benchmarks" / "kernel"))

import contenders  # noqa: E402
from bench_scenes import ball  # noqa: E402
from cycles_contender import Cycles  # noqa: E402

import legoworld  # noqa: E402
from legoworld.running.inspection import OpenScene  # noqa: E402
from legoworld.scene.folder import SceneFolder  # noqa: E402
from legoworld.scene.freeze import FrozenFiles  # noqa: E402
from legoworld.scene.read_scene import ReadScene  # noqa: E402
from legoworld.scene.snapshot import (  # noqa: E402
    RenderSettings,
    SceneCamera,
    SceneObject,
    Snapshot,
)
from legoworld.visibility import kernel  # noqa: E402
from legoworld.visibility.posed_camera import Camera  # noqa: E402
from legoworld.visibility.runs import instance_extents  # noqa: E402

SIZE = (640, 480)
TASK = "coco-masks"
Labels = tuple[NDArray[np.bool_], NDArray[np.int64], NDArray[np.float32]]
#: What gives the labels of one camera.
Contender = Callable[[Camera], Labels]
CAMERA = SceneCamera(
    name="Camera", type="PERSP", lens_mm=35.0, sensor_width_mm=36.0, sensor_height_mm=24.0,
    world_from_camera=((1, 0, 0, 0), (0, 0, 1, -6), (0, -1, 0, 1)), sensor_fit="AUTO",
    shift_x=0.0, shift_y=0.0, ortho_scale=6.0, clip_start=0.1, clip_end=1000.0,
)  # fmt: skip
RENDER = RenderSettings(
    resolution_x=640, resolution_y=480, resolution_percentage=100, pixel_aspect_x=1.0,
    pixel_aspect_y=1.0, use_border=False, frame=1, subframe=0.0, unit_system="METRIC",
    unit_scale=1.0, scene_name="balls", view_layer="",
)  # fmt: skip


def balls(n_triangles: int, n: int = 20) -> legoworld.Scene:
    """Labelled balls in a square, each a mesh of its own, of so many triangles in all."""
    side = int(np.sqrt(n_triangles / n / 2))
    vertices, triangles = ball(side, side, roughness=0.02)
    places = np.random.default_rng(0).uniform((-2, -2, 0), (2, 2, 1.5), (n, 3))
    world = np.zeros((n, 3, 4))
    world[:, :, :3], world[:, :, 3] = 0.5 * np.eye(3), places
    objects = tuple(
        SceneObject(
            name=f"Ball {i}", library=None, type="MESH", parent=-1, collections=(),
            instance_type="NONE", properties={"category": ("chair", "cup", "book")[i % 3]},
        )
        for i in range(n)
    )  # fmt: skip
    numbers = np.arange(n, dtype=np.int32)
    snapshot = Snapshot(
        objects=objects, collections=(), camera=CAMERA, render=RENDER, warnings=(),
        vertices=np.concatenate([vertices] * n), triangles=np.concatenate([triangles] * n),
        vertex_start=np.arange(n + 1, dtype=np.int64) * len(vertices),
        triangle_start=np.arange(n + 1, dtype=np.int64) * len(triangles),
        occurrence_object=numbers, occurrence_instancer=np.full(n, -1, np.int32),
        occurrence_frame=np.zeros(n, np.int32), surface_occurrence=numbers, surface_mesh=numbers,
        surface_holdout=np.zeros(n, np.uint8), world_from_mesh=world,
    )  # fmt: skip
    files = FrozenFiles(artefacts={}, dependencies={}, frozen="at_readout")
    read = ReadScene(snapshot=snapshot, snapshot_sha256="", files=files)
    folder = SceneFolder(path=Path(), name="balls", lone="balls.blend")
    return legoworld.Scene(OpenScene(folder=folder, scene=read, warnings=()))


def open_case(name: str) -> legoworld.Scene:
    """An example by its name, or balls of as many triangles as the name says."""
    counts = {"5k": 5_000, "100k": 100_000, "1m": 1_000_000}
    return balls(counts[name]) if name in counts else legoworld.open_scene(ROOT / "examples" / name)


def cameras_around(scene: legoworld.Scene, count: int) -> list[Camera]:
    """Cameras near the active one, which every view shows most of the scene from."""
    (own,) = scene.views([next(iter(scene.cameras))], size_wh=SIZE).cameras
    pose = np.array(own.world_from_cam, np.float64)
    depth = scene.view(size_wh=SIZE).depth_z_m
    reach = float(np.median(depth[np.isfinite(depth)])) / scene.view().render.unit_scale
    steps = np.random.default_rng(1).uniform(-0.1, 0.1, (count, 2)) * reach
    moved = np.repeat(pose[None], count, axis=0)
    moved[:, :, 3] += steps[:, :1] * pose[:, 0] + steps[:, 1:] * pose[:, 1]
    return list(
        scene.views(world_from_cam=moved, K=own.K, size_wh=SIZE, clip=own.clip, workers=1).cameras
    )


def flat_world(
    scene: legoworld.Scene,
) -> tuple[NDArray[np.float32], NDArray[np.int32], NDArray[np.int32]]:
    """Vertices in the world, triangles, and the instance of each triangle."""
    inspection = scene.view(task=TASK, size_wh=(4, 4))._inspection
    snapshot, grouping = scene._open_scene.scene.snapshot, inspection.grouping
    points, faces, owners, offset = [], [], [], 0
    for surface, mesh in enumerate(snapshot.surface_mesh.tolist()):
        v = snapshot.vertices[snapshot.vertex_start[mesh] : snapshot.vertex_start[mesh + 1]]
        t = snapshot.triangles[snapshot.triangle_start[mesh] : snapshot.triangle_start[mesh + 1]]
        matrix = snapshot.world_from_mesh[surface]
        points.append((v @ matrix[:, :3].T + matrix[:, 3]).astype(np.float32))
        faces.append(t + np.int32(offset))
        owners.append(np.full(len(t), grouping.surface_instance[surface], np.int32))
        offset += len(v)
    return np.concatenate(points), np.concatenate(faces), np.concatenate(owners)


def rays(camera: Camera) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Origin and directions (H * W, 3) in the world; a direction's length parameter is planar z."""
    width, height = camera.size_wh
    x = (np.arange(width, dtype=np.float32) + 0.5 - camera.cx) / camera.fx
    y = (np.arange(height, dtype=np.float32) + 0.5 - camera.cy) / camera.fy
    grid = np.stack([*np.meshgrid(x, y), np.ones((height, width))], axis=-1).reshape(-1, 3)
    pose = np.array(camera.world_from_cam)
    return pose[:, 3].astype(np.float32), (grid @ pose[:, :3].T).astype(np.float32)


def labels_of(
    instance: NDArray[np.int32], z: NDArray[np.float32], labelled: NDArray[np.int64]
) -> Labels:
    """Masks and boxes of an instance picture by NumPy alone."""
    seen = labelled[np.isin(labelled, instance)]
    masks = instance[None] == seen[:, None, None]
    boxes = np.empty((len(seen), 4), np.int64)
    for i, mask in enumerate(masks):
        rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
        boxes[i] = columns[0], rows[0], np.ptp(columns) + 1, np.ptp(rows) + 1
    return masks, boxes, z


def kernel_labels(
    instance: NDArray[np.int32], n_instances: int, labelled: Sequence[int]
) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """The masks and boxes of a kernel call's picture, without any of the API."""
    area, extents = instance_extents(instance, n_instances)
    seen = [i for i in labelled if area[i]]
    masks = np.zeros((len(seen), *instance.shape), bool)
    for mask, i in zip(masks, seen, strict=True):
        x0, y0, x1, y1 = extents[i].tolist()
        np.equal(instance[y0:y1, x0:x1], i, out=mask[y0:y1, x0:x1])
    return masks, extents[seen]


def tracer(name: str, scene: legoworld.Scene) -> Contender:
    """A ray tracer over the flattened scene, built."""
    points, faces, owner = flat_world(scene)
    owner = np.append(owner, np.int32(-1))  # of no triangle
    view = scene.view(task=TASK, size_wh=SIZE)
    labelled = np.array([i.id for i in view.instances if i.labelled], np.int64)
    shape = SIZE[1], SIZE[0]
    trace: Callable[[NDArray[np.float32], NDArray[np.float32]], tuple[NDArray, NDArray]]
    if name == "open3d":
        import open3d as o3d

        made = o3d.t.geometry.RaycastingScene(nthreads=1)
        made.add_triangles(o3d.core.Tensor(points), o3d.core.Tensor(faces.astype(np.uint32)))

        def trace(origin, directions):
            both = np.concatenate([np.broadcast_to(origin, directions.shape), directions], axis=1)
            hit = made.cast_rays(o3d.core.Tensor.from_numpy(both), nthreads=1)
            number = hit["primitive_ids"].numpy().astype(np.int64)
            z = hit["t_hit"].numpy()
            return np.where(np.isfinite(z), number, -1), z

    elif name == "embreex":
        from embreex import rtcore_scene
        from embreex.mesh_construction import TriangleMesh

        built = rtcore_scene.EmbreeScene()
        TriangleMesh(built, points, faces)

        def trace(origin, directions):
            origins = np.ascontiguousarray(np.broadcast_to(origin, directions.shape))
            hit = built.run(origins, directions, output=True)
            return hit["primID"], np.where(hit["primID"] >= 0, hit["tfar"], np.inf)

    else:
        import trimesh

        mesh = trimesh.Trimesh(points, faces, process=False)

        def trace(origin, directions):
            origins = np.broadcast_to(origin, directions.shape)
            place, ray, number = mesh.ray.intersects_location(
                origins, directions, multiple_hits=False
            )
            first = np.full(len(directions), -1)
            z = np.full(len(directions), np.inf)
            first[ray] = number
            along = directions[ray].astype(np.float64)
            z[ray] = ((place - origin) * along).sum(1) / (along * along).sum(1)
            return first, z

    def labels(camera: Camera) -> Labels:
        triangle, z = trace(*rays(camera))
        instance = owner[triangle].reshape(shape)
        return labels_of(instance, z.astype(np.float32).reshape(shape), labelled)

    labels(view._camera)  # the first question builds
    return labels


def per_view(make: Contender, cameras: Sequence[Camera], rounds: int) -> float:
    """CPU milliseconds of a view, the least of the rounds."""
    found = []
    for _ in range(rounds):
        begin = time.process_time()
        for camera in cameras:
            make(camera)
        found.append((time.process_time() - begin) / len(cameras) * 1e3)
    return min(found)


def run_case(name: str, counts: list[int], args: argparse.Namespace) -> None:
    """One row for each number of views, and one for each contender."""
    scene = open_case(name)
    cameras = cameras_around(scene, max(counts))

    def ours(some: Sequence[Camera]) -> None:
        for view in scene.views(some, task=TASK, workers=1):
            view.masks(), view.boxes_xywh_px(), view.depth_z_m

    triangles = scene._open_scene.scene.snapshot.n_triangles
    print(f"\n{name}: {triangles:,} triangles, {len(cameras)} cameras")
    ms = float("nan")
    for count in counts:
        some, times, bare, labelled = cameras[:count], [], [], []
        calls = [
            (view._inspection.view.surfaces, view.projection, len(view.instances))
            for view in scene.views(some[:50], task=TASK, workers=1)
        ]
        ids = [i.id for i in scene.view(task=TASK, size_wh=(4, 4)).instances if i.labelled]
        for _ in range(args.rounds):
            begin = time.process_time()
            ours(some)
            times.append((time.process_time() - begin) / count * 1e3)
            for label, found in ((False, bare), (True, labelled)):
                begin = time.process_time()
                for i in range(count):
                    surfaces, projection, n = calls[i % len(calls)]
                    buffers = kernel.render(surfaces, projection, SIZE, threads=1)
                    if label:
                        kernel_labels(buffers.instance, n, ids)
                found.append((time.process_time() - begin) / count * 1e3)
        ms = min(times)
        print(
            f"  {count:5} views: {ms:7.2f} ms a view, {1e3 / ms:6.0f} views a second of a core; "
            f"kernel calls alone {min(bare):6.2f} ms, {ms / min(bare):.2f}x; "
            f"with the same labels {min(labelled):6.2f} ms, {ms / min(labelled):.2f}x; "
            f"{resident_mb():,.0f} MB resident"
        )
    true_z_m = scene.views([cameras[0]], task=TASK)[0].depth_z_m
    for who in [n for n in args.against if n in ("embreex", "open3d", "trimesh")]:
        if why := contenders.why_absent(who):
            print(f"  {who}: absent ({why})")
            continue
        make = tracer(who, scene)
        theirs = make(cameras[0])
        alike = np.mean(
            np.isclose(theirs[2], true_z_m, rtol=1e-4) | (np.isinf(theirs[2]) & np.isinf(true_z_m))
        )
        took = per_view(make, cameras[: args.few], args.rounds)
        print(f"  {who:8} {took:9.2f} ms a view, {took / ms:7.1f}x ours; same depth at {alike:.2%}")
    if "cycles" in args.against:
        view = scene.view(task=TASK, size_wh=SIZE)
        surfaces = view._inspection.view.surfaces
        with Cycles(args.cycles_python, surfaces, SIZE) as cycles:
            cycles.render()
            took = min(cycles.render()[1] for _ in range(args.rounds)) * 1e3
        print(f"  cycles   {took:9.2f} ms a view, {took / ms:7.1f}x ours; passes alone")


def resident_mb() -> float:
    """Resident memory of this process."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS")) / 1000


def main() -> None:
    """Print everything; see the module's docstring."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])

    def names(text: str) -> list[str]:
        return text.split(",")

    parser.add_argument("--scenes", type=names, default=["coffee", "motorcycle", "5k", "100k"])
    parser.add_argument("--views", type=names, default=["1", "10", "100"])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--few", type=int, default=3, help="views of the contenders")
    parser.add_argument("--cycles-python", default=sys.executable)
    parser.add_argument("--against", type=names, default=["embreex", "open3d", "trimesh", "cycles"])
    args = parser.parse_args()
    for name in args.scenes:
        run_case(name, [int(n) for n in args.views], args)


main()
