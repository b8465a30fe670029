"""The amodal readout beside single draws of instances: the same masks, and what both cost.

    python benchmarks/kernel/amodal.py [SCENES ...] [--rounds 11] [--crowd 10000]

SCENES are scene folders, by default the shipped examples. Each instance is drawn alone, and its
mask and depth are held to the layers bit for bit: V within A, D = D_i on V, and the hidden pixels
to the sum over occluders. Medians of CPU time, one thread, in units of one draw. --crowd: also a
made-up picture of so many plates, 1920 x 1080, with the peak of memory (0: none).
"""

from __future__ import annotations

import argparse
import dataclasses
import resource
from collections.abc import Callable
from pathlib import Path

import numpy as np
from hits_and_layers import EXAMPLES, _only, measured
from pycocotools import mask as coco_mask

import legoworld
from legoworld.visibility.kernel import Surfaces, render
from legoworld.visibility.projection import Projection
from legoworld.visibility.runs import ColumnRuns, instance_extents
from legoworld.visibility.view import View


def main() -> int:
    """Check and time every scene; see the module's docstring."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*", type=Path)
    parser.add_argument("--rounds", type=int, default=11)
    parser.add_argument("--crowd", type=int, default=10_000)
    args = parser.parse_args()
    for folder in args.scenes or sorted(p.parent for p in EXAMPLES.glob("*/scene.blend")):
        try:
            view: View = legoworld.open_scene(folder, allow_changed=True).view()._inspection.view
        except legoworld.LegoWorldError as error:
            print(f"{folder.name}: {error}")
            continue
        check(view)
        show(folder.name, view, args.rounds, singles=True)
    if args.crowd:
        view = crowd(args.crowd, legoworld.open_scene(EXAMPLES / "coffee").view())
        show(f"crowd of {args.crowd}", view, min(args.rounds, 3), singles=False)
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(f"    peak of memory {peak:.0f} MiB")
    return 0


def readout(view: View) -> None:
    """Everything that a result of the readout is made of."""
    amodal = view.amodal(threads=1)
    ids = np.flatnonzero(amodal.in_frame_px).tolist()
    amodal.masks.counts(0)
    ColumnRuns(view.buffers.instance, len(view.area_px))
    amodal.silhouettes(ids, threads=1)
    amodal.occluders.by_hidden()
    amodal.direct_occluders.by_hidden()
    assert len(amodal.order.layer) == len(view.area_px)


def check(view: View) -> None:
    """SystemExit where the layers are not what single draws are."""
    amodal, buffers = view.amodal(), view.buffers
    hidden = {i: sum(pixels.values()) for i, pixels in amodal.occluders.by_hidden().items()}
    for i in np.flatnonzero(amodal.in_frame_px).tolist():
        alone = render(_only(view.surfaces, i), view.projection, view.size_wh,
                       depth_scale=view.depth_scale)  # fmt: skip
        mask, visible = alone.instance >= 0, buffers.instance == i
        text = coco_mask.encode(np.asfortranarray(mask, np.uint8))["counts"].decode()
        holds = (
            amodal.masks.counts(i) == text
            and not (visible & ~mask).any()
            and alone.depth_z_m[visible].tobytes() == buffers.depth_z_m[visible].tobytes()
            and hidden.get(i, 0) == mask.sum() - visible.sum()
        )
        if not holds:
            raise SystemExit(f"instance {i} is not what is drawn of it alone")


def show(name: str, view: View, rounds: int, *, singles: bool) -> None:
    """Print the rows of one view."""
    amodal = view.amodal(threads=1)
    given = view.projection, view.size_wh
    alone = [_only(view.surfaces, i) for i in np.flatnonzero(amodal.in_frame_px)]

    def drawn_alone() -> None:
        for one in alone:
            shown = render(one, *given, threads=1).instance >= 0
            coco_mask.encode(np.asfortranarray(shown, np.uint8))

    rows: dict[str, Callable[[], object]] = {
        "draw": lambda: render(view.surfaces, *given, threads=1),
        "layers": lambda: view.amodal(threads=1),
        "masks": lambda: ColumnRuns(amodal.layers, len(view.area_px)),
        "wholes": lambda: amodal.silhouettes(range(len(view.area_px)), threads=1),
        "readout": lambda: readout(view),
    }
    if singles:
        rows["alone"] = drawn_alone
    cpu = {row: float(np.median(times)) for row, times in measured(rows, rounds).items()}
    print(f"{name}: {view.size_wh[0]} x {view.size_wh[1]}, {len(alone)} instances, "
          f"{len(amodal.layers.instance)} amodal pixels")  # fmt: skip
    for row, seconds in cpu.items():
        print(f"    {row:8} {seconds * 1e3:9.2f} ms CPU {seconds / cpu['draw']:8.2f} draws")


def crowd(count: int, any_view: legoworld.SceneView) -> View:
    """Plates of 20 to 200 pixels all over a picture and across its edges."""
    random, size_wh = np.random.default_rng(0), (1920, 1080)
    camera = Projection(
        orthographic=False, fx=1000, fy=1000, cx=960, cy=540, z_near=0.1, z_far=1000
    )
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
    matrices = np.zeros((count, 3, 4))
    z = random.uniform(2, 20, count)
    half = random.uniform(10, 100, count) * z / camera.fx
    matrices[:, 0, 0], matrices[:, 1, 1], matrices[:, 2, 2] = half, half, 1
    centre = random.uniform((-100, -100), (2020, 1180), (count, 2))
    matrices[:, :2, 3] = (centre - (camera.cx, camera.cy)) * (z / camera.fx)[:, None]
    matrices[:, 2, 3] = z
    surfaces = Surfaces(
        vertices=corners, triangles=np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        vertex_start=np.array([0, 4]), triangle_start=np.array([0, 2]),
        placement_mesh=np.zeros(count, np.int32), cam_from_mesh=matrices,
        placement_id=np.arange(count, dtype=np.int32), cutouts=None,
    )  # fmt: skip
    buffers = render(surfaces, camera, size_wh)
    area, extents = instance_extents(buffers.instance, count)
    return dataclasses.replace(
        any_view._inspection.view, size_wh=size_wh, projection=camera, surfaces=surfaces,
        depth_scale=1.0, buffers=buffers, area_px=area, bbox_xyxy_px=extents,
    )  # fmt: skip


if __name__ == "__main__":
    raise SystemExit(main())
