"""The summary of a depth evaluation: what is depth's own beside means, intervals, coverage."""

from __future__ import annotations

from collections.abc import Sequence

from legoworld.evaluation.depth.eth3d import parse_scene_name, training_images
from legoworld.evaluation.depth.protocol import HOLE_POLICIES, METRICS, DepthProtocol
from legoworld.evaluation.pixels.family import Settings
from legoworld.evaluation.pixels.summary import common, covered, mean, means, with_missing
from legoworld.records.base import UNSET, UnsetType
from legoworld.records.depth import (
    AllAttempted,
    DepthCoverage,
    DepthRow,
    DepthSummary,
    PartOfEth3d,
    ScoredDepthRow,
)
from legoworld.records.evaluation_summary import Evaluator


def summarise(
    rows: Sequence[DepthRow],
    *,
    kind: str,
    partial: bool,
    protocol: DepthProtocol,
    settings: Settings,
) -> DepthSummary:
    """summary.json. rows: of every attempted image, ascending id."""
    scored = [row for row in rows if isinstance(row, ScoredDepthRow)]
    return DepthSummary(
        task=protocol.card.task,
        kind=kind,
        partial=partial,
        evaluator=Evaluator(name=protocol.evaluator, version=protocol.evaluator_version),
        protocol=protocol.choices(settings.options["camera_model"]),
        coverage=DepthCoverage(**covered(rows), eth3d=_part_of_eth3d(rows)),
        constant=means([row.constant for row in scored], METRICS),
        all_attempted=_all_attempted(rows, protocol),
        mean_hole_share=mean([row.hole_share for row in scored]),
        mean_outside_view_share=mean([row.outside_view_share for row in scored]),
        mean_clamped_share=mean([row.clamped_share for row in scored]),
        worse_than_constant=sum(bool(row.worse_than_constant) for row in scored),
        **common(rows, METRICS, settings),
    )


def _part_of_eth3d(rows: Sequence[DepthRow]) -> PartOfEth3d | UnsetType:
    """The share of ETH3D's training set; UNSET if an image is from another dataset."""
    names = {row.file_name for row in rows}
    whole = {image.file_name for image in training_images()}
    if not names or not names <= whole:
        return UNSET
    scenes, of = ({parse_scene_name(name) for name in some} for some in (names, whole))
    return PartOfEth3d(
        images=len(names), of_images=len(whole), scenes=len(scenes), of_scenes=len(of)
    )


def _all_attempted(rows: Sequence[DepthRow], protocol: DepthProtocol) -> AllAttempted:
    """AbsRel over every image with ground truth; an unscored one counts with error 1."""
    with_truth, given = [row for row in rows if row.has_truth], protocol.failed_image_abs_rel
    values = with_missing(with_truth, "abs_rel", given)
    return AllAttempted(
        abs_rel={policy: mean(values(policy)) for policy in HOLE_POLICIES},
        images=len(with_truth),
        missing=sum(not row.has_score for row in with_truth),
        missing_abs_rel=given,
    )
