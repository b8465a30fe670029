"""`legoworld baseline import`: anyone's results as a run folder like any other."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from legoworld.baselines.baseline_run import BaselineResult, Progress, write_run
from legoworld.baselines.depth_folder import (
    DepthSource,
    depth_source_file,
    planar_depth,
    write_array,
)
from legoworld.baselines.labels import LabelMap, Matcher
from legoworld.baselines.records import (
    Record,
    ResultMissingError,
    depth_record,
    detection_record,
    failed_record,
    is_intact,
)
from legoworld.baselines.request import common_configuration
from legoworld.baselines.results_file import BoxFormat, by_image, ours, read_results
from legoworld.errors import LegoWorldError, UsageError
from legoworld.evaluation.predictions import Predictions, PredictionsInvalidError, check_results
from legoworld.evaluation.protocols import detection_protocol
from legoworld.files import canonical_json, sha256_of_file, sha256_of_text
from legoworld.readouts.depth import depth_file
from legoworld.readouts.tasks import Protocol
from legoworld.running import run_folder
from legoworld.running.disk import check_disk
from legoworld.track import Track, TrackImage

Say = Callable[[str], None]


@dataclass(frozen=True, kw_only=True)
class ImportRequest:
    """What is imported, for which track, and what is declared of it.

    name: what the baseline is called; ran_on: ids of the images it was run on, None for all;
    subset: whether results of other images are left out instead of refused.
    """

    protocol: Protocol
    track: Track
    run: Path
    name: str
    ran_on: frozenset[int] | None
    subset: bool
    overwrite: bool


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
    entries, left_out = ours(found, Matcher(vocabulary, source.labels), source.box_format)
    for label, count in left_out.items():
        notice(f"label {label!r}: {count} predictions left out, as the label map says")
    checked = _checked(request, entries, images)
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
        configuration = _configuration(request, images, imported)
        run_folder.prepare(request.run, configuration, overwrite=request.overwrite)
        with run_folder.journal(request.run) as journal:
            records = [
                run_folder.append(journal, record(i) if _ran_on(request, i) else _not_run_on(i))
                for i in images
            ]
        return _written(request, records, configuration)


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
    with run_folder.locked(request.run):
        configuration = _configuration(request, images, imported)
        earlier = run_folder.prepare(request.run, configuration, overwrite=request.overwrite)
        by_id = {record["row"]["image_id"]: record for record in earlier}
        sizes = [i.size_wh for i in images if i.id not in by_id and i.size_wh is not None]
        check_disk(request.run, sizes, notice, next_step="free some space, or choose another -o")
        with run_folder.journal(request.run) as journal:
            records = []
            for record in _depth_records(request, source, images, by_id):
                records.append(run_folder.append(journal, record))
                progress(record["row"])
        return _written(request, records, configuration)


def images_run(path: Path, images: Sequence[TrackImage]) -> frozenset[int]:
    """The images a list names, by id or file name: a JSON list, or one a line.

    UsageError for a name or id that the track does not have.
    """
    text = path.read_text(encoding="utf-8")
    try:
        listed = json.loads(text)
    except ValueError:
        listed = [line.strip() for line in text.splitlines() if line.strip()]
    names = {str(i.id): i.id for i in images} | {i.file_name: i.id for i in images}
    entries = listed if isinstance(listed, list) else [listed]
    unknown = [entry for entry in entries if str(entry) not in names]
    if unknown or not entries:
        raise UsageError(
            f"{path.name} does not list images of the track",
            found=repr(unknown[0]) if unknown else "nothing",
            expected=f"ids or file names, such as {images[0].id} or {images[0].file_name}",
        )
    return frozenset(names[str(entry)] for entry in entries)


def _checked(
    request: ImportRequest, entries: Sequence[Any], images: Sequence[TrackImage]
) -> Predictions:
    assert request.protocol.vocabulary is not None
    return check_results(
        entries,
        status_by_image={i.id: "ok" if _ran_on(request, i) else "missing" for i in images},
        sizes_wh={i.id: i.size_wh for i in images if i.size_wh is not None},
        vocabulary=request.protocol.vocabulary,
        protocol=detection_protocol(request.protocol.task.name),
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


def _depth_records(
    request: ImportRequest,
    source: DepthSource,
    images: Sequence[TrackImage],
    earlier: Mapping[int, Record],
) -> Iterator[Record]:
    for image in images:
        try:
            path = depth_source_file(source, image) if _ran_on(request, image) else None
            if path is None:
                yield _not_run_on(image) if not _ran_on(request, image) else _no_file(image)
                continue
            entry = {"source": {"file": path.name, "sha256": sha256_of_file(path)}}
            if image.id in earlier and is_intact(earlier[image.id], request.run, entry):
                yield earlier[image.id]
                continue
            write_array(request.run / depth_file(image.scene), planar_depth(path, source, image))
            yield depth_record(image, request.run, entry)
        except LegoWorldError as error:
            (request.run / depth_file(image.scene)).unlink(missing_ok=True)
            yield failed_record(image, error)


def _refuse_unusable(
    request: ImportRequest, source: DepthSource, images: Sequence[TrackImage]
) -> None:
    """Raise the first array's error when not one array is usable, before anything is written."""
    first_error: LegoWorldError | None = None
    for image in images:
        try:
            path = depth_source_file(source, image) if _ran_on(request, image) else None
            if path is not None:
                planar_depth(path, source, image)
                return
        except LegoWorldError as error:
            first_error = first_error or error
    raise first_error or UsageError(
        "the folder has no depth of the track's photos",
        found=f"nothing like {images[0].scene}.npy",
        expected="<file_name without extension>.npy, .npz, .pfm, .exr or .png",
    )


def _no_file(image: TrackImage) -> Record:
    expected = f"{image.scene}.npy, .npz, .pfm, .exr or .png"
    return failed_record(
        image, ResultMissingError("there is no depth file", found="nothing", expected=expected)
    )


def _not_run_on(image: TrackImage) -> Record:
    return failed_record(image, ResultMissingError("not among the images it was run on"))


def _ran_on(request: ImportRequest, image: TrackImage) -> bool:
    return request.ran_on is None or image.id in request.ran_on


def _configuration(
    request: ImportRequest, images: Sequence[TrackImage], imported: Mapping[str, Any]
) -> dict[str, Any]:
    ran_on = sorted(request.ran_on) if request.ran_on is not None else None
    return common_configuration(request.protocol, request.track, images, partial=False) | {
        "baseline": request.name,
        "imported": dict(imported),
        "images_run_sha256": sha256_of_text(canonical_json(ran_on)) if ran_on else None,
        "subset": request.subset,
        "used_truth": None,
    }


def _written(
    request: ImportRequest, records: Sequence[Record], configuration: dict[str, Any]
) -> BaselineResult:
    baseline = {"name": request.name, "imported": configuration["imported"]}
    return write_run(request.run, records, configuration, baseline)
