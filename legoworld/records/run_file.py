"""run.json and summary.json of a run, and what its journal holds of an image."""

from __future__ import annotations

from typing import Any

from msgspec import field

from legoworld.records.base import UNSET, Record, UnsetType
from legoworld.records.cards import OptionValue
from legoworld.records.predictions import Number, Prediction
from legoworld.records.render_card import RenderCard
from legoworld.records.run_rows import RunRow
from legoworld.records.scene_folder import Protected


class WholeRun(Record, frozen=True, kw_only=True):
    """What the run that a shard is a part of has in place of the shard's own."""

    attempted: int
    partial: bool


class Shard(Record, frozen=True, kw_only=True):
    """Every n-th image, from the index-th on. of: n."""

    index: int
    of: int
    whole: WholeRun


class Imported(Record, frozen=True, kw_only=True):
    """What was imported, and what was declared of it: a results file, or a folder of arrays."""

    file: str | UnsetType = UNSET
    sha256: str | UnsetType = UNSET
    box_format: str | UnsetType | None = UNSET
    image_ids: str | UnsetType = UNSET
    category_ids: str | UnsetType = UNSET
    label_map_sha256: str | UnsetType = UNSET
    left_out: dict[str, int] | UnsetType = UNSET
    empty_masks_dropped: int | UnsetType = UNSET
    folder: str | UnsetType = UNSET
    space: str | UnsetType | None = UNSET
    unit: str | UnsetType | None = UNSET
    sign: str | UnsetType | None = UNSET
    array: str | UnsetType | None = UNSET
    suffix: str | UnsetType | None = UNSET
    cameras_sha256: str | UnsetType | None = UNSET


class UsedTruth(Record, frozen=True, kw_only=True):
    """Ground truth that a baseline was prompted with."""

    sha256: str
    what: str = ""


class BenchReading(Record, frozen=True, kw_only=True):
    """How submissions are read. card: of the render, null without one; noise: of two seeds."""

    card: RenderCard | None
    noise: bool


class Configuration(Record, frozen=True, kw_only=True):
    """What a run's results depend on besides scenes or photos; resuming needs all of it equal.

    A run of scenes has the fields of scenes, one of a baseline those of baselines.
    """

    task: str
    attempted: int
    schema_version: int | UnsetType = UNSET
    kind: str | UnsetType | None = UNSET
    card_version: str | UnsetType = UNSET
    card_sha256: str | UnsetType = UNSET
    vocabulary_sha256: str | UnsetType | None = UNSET
    track_sha256: str | UnsetType | None = UNSET
    images_sha256: str | UnsetType | None = UNSET
    partial: bool | UnsetType = UNSET
    legoworld: str | UnsetType = UNSET
    images_per_file: int | UnsetType | None = UNSET
    prediction_order: str | UnsetType | None = UNSET
    # Of scenes.
    shard: Shard | UnsetType | None = UNSET
    source: str | UnsetType | None = UNSET
    require_frozen: bool | UnsetType = UNSET
    max_side: int | UnsetType | None = UNSET
    variant: str | UnsetType = UNSET
    bpy: str | UnsetType | None = UNSET
    snapshot_schema: int | UnsetType = UNSET
    row_schema: int | UnsetType = UNSET
    bench: BenchReading | UnsetType = UNSET
    sky: str | UnsetType = UNSET
    # Of baselines.
    baseline: str | UnsetType | None = UNSET
    baseline_version: str | UnsetType = UNSET
    baseline_card_sha256: str | UnsetType = UNSET
    code_sha256: str | UnsetType = UNSET
    weights: str | UnsetType = UNSET
    device: str | UnsetType = UNSET
    dtype: str | UnsetType = UNSET
    batch_size: int | UnsetType = UNSET
    options: dict[str, OptionValue | None] | UnsetType = UNSET
    label_map_sha256: str | UnsetType = UNSET
    provenance: dict[str, Any] | str | UnsetType = UNSET
    used_truth: UsedTruth | UnsetType | None = UNSET
    # Of imports.
    imported: Imported | UnsetType = UNSET
    images_run_sha256: str | UnsetType | None = UNSET
    subset: bool | UnsetType = UNSET


class CameraOfScene(Record, frozen=True, kw_only=True):
    """The scene's camera. world_from_camera: (3, 4), from OpenCV axes; see SceneCamera."""

    name: str
    type: str
    world_from_camera: tuple[tuple[Number, ...], ...]
    lens_mm: Number
    sensor_width_mm: Number
    sensor_height_mm: Number
    sensor_fit: str
    shift_x: Number
    shift_y: Number
    ortho_scale: Number
    clip_start: Number
    clip_end: Number


class ProjectionOfView(Record, frozen=True, kw_only=True):
    """How the view was projected, in pixels; see Projection."""

    orthographic: bool
    fx: Number
    fy: Number
    cx: Number
    cy: Number
    z_near: Number
    z_far: Number


class RenderOfScene(Record, frozen=True, kw_only=True):
    """The scene's own render settings; see RenderSettings."""

    resolution_x: int
    resolution_y: int
    resolution_percentage: int
    pixel_aspect_x: Number
    pixel_aspect_y: Number
    use_border: bool
    frame: int
    subframe: Number
    unit_system: str
    unit_scale: Number
    scene_name: str
    view_layer: str


class ImportedFrom(Record, frozen=True, kw_only=True):
    """The file a result was taken from. matched_by: the rule by which its name is the photo's."""

    file: str
    sha256: str | UnsetType = UNSET
    matched_by: str | UnsetType = UNSET


class ReadArray(Record, frozen=True, kw_only=True):
    """What of an imported file was read. array: its name in an .npz or .exr."""

    array: str | None
    dtype: str
    shape: tuple[int, ...]


class ImageSource(Record, frozen=True, kw_only=True):
    """What an image's result was made from: a scene, a photo on a machine, or an imported file.

    files, dependencies: sha256 by name, null where there is none. provenance: of the scene, as its
    provenance.json has it. environment: of the machine, as the baseline's process says it.
    """

    scene: str | UnsetType = UNSET
    frozen: str | UnsetType = UNSET
    files: dict[str, str | None] | UnsetType = UNSET
    dependencies: dict[str, str | None] | UnsetType = UNSET
    snapshot_sha256: str | UnsetType = UNSET
    camera: CameraOfScene | UnsetType = UNSET
    projection: ProjectionOfView | UnsetType = UNSET
    render: RenderOfScene | UnsetType = UNSET
    provenance: dict[str, Any] | str | UnsetType = UNSET
    photo_sha256: str | UnsetType = UNSET
    environment: dict[str, Any] | UnsetType = UNSET
    source: ImportedFrom | UnsetType = UNSET
    read: ReadArray | UnsetType = UNSET


class BaselineAbout(Record, frozen=True, kw_only=True):
    """What run.json says of a baseline.

    variables: names that were passed to its process; sandbox: what its process was kept from.
    """

    name: str | UnsetType = UNSET
    title: str | UnsetType = UNSET
    licence: str | UnsetType = UNSET
    label_map: dict[str, str | None] | UnsetType = UNSET
    variables: tuple[str, ...] | UnsetType = UNSET
    sandbox: Protected | UnsetType = UNSET
    imported: Imported | UnsetType = UNSET


class RunHead(Record, frozen=True, kw_only=True):
    """As much of run.json as tells what is compared and resumed."""

    configuration: Configuration
    results_sha256: dict[str, str] | UnsetType = UNSET


class RunFile(RunHead, frozen=True, kw_only=True):
    """run.json. scenes: each image's source by its id; results_sha256: of the files beside it.

    finished_at is the only time in a run.
    """

    schema_version: int
    finished_at: str
    versions: dict[str, str]
    scenes: dict[str, ImageSource] = field(default_factory=dict)
    baseline: BaselineAbout | UnsetType = UNSET


class RunView(RunHead, frozen=True, kw_only=True):
    """view/run.json of an evaluation: run.json without its time, and the rows, ascending id."""

    versions: dict[str, str] | None = None
    scenes: dict[str, ImageSource | None] | None = None
    baseline: BaselineAbout | None = None
    images: tuple[RunRow, ...]


class RunCoverage(Record, frozen=True, kw_only=True):
    """Images by outcome. ok_empty: boxes or masks alone, images without any."""

    attempted: int
    ok: int
    by_status: dict[str, int]
    ok_empty: int | UnsetType = UNSET


class ValidityCounts(Record, frozen=True, kw_only=True):
    """How many submissions are valid, and how many fail each check."""

    valid: int
    failed: dict[str, int]


class RunSummary(Record, frozen=True, kw_only=True):
    """summary.json of a run: coverage, what was made, and labels that came to nothing."""

    schema_version: int
    task: str
    partial: bool
    coverage: RunCoverage
    warnings: int
    depth_bytes: int | UnsetType = UNSET
    predictions: int | UnsetType = UNSET
    # Of a baseline.
    counts: dict[str, int] | UnsetType = UNSET
    empty_masks_dropped: int | UnsetType = UNSET
    # Of scenes.
    unmatched_labels: dict[str, int] | UnsetType = UNSET
    unexported_instances: dict[str, int] | UnsetType = UNSET
    nested_instances: int | UnsetType = UNSET
    validity: ValidityCounts | UnsetType = UNSET


class ImageRecord(Record, frozen=True, kw_only=True):
    """What a run records of one image, and a line of its journal.

    scene: its entry in run.json, null where nothing was read. trace: of an error that no verdict
    foresees; it is said, and is in no file.
    """

    row: RunRow
    predictions: tuple[Prediction, ...] = ()
    scene: ImageSource | None = None
    trace: str | UnsetType = UNSET
