"""A folder of depth arrays as a run folder: planar, labelled, each a row of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from legoworld.baselines.baseline_import import (
    ImportRequest,
    import_configuration,
    write_import,
)
from legoworld.baselines.baseline_run import BaselineResult, Progress
from legoworld.baselines.depth_folder import (
    SUFFIXES,
    DepthSource,
    depth_files,
    depth_source_file,
    planar_depth,
    write_array,
)
from legoworld.baselines.records import (
    Record,
    ResultMissingError,
    depth_record,
    failed_record,
    is_intact,
)
from legoworld.errors import LegoWorldError, UsageError
from legoworld.files import canonical_json, sha256_of_file, sha256_of_text
from legoworld.readouts.depth import depth_file
from legoworld.running import run_folder
from legoworld.running.disk import check_disk
from legoworld.track import TrackImage
from legoworld.wording import counted

Say = Callable[[str], None]


def import_depth(
    request: ImportRequest, source: DepthSource, *, progress: Progress, notice: Say
) -> BaselineResult:
    """Import a folder of depth arrays; goes on where an interrupted import stopped.

    An array that `evaluate` could not score is a row of the run. When no array at all can be
    used, the first one's error is raised and nothing is kept.
    """
    images = list(request.track.images)
    imported = {
        "folder": source.folder.resolve().name,
        "space": source.space,
        "unit": source.unit,
        "cameras_sha256": sha256_of_text(
            canonical_json({n: [*c.intrinsics_px] for n, c in source.cameras.items()})
        )
        if source.cameras
        else None,
    }
    _refuse_unusable(request, source, images)
    _notice_strangers(source, images, notice)
    with run_folder.locked(request.run):
        configuration = import_configuration(request, images, imported)
        earlier = run_folder.prepare(request.run, configuration, overwrite=request.overwrite)
        by_id = {record["row"]["image_id"]: record for record in earlier}
        sizes = [i.size_wh for i in images if i.id not in by_id and i.size_wh is not None]
        check_disk(request.run, sizes, notice, next_step="free some space, or choose another -o")
        with run_folder.journal(request.run) as journal:
            records = []
            for record in _depth_records(request, source, images, by_id):
                records.append(run_folder.append(journal, record))
                progress(record["row"])
        return write_import(request, records, configuration)


def _depth_records(
    request: ImportRequest,
    source: DepthSource,
    images: Sequence[TrackImage],
    earlier: Mapping[int, Record],
) -> Iterator[Record]:
    for image in images:
        try:
            if not request.was_run_on(image):
                raise ResultMissingError("not among the images it was run on")
            path = _existing(source, image)
            entry = {"source": {"file": path.name, "sha256": sha256_of_file(path)}}
            if image.id in earlier and is_intact(earlier[image.id], request.run, entry):
                yield earlier[image.id]
                continue
            write_array(request.run / depth_file(image.scene), planar_depth(path, source, image))
            yield depth_record(image, request.run, entry)
        except LegoWorldError as error:
            yield failed_record(image, error)


def _notice_strangers(source: DepthSource, images: Sequence[TrackImage], notice: Say) -> None:
    known = {f"{image.scene}{suffix}" for image in images for suffix in SUFFIXES}
    names = (path.relative_to(source.folder).as_posix() for path in depth_files(source.folder))
    strangers = [name for name in names if name not in known]
    if strangers:
        files = counted(len(strangers), "file is", "files are")
        notice(f"{files} of no photo of the track, such as {strangers[0]}")


def _refuse_unusable(
    request: ImportRequest, source: DepthSource, images: Sequence[TrackImage]
) -> None:
    """Raise the first array's error when not one array is usable, before anything is written."""
    first_error: LegoWorldError | None = None
    for image in images:
        try:
            path = depth_source_file(source, image) if request.was_run_on(image) else None
            if path is not None:
                planar_depth(path, source, image)
                return
        except LegoWorldError as error:
            first_error = first_error or error
    other = next((p.relative_to(source.folder) for p in depth_files(source.folder)), None)
    raise first_error or UsageError(
        "the folder has no depth of the track's photos",
        found=f"nothing like {images[0].scene}.npy" + (f", but {other}" if other else ""),
        expected="<file_name without extension>.npy, .npz, .pfm, .exr or .png",
    )


def _existing(source: DepthSource, image: TrackImage) -> Path:
    path = depth_source_file(source, image)
    if path is None:
        expected = f"{image.scene}.npy, .npz, .pfm, .exr or .png"
        raise ResultMissingError("there is no depth file", found="nothing", expected=expected)
    return path
