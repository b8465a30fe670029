"""A folder of arrays of others as a run folder: one file and one row for each photo."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from msgspec.structs import replace

from legoworld.baselines.baseline_import import (
    ImportRequest,
    import_record,
    write_import,
)
from legoworld.baselines.pixel_matching import Match, Matches, Naming, match_files
from legoworld.baselines.records import ResultMissingError, is_intact
from legoworld.depth_files.read_depth import SUFFIXES
from legoworld.errors import LegoWorldError, UsageError
from legoworld.evaluation.pixels.family import PixelArray
from legoworld.files import sha256_of_file
from legoworld.pluralize import plural
from legoworld.readouts.pixels import PixelFile
from legoworld.records.run_file import ImageRecord, ImageSource, Imported, ImportedFrom, ReadArray
from legoworld.running.readout_run import Progress, RunResult
from legoworld.running.scene_pass import check_disk
from legoworld.tracks.track import TrackImage

Say = Callable[[str], None]
_FLOAT16: Final = "the file holds float16: three digits, and nothing beyond 65504"


@dataclass(frozen=True, kw_only=True)
class PixelSource:
    """A folder of arrays, and what a family makes of them.

    suffix: the ending of the files' names; imported: what the run says of the folder and its
    declarations; stored: how the run keeps an array.
    read: a photo's array after all checks; write: it, into the run; record: the image's record of
    what was written. LegoWorldError of these is that image's row.
    """

    folder: Path
    suffix: str | None
    naming: Naming
    imported: Imported
    stored: PixelFile
    read: Callable[[Path, TrackImage], PixelArray]
    write: Callable[[Path, Any], None]
    record: Callable[[TrackImage, Path, ImageSource], ImageRecord]


def import_pixels(
    request: ImportRequest, source: PixelSource, *, progress: Progress, notice: Say
) -> RunResult:
    """Import a folder of arrays; an interrupted import is resumed.

    An array that `evaluate` could not score is a row of the run. If no array is usable, the first
    one's error is raised and nothing is kept.
    """
    images = list(request.track.images)
    matches = match_files(source.folder, images, source.suffix, source.naming)
    _refuse_unusable(request, source, images, matches)
    _notice_names(matches, notice)

    def records(earlier: Sequence[ImageRecord]) -> Iterator[ImageRecord]:
        by_id = {record.row.image_id: record for record in earlier}
        sizes = [i.size_wh for i in images if i.id not in by_id and i.size_wh is not None]
        check_disk(
            request.run,
            [source.stored.most_bytes(size) for size in sizes],
            notice,
            what=source.naming.noun,
            next_step="free some space, or choose another -o",
        )

        def answer(image: TrackImage) -> ImageRecord:
            return _answer(request, source, matches, by_id.get(image.id), image)

        return (import_record(request, image, answer) for image in images)

    return write_import(request, source.imported, records, progress)


def _answer(
    request: ImportRequest,
    source: PixelSource,
    matches: Matches,
    earlier: ImageRecord | None,
    image: TrackImage,
) -> ImageRecord:
    match = _existing(matches, image, source.naming.noun)
    file = match.path.relative_to(source.folder).as_posix()
    digest = sha256_of_file(match.path)
    entry = ImageSource(source=ImportedFrom(file=file, sha256=digest, matched_by=match.how))
    if earlier is not None and is_intact(earlier, request.run, entry):
        return earlier
    array = source.read(match.path, image)
    source.write(request.run / source.stored.path(image.scene), array)
    return _record(image, request, source, entry, array)


def _record(
    image: TrackImage,
    request: ImportRequest,
    source: PixelSource,
    entry: ImageSource,
    array: PixelArray,
) -> ImageRecord:
    """The record with what was read from the file, and a warning below float32 precision."""
    stored = array.stored
    assert stored is not None
    read = ReadArray(array=stored.array, dtype=stored.dtype, shape=tuple(stored.shape))
    record = source.record(image, request.run, replace(entry, read=read))
    if stored.dtype == "float16":
        return replace(record, row=replace(record.row, warnings=(_FLOAT16,)))
    return record


def _notice_names(matches: Matches, notice: Say) -> None:
    """Report files matched other than by the photos' own paths, and files that match no photo."""
    strangers = matches.strangers
    if strangers:
        files = plural(len(strangers), "file is", "files are")
        notice(f"{files} not matched to a photo of the track, such as {strangers[0]}")
    for how, count in sorted(Counter(m.how for m in matches.by_image.values()).items()):
        if how != "same_path":
            files = plural(count, "file is", "files are")
            notice(f"{files} matched by: {how.replace('_', ' ')}")


def _refuse_unusable(
    request: ImportRequest, source: PixelSource, images: Sequence[TrackImage], matches: Matches
) -> None:
    """Raise the first array's error if no array is usable, before anything is written."""
    first_error: LegoWorldError | None = None
    for image in images:
        try:
            match = matches.of(image) if request.was_run_on(image) else None
            if match is not None:
                source.read(match.path, image)
                return
        except LegoWorldError as error:
            first_error = first_error or error
    other = f", but {matches.strangers[0]}" if matches.strangers else ""
    raise first_error or UsageError(
        f"the folder has no {source.naming.noun} for the track's photos",
        found=f"nothing like {images[0].scene}.npy{other}",
        expected=f"<file_name without extension> and one of {' '.join(SUFFIXES)}",
        next_step="for names with an extra ending before the format, pass --suffix",
    )


def _existing(matches: Matches, image: TrackImage, noun: str) -> Match:
    match = matches.of(image)
    if match is None:
        expected = f"{image.scene}.npy, or another of {' '.join(SUFFIXES)}"
        raise ResultMissingError(f"there is no {noun} file", found="nothing", expected=expected)
    return match
