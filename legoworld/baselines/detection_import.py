"""A results file as a run folder: every box or mask checked before anything is written."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from legoworld.baselines.baseline_import import (
    ImportRequest,
    import_configuration,
    not_run_on,
    write_import,
)
from legoworld.baselines.baseline_run import BaselineResult
from legoworld.baselines.box_formats import (
    BoxFormat,
    check_declared,
    in_terms_of,
    other_formats,
)
from legoworld.baselines.labels import LabelMap, Matcher
from legoworld.baselines.records import Record, detection_record
from legoworld.baselines.results_file import by_image, ours, read_results
from legoworld.evaluation.box_formats import BoxFormatError
from legoworld.evaluation.predictions import Predictions, PredictionsInvalidError, check_results
from legoworld.evaluation.protocols import detection_protocol
from legoworld.files import canonical_json, sha256_of_file, sha256_of_text
from legoworld.running import run_folder
from legoworld.track import TrackImage
from legoworld.wording import counted

Say = Callable[[str], None]


@dataclass(frozen=True, kw_only=True)
class DetectionSource:
    """A results file and what is declared of it."""

    path: Path
    box_format: BoxFormat
    labels: LabelMap


def import_detections(
    request: ImportRequest, source: DetectionSource, *, notice: Say
) -> BaselineResult:
    """Import COCO or LVIS results. Nothing is written when anything in them would be refused."""
    vocabulary, images = request.protocol.vocabulary, list(request.track.images)
    assert vocabulary is not None
    found = read_results(source.path)
    if request.subset:
        found = replace(found, entries=_of_track(found.entries, images, notice))
    else:
        _refuse_strangers(found.entries, images)
    entries, left_out = ours(found, Matcher(vocabulary, source.labels), source.box_format)
    for label, count in left_out.items():
        left = counted(count, "prediction", "predictions")
        notice(f"label {label!r}: {left} left out, as the label map says")
    as_given, _ = ours(found, Matcher(vocabulary, source.labels), "xywh")
    checked = _checked(request, source.box_format, entries, as_given)
    for warning in checked.warnings:
        notice(warning)
    groups = by_image(checked.entries)
    imported = {
        "file": source.path.name,
        "sha256": sha256_of_file(source.path),
        "box_format": source.box_format if request.protocol.task.name == "coco" else None,
        "label_map_sha256": sha256_of_text(canonical_json(source.labels)),
        "left_out": left_out,
        "empty_masks_dropped": checked.n_dropped_empty,
    }

    def record(image: TrackImage) -> Record:
        own = Predictions(entries=tuple(groups.get(image.id, ())), warnings=(), n_dropped_empty=0)
        return detection_record(image, own, {"source": {"file": source.path.name}})

    with run_folder.locked(request.run):
        configuration = import_configuration(request, images, imported)
        run_folder.prepare(request.run, configuration, overwrite=request.overwrite)
        with run_folder.journal(request.run) as journal:
            records = [
                run_folder.append(journal, record(i) if request.was_run_on(i) else not_run_on(i))
                for i in images
            ]
        return write_import(request, records, configuration)


def _checked(
    request: ImportRequest,
    box_format: BoxFormat,
    entries: Sequence[Any],
    as_given: Sequence[Any],
) -> Predictions:
    """Entries after every check that scoring makes, its errors in terms of the import's options.

    as_given: the same entries with the file's own numbers.
    """
    images, sizes_wh = request.track.images, _sizes_wh(request.track.images)
    assert request.protocol.vocabulary is not None
    try:
        checked = check_results(
            entries,
            status_by_image={i.id: "ok" if request.was_run_on(i) else "missing" for i in images},
            sizes_wh=sizes_wh,
            vocabulary=request.protocol.vocabulary,
            protocol=detection_protocol(request.protocol.task.name),
            order="given",
        )
    except BoxFormatError as error:
        others = other_formats(as_given, sizes_wh, box_format)
        raise in_terms_of(error, box_format, others) from error
    except PredictionsInvalidError as error:
        if not error.next_step.endswith("map categories by name"):
            raise
        raise PredictionsInvalidError(
            error.what,
            found=error.found,
            expected=error.expected,
            next_step=f"{error.next_step}, with --label-map FILE",
        ) from error
    if request.protocol.task.name == "coco":
        check_declared(as_given, sizes_wh, box_format)
    return checked


def _sizes_wh(images: Sequence[TrackImage]) -> dict[int, tuple[int, int]]:
    return {i.id: i.size_wh for i in images if i.size_wh is not None}


def _refuse_strangers(entries: Sequence[Any], images: Sequence[TrackImage]) -> None:
    known = {image.id for image in images}
    ids = [e.get("image_id") for e in entries if isinstance(e, dict)]
    strangers = [i for i in ids if type(i) is int and i not in known]
    if strangers:
        raise PredictionsInvalidError(
            f"{len(strangers)} of {len(entries)} predictions are of images outside the track",
            found=f"image {strangers[0]}",
            expected=f"one of the track's {len(known)} images, such as {images[0].id}",
            next_step="pass --subset to leave them out",
        )


def _of_track(entries: Sequence[Any], images: Sequence[TrackImage], notice: Say) -> tuple[Any, ...]:
    known = {image.id for image in images}
    kept = tuple(e for e in entries if isinstance(e, dict) and e.get("image_id") in known)
    if entries and not kept:
        raise PredictionsInvalidError(
            "no prediction is of an image of the track",
            found=f"{len(entries)} predictions, the first {entries[0]!r}"[:200],
            expected=f"some of {len(images)} images, such as {images[0].id}",
        )
    notice(f"{len(kept)} of {len(entries)} predictions are of the track's images; the rest is left")
    return kept
