"""Private ground truth: COCO instances and LVIS JSON, checked and reduced to a run's images."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Any, cast

from legoworld.errors import LegoWorldError, cause
from legoworld.evaluation.detection.inputs.truth_checks import (
    Foreign,
    TruthInvalidError,
    check_annotations,
    check_image_values,
    check_images,
)
from legoworld.evaluation.detection.protocols import DetectionProtocol
from legoworld.evaluation.run import Run
from legoworld.pluralize import plural, share, word_for
from legoworld.records.base import RecordError, read_json
from legoworld.records.run_rows import RunImage
from legoworld.tracks.vocabulary import Vocabulary, dataset_version, from_json


class TruthMismatchError(LegoWorldError):
    """Ground truth and run have different images, categories or versions."""

    code = "truth_mismatch"


@dataclass(frozen=True, kw_only=True)
class Truth:
    """The ground truth of a run's images.

    images, annotations, categories: as in the file, in its order, annotations numbered from 1.
    version: the dataset's, such as "1.0" or "0.5" for LVIS. warnings: counted repairs.
    """

    images: tuple[dict[str, Any], ...]
    annotations: tuple[dict[str, Any], ...]
    categories: tuple[dict[str, Any], ...]
    vocabulary: Vocabulary
    version: str
    warnings: tuple[str, ...]

    @cached_property
    def by_image(self) -> dict[int, tuple[dict[str, Any], list[dict[str, Any]]]]:
        """The image and its annotations, by image id."""
        found: dict[int, tuple[dict[str, Any], list[dict[str, Any]]]] = {
            image["id"]: (image, []) for image in self.images
        }
        for annotation in self.annotations:
            found[annotation["image_id"]][1].append(annotation)
        return found

    @cached_property
    def sizes_wh(self) -> dict[int, tuple[int, int]]:
        """Width and height of each image by id."""
        return {image["id"]: (image["width"], image["height"]) for image in self.images}

    def document(self) -> dict[str, Any]:
        """A COCO-style document that an evaluator may modify: nothing in it is shared."""
        return {
            "info": {},
            "images": [dict(i) for i in self.images],
            "annotations": [dict(a) for a in self.annotations],
            "categories": [dict(c) for c in self.categories],
        }


def select_images(truth: Truth, image_ids: Collection[int]) -> Truth:
    """The truth of some of its images, as if no other were in the file.

    TruthMismatchError for an image that it lacks.
    """
    images = [truth.by_image.get(image_id) for image_id in sorted(image_ids)]
    if not all(images):
        unknown = sorted(set(image_ids) - set(truth.by_image))
        raise TruthMismatchError(
            f"{share(len(unknown), len(image_ids), 'image', 'images')} "
            f"{word_for(len(unknown), 'is', 'are')} not in the truth",
            found=f"image {unknown[0]}",
            expected=f"one of its {plural(len(truth.by_image), 'image', 'images')}",
        )
    chosen = [image for image in images if image]
    own = [annotation for _, annotations in chosen for annotation in annotations]
    own.sort(key=lambda annotation: int(annotation["id"]))
    return replace(
        truth,
        images=tuple(image for image, _ in chosen),
        annotations=tuple({**entry, "id": n} for n, entry in enumerate(own, start=1)),
    )


def read_truth(path: Path, protocol: DetectionProtocol, run: Run | None = None) -> Truth:
    """Read the ground truth of a run's images, or of every image of a file.

    TruthInvalidError: the file is broken. TruthMismatchError: its images, categories or version
    differ from the run's.
    """
    document = _document(path, protocol)
    vocabulary = from_json(document["categories"], str(path))
    version = dataset_version(vocabulary, protocol.task)
    repairs: Counter[str] = Counter()
    if run is not None:
        _check_vocabulary(path, vocabulary, version, run)
    all_images = check_images(str(path), document["images"], repairs)
    if run is not None:
        images = _select_run_images(path, all_images, run)
    else:
        images = [all_images[image_id] for image_id in sorted(all_images)]
    check_image_values(str(path), images, federated=protocol.federated)
    annotations = check_annotations(
        str(path),
        document["annotations"],
        images=all_images,
        wanted=[int(cast("int", image["id"])) for image in images],
        category_ids=frozenset([c.id for c in vocabulary.categories]),
        check_shapes=protocol.payload.check_shapes,
        repairs=repairs,
    )
    if protocol.payload.check_format is not None:
        protocol.payload.check_format(str(path), annotations, all_images, repairs)
    if protocol.federated:
        _check_frequencies(path, document["categories"])
    return Truth(
        images=tuple(images),
        annotations=tuple(_number_annotations(annotations, protocol, repairs)),
        categories=tuple(sorted(document["categories"], key=lambda c: int(c["id"]))),
        vocabulary=vocabulary,
        version=version,
        warnings=tuple(f"{count} {what}" for what, count in sorted(repairs.items())),
    )


def _document(path: Path, protocol: DetectionProtocol) -> dict[str, Any]:
    try:
        document = read_json(path.read_bytes())
    except (OSError, RecordError) as error:
        raise TruthInvalidError(
            f"the truth {path} cannot be read",
            found=cause(error),
            expected="COCO instances or LVIS JSON",
        ) from error
    if protocol.payload.document is not None:
        document = protocol.payload.document(document, str(path))
    for key in ("images", "annotations", "categories"):
        if not isinstance(document, dict) or not isinstance(document.get(key), list):
            raise TruthInvalidError(
                f"the truth {path} has no {key}",
                found=f"keys {sorted(document)[:8]}" if isinstance(document, dict) else "no object",
                expected="COCO instances or LVIS JSON with images, annotations and categories",
                next_step="a track is no truth: pass the dataset's own annotation file",
            )
    checked: dict[str, Any] = document
    return checked


def _check_vocabulary(path: Path, vocabulary: Vocabulary, version: str, run: Run) -> None:
    expected = run.configuration.vocabulary_sha256
    if vocabulary.sha256 == expected:
        return
    raise TruthMismatchError(
        "run and truth have different categories",
        found=f"{path}: {plural(len(vocabulary.categories), 'category', 'categories')}, "
        f"version {version}, {vocabulary.sha256[:12]}",
        expected=f"the run's vocabulary, {str(expected)[:12]}",
        next_step="make the track from this truth with `legoworld track make` and run with it",
    )


def _select_run_images(path: Path, by_id: Mapping[int, Foreign], run: Run) -> list[Foreign]:
    """The ground truth's entries of the run's images, by ascending id."""
    unknown = [i for i in run.images if i.image_id not in by_id]
    if unknown:
        raise TruthMismatchError(
            f"{share(len(unknown), len(run.images), 'image', 'images')} of the run "
            f"{word_for(len(unknown), 'is', 'are')} not in the truth",
            found=f"image {unknown[0].image_id} ({unknown[0].file_name}) is not in {path}",
            expected="every image of the track in the truth",
            next_step="pass the truth the track was made from",
        )
    for image in run.images:
        _check_same_photo(path, image, by_id[image.image_id])
    return [by_id[image.image_id] for image in run.images]


def _check_same_photo(path: Path, image: RunImage, entry: Foreign) -> None:
    names = {PurePosixPath(str(entry[k])).name for k in ("file_name", "coco_url") if entry.get(k)}
    size_wh = (entry.get("width"), entry.get("height"))
    if PurePosixPath(image.file_name).name not in names:
        raise TruthMismatchError(
            f"image {image.image_id} is another photo in the truth",
            found=f"{sorted(names)} in {path}",
            expected=f"{image.file_name}, as in the run",
            next_step="score a run whose track was made from this truth",
        )
    if image.size_wh is not None and image.size_wh != size_wh:
        raise TruthMismatchError(
            f"image {image.image_id} has another size in the truth",
            found=f"{size_wh[0]}x{size_wh[1]} in {path}",
            expected=f"{image.size_wh[0]}x{image.size_wh[1]}, as in the run",
        )


def _number_annotations(
    annotations: Sequence[Foreign], protocol: DetectionProtocol, repairs: Counter[str]
) -> list[Foreign]:
    """Annotations numbered from 1 in file order: the official evaluator takes 0 for unmatched."""
    numbered = []
    for number, entry in enumerate(annotations, start=1):
        if entry["id"] == 0:
            repairs["annotation id 0, which the official evaluator takes for unmatched"] += 1
        copy = {**entry, "id": number}
        if not protocol.federated and "iscrowd" not in entry:
            repairs["annotations without iscrowd, taken as 0"] += 1
            copy["iscrowd"] = 0
        numbered.append(copy)
    return numbered


def _check_frequencies(path: Path, categories: Sequence[Foreign]) -> None:
    bad = [c for c in categories if c.get("frequency") not in ("r", "c", "f")]
    if bad:
        raise TruthInvalidError(
            f"{plural(len(bad), 'category', 'categories')} of {path} have no frequency group",
            found=f"{bad[0]['name']}: {bad[0].get('frequency')!r}",
            expected="r, c or f on each, as LVIS has them",
        )
