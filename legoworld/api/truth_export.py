"""Runs over reference scenes as the ground truth of LVIS masks and of panoptic segments.

A scene's labels are complete: what they do not name is not there.
"""

from __future__ import annotations

import shutil
from pathlib import Path

from msgspec.structs import replace

from legoworld.api.coco_export import readable_document, run_coco_document, run_vocabulary
from legoworld.errors import UsageError
from legoworld.evaluation.run import Run, RunUnusableError, read_run
from legoworld.exports.formats import ExportResult
from legoworld.files import canonical_json, write_text
from legoworld.readouts.family import ANSWERS
from legoworld.records.base import UNSET, RecordError, as_json, decode
from legoworld.records.coco_file import PanopticAnswers, PanopticTruthFile
from legoworld.records.track import CategoryInfo, ImageInfo
from legoworld.shipped import catalog
from legoworld.tasks.registry import find_family, require_task
from legoworld.tasks.shipped import PANOPTIC
from legoworld.tracks.vocabulary import find_dataset


def write_lvis(run_folder: Path, output: Path, *, track: Path | None) -> ExportResult:
    """Write a run of LVIS masks as LVIS's JSON: every other category is verified to be absent.

    Raises UsageError for runs of other tasks, and what `export` does of a damaged one.
    """
    run = read_run(run_folder)
    if not require_task(run.task).dataset.federated:
        raise _wrong(run, "LVIS masks")
    document = run_coco_document(run_folder, track=track)
    present: dict[int, set[int]] = {image.id: set() for image in document.images}
    for one in document.annotations:
        present[one.image_id].add(one.category_id)
    ids = [category.id for category in document.categories]
    images = [
        replace(
            image,
            neg_category_ids=tuple(i for i in ids if i not in present[image.id]),
            not_exhaustive_category_ids=(),
        )
        for image in document.images
    ]
    shipped = catalog.folder("datasets") / find_dataset(run.task) / "categories.json"
    groups = {c.id: c.frequency for c in decode(tuple[CategoryInfo, ...], shipped.read_bytes())}
    categories = tuple(replace(c, frequency=groups.get(c.id) or UNSET) for c in document.categories)
    document = replace(document, images=tuple(images), categories=categories)
    write_text(output, readable_document(document))
    return ExportResult(images=len(images), annotations=len(document.annotations))


def write_panoptic(run_folder: Path, output: Path, *, track: Path | None) -> ExportResult:
    """Write a run of segments as panopticapi's truth: panoptic.json and its folder of PNGs.

    Raises UsageError for runs of other tasks, RunUnusableError for an image without a result.
    """
    run = read_run(run_folder)
    if find_family(run.task) != PANOPTIC:
        raise _wrong(run, "panoptic segments")
    lost = [image.file_name for image in run.images if image.status != "ok"]
    if lost:
        raise RunUnusableError(
            "an image without a result is no ground truth",
            found=", ".join(lost[:3]),
            next_step="read its scene out, or leave the image out of the track",
        )
    try:
        answers = decode(PanopticAnswers, (run_folder / ANSWERS).read_bytes())
    except (OSError, RecordError) as error:
        raise RunUnusableError(f"the run's {ANSWERS} cannot be read", found=str(error)) from error
    truth = PanopticTruthFile(
        images=tuple(_image(run, i.image_id) for i in run.images),
        annotations=answers.annotations,
        categories=tuple(
            CategoryInfo(id=c.id, name=c.name, isthing=1 if c.isthing else 0)
            for c in run_vocabulary(run, track).categories
        ),
    )
    shutil.copytree(run_folder / Path(ANSWERS).stem, output / PANOPTIC.name)
    write_text(output / f"{PANOPTIC.name}.json", canonical_json(as_json(truth)) + "\n")
    segments = sum(len(one.segments_info) for one in answers.annotations)
    return ExportResult(images=len(run.images), annotations=segments)


def _image(run: Run, image_id: int) -> ImageInfo:
    one = next(image for image in run.images if image.image_id == image_id)
    assert one.size_wh is not None
    width, height = one.size_wh
    return ImageInfo(id=image_id, file_name=one.file_name, width=width, height=height)


def _wrong(run: Run, wanted: str) -> UsageError:
    return UsageError(
        f"a run of {run.task} has no {wanted}",
        expected=f"a run of {wanted}",
        next_step="docs/exports.md lists the formats of each task",
    )
