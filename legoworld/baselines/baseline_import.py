"""`legoworld baseline import`: declarations about imported results, and their run."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from msgspec.structs import replace

from legoworld.baselines.baseline_run import write_run
from legoworld.baselines.family import ImportListener
from legoworld.baselines.records import ResultMissingError
from legoworld.baselines.request import baseline_configuration
from legoworld.errors import LegoWorldError, UsageError, one_line
from legoworld.files import EncodingError, canonical_json, sha256_of_file, sha256_of_text, utf8_text
from legoworld.pluralize import in_another_folder
from legoworld.readouts.family import Protocol
from legoworld.records.folders import run_folder
from legoworld.records.folders.run_journal import append, journal
from legoworld.records.run_file import BaselineAbout, ImageRecord, Imported
from legoworld.running.image_record import failed_record
from legoworld.running.readout_run import Progress, RunResult
from legoworld.tracks.track import Track, TrackImage


@dataclass(frozen=True, kw_only=True)
class ImportRequest:
    """An import, its track, and the declarations about it.

    name: of the baseline; ran_on: ids of the images it was run on, None for all; subset: whether
    results of other images are ignored instead of refused.
    """

    protocol: Protocol
    track: Track
    run: Path
    name: str
    ran_on: frozenset[int] | None
    subset: bool
    overwrite: bool

    def was_run_on(self, image: TrackImage) -> bool:
        """Whether an image without results has an empty answer instead of no answer."""
        return self.ran_on is None or image.id in self.ran_on


def images_run(path: Path, images: Sequence[TrackImage]) -> frozenset[int]:
    """The images named by a list of ids or file names: a JSON list, or one per line.

    UsageError for a name or id that the track does not have.
    """
    try:
        text = utf8_text(path.read_bytes())
    except EncodingError as error:
        raise UsageError(
            f"{path} is not a list of images", found=str(error), expected="text or JSON"
        ) from error
    try:
        listed = json.loads(text)
    except (ValueError, RecursionError):
        listed = [line.strip() for line in text.splitlines() if line.strip()]
    names = {str(i.id): i.id for i in images} | {i.file_name: i.id for i in images}
    entries = listed if isinstance(listed, list) else [listed]
    unknown = [entry for entry in entries if str(entry) not in names]
    if unknown or not entries:
        meant = in_another_folder(str(unknown[0]), names) if unknown else None
        raise UsageError(
            f"{path} does not list images of the track",
            found=one_line(repr(unknown[0]), 100) if unknown else "nothing",
            expected=f"{meant!r}, as the track has it in another folder"
            if meant
            else f"ids or file names, such as {images[0].id} or {images[0].file_name}",
            next_step=f"if it is that photo, list the track's name or {names[meant]}, its id"
            if meant
            else "",
        )
    return frozenset(names[str(entry)] for entry in entries)


def import_record(
    request: ImportRequest, image: TrackImage, answer: Callable[[TrackImage], ImageRecord]
) -> ImageRecord:
    """The record of an image, by `answer` where the results cover it; its error is the image's."""
    try:
        if not request.was_run_on(image):
            raise ResultMissingError("not among the images it was run on")
        return answer(image)
    except LegoWorldError as error:
        return failed_record(image, error)


def write_import(
    request: ImportRequest,
    imported: Imported,
    records: Callable[[Sequence[ImageRecord]], Iterable[ImageRecord]],
    progress: Progress = lambda _row: None,
) -> RunResult:
    """Make the run folder of an import. imported: the input and its declarations.

    records: all records in the track's order, from those of an earlier, equal import.
    """
    ran_on = sorted(request.ran_on) if request.ran_on is not None else None
    configuration = replace(
        baseline_configuration(
            request.protocol, request.track, request.track.images, partial=False
        ),
        baseline=request.name,
        imported=imported,
        images_run_sha256=sha256_of_text(canonical_json(ran_on)) if ran_on else None,
        subset=request.subset,
        used_truth=None,
    )
    with run_folder.lock_run(request.run):
        earlier = run_folder.prepare(request.run, configuration, overwrite=request.overwrite)
        made = records(earlier)
        with journal(request.run) as stream:
            stored = []
            for record in made:
                stored.append(append(stream, record))
                progress(record.row)
        baseline = BaselineAbout(name=request.name, imported=imported)
        return write_run(request.run, stored, configuration, baseline)


def import_images(
    request: ImportRequest,
    source: Path,
    answer: Callable[[TrackImage], ImageRecord],
    telling: ImportListener,
) -> RunResult:
    """A run of the answers to the track's images, each made anew from a file or a folder.

    answer: an image's record, written below the run where it has a file; a LegoWorldError of it is
    that image's row.
    """
    images = request.track.images
    telling.total(len(images))
    if source.is_dir():
        imported = Imported(folder=source.resolve().name)
    else:
        imported = Imported(file=source.name, sha256=sha256_of_file(source))
    return write_import(
        request,
        imported,
        lambda _earlier: (import_record(request, image, answer) for image in images),
        telling.progress,
    )
