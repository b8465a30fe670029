"""Boxes in space: eight corners in the camera frame, overlapped exactly; "area" is depth.

Omni3D's rules of AP3D (Brazil et al., CVPR 2023), as docs/protocols/boxes3d.md states them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, Final, TypeGuard, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from legoworld.errors import LegoWorldError
from legoworld.evaluation.box_overlaps import box_ious, box_volumes
from legoworld.evaluation.detection.box3d_errors import difference_said, space_errors
from legoworld.evaluation.detection.grid import SPACE
from legoworld.evaluation.detection.inputs.box_formats import is_finite
from legoworld.evaluation.detection.inputs.prediction_checks import PredictionsInvalidError
from legoworld.evaluation.detection.inputs.prediction_columns import (
    GivenColumns,
    PredictionColumns,
    number_columns,
)
from legoworld.evaluation.detection.inputs.prediction_order import in_order
from legoworld.evaluation.detection.inputs.truth_checks import (
    Foreign,
    TruthInvalidError,
    refuse_annotations,
)
from legoworld.evaluation.detection.payloads.payload import (
    Checking,
    Outline,
    Overlaps,
    Payload,
    Row,
)
from legoworld.files import Json
from legoworld.records.coco_file import TrueImage
from legoworld.records.predictions import Box3dPrediction
from legoworld.visibility.cuboids import SIGNS, cuboid_corners, edge_vectors, extent_px, lines_px

if TYPE_CHECKING:
    from legoworld.evaluation.detection.matching.matches import Chunk

Floats = NDArray[np.float64]
_Fault = Callable[[Floats], tuple[str, str]]

#: Truth that is ignored: cut off by the picture, or hidden, by at least so much.
CUT_OFF: Final = 1 / 3
SEEN: Final = 1 / 3
#: How far a corner may be from a parallelepiped's, over the box's diagonal.
_SLACK: Final = 0.01
#: Pairs of an image: a gigabyte of overlaps.
MOST_PAIRS: Final = 2**27
#: Others' boxes whose median depth is beyond it are in other units; at least _MANY boxes tell.
_FARTHEST_M: Final = 500.0
_MANY: Final = 4
_FLAT: Final = "boxes without a volume: they overlap nothing"
_FRAME: Final = "the camera frame of OpenCV in metres: x right, y down, z forward"
_CORNERS: Final = "bbox3D (or bbox3D_cam): 8 corners x, y, z of a box, in Omni3D's order"


def corner_array(boxes: ArrayLike) -> Floats:
    """(n, 8, 3) corners of boxes."""
    return np.array(boxes, np.float64).reshape(-1, 8, 3)


def _check_columns(given: GivenColumns, checking: Checking) -> tuple[PredictionColumns, int]:
    """A scene's own boxes may lie anywhere; what others made is held to the frame, too."""
    columns = given.columns
    corners = corner_array(columns.shape)
    rules = (_shape_fault, _frame_fault, _unit_fault)[: 3 if checking.order == "given" else 1]
    _refuse(PredictionsInvalidError, "the boxes in space cannot be scored", corners, rules)
    checking.warnings[_FLAT] = int((box_volumes(corners) == 0).sum())
    return in_order(columns, checking.order), 0


def _refuse(
    error: type[LegoWorldError], problem: str, corners: Floats, rules: Sequence[_Fault]
) -> None:
    """Raise the error for the first rule that (n, 8, 3) corners break."""
    for rule in rules:
        found, next_step = rule(corners)
        if found:
            expected = _CORNERS if rule is _shape_fault else _FRAME
            raise error(problem, found=found, expected=expected, next_step=next_step)


def _shape_fault(corners: Floats) -> tuple[str, str]:
    """What is found where corners are none of a parallelepiped's, and what to do."""
    center, edges = corners.mean(axis=1), edge_vectors(corners)
    straight = center[:, None] + np.einsum("kc,ncd->nkd", SIGNS, edges) / 2
    with np.errstate(invalid="ignore", over="ignore"):
        off = np.abs(corners - straight).max(axis=(1, 2))
        size = np.abs(edges).sum(axis=(1, 2))
        bad = np.flatnonzero(~(off <= _SLACK * size + 1e-6))
    if not len(bad):
        return "", ""
    found = f"box {bad[0]} of {len(corners)}: corners that are not a box's, in this order"
    return found, "order the corners as Omni3D's get_cuboid_verts does, all of them finite"


def _frame_fault(corners: Floats) -> tuple[str, str]:
    """What is found where most boxes are wholly behind the camera, and what to do."""
    behind = int((corners[:, :, 2] <= 0).all(axis=1).sum())
    if len(corners) < _MANY or behind * 2 <= len(corners):
        return "", ""
    found = f"{behind} of {len(corners)} boxes behind the camera"
    return found, "if z points backwards (OpenGL, Blender), negate y and z of every corner"


def _unit_fault(corners: Floats) -> tuple[str, str]:
    """What is found where boxes are far away, and what to do."""
    median = float(np.median(corners[:, :, 2])) if len(corners) >= _MANY else 0.0
    if median <= _FARTHEST_M:
        return "", ""
    return f"a median depth of {median:.0f} m", "if these are millimetres, divide by 1000"


def _document(document: Foreign, _name: str) -> Foreign:
    """Omni3D's document in COCO's words; what is malformed is left for the checks to refuse."""
    if not isinstance(document, dict) or not all(
        isinstance(document.get(key), list) for key in ("images", "annotations")
    ):
        return document
    images = [_image(entry) for entry in cast("list[Json]", document["images"])]
    by_id = {str(i.get("id")): i for i in images if isinstance(i, dict)}
    annotations = cast("list[Json]", document["annotations"])
    return {
        **document,
        "images": images,
        "annotations": [_annotation(entry, by_id) for entry in annotations],
    }


def _image(entry: Json) -> Json:
    if isinstance(entry, dict) and "file_name" not in entry and "file_path" in entry:
        return {**entry, "file_name": entry["file_path"]}
    return entry


def _annotation(entry: Json, images: Mapping[str, Foreign]) -> Json:
    """With what is scored: corners, whether it is ignored, its depth as area, its extent."""
    if not isinstance(entry, dict):
        return entry
    given = entry.get("bbox3D", entry.get("bbox3D_cam"))
    if not _are_rows(given, 8):
        return {**entry, "bbox": [0, 0, 0, 0], "area": 0, "bbox3D": None}
    corners = np.array(given, np.float64)
    return {
        **entry,
        "bbox": _extent(corners, images.get(str(entry.get("image_id")), {})),
        "area": max(float(corners[:, 2].mean()), 0.0),
        "iscrowd": 0,
        "ignore": int(_is_ignored(entry, corners)),
        "bbox3D": given,
    }


def _extent(corners: Floats, image: Foreign) -> list[float]:
    """The box around the edges in the picture; zeros where the image's entry is unusable."""
    camera, width, height = (image.get(key) for key in ("K", "width", "height"))
    if not (_are_rows(camera, 3) and is_finite(width) and is_finite(height)):
        return [0.0] * 4
    return extent_px(lines_px(corners, camera), (int(width), int(height)))


def _is_ignored(entry: Foreign, corners: Floats) -> bool:
    """Omni3D's rules at its defaults; a negative or missing share is unknown."""
    cut, seen, sizes = (entry.get(key) for key in ("truncation", "visibility", "dimensions"))
    given = [s for s in sizes if is_finite(s)] if isinstance(sizes, list) else []
    return (
        bool((corners[:, 2] <= 0).any())
        or entry.get("valid3D") is False
        or min([*np.abs(edge_vectors(corners)).max(axis=1).tolist(), *given]) <= 0
        or (is_finite(cut) and cut >= CUT_OFF)
        or (is_finite(seen) and 0 <= seen <= SEEN)
    )


def _are_rows(given: Json, n: int) -> TypeGuard[list[list[float]]]:
    """Whether these are n rows of three finite numbers: corners, or a camera's matrix."""
    return (
        isinstance(given, list)
        and len(given) == n
        and all(isinstance(p, list) and len(p) == 3 and all(map(is_finite, p)) for p in given)
    )


def _check_shapes(name: str, own: Sequence[Foreign], images: Mapping[int, Foreign]) -> None:
    """Corners of a box in every annotation, and a camera for its image."""
    refuse_annotations(name, own, lambda a: None if a["bbox3D"] else "no corners", _CORNERS)

    def camera_fault(entry: Foreign) -> str | None:
        camera = images[cast("int", entry["image_id"])].get("K")
        return None if _are_rows(camera, 3) else f"K {camera!r}"[:80]

    expected = "K of its image: 3 rows of 3 numbers, pixels"
    refuse_annotations(name, own, camera_fault, expected)


def _check_format(
    name: str, own: Sequence[Foreign], _images: Mapping[int, Foreign], repairs: Counter[str]
) -> None:
    corners = corner_array([cast("Any", a["bbox3D"]) for a in own if a.get("valid3D") is not False])
    problem = f"the boxes of {name} cannot be scored against"
    _refuse(TruthInvalidError, problem, corners, (_shape_fault, _frame_fault))
    if far := _unit_fault(corners)[0]:
        repairs[f"truth boxes at {far}; are they in metres?"] += len(corners)
    if flat := int((box_volumes(corners) == 0).sum()):
        repairs["truth boxes without a volume: they are ignored"] += flat


def _overlaps(chunk: Chunk) -> Overlaps:
    """Image after image; the size of a detection is the depth of its centre."""
    mine, true = chunk.first_detection.tolist(), chunk.first_truth.tolist()
    ious = [
        box_ious(
            chunk.shapes[mine[i] : mine[i + 1]], chunk.true_shapes[true[i] : true[i + 1]]
        ).ravel()
        for i in range(len(chunk.sizes_hw))
    ]
    return Overlaps(
        iou=np.concatenate([*ious, np.empty(0)]), area=chunk.shapes[:, :, 2].mean(axis=1)
    )


def _shape(row: Row, _size_hw: tuple[int, int]) -> Any:
    return row.corners


def _compare_boxes(boxes: ArrayLike, others: ArrayLike, crowd: Sequence[int]) -> Floats:
    mine, theirs = corner_array(boxes), corner_array(others)
    ious = box_ious(mine, theirs)
    volumes = box_volumes(mine)[:, None]
    common = ious * (volumes + box_volumes(theirs)) / (1 + ious)
    inside = np.divide(common, volumes, out=np.zeros_like(ious), where=volumes > 0)
    return np.where(np.array(crowd, bool), inside, ious)


def _enclose_boxes(boxes: ArrayLike) -> Any:
    """The box around boxes, along the first one's axes."""
    corners = corner_array(boxes)
    edges = edge_vectors(corners[0])
    lengths = np.sqrt((edges**2).sum(axis=1))
    axes = (edges / np.where(lengths > 0, lengths, 1)[:, None]).T
    along = corners.reshape(-1, 3) @ axes
    low, high = along.min(0), along.max(0)
    return cuboid_corners(axes @ ((low + high) / 2), axes, high - low)


def _outline(row: Row, image: TrueImage) -> Outline:
    """The edges as they are seen by the photo's camera."""
    lines = lines_px(np.array(row.corners, np.float64), image.intrinsics or ())
    return Outline(box=extent_px(lines, (image.width, image.height)), polygons=lines)


def _difference(row: Row, truth: Row) -> str:
    return difference_said(np.array(row.corners, np.float64), np.array(truth.corners, np.float64))


BOXES3D: Final = Payload(
    name="boxes_3d",
    iou_type="bbox3D",
    grid=SPACE,
    record=Box3dPrediction,
    field="bbox3D",
    read_columns=partial(number_columns, "bbox3D"),
    check_columns=_check_columns,
    check_shapes=_check_shapes,
    check_format=_check_format,
    pack_shapes=corner_array,
    overlaps=_overlaps,
    shape=_shape,
    compare_shapes=_compare_boxes,
    enclose_shapes=_enclose_boxes,
    outline=_outline,
    document=_document,
    own_ignore=True,
    most_pairs=MOST_PAIRS,
    difference=_difference,
    pair_errors=space_errors,
)
