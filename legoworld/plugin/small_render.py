"""A small fixed render of a saved copy, for what only light tells."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from legoworld.scene.artefacts import without_metadata
from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.open_scene import CardRender, card_request
from legoworld.scene.pictures import decoded_picture
from legoworld.scene.requests import StandRequest
from legoworld.scene.snapshot import SceneCamera

#: Cycles, few samples, no denoising: noise averages out over a region.
_LONGEST_PX: Final = 192
_SAMPLES: Final = 16


def render_luma(
    blend: Path, blender: BlenderProcess, photo_wh: tuple[int, int]
) -> NDArray[np.float64]:
    """(h, w) Rec. 709 luma of a .blend's camera view, in the photo's shape, at most 192 pixels.

    Raises what the worker reports: a scene without a camera, or one that does not render.
    """
    shrink = min(1.0, _LONGEST_PX / max(photo_wh))
    width, height = (max(1, round(side * shrink)) for side in photo_wh)
    png = render_copy(blend, blender, (width, height), samples=_SAMPLES)
    picture = decoded_picture(png, color=True)
    assert picture is not None  # our own PNG
    return rec709_luma(np.ascontiguousarray(picture[:, :, ::-1]))


def render_copy(
    blend: Path,
    blender: BlenderProcess,
    size_wh: tuple[int, int],
    *,
    samples: int,
    denoise: bool = False,
    camera: SceneCamera | None = None,
) -> bytes:
    """The PNG of a .blend's camera view at a size, without metadata: equal scenes, equal bytes.

    camera: one of the scene's by its name, at the pose and planes that it has here; None for the
    active one.
    """
    output = blender.workspace("legoworld-live-") / "render.png"
    output.unlink(missing_ok=True)
    stand: StandRequest | None = None
    if camera is not None:
        clip = (camera.clip_start, camera.clip_end)
        pose = camera.world_from_camera
        stand = {"world_from_camera": pose, "zoom": 1.0, "camera": camera.name, "clip": clip}
    card = CardRender(size_wh=size_wh, samples=samples, seed=0, denoise=denoise, stand=stand)
    blender.request(
        {
            "kind": "card_render",
            "blend": str(blend.resolve()),
            "output": str(output),
            "card": card_request(card),
        }
    )
    return without_metadata(output.read_bytes())


def rec709_luma(rgb: NDArray[np.uint8]) -> NDArray[np.float64]:
    """(H, W) Rec. 709 luma Y' of (H, W, 3) display-encoded RGB, 0 to 1."""
    return np.asarray(rgb @ np.array([0.2126, 0.7152, 0.0722])) / 255


def spread(small: NDArray[np.float64], size_wh: tuple[int, int]) -> NDArray[np.float64]:
    """A (h, w) picture at a larger (H, W): each pixel the nearest one of the small picture."""
    width, height = size_wh
    rows = (np.arange(height) * small.shape[0]) // height
    columns = (np.arange(width) * small.shape[1]) // width
    return np.asarray(small[rows[:, None], columns[None, :]])
