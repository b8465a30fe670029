"""Depth of baselines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

from msgspec import structs

from legoworld.baselines.baseline_import import ImportRequest
from legoworld.baselines.depth_folder import (
    DepthDeclared,
    planar_depth,
    read_cameras_file,
    write_array,
)
from legoworld.baselines.depth_records import answered_depth, depth_record
from legoworld.baselines.family import BaselineFamily, ImportListener
from legoworld.baselines.pixel_import import PixelSource, import_pixels
from legoworld.baselines.pixel_matching import Naming
from legoworld.files import canonical_json, sha256_of_text
from legoworld.readouts.depth import DEPTH_FILE
from legoworld.records.run_file import Imported, RunSummary
from legoworld.records.run_rows import RunRow
from legoworld.running.readout_run import RunResult

#: --suffix sets any other ending.
NAMING: Final = Naming(
    noun="depth",
    endings=(
        *("_depth", "-depth", "_pred", "-pred", "_depth_pred", "_pred_depth"),
        *("_disp", "-disp", "_disparity"),
    ),
)


def depth_source(folder: Path, options: Mapping[str, Any]) -> PixelSource:
    """A folder of depth arrays, by the options of its import."""
    declared = declared_depth(options)
    return PixelSource(
        folder=folder,
        suffix=options.get("suffix"),
        naming=NAMING,
        imported=imported_depth(folder, declared, options),
        stored=DEPTH_FILE,
        read=partial(planar_depth, declared),
        write=write_array,
        record=depth_record,
    )


def declared_depth(options: Mapping[str, Any]) -> DepthDeclared:
    """What the options of an import say of a folder's depth."""
    intrinsics = options.get("intrinsics")
    return DepthDeclared(
        space=options.get("space"),
        unit=options.get("unit"),
        cameras=read_cameras_file(intrinsics) if intrinsics else {},
        array=options.get("array"),
    )


def imported_depth(folder: Path, declared: DepthDeclared, options: Mapping[str, Any]) -> Imported:
    """What a run says of the folder of depth that it is of."""
    cameras = {name: [*camera.intrinsics_px] for name, camera in declared.cameras.items()}
    return Imported(
        folder=folder.resolve().name,
        space=declared.space,
        unit=declared.unit,
        array=declared.array,
        suffix=options.get("suffix"),
        cameras_sha256=sha256_of_text(canonical_json(cameras)) if cameras else None,
    )


def _import(
    request: ImportRequest, source: Path, options: Mapping[str, Any], telling: ImportListener
) -> RunResult:
    answers = depth_source(source, options)
    telling.total(len(request.track.images))
    return import_pixels(request, answers, progress=telling.progress, notice=telling.notice)


def _sum_up(summary: RunSummary, ok: Sequence[RunRow]) -> RunSummary:
    return structs.replace(summary, depth_bytes=sum(row.depth.bytes for row in ok if row.depth))


BASELINE: Final = BaselineFamily(
    of_folder=True,
    what="a folder of depth arrays",
    options=frozenset({"space", "unit", "intrinsics", "array", "suffix"}),
    import_answers=_import,
    sum_up=_sum_up,
    own_file=lambda row: DEPTH_FILE.path(row.scene),
    answered=answered_depth,
)
