"""What the writers of views take, and the files they have in common."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from legoworld.errors import LegoWorldError, UsageError
from legoworld.readouts.pictures import Rgb, read_photo
from legoworld.scene.blender_process import Limits
from legoworld.scene.folder import PICTURE
from legoworld.scene.instances import Grouping, Instance
from legoworld.scene.snapshot import Snapshot
from legoworld.visibility.view import View


@dataclass(frozen=True, kw_only=True)
class ExportedView:
    """One view of a scene. Views of one scene come one after another.

    scene: its name; folder: where scene.blend lies, None where that is not known; snapshot: with
    the camera of the view; limits: of a Blender process that opens the scene again.
    """

    scene: str
    folder: Path | None
    snapshot: Snapshot
    grouping: Grouping
    view: View
    limits: Limits

    def labelled(self) -> list[Instance]:
        """The instances with a category, by id."""
        return [i for i in self.grouping.instances if i.category is not None]

    def intrinsics(self, form: str) -> NDArray[np.float64]:
        """(3, 3) K in pixels, the centre of the first pixel at (0.5, 0.5).

        UsageError for an orthographic camera or a distorting lens, which the format cannot hold.
        """
        camera = self.view.projection
        if self.view.lens is not None:
            raise UsageError(
                f"{form} cannot hold a distorting lens",
                found=f"camera {self.snapshot.camera.name!r} of scene {self.scene!r}",
                next_step="export the views of the same cameras without their lens",
            )
        if camera.orthographic:
            raise UsageError(
                f"{form} cannot hold an orthographic camera",
                found=f"camera {self.snapshot.camera.name!r} of scene {self.scene!r}",
                expected="a perspective camera",
            )
        return np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])

    def world_from_cam_m(self) -> NDArray[np.float64]:
        """(4, 4) pose of the camera, OpenCV axes, metres."""
        pose = np.array([*self.snapshot.camera.world_from_camera, (0, 0, 0, 1)], np.float64)
        pose[:3, 3] *= self.view.depth_scale
        return pose

    def rays(self, form: str) -> NDArray[np.float64]:
        """(H, W) length of each pixel's ray at z = 1."""
        width, height = self.view.size_wh
        k = self.intrinsics(form)
        x = (np.arange(width) + 0.5 - k[0, 2]) / k[0, 0]
        y = (np.arange(height) + 0.5 - k[1, 2]) / k[1, 1]
        return np.asarray(np.sqrt(1 + x[None] ** 2 + y[:, None] ** 2))

    def picture(self) -> Rgb | None:
        """The scene's own (H, W, 3) picture, where it has the view's size."""
        file = self.folder / PICTURE if self.folder else None
        if file is None or not file.is_file():
            return None
        picture = read_photo(file)
        return picture if picture.shape[1::-1] == self.view.size_wh else None


def write_image(path: Path, pixels: NDArray[Any]) -> None:
    """Write a PNG: (H, W) uint8 or uint16, or (H, W, 3 or 4) uint8, red first. LegoWorldError."""
    order = {3: [2, 1, 0], 4: [2, 1, 0, 3]}
    stored = pixels if pixels.ndim == 2 else pixels[..., order[pixels.shape[2]]]
    done, data = cv2.imencode(".png", np.ascontiguousarray(stored))
    if not done:
        raise LegoWorldError("an image could not be encoded", found=f"shape {pixels.shape}")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data.tobytes())
