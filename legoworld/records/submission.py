"""The rows of a bench run: what a submission is, before anything private is looked at.

RUN/surface/<stem>.npz holds, all at the scoring raster's size (H, W):
`depth_z_m` float32, planar depth with the submission's pose and the reference's field of view,
`own_depth_z_m` the same with the submission's own intrinsics (absent where those are equal), each
+inf where nothing is hit, with `intrinsics_px` and `own_intrinsics_px` (fx, fy, cx, cy, raster
pixels); `plane` int16, the index in `Integrity.planes` of the camera-facing plane that a pixel
shows, -1 elsewhere; and `textures` (N, 36, 64, 3) uint8, the image textures scaled down.
"""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from legoworld.records.base import UNSET, Record, UnsetType
from legoworld.records.joints import Pose, SceneJoint

Size = tuple[int, int]


class Check(Record, frozen=True, kw_only=True):
    """One validity check. found, expected and next_step are in words; null where it passed."""

    ok: bool
    found: str | None = None
    expected: str | None = None
    next_step: str | None = None


class Validity(Record, frozen=True, kw_only=True):
    """V's checks, from the artefacts alone: what made them, and how that ended, does not enter.

    geometry: at least one renderable mesh; camera: an active one.
    """

    scene_blend: Check
    geometry: Check
    camera: Check
    scene_glb: Check
    final_png: Check

    @property
    def valid(self) -> bool:
        """V."""
        return all(getattr(self, name).ok for name in self.__struct_fields__)


class SubmittedCamera(Record, frozen=True, kw_only=True):
    """The submission's active camera, at the image's size. hfov_deg: null for an orthographic one.

    fx, fy, cx, cy: pixels (orthographic: pixels a metre, of which only the pose is used).
    """

    type: Literal["PERSP", "ORTHO"]
    hfov_deg: float | None
    fx: float
    fy: float
    cx: float
    cy: float
    clip_start_m: float
    clip_end_m: float
    world_from_cam: Pose


class WrittenFile(Record, frozen=True, kw_only=True):
    """A file of the run folder."""

    file: str
    sha256: str
    bytes: int


class SurfaceFile(WrittenFile, frozen=True, kw_only=True):
    """The visible surface. finite_px: raster pixels that show geometry."""

    raster_wh: Size
    finite_px: int


class RenderNoise(Record, frozen=True, kw_only=True):
    """How far two seeds of one render differ, which bounds what noise can do to A.

    share_over_delta: of pixels whose largest channel difference is above the card's delta.
    """

    seeds: tuple[int, int]
    share_over_delta: float
    mean_largest_difference: float


class RenderFile(WrittenFile, frozen=True, kw_only=True):
    """The evaluator's own render. noise: null where it was not asked for."""

    size_wh: Size
    card_sha256: str
    noise: RenderNoise | None


class ProbedFile(WrittenFile, frozen=True, kw_only=True):
    """What a private probe sees of a submission, `records.second_card` says what the file holds.

    render: of the second view, null without one; surface_differs: share of the raster where the
    first sample of Cycles' own render meets another surface than the kernel, null where nothing
    was rendered; unreadable_alpha: materials whose alpha the kernel took as opaque.
    """

    render: RenderFile | None
    surface_differs: float | None
    unreadable_alpha: int


class ImageTexture(Record, frozen=True, kw_only=True):
    """An image that the scene holds.

    path: as the .blend has it; its last part alone where it leads out of the scene folder;
    thumbnail: its index in the surface file's `textures`, null where its pixels cannot be read;
    users: what shows it.
    """

    name: str
    path: str
    size_wh: Size
    packed: bool
    generated: bool
    absolute_path: bool
    thumbnail: int | None
    users: tuple[Literal["material", "world", "compositor", "camera", "other"], ...]


class TextBlock(Record, frozen=True, kw_only=True):
    """A text inside the .blend. Scripts in it never run."""

    name: str
    characters: int
    registers: bool


class CameraPlane(Record, frozen=True, kw_only=True):
    """A flat mesh turned to the camera. tilt_deg: between its normal and the viewing ray.

    share: of the scoring raster's pixels that show it; images: names of the textures it shows.
    """

    object: str
    tilt_deg: float
    share: Annotated[float, Meta(ge=0, le=1)]
    images: tuple[str, ...]


class Joint(Record, frozen=True, kw_only=True):
    """A `joint` property of an object, as text. parent: the object it hangs from, null for none."""

    object: str
    parent: str | None
    text: str


class Integrity(Record, frozen=True, kw_only=True):
    """What the opened scene holds that may be a picture instead of geometry; facts, no verdict."""

    images: tuple[ImageTexture, ...]
    world_nodes: tuple[str, ...]
    compositor_nodes: tuple[str, ...]
    texts: tuple[TextBlock, ...]
    drivers: int
    planes: tuple[CameraPlane, ...]
    joints: tuple[Joint, ...]


class BenchRow(Record, frozen=True, kw_only=True):
    """One line of per_image.jsonl of a bench run.

    status: ok where surface and render (unless --no-render) were made, whatever V says; otherwise
    why not, with code and reason. A row that is not ok still says what of V was found.
    surface, render, camera and integrity are left out where they could not be made, joints where
    the scene has none, probe where none was asked for.
    """

    image_id: int
    file_name: str
    scene: str
    size_wh: Size | None
    status: str
    code: str
    reason: str | None
    warnings: tuple[str, ...]
    valid: bool | UnsetType = UNSET
    validity: Validity | UnsetType = UNSET
    camera: SubmittedCamera | UnsetType = UNSET
    surface: SurfaceFile | UnsetType = UNSET
    render: RenderFile | UnsetType = UNSET
    integrity: Integrity | UnsetType = UNSET
    joints: tuple[SceneJoint, ...] | UnsetType = UNSET
    probe: ProbedFile | UnsetType = UNSET
    files_sha256: str | UnsetType = UNSET
    snapshot_sha256: str | UnsetType = UNSET
    frozen: str | UnsetType = UNSET
