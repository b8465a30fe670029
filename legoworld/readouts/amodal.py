"""Amodal masks of a picture's instances, hidden ones too, as COCO results in KINS's dialect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from pycocotools import mask as _mask

from legoworld.conventions import EQUAL_CONFIDENCE
from legoworld.readouts.exports import bbox_xywh_px
from legoworld.readouts.family import AnsweredImage, Export
from legoworld.records.base import UNSET
from legoworld.records.predictions import Occluders, Prediction, Rle
from legoworld.scene.instances import Instance
from legoworld.tables.table import Number, Table, table
from legoworld.visibility.runs import ColumnRuns

#: What a card reads.
AMODAL: Final = "amodal"

_API: Any = _mask  # its stubs do not know text counts


def amodal_exports(image: AnsweredImage) -> list[Export]:
    """Results of one image in canonical order: category id, then the amodal RLE's bytes.

    Every instance in the vocabulary with an amodal pixel in the frame.
    """
    view, amodal = image.view, image.view.amodal(threads=image.threads)
    exported = [i for i in image.instances if i.category and amodal.in_frame_px[i.id]]
    visible = ColumnRuns(view.buffers.instance, len(view.area_px))
    shown, direct = amodal.occluders.by_hidden(), amodal.direct_occluders.by_hidden()
    silhouettes = amodal.silhouettes([i.id for i in exported], image.threads)
    exports = []
    for instance, silhouette in zip(exported, silhouettes, strict=True):
        assert instance.category is not None
        assert silhouette.visible_of_in_frame is not None
        mask = Rle(size=visible.size_hw, counts=amodal.masks.counts(instance.id))
        hidden_px = silhouette.in_frame_px - silhouette.visible_px
        prediction = Prediction(
            image_id=image.image_id,
            category_id=instance.category.id,
            score=EQUAL_CONFIDENCE,
            bbox=_box(mask),
            segmentation=mask,
            visible_mask=Rle(size=visible.size_hw, counts=visible.counts(instance.id)),
            inmodal_bbox=bbox_xywh_px(view, instance.id),
            occlude_rate=hidden_px / silhouette.in_frame_px,
            visible_of_in_frame=silhouette.visible_of_in_frame,
            in_frame_of_whole=silhouette.in_frame_of_whole,
            visible_of_whole=silhouette.visible_of_whole,
            whole_unknown=silhouette.unknown or UNSET,
            instance=instance.id,
            occluded_by=_list_occluders(shown.get(instance.id, {}), image.instances),
            directly_occluded_by=_list_occluders(direct.get(instance.id, {}), image.instances),
            layer=int(amodal.order.layer[instance.id]),
            cycle=amodal.order.cycle(instance.id),
        )
        exports.append((prediction, instance))
    return sorted(exports, key=lambda export: _canonical_key(export[0]))


def amodal_table(image: AnsweredImage) -> Table:
    """Of each result what hides it, by instance id; all unlabelled ones are `other`."""
    fractions = "occlude_rate", "in_frame_of_whole"
    return table(
        ("id", "instance", *fractions, "layer", "in a cycle with", "occluded by (pixels)"),
        [
            (
                instance.id,
                instance.name,
                *(Number(value=getattr(row, name)) for name in fractions),
                row.layer or 0,
                ", ".join(str(i) for i in row.cycle or () if i != instance.id) or "-",
                ", ".join(f"{'other' if i is None else i} ({n})" for i, n in row.occluded_by or ())
                or "-",
            )
            for row, instance in amodal_exports(image)
        ],
        title="What hides what",
    )


def _canonical_key(prediction: Prediction) -> tuple[Any, ...]:
    assert prediction.segmentation
    return prediction.category_id, prediction.segmentation.counts


def _box(mask: Rle) -> tuple[int, int, int, int]:
    x, y, width, height = _API.toBbox({"size": mask.size, "counts": mask.counts}).tolist()
    return int(x), int(y), int(width), int(height)


def _list_occluders(pixels: Mapping[int, int], instances: Sequence[Instance]) -> Occluders:
    """Labelled instances by id; then, as None, unlabelled ones and holdouts together."""
    labelled = {j: n for j, n in pixels.items() if j >= 0 and instances[j].category}
    rest = sum(pixels.values()) - sum(labelled.values())
    return (*sorted(labelled.items()), *[(None, rest)] * (rest > 0))
