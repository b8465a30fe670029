"""Amodal ground truth: our own, and the files of KINS, D2SA, COCOA-cls and COCOA, in one form.

That form is COCO's, with the amodal mask as `segmentation` and a `visible_mask` in each annotation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, cast

from legoworld.errors import cause
from legoworld.evaluation.detection.inputs.truth_checks import (
    Foreign,
    TruthInvalidError,
    check_masks,
)
from legoworld.files import Json

#: What the visible mask is called: in D2SA, COCOA and ours; in KINS; in KINS as it was first given.
_VISIBLE: Final = ("visible_mask", "inmodal_seg", "i_segm")
#: The categories of COCOA, whose regions have names in free text.
_COCOA: Final[list[Json]] = [{"id": 1, "name": "object"}, {"id": 2, "name": "stuff"}]


def coco_document(document: Json, name: str) -> Any:
    """A truth file's content in our form. TruthInvalidError without a visible mask in it."""
    given = document.get("annotations") if isinstance(document, dict) else None
    if not isinstance(document, dict) or not isinstance(given, list):
        return document  # refused by who reads it
    annotations = [a for a in given if isinstance(a, dict)]
    if len(annotations) < len(given):
        return document
    if annotations and all("regions" in a for a in annotations):
        annotations = _cocoa_annotations(annotations, name)
        document = {**document, "categories": _COCOA}
    if annotations and not any(key in a for a in annotations for key in _VISIBLE):
        raise TruthInvalidError(
            f"{name} is no amodal ground truth",
            found="no visible_mask in any annotation",
            expected="COCO JSON with segmentation (amodal) and visible_mask or inmodal_seg",
            next_step="`legoworld export RUN --format kins` writes one from a run of amodal",
        )
    return {**document, "annotations": [_with_visible(a) for a in annotations]}


def _with_visible(annotation: Foreign) -> Foreign:
    """What nothing hides may come without a visible mask: it is the amodal one."""
    for key in _VISIBLE:
        if annotation.get(key) is not None:
            return {**annotation, "visible_mask": annotation[key]}
    if annotation.get("occlude_rate"):
        return annotation
    return {**annotation, "visible_mask": annotation.get("segmentation")}


def _cocoa_annotations(annotations: Sequence[Foreign], name: str) -> list[Foreign]:
    images = {str(a.get("image_id")) for a in annotations}
    if len(images) < len(annotations):
        raise TruthInvalidError(
            f"images of {name} are annotated more than once",
            found=f"{len(annotations)} annotations of {len(images)} images",
            expected="one annotator's regions for each image",
            next_step="keep one annotation of each image",
        )
    try:
        regions = [(a["image_id"], r) for a in annotations for r in cast("Any", a["regions"])]
        return [_region(k, *one) for k, one in enumerate(regions, start=1)]
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise TruthInvalidError(
            f"{name} has regions that cannot be used",
            found=cause(error),
            expected='COCOA\'s "regions": [{"segmentation": [x, y, ...], "area", "visible_mask"}]',
        ) from error


def _region(number: int, image_id: Json, region: dict[str, Any]) -> Foreign:
    """An annotation of one of COCOA's regions. KeyError, TypeError, ValueError."""
    corners = region["segmentation"]
    x, y = corners[0::2], corners[1::2]
    return {
        **{key: region[key] for key in (*_VISIBLE, "occlude_rate") if key in region},
        "id": number,
        "image_id": image_id,
        "category_id": 2 if region.get("isStuff") else 1,
        "segmentation": [corners],
        "bbox": [min(x), min(y), max(x) - min(x), max(y) - min(y)],
        "area": region["area"],
        "iscrowd": 0,
    }


def check_amodal(name: str, own: Sequence[Foreign], images: Mapping[int, Foreign]) -> None:
    """Both masks of each annotation. An empty list is the visible mask of what is hidden."""
    check_masks(name, own, images)
    for entry in own:
        image = images[cast("int", entry["image_id"])]
        if entry.get("visible_mask") == []:
            width, height = cast("int", image["width"]), cast("int", image["height"])
            entry["visible_mask"] = {"size": [height, width], "counts": [width * height]}
    visible = [{**entry, "segmentation": entry.get("visible_mask")} for entry in own]
    check_masks(f"{name} (visible_mask)", visible, images)
    for entry, checked in zip(own, visible, strict=True):
        entry["visible_mask"] = checked["segmentation"]
