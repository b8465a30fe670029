"""A looping picture of a scene to show others: photo, render, and its surfaces from around."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from legoworld.errors import UsageError
from legoworld.files import atomic_path
from legoworld.readouts import pictures

if TYPE_CHECKING:
    from legoworld.api.scene_view import SceneView
    from legoworld.api.scenes import Scene

_LONGEST_PX: Final = 640
_FRAME_MS: Final = 80
#: Frames that a still is shown for, and that one still fades into the next.
_HELD: Final = 12
_FADING: Final = 8
#: Of one swing around the middle of what is seen, and how far it goes to each side.
_SWING: Final = 48
_SWING_DEG: Final = 25.0
_QUALITY: Final = 75
#: What is lit least, and what is behind the surfaces.
_DARKEST: Final = 0.35
_GROUND: Final = 24
Picture = NDArray[np.uint8]


def write_animation(scene: Scene, file: Path, photo: Path | None, render: Path | None) -> None:
    """Write a looping WebP: stills that fade into each other, then a swing of the camera.

    The stills are the photo and the render, where they are there, and the surfaces in the colours
    of their instances, lit from the camera. The same scene and pictures give the same bytes.
    UsageError where the camera sees no surface, or for a photo that is no picture.
    """
    stills = [pictures.read_photo(path) for path in (photo, render) if path is not None]
    width, height = stills[0].shape[1::-1] if stills else scene.size_wh
    scale = min(1.0, _LONGEST_PX / max(width, height))
    size_wh = max(1, round(width * scale)), max(1, round(height * scale))
    view = scene.view(size_wh=size_wh)
    turned = [_lit(one) for one in scene.views(world_from_cam=_swing(view), size_wh=size_wh)]
    shown = [*(_fit(still, size_wh) for still in stills), turned[0]]
    frames = [Image.fromarray(one) for one in _frames(shown, turned)]
    data = io.BytesIO()
    frames[0].save(
        data, "WEBP", save_all=True, append_images=frames[1:], duration=_FRAME_MS, loop=0,
        quality=_QUALITY, method=4,
    )  # fmt: skip
    with atomic_path(file) as unfinished:
        unfinished.write_bytes(data.getvalue())


def _fit(still: Picture, size_wh: tuple[int, int]) -> Picture:
    """The whole picture at this size, with bars where its shape is another."""
    (width, height), (h, w) = size_wh, still.shape[:2]
    scale = min(width / w, height / h)
    fitted = min(width, max(1, round(w * scale))), min(height, max(1, round(h * scale)))
    left, top = (width - fitted[0]) // 2, (height - fitted[1]) // 2
    made: Picture = np.full((height, width, 3), _GROUND, np.uint8)
    resized = cv2.resize(still, fitted, interpolation=cv2.INTER_AREA)
    made[top : top + fitted[1], left : left + fitted[0]] = resized
    return made


def _frames(stills: Sequence[Picture], turned: Sequence[Picture]) -> Iterator[Picture]:
    """Each still held and faded into the next, the swing, and back to the first still."""
    for one, following in pairwise(stills):
        yield from [one] * _HELD
        yield from _fade(one, following)
    yield from turned
    if len(stills) > 1:
        yield from _fade(stills[-1], stills[0])


def _fade(one: Picture, other: Picture) -> Iterator[Picture]:
    for step in range(1, _FADING):
        share = step / _FADING
        yield cv2.addWeighted(one, 1.0 - share, other, share, 0.0).astype(np.uint8)


def _swing(view: SceneView) -> NDArray[np.float64]:
    """(_SWING, 4, 4) world_from_cam: the camera turned about the world's z axis.

    The axis goes through the point on the optical axis at the median depth of what is seen.
    """
    depth = view.depth_z_m[view.instance >= 0]
    if depth.size == 0:
        raise UsageError(
            "there is nothing to show",
            found="a camera that sees no surface",
            next_step="`legoworld inspect` says why each instance is not visible",
        )
    pose = view.world_from_cam
    middle = (pose @ [0.0, 0.0, float(np.median(depth)), 1.0])[:3]
    angles = np.deg2rad(_SWING_DEG) * np.sin(2 * np.pi * np.arange(_SWING) / _SWING)
    turns = np.tile(np.eye(4), (_SWING, 1, 1))
    turns[:, 0, 0] = turns[:, 1, 1] = np.cos(angles)
    turns[:, 1, 0], turns[:, 0, 1] = np.sin(angles), -np.sin(angles)
    turns[:, :3, 3] = middle - turns[:, :3, :3] @ middle
    poses: NDArray[np.float64] = turns @ pose
    return poses


def _lit(view: SceneView) -> Picture:
    """The surfaces in the colours of their instances, brightest where they face the camera."""
    facing = np.nan_to_num(-view.normals()[:, :, 2], nan=0.0)
    light = _DARKEST + (1.0 - _DARKEST) * np.clip(facing, 0.0, 1.0)
    # Twice: the picture is drawn at half brightness.
    coloured = pictures.instance_picture(view.instance) * (2.0 * light[:, :, None])
    seen = (view.instance >= 0)[:, :, None]
    picture: Picture = np.where(seen, coloured.round(), _GROUND).astype(np.uint8)
    return picture
