"""A results file as a run folder: every box or mask checked before anything is written."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from legoworld.baselines.baseline_import import (
    ImportRequest,
    import_record,
    write_import,
)
from legoworld.baselines.box_formats import (
    BoxFormat,
    check_declared,
    other_formats,
    rephrase_error,
    with_xywh,
)
from legoworld.baselines.category_ids import (
    CategoryIds,
    as_options,
    check_numbering,
    map_category_ids,
    most_frequent,
    other_readings,
    plain_ids,
    readings,
    refuse_doubtful,
)
from legoworld.baselines.foreign_results import Entry
from legoworld.baselines.labels import LabelMap, Matcher
from legoworld.baselines.photo_names import MatchedResults, place
from legoworld.baselines.records import detection_record
from legoworld.baselines.results_file import (
    NamedEntries,
    ResultsFile,
    by_image,
    read_results,
    with_masks,
    with_our_categories,
)
from legoworld.evaluation.detection.inputs.box_formats import BoxFormatError
from legoworld.evaluation.detection.inputs.prediction_checks import (
    PredictionsInvalidError,
    as_predictions,
)
from legoworld.evaluation.detection.inputs.prediction_columns import make_columns
from legoworld.evaluation.detection.inputs.predictions import (
    Predictions,
    check_results,
    prediction_type,
)
from legoworld.evaluation.detection.payloads.amodal import AMODAL
from legoworld.evaluation.detection.payloads.boxes import BOXES
from legoworld.evaluation.detection.payloads.boxes3d import BOXES3D
from legoworld.evaluation.detection.payloads.masks import MASKS
from legoworld.evaluation.detection.protocols import detection_protocol
from legoworld.files import canonical_json, sha256_of_file, sha256_of_text
from legoworld.pluralize import plural, share, word_for
from legoworld.records.run_file import ImageRecord, ImageSource, Imported, ImportedFrom
from legoworld.running.readout_run import RunResult
from legoworld.tracks.track import TrackImage
from legoworld.tracks.vocabulary import Vocabulary

Say = Callable[[str], None]


@dataclass(frozen=True, kw_only=True)
class DetectionSource:
    """A results file and its declarations.

    box_format: None for the default of the file's kind; category_ids: None if undeclared.
    """

    path: Path
    box_format: BoxFormat | None
    labels: LabelMap
    category_ids: CategoryIds | None = None


def import_detections(request: ImportRequest, source: DetectionSource, *, notice: Say) -> RunResult:
    """Import boxes or masks. Nothing is written if any of them is refused."""
    images = list(request.track.images)
    results = read_results(source.path)
    if results.n_float_ids:
        n = plural(results.n_float_ids, "prediction", "predictions")
        notice(f"{n} with ids written as fractions, such as 139.0: read as whole numbers")
    box_format = source.box_format or results.box_format or "xywh"
    placed = place(results.entries, results.images, images, subset=request.subset)
    _say_placed(placed, len(results.entries), notice)
    named = _resolve_categories(request, source, results, placed)
    checked = _check_predictions(request, box_format, named.entries, notice)
    if source.category_ids is None and named.by_id and not results.of_torchvision:
        all_ids = named.by_id.total() == len(placed.entries)
        ids = plain_ids(results.entries) if all_ids else named.by_id
        refuse_doubtful(ids, *_of_dataset(request))
    _say_categories(request, source, named, checked, notice)
    groups = by_image(checked.entries)
    imported = Imported(
        file=source.path.name,
        sha256=sha256_of_file(source.path),
        box_format=box_format if _dialect(request).uses_boxes else None,
        image_ids=placed.by,
        category_ids=source.category_ids or "dataset" if named.by_id else "names",
        label_map_sha256=sha256_of_text(canonical_json(source.labels)),
        left_out=named.left_out,
        empty_masks_dropped=checked.n_dropped_empty,
    )

    def record(image: TrackImage) -> ImageRecord:
        entries = make_columns(groups.get(image.id, ()))
        own = Predictions(entries=entries, warnings=(), n_dropped_empty=0)
        return detection_record(image, own, ImageSource(source=ImportedFrom(file=source.path.name)))

    return write_import(
        request, imported, lambda _earlier: (import_record(request, i, record) for i in images)
    )


def _say_placed(matches: MatchedResults, of: int, notice: Say) -> None:
    if matches.by == "file_names":
        notice("images are matched by file name")
    if matches.left_out:
        n_kept = of - matches.left_out
        kept, are = share(n_kept, of, "prediction", "predictions"), word_for(n_kept, "is", "are")
        notice(f"{kept} {are} of the track's images; the rest is ignored")


def _resolve_categories(
    request: ImportRequest, source: DetectionSource, results: ResultsFile, matches: MatchedResults
) -> NamedEntries:
    """Entries with the vocabulary's category ids: by name, or by the declared numbering."""
    vocabulary = request.protocol.vocabulary
    assert vocabulary is not None
    known = None
    if source.category_ids is not None:
        known = map_category_ids(source.category_ids, vocabulary, request.protocol.task.name)
    matcher = Matcher(vocabulary, source.labels)
    named = with_our_categories(results, matches.entries, matcher, known)
    if source.category_ids is not None and known is not None:
        check_numbering(named.by_id, known, source.category_ids)
    return named


def _say_categories(
    request: ImportRequest,
    source: DetectionSource,
    named_entries: NamedEntries,
    predictions: Predictions,
    notice: Say,
) -> None:
    """Report dropped labels, the predicted categories, and doubts about the ids' meaning."""
    vocabulary = request.protocol.vocabulary
    assert vocabulary is not None
    for label, count in named_entries.left_out.items():
        left = plural(count, "prediction", "predictions")
        notice(f"label {label!r}: {left} left out, as the label map says")
    if predictions.entries:
        notice(most_frequent(predictions.entries.category_id.tolist(), vocabulary))
    if source.category_ids is None:
        return
    if not named_entries.by_id:
        notice(f"the file names its categories: --category-ids {source.category_ids} is not used")
    elif others := other_readings(source.category_ids, named_entries.by_id, *_of_dataset(request)):
        notice(others)


def _of_dataset(request: ImportRequest) -> tuple[Vocabulary, str]:
    assert request.protocol.vocabulary is not None
    return request.protocol.vocabulary, request.protocol.task.name


def _check_predictions(
    request: ImportRequest,
    box_format: BoxFormat,
    as_given: Sequence[Entry],
    notice: Say,
) -> Predictions:
    """Entries after all checks of scoring, with errors rephrased for the import's options.

    as_given: entries with the file's own boxes.
    """
    images, sizes_wh = request.track.images, _sizes_wh(request.track.images)
    vocabulary, task = request.protocol.vocabulary, request.protocol.task.name
    assert vocabulary is not None
    protocol = detection_protocol(task)
    dialect = _dialect(request)
    entries = [with_xywh(entry, box_format) for entry in as_given]
    entries = dialect.prepare(entries, sizes_wh, notice)
    try:
        checked = check_results(
            [as_predictions(entries, prediction_type(protocol))],
            status_by_image={i.id: "ok" if request.was_run_on(i) else "missing" for i in images},
            sizes_wh=sizes_wh,
            vocabulary=vocabulary,
            protocol=protocol,
            order="given",
        )
    except BoxFormatError as error:
        others = other_formats(as_given, sizes_wh, box_format)
        raise rephrase_error(error, box_format, others) from error
    except PredictionsInvalidError as error:
        if not error.next_step.endswith("map categories by name"):
            raise
        meant = readings(plain_ids(as_given), vocabulary, task)
        raise _with_options(error, meant) from error
    if dialect.uses_boxes:
        check_declared(as_given, sizes_wh, box_format)
    for warning in checked.warnings:
        notice(warning)
    return checked


def _with_options(
    error: PredictionsInvalidError, meant: Mapping[CategoryIds, str]
) -> PredictionsInvalidError:
    """An error about category ids, extended by the options that declare them."""
    declare = f", or pass {as_options(meant)}" if meant else ""
    return PredictionsInvalidError(
        error.what,
        found=error.found,
        expected=error.expected,
        next_step=f"{error.next_step}, with --label-map FILE{declare}",
    )


def _as_given(
    entries: list[Entry], _sizes_wh: Mapping[int, tuple[int, int]], _notice: Say
) -> list[Entry]:
    return entries


def _fill_polygons(
    entries: list[Entry], sizes_wh: Mapping[int, tuple[int, int]], notice: Say
) -> list[Entry]:
    """Polygons as masks."""
    entries, filled = with_masks(entries, sizes_wh)
    if filled:
        notice(f"{plural(filled, 'mask', 'masks')} of polygons, filled as pycocotools does")
    return entries


def _filled_amodal(
    entries: list[Entry], sizes_wh: Mapping[int, tuple[int, int]], notice: Say
) -> list[Entry]:
    """Polygons as masks, also of visible parts, which KINS calls inmodal_seg."""
    named = [{"visible_mask": e["inmodal_seg"], **e} if "inmodal_seg" in e else e for e in entries]
    return with_masks(_fill_polygons(named, sizes_wh, notice), sizes_wh, "visible_mask")[0]


@dataclass(frozen=True, kw_only=True)
class _Dialect:
    """How results of others are read. uses_boxes: whether boxes and their format count."""

    uses_boxes: bool
    prepare: Callable[[list[Entry], Mapping[int, tuple[int, int]], Say], list[Entry]]


#: By the payload's name.
_DIALECTS: Final = {
    BOXES.name: _Dialect(uses_boxes=True, prepare=_as_given),
    MASKS.name: _Dialect(uses_boxes=False, prepare=_fill_polygons),
    AMODAL.name: _Dialect(uses_boxes=False, prepare=_filled_amodal),
    BOXES3D.name: _Dialect(uses_boxes=False, prepare=_as_given),
}


def _dialect(request: ImportRequest) -> _Dialect:
    return _DIALECTS[detection_protocol(request.protocol.task.name).payload.name]


def _sizes_wh(images: Sequence[TrackImage]) -> dict[int, tuple[int, int]]:
    return {i.id: i.size_wh for i in images if i.size_wh is not None}
