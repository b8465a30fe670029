"""Depth of baselines: folders of arrays, and a process's files, read back as in scoring."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Final

from msgspec import structs
from msgspec.structs import replace

from legoworld.baselines.baseline_import import ImportRequest
from legoworld.baselines.depth_folder import (
    DepthDeclarations,
    planar_depth,
    predicted_px,
    read_cameras_file,
    write_array,
)
from legoworld.baselines.family import BaselineFamily, ImportListener, ImportOptions
from legoworld.baselines.pixel_import import PixelSource, import_pixels
from legoworld.baselines.pixel_matching import Naming
from legoworld.baselines.records import AnswerInvalidError, AnswerRules
from legoworld.evaluation.depth.family import PIXELS
from legoworld.evaluation.depth.labelled import read_prediction
from legoworld.evaluation.pixels.resampling import size_check
from legoworld.files import canonical_json, sha256_of_file, sha256_of_text
from legoworld.readouts.depth import DEPTH_FILE
from legoworld.records.base import UNSET, canonical
from legoworld.records.baseline_messages import DepthSaid, Message
from legoworld.records.run_file import ImageRecord, ImageSource, Imported, RunSummary
from legoworld.records.run_rows import DepthFile, RunRow
from legoworld.running.image_record import initial_row
from legoworld.running.readout_run import RunResult
from legoworld.tracks.track import TrackImage


def answered_depth(
    image: TrackImage, answer: Message, rules: AnswerRules, source: ImageSource
) -> ImageRecord:
    """A child's answer as a record. LegoWorldError for a file that `evaluate` would refuse."""
    record = depth_record(image, rules.run, source)
    _check_depth_answer(answer.depth, record.row)
    return record


def depth_record(image: TrackImage, run: Path, source: ImageSource) -> ImageRecord:
    """The record of one image's depth file in the run, read back and checked.

    LegoWorldError if it is missing, undeclared, or cannot be scored.
    """
    name = DEPTH_FILE.path(image.scene)
    path = run / name
    if not path.is_file():
        raise AnswerInvalidError("the depth file was not written", expected=name)
    assert image.size_wh is not None
    array = read_prediction(path, size_check(PIXELS, image.size_wh))
    depth = DepthFile(
        file=name,
        space=array.space,
        unit=array.unit,
        bytes=path.stat().st_size,
        sha256=sha256_of_file(path),
        finite_px=predicted_px(array, image),
    )
    row = replace(initial_row(image), rendered_wh=array.size_wh, depth=depth)
    return ImageRecord(row=row, scene=source)


def _check_depth_answer(said: DepthSaid | None, row: RunRow) -> None:
    """Check that the written file is the one the child reported."""
    assert row.depth
    assert row.rendered_wh
    answered = DepthSaid(
        sha256=row.depth.sha256 or "",
        size_wh=row.rendered_wh,
        space=row.depth.space or "",
        unit=None if row.depth.unit is UNSET else row.depth.unit,
    )
    if said != answered:
        raise AnswerInvalidError(
            "the depth file is not the one the baseline spoke of",
            found=canonical(answered),
            expected=canonical(said) if said else "a word about the file",
        )


#: --suffix sets any other ending.
NAMING: Final = Naming(
    noun="depth",
    endings=(
        *("_depth", "-depth", "_pred", "-pred", "_depth_pred", "_pred_depth"),
        *("_disp", "-disp", "_disparity"),
    ),
)


def depth_source(folder: Path, options: ImportOptions) -> PixelSource:
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


def declared_depth(options: ImportOptions) -> DepthDeclarations:
    """What the options of an import say of a folder's depth."""
    intrinsics = options.get("intrinsics")
    return DepthDeclarations(
        space=options.get("space"),
        unit=options.get("unit"),
        cameras=read_cameras_file(intrinsics) if intrinsics else {},
        array=options.get("array"),
    )


def imported_depth(
    folder: Path, declarations: DepthDeclarations, options: ImportOptions
) -> Imported:
    """What a run says of the folder of depth that it is of."""
    cameras = {name: [*camera.intrinsics_px] for name, camera in declarations.cameras.items()}
    return Imported(
        folder=folder.resolve().name,
        space=declarations.space,
        unit=declarations.unit,
        array=declarations.array,
        suffix=options.get("suffix"),
        cameras_sha256=sha256_of_text(canonical_json(cameras)) if cameras else None,
    )


def _import(
    request: ImportRequest, source: Path, options: ImportOptions, telling: ImportListener
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
