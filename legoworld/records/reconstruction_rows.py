"""per_image.jsonl of a bench evaluation: one submission held to one reference."""

from __future__ import annotations

from typing import Final, Literal

from legoworld.records.articulation import Articulation
from legoworld.records.base import UNSET, Record, UnsetType
from legoworld.records.bench_dataset import Tier
from legoworld.records.evaluation_rows import EvaluationRow, Outcome
from legoworld.records.submission import Check

#: Statuses of submissions that were compared; of every other one V, R, A and S are 0.
COMPARED: Final = "ok"
#: What could not be evaluated although the readout had made everything, after one retry.
EVALUATOR_ERROR: Final = "evaluator_error"
FlagKind = Literal[
    "picture_in_scene",
    "picture_in_world",
    "compositor_nodes",
    "camera_facing_planes",
    "text_blocks",
    "drivers",
    "appearance_without_geometry",
    "view_drop",
]


class PrecisionRecall(Record, frozen=True, kw_only=True):
    """Shares of points within tau: precision of submitted ones, recall of reference ones."""

    f1: float
    precision: float
    recall: float


class ObjectRow(PrecisionRecall, frozen=True, kw_only=True):
    """One scored object at the headline's tolerance. at: the same by the other tolerances' names.

    An object without a reference point is not eligible: it is listed and not averaged.
    """

    id: int
    name: str
    category: str
    eligible: bool
    n_reference: int
    n_submitted: int
    at: dict[str, PrecisionRecall]


class Registration(Record, frozen=True, kw_only=True):
    """The rigid motion that trimmed ICP finds from the submitted surface to the reference's."""

    rotation_deg: float
    translation_m: float
    iterations: int
    trimmed_rms_m: float


class CameraError(Record, frozen=True, kw_only=True):
    """The submission's camera against the reference's.

    fov_deg: horizontal, submitted minus reference; null for an orthographic camera. world_*: of the
    two poses as each scene's own world states them, which say nothing where an agent chose its own
    origin; registration: of the surfaces, in the camera frame, null where ICP has too few points.
    """

    fov_deg: float | None
    world_rotation_deg: float | None
    world_translation_m: float | None
    registration: Registration | None


class Diagnostics(Record, frozen=True, kw_only=True):
    """Numbers beside R, none of which enters it; null where undefined. docs/protocols/bench.md."""

    object_union: PrecisionRecall
    visible_scene: PrecisionRecall
    chamfer_l1_half_sum_over_reference_visible_box_diagonal: float | None
    voxel_iou_5_percent_of_median_depth: float | None
    voxel_iou_5cm: float | None
    voxel_iou_10cm: float | None
    R_median_scale: float | None
    R_disparity_scale_shift: float | None
    R_rigid: float | None
    R_own_intrinsics: float | None


class NoiseBeside(Record, frozen=True, kw_only=True):
    """What the render card's noise can do to A; null where it was not measured.

    reference_mean, reference_sd: A of the reference's own renders by seed; two_seeds: the share of
    pixels that two seeds of this submission's render put more than delta apart.
    """

    reference_mean: float | None
    reference_sd: float | None
    two_seeds: float | None


class Appearance(Record, frozen=True, kw_only=True):
    """A's parts. curve: A by delta; where_*: A of pixels whose geometry agrees, or does not."""

    n_px: int
    n_hits: int
    curve: dict[str, float]
    where_geometry_agrees: float | None
    n_geometry_agrees_px: int
    where_geometry_differs: float | None
    n_geometry_differs_px: int
    noise: NoiseBeside


class Flag(Record, frozen=True, kw_only=True):
    """Something a person should look at; it changes no score. measured: its number, see kind."""

    kind: FlagKind
    what: str
    measured: float
    threshold: float


class ReconstructionRow(EvaluationRow, frozen=True, kw_only=True):
    """One case. status: ok where it was compared; valid, R, A, S: zeros where it was not.

    run_status: the readout's. R and A are null where they were not asked for (A without a render),
    S then too. validity: each check, null where the readout recorded none. articulation: left out
    where the reference has no joint.
    """

    code: str | None
    reason: str | None
    run_status: str
    warnings: tuple[str, ...]
    family: str
    environment: str | None
    theme: str | None
    split: str | None
    tier: Tier | None
    view: int
    valid: bool
    validity: dict[str, Check] | None
    R: float | None
    A: float | None
    S: float | None
    R_at: dict[str, float]
    objects: tuple[ObjectRow, ...]
    fov_error_deg: float | None
    camera: CameraError | None
    diagnostics: Diagnostics | None
    appearance: Appearance | None
    flags: tuple[Flag, ...]
    articulation: Articulation | UnsetType = UNSET

    @property
    def has_score(self) -> bool:
        """Whether the submission is valid."""
        return self.valid

    @property
    def has_truth(self) -> bool:
        """Always: a case without an eligible object is refused when it is made."""
        return True

    @property
    def score_gap(self) -> str:
        """Why the submission counts 0."""
        if self.valid:
            return ""
        return "not valid" if self.status == COMPARED else self.status

    @property
    def outcome(self) -> Outcome:
        """A submission that was compared and is not valid is a part of its own."""
        if self.status != COMPARED:
            return Outcome("failed", self.status)
        return Outcome("scored", self.status) if self.valid else Outcome("empty", "not valid")
