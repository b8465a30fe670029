"""A view of a scene as a Rerun recording: python to_rerun.py SCENE RECORDING.rrd."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import rerun as rr

import legoworld


def to_rerun(view: legoworld.SceneView, path: Path) -> None:
    """Log camera, overlay, depth in metres and instances (id + 1; 0 where there is none)."""
    recording = rr.RecordingStream("legoworld")
    recording.save(path)
    lens = view.projection
    labels = [(i.id + 1, i.category or i.name) for i in view.instances]
    recording.log("/", rr.AnnotationContext([(0, "none"), *labels]), static=True)
    intrinsics = [[lens.fx, 0.0, lens.cx], [0.0, lens.fy, lens.cy], [0.0, 0.0, 1.0]]
    recording.log(
        "camera",
        rr.Pinhole(image_from_camera=intrinsics, resolution=list(view.size_wh)),
        static=True,
    )
    recording.log("camera/overlay", rr.Image(view.overlay()))
    depth = np.where(np.isfinite(view.depth_z_m), view.depth_z_m, 0.0)  # 0: nothing is hit
    recording.log("camera/depth", rr.DepthImage(depth.astype(np.float32), meter=1.0))
    instance = np.maximum(view.instance, -1) + 1
    recording.log("camera/instances", rr.SegmentationImage(instance.astype(np.uint16)))
    recording.flush()


if __name__ == "__main__":
    to_rerun(legoworld.open_scene(sys.argv[1]).view(task="coco"), Path(sys.argv[2]))
