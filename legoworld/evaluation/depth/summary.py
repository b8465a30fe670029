"""What is depth's own in a summary: the constant, shares, the part of ETH3D that was attempted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from msgspec.structs import asdict

from legoworld.evaluation.depth.eth3d import parse_scene_name, training_images
from legoworld.evaluation.depth.protocol import METRICS
from legoworld.evaluation.pixels.family import Settings
from legoworld.evaluation.pixels.summary import mean, means
from legoworld.records.base import UNSET, UnsetType
from legoworld.records.depth import DepthCoverage, DepthRow, PartOfEth3d, ScoredDepthRow
from legoworld.records.evaluation_summary import Coverage


def own_fields(
    _rows: Sequence[DepthRow], scored: Sequence[ScoredDepthRow], _settings: Settings
) -> Mapping[str, Any]:
    """The fields of a summary that only depth has."""
    return {
        "constant": means([row.constant for row in scored], METRICS),
        "mean_outside_view_share": mean([row.outside_view_share for row in scored]),
        "mean_clamped_share": mean([row.clamped_share for row in scored]),
        "worse_than_constant": sum(bool(row.worse_than_constant) for row in scored),
    }


def depth_coverage(rows: Sequence[DepthRow], coverage: Coverage) -> DepthCoverage:
    """With how many images of ETH3D there are."""
    return DepthCoverage(**asdict(coverage), eth3d=_part_of_eth3d(rows))


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
