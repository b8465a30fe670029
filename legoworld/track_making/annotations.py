"""Tracks from COCO-style annotation files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from legoworld.cards import load_card
from legoworld.errors import CatalogError, UsageError, cause
from legoworld.evaluation.detection.inputs.truth_checks import (
    check_annotations,
    check_image_values,
    check_images,
)
from legoworld.evaluation.detection.payloads.masks import MASKS
from legoworld.evaluation.detection.protocols import PAYLOADS
from legoworld.files import sha256_of_file
from legoworld.records.base import RecordError, read_json, to_record
from legoworld.records.track import PRIVATE_KEYS, ImageInfo
from legoworld.tasks.registry import require_task
from legoworld.track_making.family import TrackFamily
from legoworld.tracks.track import Source
from legoworld.tracks.vocabulary import categories_in, dataset_version, make_vocabulary

#: The allowed keys of an image. LVIS's lists of verified categories count as annotations.
_PUBLIC_KEYS: Final = tuple(key for key in ImageInfo.__struct_fields__ if key not in PRIVATE_KEYS)


def annotation_source(task: str, path: Path) -> Source:
    """The public half of a COCO-style annotation file.

    Its annotations, if any, get the same checks as in scoring: TruthInvalidError. UsageError for a
    folder, CatalogError for another file.
    """
    if path.is_dir():
        raise UsageError(
            "the ground truth is a folder",
            found=str(path),
            expected="a COCO or LVIS annotation file",
        )
    # Families of other answers may read anything of an annotation.
    payload = PAYLOADS.get(load_card(task).reads, MASKS)
    try:
        document = read_json(path.read_bytes())
        if payload.document is not None:
            document = payload.document(document, str(path))
        entries, _ = document["images"], document["categories"]
    except (OSError, RecordError, KeyError, TypeError) as error:
        raise CatalogError(
            f"{path} cannot be read",
            found=cause(error)
            if isinstance(error, RecordError)
            else f"{type(error).__name__}: {error}",
            expected="COCO or LVIS JSON with images and categories",
        ) from error
    categories = categories_in(document["categories"], str(path))
    vocabulary = make_vocabulary(categories, str(path))
    if not isinstance(entries, list):
        raise CatalogError(
            f"{path} lists no images", found=type(entries).__name__, expected="a list"
        )
    images = check_images(str(path), entries, Counter())
    _check_dataset(task, path, list(images.values()))
    annotations = document.get("annotations")
    if isinstance(annotations, list):
        check_image_values(
            str(path), list(images.values()), federated=require_task(task).dataset.federated
        )
        check_annotations(
            str(path),
            annotations,
            images=images,
            wanted=images,
            category_ids=frozenset(c.id for c in categories),
            check_shapes=payload.check_shapes,
            repairs=Counter(),
        )
    public = [{key: e[key] for key in _PUBLIC_KEYS if key in e} for e in images.values()]
    try:
        infos = to_record(tuple[ImageInfo, ...], public)
    except RecordError as error:
        raise CatalogError(
            f"{path} has images that cannot be used",
            found=str(error),
            expected='"images": [{"id", "file_name" or "coco_url", "width", "height"}]',
        ) from error
    return Source(
        name=path.name,
        version=dataset_version(vocabulary, task),
        sha256=sha256_of_file(path),
        images=infos,
        categories=categories,
    )


def _check_dataset(task: str, path: Path, entries: Sequence[Mapping[str, Any]]) -> None:
    """LVIS lists verified categories on every image, COCO on none."""
    federated = [e for e in entries if "neg_category_ids" in e]
    if len(federated) != (len(entries) if require_task(task).dataset.federated else 0):
        raise CatalogError(
            f"{path} is not ground truth of {task}",
            found=f"{len(federated)} of {len(entries)} images have neg_category_ids",
            expected="all of them in LVIS, none in COCO",
            next_step="pass the --task this file belongs to",
        )


TRACK: Final = TrackFamily(source=lambda task, truth, _options: annotation_source(task, truth))
