"""Runs and views as complete COCO JSON: images, categories, and annotations with a score."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from pathlib import Path, PurePath
from typing import Any, Literal

from legoworld.api.arguments import check_argument, check_arguments
from legoworld.api.scene_view import SceneView
from legoworld.api.settings import open_track
from legoworld.conventions import EQUAL_CONFIDENCE
from legoworld.errors import UsageError
from legoworld.evaluation.detection.inputs.box_formats import check_box_values
from legoworld.evaluation.detection.inputs.masks import (
    EncodedMask,
    areas_px,
    bounding_box,
    compress_mask,
)
from legoworld.evaluation.detection.inputs.prediction_columns import PredictionColumns
from legoworld.evaluation.detection.inputs.prediction_order import configured_order
from legoworld.evaluation.detection.inputs.predictions import (
    Predictions,
    check_results,
    prediction_type,
)
from legoworld.evaluation.detection.payloads.amodal import AMODAL
from legoworld.evaluation.detection.payloads.boxes3d import BOXES3D
from legoworld.evaluation.detection.protocols import detection_protocol
from legoworld.evaluation.run import (
    Run,
    RunUnusableError,
    read_predictions,
    read_rows,
    read_run,
)
from legoworld.files import refuse_existing, write_text
from legoworld.records.base import UNSET, Record, canonical, readable
from legoworld.records.coco_file import (
    CocoAnnotation,
    CocoCategory,
    CocoFile,
    CocoImage,
    CocoInfo,
    ObjectNames,
)
from legoworld.records.predictions import Box, Prediction, Rle
from legoworld.shipped import catalog
from legoworld.tasks.registry import family_tasks, find_family
from legoworld.tasks.shipped import DETECTION
from legoworld.tracks.track import Track
from legoworld.tracks.vocabulary import Category, Vocabulary, find_dataset, load


@check_arguments
def export(
    run_or_views: str | Path | Iterable[SceneView],
    output: str | Path,
    *,
    format: Literal["coco", "kins"] = "coco",  # noqa: A002  as the command calls it
    track: Track | str | Path | None = None,
    overwrite: bool = False,
) -> CocoFile:
    """Write a dataset file for other tools; return the document.

    run_or_views: a run's folder, whose predictions become annotations; or views of one task, which
    are taken one by one: an image each, numbered from 1 and named by its camera, with the masks,
    boxes and areas of its `labelled`. output: the file, or a folder that gets annotations.json.
    format: kins adds the visible parts of amodal masks to a run's, in KINS's fields. track: source
    of a run's category names if they are not the shipped dataset's. overwrite: replace the file.

    Raises UsageError, RunUnusableError or PredictionsInvalidError; nothing is written then.
    """
    check_argument("folder", output)
    if format not in ("coco", "kins"):
        raise UsageError(f"unknown format {format!r}"[:100], expected="coco or kins")
    file = Path(output)
    if isinstance(run_or_views, str | Path):
        refuse_existing(file, overwrite=overwrite)
        document = run_coco_document(Path(run_or_views), visible=format == "kins", track=track)
    else:
        if file.suffix != ".json":
            file.mkdir(parents=True, exist_ok=True)
            file /= "annotations.json"
        refuse_existing(file, overwrite=overwrite)
        document = _document_of_views(run_or_views)
    write_text(file, readable_document(document))
    return document


def _document_of_views(views: Iterable[SceneView]) -> CocoFile:
    images: list[CocoImage] = []
    annotations: list[CocoAnnotation] = []
    of: tuple[str | None, Vocabulary] | None = None
    for image_id, view in enumerate(views, start=1):
        vocabulary = view.vocabulary
        if vocabulary is None or (of is not None and (view.task, vocabulary) != of):
            raise UsageError(
                "views are exported with the categories of one task",
                found=f"a view {image_id} of {view.task or 'no task'}",
                expected="views(task=...)",
            )
        of = view.task, vocabulary
        (width, height), name = view.size_wh, view.camera.name
        images.append(
            CocoImage(
                id=image_id,
                file_name=name if PurePath(name).suffix else f"{name}.png",
                width=width,
                height=height,
            )
        )
        for row, rle in zip(view.labelled, view.rles(), strict=True):
            assert row.category_id is not None
            annotations.append(
                CocoAnnotation(
                    id=len(annotations) + 1,
                    image_id=image_id,
                    category_id=row.category_id,
                    bbox=row.bbox_xywh_px,
                    area=float(row.area_px),
                    segmentation=rle,
                    iscrowd=0,
                    score=EQUAL_CONFIDENCE,
                    attributes=ObjectNames(name=row.name, objects=row.objects),
                )
            )
        del view
    if of is None:
        raise UsageError("there is no view to export", expected="one or more")
    task, vocabulary = of
    return CocoFile(
        info=CocoInfo(
            description=f"legoworld views of {task or 'a track'}: instances as annotations",
            task=task or "",
            vocabulary_sha256=vocabulary.sha256,
            images_without_result=(),
        ),
        images=tuple(images),
        annotations=tuple(annotations),
        categories=tuple(CocoCategory(id=c.id, name=c.name) for c in vocabulary.categories),
    )


def run_coco_document(
    run_folder: Path, *, visible: bool = False, track: Track | str | Path | None = None
) -> CocoFile:
    """A run of boxes or masks as a dataset for other tools.

    visible: with the visible parts of amodal masks, in KINS's fields. track: source of the
    category names if they are not the shipped dataset's; without it a scene's run gives the
    categories that it predicts. Raises UsageError for a depth run, unknown names or visible parts
    of other masks, RunUnusableError or PredictionsInvalidError for a damaged run.
    """
    source = read_run(run_folder)
    if find_family(source.task) != DETECTION:
        raise UsageError(
            f"a run of {source.task} has no boxes or masks",
            expected=f"a run of {', '.join(task.name for task in family_tasks(DETECTION))}",
            next_step="docs/exports.md lists the formats of each task",
        )
    if visible and detection_protocol(source.task).payload is not AMODAL:
        raise UsageError(
            f"a run of {source.task} has no amodal masks", next_step="pass --format coco"
        )
    if detection_protocol(source.task).payload is BOXES3D:
        raise UsageError(
            f"a run of {source.task} has boxes in space, which COCO has no place for",
            next_step="pass --format omni3d or --format kitti",
        )
    vocabulary = run_vocabulary(source, track)
    images = [_image(i.image_id, i.file_name, i.size_wh) for i in source.images]
    predictions = _predictions(source, vocabulary)
    return CocoFile(
        info=CocoInfo(
            description=f"legoworld run of {source.task}: predictions as annotations",
            task=source.task,
            vocabulary_sha256=source.configuration.vocabulary_sha256 or vocabulary.sha256,
            images_without_result=tuple(i.image_id for i in source.images if i.status != "ok"),
        ),
        images=tuple(images),
        annotations=tuple(_annotations(source, predictions, visible=visible)),
        categories=tuple(CocoCategory(id=c.id, name=c.name) for c in vocabulary.categories),
    )


def run_vocabulary(run: Run, track: Track | str | Path | None) -> Vocabulary:
    """The categories of the run: the track's, a shipped dataset's, or those of its own labels.

    Raises UsageError where none of them is the run's vocabulary.
    """
    expected = run.configuration.vocabulary_sha256
    vocabulary = open_track(track).vocabulary if track is not None else None
    if vocabulary is None:
        datasets = catalog.folder("datasets")
        own = load(datasets / find_dataset(run.task) / "categories.json")
        others = (load(file) for file in sorted(datasets.glob("*/categories.json")))
        vocabulary = next((one for one in chain([own], others) if one.sha256 == expected), own)
    if vocabulary.sha256 == expected:
        return vocabulary
    named = track is None and find_family(run.task) == DETECTION
    exported = _exported_categories(run) if named else None
    if exported is None:
        raise UsageError(
            "the names of the run's categories are unknown",
            found=f"{len(vocabulary.categories)} categories, {vocabulary.sha256[:12]}",
            expected=f"the run's vocabulary, {str(expected)[:12]}",
            next_step="pass --track with the track the run was made for",
        )
    return exported


def _exported_categories(run: Run) -> Vocabulary | None:
    """The categories of a scene's predictions, named by the rows; None where rows name none."""
    named = {row.image_id: iter(row.exported or ()) for row in read_rows(run)}
    kind = prediction_type(detection_protocol(run.task))
    ids = sorted({p.category_id for batch in read_predictions(run, kind) for p in batch})
    if not ids:
        return None
    names: dict[int, str] = {}
    unnamed = Vocabulary(tuple(Category(id=i, name=str(i)) for i in ids))
    for prediction in _predictions(run, unnamed).entries:  # in the order of the rows' names
        one = next(named.get(prediction.image_id, iter(())), None)
        if one is None or not one.category:
            return None
        names[prediction.category_id] = one.category
    return Vocabulary(tuple(Category(id=i, name=names[i]) for i in ids))


def _image(image_id: int, file_name: str, size_wh: tuple[int, int] | None) -> CocoImage:
    if size_wh is None:
        raise RunUnusableError(
            f"image {image_id} of the run has no size",
            found=f"{file_name}, read without a track",
            expected="a width and height for every image",
            next_step="make the run with --track",
        )
    return CocoImage(id=image_id, file_name=file_name, width=size_wh[0], height=size_wh[1])


def _predictions(run: Run, vocabulary: Vocabulary) -> Predictions:
    return check_results(
        read_predictions(run, prediction_type(detection_protocol(run.task))),
        status_by_image={i.image_id: i.status for i in run.images},
        sizes_wh={i.image_id: i.size_wh for i in run.images if i.size_wh is not None},
        vocabulary=vocabulary,
        protocol=detection_protocol(run.task),
        order=configured_order(run.configuration),
        check_boxes=check_box_values,
    )


def _annotations(run: Run, predictions: Predictions, *, visible: bool) -> Iterator[CocoAnnotation]:
    """Predictions numbered from 1 in the run's order; a scene's with the names of their objects."""
    names = _objects(run)
    place: dict[int, int] = {}
    for number, (result, (box, area)) in enumerate(
        zip(predictions.entries, _extents(predictions.entries), strict=True), start=1
    ):
        image_id = result.image_id
        nth = place[image_id] = place.get(image_id, -1) + 1
        yield CocoAnnotation(
            id=number,
            image_id=image_id,
            category_id=result.category_id,
            bbox=box,
            area=area,
            segmentation=result.segmentation or (),
            iscrowd=0,
            score=result.score,
            attributes=names[image_id][nth] if image_id in names else UNSET,
            **_visible_part(result, area) if visible else {},
        )


def _visible_part(result: Prediction, area: float) -> dict[str, Any]:
    if not result.visible_mask:
        return {}
    mask = _mask(result.visible_mask)
    shown = float(areas_px([mask])[0])
    return {
        "inmodal_seg": result.visible_mask,
        "inmodal_bbox": bounding_box(mask),
        "a_area": area,
        "i_area": shown,
        "occlude_rate": max(area - shown, 0.0) / area if area else 0.0,
    }


def _objects(run: Run) -> dict[int, list[ObjectNames]]:
    """Name and objects of every prediction, in order, for images whose row records them."""
    return {
        row.image_id: [ObjectNames(name=one.name, objects=one.objects) for one in row.exported]
        for row in read_rows(run)
        if row.exported and len(row.exported) == row.n_predictions
    }


def _extents(predictions: PredictionColumns) -> list[tuple[Box, float]]:
    """Box and area of each prediction: a mask's extent and pixel count, a box's width x height."""
    if predictions.sizes_wh is not None:
        masks = [_mask(p.segmentation) for p in predictions if p.segmentation]
        return list(zip(map(bounding_box, masks), areas_px(masks).tolist(), strict=True))
    boxes = [p.bbox for p in predictions if p.bbox]
    return [(box, float(box[2] * box[3])) for box in boxes]


def _mask(rle: Rle) -> EncodedMask:
    return compress_mask({"size": [*rle.size], "counts": rle.counts}, rle.size)


def readable_document(document: CocoFile) -> str:
    """JSON with one image, annotation or category per line."""
    info = readable(document.info).rstrip().replace("\n", "\n ")
    parts: tuple[tuple[str, Sequence[Record]], ...] = (
        ("images", document.images),
        ("annotations", document.annotations),
        ("categories", document.categories),
    )
    lists = [f'"{key}": [\n' + ",\n".join(map(canonical, part)) + "\n]" for key, part in parts]
    return "{\n" + ",\n".join([f'"info": {info}', *lists]) + "\n}\n"
