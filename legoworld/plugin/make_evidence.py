"""`legoworld plugin evidence`: what providers say about a photo, gathered into one folder.

Nothing here reads ground truth: regions are an agent's own outlines or a model's results.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.files import sha256_of_file, write_text
from legoworld.plugin.evidence import (
    EVIDENCE,
    Evidence,
    EvidenceInvalidError,
    check_run_lengths,
)
from legoworld.plugin.evidence_camera import (
    camera_evidence,
    camera_problem,
    read_camera,
    unusable_camera,
)
from legoworld.plugin.evidence_depth import GivenDepth, write_depth
from legoworld.plugin.evidence_runs import RunEvidence, of_run
from legoworld.readouts.masks import MOST_COORDINATE_PX, are_near
from legoworld.readouts.pictures import read_photo
from legoworld.records.base import UNSET, Record, RecordError, UnsetType, decode, readable
from legoworld.records.plugin_evidence import (
    CameraEvidence,
    DepthEvidence,
    DepthSpace,
    EvidenceFile,
    Outlines,
    PhotoEvidence,
    ProviderCamera,
    ProviderRecord,
    Region,
)
from legoworld.tracks.vocabulary import Vocabulary

#: Regions of a model below this confidence are mostly noise.
LEAST_SCORE: Final = 0.3
#: A provider's camera, in pixels of the photo; `evidence.json` has the part that is used.
CAMERA: Final = "camera.json"


class _NoPixelError(EvidenceInvalidError):
    """A region has no pixel."""


class RunLength(Record, frozen=True, kw_only=True):
    """COCO's compressed RLE."""

    size: tuple[int, int]
    counts: str


class Detection(Record, frozen=True, kw_only=True):
    """One entry of a COCO or LVIS results file. visible_mask: what is seen of an amodal mask."""

    image_id: int
    category_id: int
    score: float
    bbox: tuple[float, float, float, float] | UnsetType = UNSET
    segmentation: RunLength | list[list[float]] | UnsetType = UNSET
    visible_mask: RunLength | UnsetType = UNSET


@dataclass(frozen=True, kw_only=True)
class BaselineEvidence:
    """A baseline's answers for the photo; None if it gave none."""

    record: ProviderRecord
    camera: ProviderCamera
    depth: GivenDepth | None


@dataclass(frozen=True, kw_only=True)
class UserEvidence:
    """Evidence from the user. regions: JSON file of outlines or results; depth: an array.

    image_id: of the photo in a results file; vocabulary: of its category ids; all_images: the
    results are of a whole track, where a photo may have none. runs: folders of
    baselines that saw the photo; camera: a provider's file; baseline: a provider's answer.
    """

    photo: Path
    regions: Sequence[Path]
    image_id: int | None
    vocabulary: Vocabulary | None
    depth: Path | None
    depth_space: DepthSpace
    hfov_deg: float | None
    all_images: bool = False
    runs: Sequence[Path] = ()
    camera: Path | None = None
    baseline: BaselineEvidence | None = None


def make_evidence(inputs: UserEvidence, output: Path) -> EvidenceFile:
    """Write evidence.json and, with depth, depth.npz. EvidenceInvalidError names what is wrong."""
    photo = read_photo(inputs.photo)
    about = _photo_evidence(inputs.photo, photo)
    size_wh = about.width, about.height
    runs = [of_run(folder, about.sha256) for folder in inputs.runs]
    regions = [r for path in inputs.regions for r in _regions(path, inputs, size_wh)]
    regions += [r for run in runs for r in _regions_from_run(run, inputs, size_wh)]
    _refuse_repeated(regions)
    camera = _camera(photo, about, inputs)
    output.mkdir(parents=True, exist_ok=True)
    if inputs.baseline is not None:
        write_text(output / CAMERA, readable(inputs.baseline.camera))
    file = EvidenceFile(
        photo=about,
        regions=tuple(sorted(regions, key=lambda region: region.name)),
        depth=_depth(inputs, runs, size_wh, output),
        camera=camera,
        provider=UNSET if inputs.baseline is None else inputs.baseline.record,
    )
    write_text(output / EVIDENCE, readable(file))
    return file


def _camera(photo: NDArray[np.uint8], about: PhotoEvidence, inputs: UserEvidence) -> CameraEvidence:
    """A file that cannot be used is refused; a model's answer that cannot be is unknown."""
    camera = None if inputs.camera is None else read_camera(inputs.camera, about)
    if inputs.baseline is not None:
        camera = inputs.baseline.camera
        if problem := camera_problem(camera, about):
            return unusable_camera(camera, problem)
    return camera_evidence(photo, inputs.hfov_deg, camera)


def _depth(
    inputs: UserEvidence, runs: Sequence[RunEvidence], size_wh: tuple[int, int], output: Path
) -> DepthEvidence | None:
    sources = [
        GivenDepth(path=run.depth, space=run.space, source=run.source, of_photo=True)
        for run in runs
        if run.depth is not None
    ]
    if inputs.depth is not None:
        path, space = inputs.depth, inputs.depth_space
        sources.append(GivenDepth(path=path, space=space, source=path.name, of_photo=False))
    if inputs.baseline is not None and inputs.baseline.depth is not None:
        sources.append(inputs.baseline.depth)
    if len(sources) > 1:
        raise EvidenceInvalidError(
            "there are two depths of the photo",
            found=", ".join(source.source for source in sources),
            expected="one",
            next_step="leave one out; `--option depth=false` leaves out a provider's",
        )
    for source in sources:
        return write_depth(source, size_wh, output)
    return None


def _regions_from_run(
    run: RunEvidence, inputs: UserEvidence, size_wh: tuple[int, int]
) -> Iterator[Region]:
    if run.results is not None:
        about = replace(inputs, image_id=run.image_id, vocabulary=run.vocabulary, all_images=True)
        entries = decode(list[Detection], run.results)
        yield from _regions_from_results(entries, run.source, about, size_wh)


def photo_alone(path: Path) -> Evidence:
    """Evidence that is a photo and nothing else."""
    photo = read_photo(path)
    about = _photo_evidence(path, photo)
    file = EvidenceFile(
        photo=about, regions=(), depth=None, camera=camera_evidence(photo, None, None)
    )
    return Evidence(file=file, disparity=None, photo=photo)


def _photo_evidence(path: Path, photo: NDArray[np.uint8]) -> PhotoEvidence:
    return PhotoEvidence(
        file_name=path.name,
        sha256=sha256_of_file(path),
        width=photo.shape[1],
        height=photo.shape[0],
    )


def _regions(path: Path, inputs: UserEvidence, size_wh: tuple[int, int]) -> Iterator[Region]:
    data = path.read_bytes()
    try:
        if data.lstrip().startswith(b"["):
            yield from _regions_from_results(
                decode(list[Detection], data), path.name, inputs, size_wh
            )
        else:
            yield from _regions_from_outlines(decode(Outlines, data), path.name, size_wh)
    except RecordError as error:
        raise EvidenceInvalidError(
            f"{path} has no regions",
            found=str(error),
            expected='{"regions": [{"name", "polygons"}]} or a list of COCO results',
        ) from error


def _regions_from_outlines(
    file: Outlines, source: str, size_wh: tuple[int, int]
) -> Iterator[Region]:
    for outline in file.regions:
        flat = [[v for point in polygon for v in point] for polygon in outline.polygons]
        if not flat or any(len(polygon) < 6 for polygon in flat):
            raise EvidenceInvalidError(
                f"region {outline.name!r} of {source} has no outline",
                found=f"{len(flat)} polygons, the shortest of {min(map(len, flat), default=0) // 2}"
                " points",
                expected="polygons of at least three points",
            )
        yield _region(outline.name, flat, size_wh, outline.category, None, source)


def _regions_from_results(
    entries: list[Detection], source: str, inputs: UserEvidence, size_wh: tuple[int, int]
) -> Iterator[Region]:
    images = {entry.image_id for entry in entries}
    image_id = inputs.image_id
    if image_id is None and len(images) == 1:
        image_id = next(iter(images))
    if inputs.all_images and image_id not in images:
        return
    if image_id is None or image_id not in images:
        raise EvidenceInvalidError(
            f"{source} is about other images",
            found=f"{len(images)} image ids"
            + ("" if image_id is None else f", none is {image_id}"),
            expected="results of the photo",
            next_step="pass --image-id with the photo's id in that file",
        )
    names = {c.id: c.name for c in inputs.vocabulary.categories} if inputs.vocabulary else {}
    kept = [e for e in entries if e.image_id == image_id and e.score >= LEAST_SCORE]
    numbered: Counter[str] = Counter()
    for entry in sorted(kept, key=lambda entry: -entry.score):
        category = names.get(entry.category_id, f"category {entry.category_id}")
        shape = entry.visible_mask or entry.segmentation or _of_box(entry, source)
        name = f"{category} {numbered[category] + 1}"
        try:
            region = _region(name, shape, size_wh, category, entry.score, source)
        except _NoPixelError:
            if entry.visible_mask:
                continue  # hidden
            raise
        numbered[category] += 1
        yield region


def _of_box(entry: Detection, source: str) -> list[list[float]]:
    if isinstance(entry.bbox, UnsetType):
        raise EvidenceInvalidError(
            f"{source} has a result without a shape",
            found="neither segmentation nor bbox",
            expected="COCO results of boxes or masks",
        )
    x, y, w, h = entry.bbox
    return [[x, y, x + w, y, x + w, y + h, x, y + h]]


def _region(
    name: str,
    shape: RunLength | list[list[float]],
    size_wh: tuple[int, int],
    category: str | None,
    score: float | None,
    source: str,
) -> Region:
    from pycocotools import mask as rle

    width, height = size_wh
    if isinstance(shape, RunLength):
        if shape.size != (height, width):
            raise EvidenceInvalidError(
                f"region {name!r} of {source} is of another photo",
                found=f"{shape.size[1]}x{shape.size[0]} pixels",
                expected=f"{width}x{height}",
            )
        check_run_lengths(name, shape.counts, width * height, source)
        encoded: Any = {"size": [height, width], "counts": shape.counts.encode("ascii")}
    else:
        if not are_near(value for polygon in shape for value in polygon):
            raise EvidenceInvalidError(
                f"region {name!r} of {source} lies too far from the photo",
                found=f"a coordinate of {max(map(abs, chain(*shape))):g} pixels",
                expected=f"less than {MOST_COORDINATE_PX:,.0f}",
            )
        polygons: Any = shape
        encoded = rle.merge(rle.frPyObjects(polygons, height, width))
    area = int(rle.area(encoded))
    if not area:
        raise _NoPixelError(
            f"region {name!r} of {source} lies outside of the photo",
            found="no pixel",
            expected=f"an outline within {width}x{height} pixels",
        )
    x, y, w, h = (round(float(v)) for v in rle.toBbox(encoded))
    return Region(
        name=name,
        counts=encoded["counts"].decode("ascii"),
        area_px=area,
        bbox_xywh_px=(x, y, w, h),
        category=category,
        score=score,
        source=source,
    )


def _refuse_repeated(regions: Sequence[Region]) -> None:
    names = Counter(region.name for region in regions)
    if twice := sorted(name for name, n in names.items() if n > 1):
        raise EvidenceInvalidError(
            "two regions have one name",
            found=", ".join(twice[:5]),
            expected="a name of its own for each region",
        )
