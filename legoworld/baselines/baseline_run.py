"""`legoworld baseline run`: run a specialist over a track's photos into a run folder."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from msgspec import structs

from legoworld.baselines.conversation import Conversation, Provenance
from legoworld.baselines.family import load_baseline_family
from legoworld.baselines.records import PhotoMissingError, is_intact
from legoworld.baselines.request import BaselineRequest, build_configuration
from legoworld.errors import UsageError
from legoworld.files import sha256_of_file
from legoworld.pluralize import share, word_for
from legoworld.readouts.family import load_readout_family
from legoworld.records.folders import run_folder
from legoworld.records.folders.read_run import recorded_configuration
from legoworld.records.folders.run_journal import JournalledImage, append, journal
from legoworld.records.run_file import (
    BaselineAbout,
    Configuration,
    ImageRecord,
    ImageSource,
    RunSummary,
)
from legoworld.records.run_rows import RunRow
from legoworld.running.image_record import failed_record
from legoworld.running.readout_run import (
    Progress,
    RunResult,
    count_rows,
    run_document,
    selected_images,
)
from legoworld.tasks.registry import require_task
from legoworld.track_making.make_track import find_photo
from legoworld.tracks.track import TrackImage
from legoworld.workers.environment import passed_names

Say = Callable[[str], None]


def run_baseline(
    request: BaselineRequest,
    *,
    progress: Progress,
    notice: Say,
    log: Say,
    kept: Callable[[int], None] = lambda _n: None,
) -> RunResult:
    """Predict every requested image without a valid result, then write the run.

    Raises UsageError, ConfigurationMismatchError or BaselineFailedError before an image is
    predicted; an image that the baseline cannot process is a row of the run, never an exception.
    log: called with the baseline's output; kept: called once with the number of kept images.
    """
    images = selected_images(request.track, request.image_ids, request.limit)
    known = build_configuration(request, images)
    photos = {i.id: path for i in images if (path := find_photo(request.photos, i)) is not None}
    if not photos:
        raise UsageError(
            "PHOTOS contains none of the track's photos",
            found=f"nothing like {request.photos.name}/{images[0].file_name}",
            expected="photos by the track's file names, or those below train2017/ or val2017/",
        )
    with run_folder.lock_run(request.run):
        earlier = run_folder.earlier_records(
            request.run, known, overwrite=request.overwrite, unknown=("provenance",)
        )
        done = _intact(earlier, images, photos, request.run)
        del earlier  # predictions are many: from here on they are on disk only
        todo = [image for image in images if image.id not in done]
        kept(len(done))
        # Now: once its provenance is known, and the run begins, a baseline may be writing already.
        run_folder.delete_leftovers(request.run)
        if done:
            predicted = share(len(done), len(images), "image", "images")
            notice(f"{predicted} {word_for(len(done), 'has', 'have')} a valid result already")

        def begin(provenance: Provenance) -> None:
            configuration = structs.replace(known, provenance=provenance)
            run_folder.begin(request.run, configuration, overwrite=request.overwrite and not began)
            began.append(True)

        began: list[bool] = []
        batches = {image.id: k // request.batch_size for k, image in enumerate(images)}
        conversation = Conversation(request, photos, batches, begin, log, notice)
        records = _write_journal(
            request, done, _every_record(conversation, images, todo, photos), progress
        )
        return write_run(
            request.run,
            [records[image.id] for image in images],
            recorded_configuration(request.run) or known,
            BaselineAbout(
                name=request.card.name,
                title=request.card.about.title,
                licence=request.card.about.licence,
                label_map=request.labels,
                # Only names, and not part of the configuration: a run resumes without them.
                variables=tuple(passed_names(request.variables)),
                sandbox=request.confinement.record(),
            ),
        )


def _intact(
    earlier: Sequence[ImageRecord],
    images: Sequence[TrackImage],
    photos: Mapping[int, Path],
    run: Path,
) -> dict[int, ImageRecord]:
    """The earlier records that can be kept, by image id."""
    by_id = {record.row.image_id: record for record in earlier}
    return {
        i.id: by_id[i.id]
        for i in images
        if i.id in by_id
        and i.id in photos
        and is_intact(by_id[i.id], run, ImageSource(photo_sha256=sha256_of_file(photos[i.id])))
    }


def _every_record(
    conversation: Conversation,
    images: list[TrackImage],
    todo: list[TrackImage],
    photos: Mapping[int, Path],
) -> Iterator[ImageRecord]:
    yield from conversation.records(images, [i for i in todo if i.id in photos])
    for image in todo:
        if image.id not in photos:
            yield failed_record(
                image,
                PhotoMissingError(
                    "there is no photo", found="nothing", expected=f"PHOTOS/{image.file_name}"
                ),
            )


def _write_journal(
    request: BaselineRequest,
    done: Mapping[int, ImageRecord],
    made: Iterator[ImageRecord],
    progress: Progress,
) -> dict[int, JournalledImage]:
    """Write every record to disk as it is made; yield it without its predictions.

    The journal is opened with the first new record: the folder is not touched until the model has
    reported its provenance.
    """
    first = next(made, None)
    with journal(request.run) as stream:
        records = {i: append(stream, record) for i, record in done.items()}
        while first is not None:
            records[first.row.image_id] = append(stream, first)
            progress(first.row)
            first = next(made, None)
    return records


def write_run(
    folder: Path,
    records: Sequence[JournalledImage],
    configuration: Configuration,
    baseline: BaselineAbout,
) -> RunResult:
    """Write the canonical files of a baseline's run, from journalled records in image order.

    Files of images without a result, of an earlier photo or refused, are deleted.
    """
    rows = tuple(record.row for record in records)
    own_file = load_baseline_family(configuration.task).own_file
    for row in rows if own_file else ():
        if own_file and row.status != "ok":
            (folder / own_file(row)).unlink(missing_ok=True)
    summary = summarise(configuration, rows)
    readout = load_readout_family(require_task(configuration.task))
    run_folder.finish(
        folder,
        records=records,
        run=run_document(configuration, baseline),
        summary=summary,
        with_predictions=readout.exports is not None,
        complete=readout.complete,
    )
    return RunResult(rows=rows, summary=summary)


def summarise(configuration: Configuration, rows: Sequence[RunRow]) -> RunSummary:
    """summary.json: coverage by status, predictions, and counted events."""
    ok = [row for row in rows if row.status == "ok"]
    counts: Counter[str] = Counter()
    for row in ok:
        counts.update(row.counts or {})
    summary = structs.replace(count_rows(configuration, rows), counts=dict(counts))
    return load_baseline_family(configuration.task).sum_up(summary, ok)
