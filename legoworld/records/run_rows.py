"""per_image.jsonl of a run: one row for each image, of a scene or of a baseline's photo."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from legoworld.records.base import UNSET, Record, UnsetType
from legoworld.records.evaluation import ImageRow
from legoworld.records.joints import SceneJoint
from legoworld.records.submission import (
    Integrity,
    ProbedFile,
    RenderFile,
    SubmittedCamera,
    SurfaceFile,
    Validity,
    WrittenFile,
)

Size = tuple[int, int]


class RunImage(ImageRow, frozen=True, kw_only=True):
    """What a score needs of a row: one attempted image. status: ok, or why there is no result.

    size_wh: of the photo, null where neither a track nor a scene says it.
    """

    size_wh: Size | None = None


class DepthFile(Record, frozen=True, kw_only=True):
    """An image's array of depth. file: from the run folder."""

    file: str
    space: str | UnsetType = UNSET
    unit: str | UnsetType | None = UNSET
    bytes: int = 0
    sha256: str | UnsetType = UNSET
    finite_px: int = 0


class NormalsFile(WrittenFile, frozen=True, kw_only=True):
    """An image's array of normals. flipped_share: of the triangles shown from their back."""

    sign: str | UnsetType = UNSET
    finite_px: int = 0
    flipped_share: float | UnsetType | None = UNSET


class InstanceCounts(Record, frozen=True, kw_only=True):
    """How many instances a scene has."""

    total: int
    labelled: int
    visible_labelled: int
    visible_unlabelled: int


class Exported(Record, frozen=True, kw_only=True):
    """What a prediction is of: the label's owner, and the objects whose surfaces it has."""

    name: str | UnsetType = UNSET
    category: str | UnsetType = UNSET
    objects: tuple[str, ...] | UnsetType = UNSET


class Unlabelled(Record, frozen=True, kw_only=True):
    """A visible instance without a category."""

    name: str
    area_px: int


class Unmatched(Record, frozen=True, kw_only=True):
    """A label outside the vocabulary, and the names nearest to it."""

    label: str
    count: int
    nearest: tuple[str, ...] = ()


class Unexported(Record, frozen=True, kw_only=True):
    """A labelled instance without a pixel, and why it has none."""

    name: str
    category: str
    reason: str


class Nested(Record, frozen=True, kw_only=True):
    """Instances that are cut out of the one around them, and their pixels."""

    instances: int
    px: int


class Segment(Record, frozen=True, kw_only=True):
    """One segment of a panoptic answer, as panopticapi names its parts. bbox: x, y, w, h."""

    id: Annotated[int, Meta(ge=1, lt=1 << 24)]
    category_id: int
    area: int
    bbox: tuple[int, int, int, int]
    iscrowd: Literal[0, 1] = 0


class RunRow(RunImage, frozen=True, kw_only=True):
    """One row. It has the fields of what was read: a scene or a photo, depth or predictions.

    scene: the image's folder in SCENES; reason: null where status is ok; answer: the file of a
    family that has one of its own for each image; segments: of its PNG.
    """

    scene: str = ""
    code: str = ""
    reason: str | None = None
    warnings: tuple[str, ...] = ()
    rendered_wh: Size | UnsetType = UNSET
    depth: DepthFile | UnsetType = UNSET
    normals: NormalsFile | UnsetType = UNSET
    answer: WrittenFile | UnsetType = UNSET
    segments: tuple[Segment, ...] | UnsetType = UNSET
    n_predictions: int | UnsetType = UNSET
    predictions_sha256: str | UnsetType = UNSET
    # Of a baseline's answer.
    empty_masks_dropped: int | UnsetType = UNSET
    counts: dict[str, int] | UnsetType = UNSET
    # Of a scene.
    scene_size_wh: Size | UnsetType = UNSET
    aspect_differs: bool | UnsetType = UNSET
    frozen: str | UnsetType = UNSET
    files_sha256: str | UnsetType = UNSET
    snapshot_sha256: str | UnsetType = UNSET
    geometry_px: int | UnsetType = UNSET
    # Of a scene's boxes or masks.
    exported: tuple[Exported, ...] | UnsetType = UNSET
    instances: InstanceCounts | UnsetType = UNSET
    unlabelled: tuple[Unlabelled, ...] | UnsetType = UNSET
    unlabelled_px: int | UnsetType = UNSET
    nested: Nested | UnsetType = UNSET
    matched: dict[str, str] | UnsetType = UNSET
    unmatched: tuple[Unmatched, ...] | UnsetType = UNSET
    unexported: tuple[Unexported, ...] | UnsetType = UNSET
    # Of a submission to the bench; see BenchRow.
    valid: bool | UnsetType = UNSET
    validity: Validity | UnsetType = UNSET
    camera: SubmittedCamera | UnsetType = UNSET
    surface: SurfaceFile | UnsetType = UNSET
    render: RenderFile | UnsetType = UNSET
    integrity: Integrity | UnsetType = UNSET
    joints: tuple[SceneJoint, ...] | UnsetType = UNSET
    probe: ProbedFile | UnsetType = UNSET

    @property
    def files(self) -> list[DepthFile | WrittenFile]:
        """The files of its own that the row has, besides predictions."""
        seen = self.probe.render if self.probe else None
        files = (self.depth, self.normals, self.answer, self.surface, self.render, self.probe, seen)
        return [file for file in files if file]
