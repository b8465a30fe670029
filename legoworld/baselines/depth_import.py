"""A folder of depth arrays as a run folder: planar and declared, one row each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final

from msgspec.structs import replace

from legoworld.baselines.baseline_import import (
    ImportRequest,
    import_configuration,
    write_import,
)
from legoworld.baselines.depth_folder import (
    DepthSource,
    planar_depth,
    write_array,
)
from legoworld.baselines.depth_matching import Match, Matches, match_files
from legoworld.baselines.records import (
    ResultMissingError,
    depth_record,
    is_intact,
)
from legoworld.depth_files.reading import SUFFIXES
from legoworld.errors import LegoWorldError, UsageError
from legoworld.evaluation.depth.arrays import DepthArray
from legoworld.files import canonical_json, sha256_of_file, sha256_of_text
from legoworld.pluralize import counted
from legoworld.readouts.depth import DEPTH_FILE
from legoworld.records.folders import run_folder
from legoworld.records.folders.run_journal import append, journal
from legoworld.records.run_file import ImageRecord, ImageSource, Imported, ImportedFrom, ReadArray
from legoworld.running.disk import check_disk
from legoworld.running.image_record import failed_record
from legoworld.running.readout_run import Progress, RunResult
from legoworld.tracks.track import TrackImage

Say = Callable[[str], None]
_FLOAT16: Final = "the file holds float16: three digits, and nothing beyond 65504"


def import_depth(
    request: ImportRequest, source: DepthSource, *, progress: Progress, notice: Say
) -> RunResult:
    """Import a folder of depth arrays; an interrupted import is resumed.

    An array that `evaluate` could not score is a row of the run. If no array is usable, the first
    one's error is raised and nothing is kept.
    """
    images = list(request.track.images)
    imported = Imported(
        folder=source.folder.resolve().name,
        space=source.space,
        unit=source.unit,
        array=source.array,
        suffix=source.suffix,
        cameras_sha256=sha256_of_text(
            canonical_json({n: [*c.intrinsics_px] for n, c in source.cameras.items()})
        )
        if source.cameras
        else None,
    )
    matches = match_files(source.folder, images, source.suffix)
    _refuse_unusable(request, source, images, matches)
    _notice_names(matches, notice)
    with run_folder.locked(request.run):
        configuration = import_configuration(request, images, imported)
        earlier = run_folder.prepare(request.run, configuration, overwrite=request.overwrite)
        by_id = {record.row.image_id: record for record in earlier}
        sizes = [i.size_wh for i in images if i.id not in by_id and i.size_wh is not None]
        check_disk(
            request.run,
            [DEPTH_FILE.most_bytes(size) for size in sizes],
            notice,
            what="depth",
            next_step="free some space, or choose another -o",
        )
        with journal(request.run) as stream:
            records = []
            for record in _depth_records(request, source, matches, by_id):
                records.append(append(stream, record))
                progress(record.row)
        return write_import(request, records, configuration)


def _depth_records(
    request: ImportRequest,
    source: DepthSource,
    matches: Matches,
    earlier: Mapping[int, ImageRecord],
) -> Iterator[ImageRecord]:
    for image in request.track.images:
        try:
            if not request.was_run_on(image):
                raise ResultMissingError("not among the images it was run on")
            match = _existing(matches, image)
            file = match.path.relative_to(source.folder).as_posix()
            digest = sha256_of_file(match.path)
            entry = ImageSource(source=ImportedFrom(file=file, sha256=digest, matched_by=match.how))
            if image.id in earlier and is_intact(earlier[image.id], request.run, entry):
                yield earlier[image.id]
                continue
            array = planar_depth(match.path, source, image)
            write_array(request.run / DEPTH_FILE.path(image.scene), array)
            yield _depth_record(image, request, entry, array)
        except LegoWorldError as error:
            yield failed_record(image, error)


def _depth_record(
    image: TrackImage, request: ImportRequest, entry: ImageSource, array: DepthArray
) -> ImageRecord:
    """The record with what was read from the file, and a warning below float32 precision."""
    stored = array.stored
    assert stored is not None
    read = ReadArray(array=stored.array, dtype=stored.dtype, shape=tuple(stored.shape))
    record = depth_record(image, request.run, replace(entry, read=read))
    if stored.dtype == "float16":
        return replace(record, row=replace(record.row, warnings=(_FLOAT16,)))
    return record


def _notice_names(matches: Matches, notice: Say) -> None:
    """Report files matched other than by the photos' own paths, and files that match no photo."""
    strangers = matches.strangers
    if strangers:
        files = counted(len(strangers), "file is", "files are")
        notice(f"{files} not matched to a photo of the track, such as {strangers[0]}")
    for how, count in sorted(Counter(m.how for m in matches.by_image.values()).items()):
        if how != "same_path":
            files = counted(count, "file is", "files are")
            notice(f"{files} matched by: {how.replace('_', ' ')}")


def _refuse_unusable(
    request: ImportRequest, source: DepthSource, images: Sequence[TrackImage], matches: Matches
) -> None:
    """Raise the first array's error if no array is usable, before anything is written."""
    first_error: LegoWorldError | None = None
    for image in images:
        try:
            match = matches.of(image) if request.was_run_on(image) else None
            if match is not None:
                planar_depth(match.path, source, image)
                return
        except LegoWorldError as error:
            first_error = first_error or error
    other = f", but {matches.strangers[0]}" if matches.strangers else ""
    raise first_error or UsageError(
        "the folder has no depth for the track's photos",
        found=f"nothing like {images[0].scene}.npy{other}",
        expected=f"<file_name without extension> and one of {' '.join(SUFFIXES)}",
        next_step="for names with an extra ending before the format, pass --suffix",
    )


def _existing(matches: Matches, image: TrackImage) -> Match:
    match = matches.of(image)
    if match is None:
        expected = f"{image.scene}.npy, or another of {' '.join(SUFFIXES)}"
        raise ResultMissingError("there is no depth file", found="nothing", expected=expected)
    return match
