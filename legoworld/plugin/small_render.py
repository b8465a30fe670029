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
#: Linear sRGB to XYZ, and XYZ of D65.
_XYZ_OF_RGB: Final = np.array(
    [[0.412453, 0.35758, 0.180423], [0.212671, 0.71516, 0.072169], [0.019334, 0.119193, 0.950227]]
)
_WHITE_XYZ: Final = np.array([0.95047, 1.0, 1.08883])


def render_small(
    blend: Path, blender: BlenderProcess, photo_wh: tuple[int, int]
) -> NDArray[np.uint8]:
    """(h, w, 3) display-encoded RGB of a .blend's camera view, in the photo's shape, h, w <= 192.

    Raises what the worker reports: a scene without a camera, or one that does not render.
    """
    shrink = min(1.0, _LONGEST_PX / max(photo_wh))
    width, height = (max(1, round(side * shrink)) for side in photo_wh)
    png = render_copy(blend, blender, (width, height), samples=_SAMPLES)
    picture = decoded_picture(png, color=True)
    assert picture is not None  # our own PNG
    return np.ascontiguousarray(picture[:, :, ::-1])


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


def mean_lab(rgb: NDArray[np.uint8]) -> NDArray[np.float64]:
    """(3,) mean CIE 1976 L*a*b* (CIE 15, D65) of (n, 3) sRGB (IEC 61966-2-1), n > 0.

    OpenCV's own conversion interpolates a table: a pixel's is off by up to .4.
    """
    unit = rgb / 255
    linear = np.where(unit <= 0.04045, unit / 12.92, ((unit + 0.055) / 1.055) ** 2.4)
    xyz = linear @ _XYZ_OF_RGB.T / _WHITE_XYZ
    x, y, z = np.where(xyz > 216 / 24389, np.cbrt(xyz), (24389 / 27 * xyz + 16) / 116).T
    return np.array([(116 * y - 16).mean(), 500 * (x - y).mean(), 200 * (y - z).mean()])


def upscale_nearest(small: NDArray[np.uint8], size_wh: tuple[int, int]) -> NDArray[np.uint8]:
    """A (h, w, 3) picture at a larger (H, W): each pixel the nearest one of the small picture."""
    width, height = size_wh
    rows = (np.arange(height) * small.shape[0]) // height
    columns = (np.arange(width) * small.shape[1]) // width
    return np.asarray(small[rows[:, None], columns[None, :]])
