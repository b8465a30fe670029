"""Depth of baselines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from msgspec import structs

from legoworld.baselines.baseline_import import ImportRequest
from legoworld.baselines.depth_folder import DepthSource, read_cameras_file
from legoworld.baselines.depth_import import import_depth
from legoworld.baselines.family import BaselineFamily, Telling
from legoworld.readouts.depth import DEPTH_FILE
from legoworld.records.run_file import RunSummary
from legoworld.records.run_rows import RunRow
from legoworld.running.readout_run import RunResult


def _import(
    request: ImportRequest, source: Path, options: Mapping[str, Any], telling: Telling
) -> RunResult:
    intrinsics = options.get("intrinsics")
    answers = DepthSource(
        folder=source,
        space=options.get("space"),
        unit=options.get("unit"),
        cameras=read_cameras_file(intrinsics) if intrinsics else {},
        array=options.get("array"),
        suffix=options.get("suffix"),
    )
    telling.total(len(request.track.images))
    return import_depth(request, answers, progress=telling.progress, notice=telling.notice)


def _sum_up(summary: RunSummary, ok: Sequence[RunRow]) -> RunSummary:
    return structs.replace(summary, depth_bytes=sum(row.depth.bytes for row in ok if row.depth))


BASELINE: Final = BaselineFamily(
    of_folder=True,
    what="a folder of depth arrays",
    options=frozenset({"space", "unit", "intrinsics", "array", "suffix"}),
    import_answers=_import,
    sum_up=_sum_up,
    own_file=lambda row: DEPTH_FILE.path(row.scene),
)
