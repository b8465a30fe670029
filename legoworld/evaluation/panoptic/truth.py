"""Panoptic ground truth: the JSON file of panopticapi and its folder of PNGs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from legoworld.cards import Card
from legoworld.errors import LegoWorldError, cause
from legoworld.evaluation.label_maps.family import MapTruth, MapTruthError
from legoworld.evaluation.run import Run
from legoworld.records.base import RecordError, decode, find_repeated
from legoworld.records.coco_file import PanopticAnnotation, PanopticTruthFile, SegmentInfo
from legoworld.records.run_rows import RunImage
from legoworld.tracks.vocabulary import make_vocabulary


@dataclass(frozen=True, kw_only=True)
class TrueSegments:
    """One image's ground truth: its PNG, its segments as the file lists them, and its size."""

    path: Path
    segments: tuple[SegmentInfo, ...]
    size_wh: tuple[int, int]


def read_truth(path: Path) -> PanopticTruthFile:
    """A JSON file of ground truth. MapTruthError for any other file."""
    try:
        document = decode(PanopticTruthFile, path.read_bytes())
    except (OSError, RecordError) as error:
        raise MapTruthError(
            f"{path.name} is no panoptic ground truth",
            found=cause(error),
            expected="JSON of images, categories with isthing, and annotations with segments_info",
        ) from error
    known = {category.id for category in document.categories}
    for entry in document.annotations:
        check_listed(entry, known, MapTruthError)
    return document


def check_listed(
    entry: PanopticAnnotation, category_ids: set[int], error: type[LegoWorldError]
) -> None:
    """Raise the error for segments of an image that cannot be told apart, or have no category."""
    strange = sorted({s.category_id for s in entry.segments_info} - category_ids)
    twice = find_repeated([s.id for s in entry.segments_info])
    if strange or twice:
        what = f"category {strange[0]}" if strange else f"segment {twice[0]} twice"
        raise error(
            f"the segments of image {entry.image_id} cannot be used",
            found=what,
            expected="different ids, and categories of the vocabulary",
        )


def find_segments(path: Path, run: Run, _card: Card) -> MapTruth:
    """The ground truth of a run's images. MapTruthError."""
    document = read_truth(path)
    return MapTruth(
        vocabulary=make_vocabulary(document.categories, str(path)),
        images=true_segments(path, document, run.images),
        inputs=[("truth", path), *pictures(path, document, run.images)],
    )


def true_segments(
    path: Path, document: PanopticTruthFile, images: Sequence[RunImage]
) -> dict[int, TrueSegments]:
    """What the file says of these images, those that it has. PNGs lie in the folder of its name."""
    wanted, folder = {image.image_id for image in images}, path.with_suffix("")
    sizes = {image.id: (image.width, image.height) for image in document.images}
    return {
        entry.image_id: TrueSegments(
            path=folder / entry.file_name,
            segments=entry.segments_info,
            size_wh=sizes[entry.image_id],
        )
        for entry in document.annotations
        if entry.image_id in wanted and entry.image_id in sizes
    }


def pictures(
    path: Path, document: PanopticTruthFile, images: Sequence[RunImage]
) -> list[tuple[str, Path]]:
    """The PNGs of these images as inputs. MapTruthError where one is not there."""
    files = [one.path for one in true_segments(path, document, images).values()]
    absent = next((file for file in files if not file.is_file()), None)
    if absent is not None:
        raise MapTruthError(
            "a PNG of the ground truth is missing",
            found=f"no {absent.name}",
            expected=f"the PNGs of {path.name} in {path.with_suffix('').name}/ beside it",
        )
    return [("truth_png", file) for file in files]
