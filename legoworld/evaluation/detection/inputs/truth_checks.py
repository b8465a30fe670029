"""Checks of a ground-truth file, as strict as those of predictions: errors name the first fault.

The official evaluators do not check: pycocotools ignores an annotation of an unknown image and
scores a box of negative width.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any, TypeVar, cast

import numpy as np

from legoworld.errors import LegoWorldError, name_on_line
from legoworld.evaluation.detection.inputs.box_formats import (
    BoxFormatError,
    check_box_format,
    is_finite,
)
from legoworld.evaluation.detection.inputs.masks import covers, measure_masks, rle_problem
from legoworld.files import Json
from legoworld.pluralize import plural, share
from legoworld.readouts.masks import MOST_COORDINATE_PX
from legoworld.records.track import LARGEST_ID

Foreign = dict[str, Json]
Fault = Callable[[Foreign], str | None]
_E = TypeVar("_E", Json, Foreign)
#: Checks the shapes of annotations of a file's name, whose images are by id.
CheckShapes = Callable[[str, Sequence[Foreign], Mapping[int, Foreign]], None]

_FEDERATED_KEYS = ("neg_category_ids", "not_exhaustive_category_ids")
_CORRECT = "correct the file, or use the dataset's own"
#: Numbers of the smallest polygon, a triangle; pycocotools takes four numbers for a box.
_POLYGON_NUMBERS = 6


class TruthInvalidError(LegoWorldError):
    """A ground-truth file is unusable for scoring."""

    code = "truth_invalid"


def check_images(name: str, entries: Sequence[Json], repairs: Counter[str]) -> dict[int, Foreign]:
    """Copies of a truth's image entries by id, in the file's order.

    name: the file's, for messages. TruthInvalidError for an entry without a usable id, and for ids
    that repeat.
    """
    objects = _objects(name, "images", entries)
    _refuse(name, "images", objects, _key_fault("id"), "an integer id")
    _refuse(name, "images", objects, _name_fault, "a file name without control characters")
    by_id: dict[int, Foreign] = {}
    twice: list[int] = []
    for entry in objects:
        image_id = _as_int(entry["id"], "image ids", repairs)
        if not 0 <= image_id <= LARGEST_ID:
            raise TruthInvalidError(
                f"an image id of {name} cannot be used",
                found=f"{image_id}",
                expected="0 to 2**53, the integers that every JSON reader keeps",
                next_step=_CORRECT,
            )
        if image_id in by_id:
            twice.append(image_id)
        by_id[image_id] = {**entry, "id": image_id}
    if twice:
        raise TruthInvalidError(
            f"image ids repeat in {name}",
            found=f"{len(twice)} of {len(objects)} images, such as image {twice[0]}",
            expected="distinct ids",
            next_step=_CORRECT,
        )
    return by_id


def check_image_values(name: str, images: Sequence[Foreign], *, federated: bool) -> None:
    """What scoring reads of the images it is about; whole numbers become integers in place.

    TruthInvalidError for a width or height that is none, and in LVIS (federated) for missing
    lists of verified categories.
    """
    _refuse(name, "images", images, _size_fault, "a width and height of at least 1 pixel")
    for entry in images:
        width, height = _size_wh(entry)
        entry |= {"width": width, "height": height}
    if federated:
        lists = " and ".join(_FEDERATED_KEYS)
        expected = f"LVIS's verified categories: {lists}, lists of ids"
        _refuse(name, "images", images, _federated_fault, expected)


def check_annotations(
    name: str,
    entries: Sequence[Json],
    *,
    images: Mapping[int, Foreign],
    wanted: Iterable[int],
    category_ids: frozenset[int],
    check_shapes: CheckShapes | None,
    repairs: Counter[str],
) -> list[Foreign]:
    """Copies of the annotations of the wanted images, in the file's order.

    images: all of the file's, as `check_images` returns them: an annotation of none of them is
    refused, one of an image that is not wanted is left out. check_shapes: the payload's. repairs
    counts what was taken in spite of its form. TruthInvalidError otherwise.
    """
    objects = _objects(name, "annotations", entries)
    refuse = partial(_refuse, name, "annotations", objects)
    refuse(_key_fault("id"), "an integer id")
    _refuse_repeats(name, objects)
    refuse(_key_fault("image_id"), "the integer id of its image")
    if any(a["image_id"] not in images for a in objects):
        refuse(
            lambda a: None if a["image_id"] in images else "no such image",
            f"the id of one of the file's {plural(len(images), 'image', 'images')}",
            "correct the image_id; where images were cut out of the file, cut their annotations, "
            "too",
        )
    ids = frozenset(wanted)
    own = [
        {**a, "image_id": _as_int(a["image_id"], "image ids", repairs)}
        for a in objects
        if a["image_id"] in ids
    ]
    _check_values(name, own, category_ids)
    for entry in own:
        entry["category_id"] = _as_int(entry["category_id"], "category ids", repairs)
    if check_shapes is not None:
        check_shapes(name, own, images)
    return own


def check_boxes(
    name: str, annotations: Sequence[Foreign], images: Mapping[int, Foreign], repairs: Counter[str]
) -> None:
    """Hold checked boxes to their images, as a results list's. TruthInvalidError names a format."""
    ids = [_int(a["image_id"]) for a in annotations]
    sizes_wh = {i: _size_wh(images[i]) for i in set(ids)}
    try:
        odd = check_box_format(ids, [a["bbox"] for a in annotations], sizes_wh)
    except BoxFormatError as error:
        raise TruthInvalidError(
            f"the boxes of {name} are not x, y, width, height in pixels",
            found=error.found,
            expected=error.expected,
            next_step=error.next_step.replace("pass ", "write "),
        ) from error
    repairs.update({f"truth {what}": count for what, count in odd.items()})


def _check_values(name: str, own: Sequence[Foreign], category_ids: frozenset[int]) -> None:
    """What both kinds of scoring read of an annotation, besides its mask."""
    refuse = partial(_refuse, name, "annotations", own)
    refuse(_key_fault("category_id"), "the integer id of its category")
    refuse(
        lambda a: None if a["category_id"] in category_ids else _format_entry(a, "category_id"),
        f"one of the file's {len(category_ids)} category ids",
    )
    refuse(_box_fault, "x, y, width, height: four finite numbers, width and height of at least 0")
    refuse(
        _area_fault,
        "a finite number of at least 0",
        "write the area in pixels of the mask, or width x height where there is none",
    )
    refuse(
        lambda a: None if a.get("iscrowd", 0) in (0, 1) else _format_entry(a, "iscrowd"), "0 or 1"
    )


def check_masks(name: str, own: Sequence[Foreign], images: Mapping[int, Foreign]) -> None:
    """Polygons of three points and more, or RLE that covers its image."""

    def fault(entry: Foreign) -> str | None:
        mask = entry.get("segmentation")
        if isinstance(mask, list) and mask:
            return _polygon_fault(mask)
        if not isinstance(mask, dict):
            return "no segmentation" if not mask else f"segmentation {mask!r}"[:80]
        problem = rle_problem(mask, _size_wh(images[_int(entry["image_id"])]))
        return f"RLE {problem}" if problem else None

    expected = "polygons [x, y, ...] of at least 3 points, or RLE of the image's [height, width]"
    _refuse(name, "annotations", own, fault, expected)
    texts: list[tuple[Foreign, str, tuple[int, int]]] = []
    for entry in own:
        mask = entry["segmentation"]
        if isinstance(mask, dict):
            width, height = _size_wh(images[_int(entry["image_id"])])
            # a size of whole floats becomes integers
            entry["segmentation"] = {**mask, "size": [height, width]}
            if isinstance(mask["counts"], str):
                texts.append((entry, mask["counts"], (width, height)))
    covered, _ = measure_masks([counts for _, counts, _ in texts])
    wrong = {
        id(texts[k][0]): f"RLE {covers(int(covered[k]), texts[k][2])}"
        for k in np.flatnonzero(covered != [w * h for _, _, (w, h) in texts])
    }
    _refuse(name, "annotations", own, lambda a: wrong.get(id(a)), expected)


def refuse_annotations(name: str, own: Sequence[Foreign], fault: Fault, expected: str) -> None:
    """TruthInvalidError with how many annotations have a fault, and the first of them."""
    _refuse(name, "annotations", own, fault, expected)


def _objects(name: str, kind: str, entries: Sequence[Json]) -> Sequence[Foreign]:
    """The entries, all of which are objects."""
    _refuse(name, kind, entries, _object_fault)
    return cast("Sequence[Foreign]", entries)


def _refuse(
    name: str,
    kind: str,
    entries: Iterable[_E],
    fault: Callable[[_E], str | None],
    expected: str = "an object",
    next_step: str = _CORRECT,
) -> None:
    """TruthInvalidError with how many entries have a fault, and the first of them."""
    first, bad, of = "", 0, 0
    for of, entry in enumerate(entries, start=1):
        problem = fault(entry)
        if problem:
            first = first or _name_offender(kind, entry, of, problem)
            bad += 1
    if bad:
        raise TruthInvalidError(
            f"{share(bad, of, kind.removesuffix('s'), kind)} of {name} cannot be scored against",
            found=first,
            expected=expected,
            next_step=next_step,
        )


def _name_offender(kind: str, entry: Json, number: int, found: str) -> str:
    """The first offender: by its id where it has one, else by its place in the file."""
    what = kind.removesuffix("s")
    if not isinstance(entry, dict) or not _is_whole(entry.get("id")):
        return f"{what} number {number} of the list: {found}"
    of_image = f" (image {entry['image_id']!r})" if "image_id" in entry else ""
    return f"{what} {entry['id']}{of_image}: {found}"


def _refuse_repeats(name: str, entries: Sequence[Foreign]) -> None:
    ids = Counter(a["id"] for a in entries)
    if len(ids) == len(entries):
        return
    twice, times = next((i, n) for i, n in ids.items() if n > 1)
    raise TruthInvalidError(
        f"annotation ids repeat in {name}",
        found=f"{len(entries)} annotations, {len(ids)} ids: annotation {twice} {times} times",
        expected="distinct ids",
        next_step=_CORRECT,
    )


def _object_fault(entry: Json) -> str | None:
    return None if isinstance(entry, dict) else repr(entry)[:60]


def _key_fault(key: str) -> Fault:
    """No integer under the key; a float of a whole number is one, as it is to pycocotools."""

    def fault(entry: Foreign) -> str | None:
        if key not in entry:
            return f"no {key}"
        return None if _is_whole(entry[key]) else _format_entry(entry, key)

    return fault


def _format_entry(entry: Foreign, key: str) -> str:
    return f"{key} {entry[key]!r}"[:100] if key in entry else f"no {key}"


def _is_whole(value: Json) -> bool:
    return type(value) is int or (type(value) is float and value.is_integer())


def _as_int(value: Json, what: str, repairs: Counter[str]) -> int:
    if type(value) is float:
        repairs[f"{what} written as decimals, taken as integers"] += 1
    return _int(value)


def _int(value: Json) -> int:
    """A value that was found whole."""
    return int(cast("float", value))


def _size_wh(image: Foreign) -> tuple[int, int]:
    return _int(image["width"]), _int(image["height"])


def _name_fault(entry: Foreign) -> str | None:
    name = str(entry.get("file_name", ""))
    return None if name_on_line(name) == name else f"file_name {name!r}"


def _size_fault(entry: Foreign) -> str | None:
    size: list[Any] = [entry.get(key) for key in ("width", "height")]
    fine = all(_is_whole(value) and value >= 1 for value in size)
    return None if fine else f"width {size[0]!r}, height {size[1]!r}"


def _federated_fault(entry: Foreign) -> str | None:
    for key in _FEDERATED_KEYS:
        value = entry.get(key)
        if not isinstance(value, list) or not all(type(c) is int for c in value):
            return _format_entry(entry, key)
    return None


def _box_fault(entry: Foreign) -> str | None:
    box: Any = entry.get("bbox")
    fine = isinstance(box, list) and len(box) == 4 and all(map(is_finite, box))
    return None if fine and min(box[2:]) >= 0 else _format_entry(entry, "bbox")


def _area_fault(entry: Foreign) -> str | None:
    area = entry.get("area")
    return None if is_finite(area) and area >= 0 else _format_entry(entry, "area")


def _polygon_fault(polygons: list[Json]) -> str | None:
    for polygon in polygons:
        if not isinstance(polygon, list) or len(polygon) < _POLYGON_NUMBERS or len(polygon) % 2:
            size = f" of {len(polygon)} numbers" if isinstance(polygon, list) else ""
            return f"a polygon{size}: {polygon!r}"[:80]
        if not _are_coordinates(cast("list[float]", polygon)):
            return "a polygon with a value that is no finite number"
    return None


def _are_coordinates(values: Sequence[float]) -> bool:
    """Whether all are finite numbers; a truth has millions, so without a call for each."""
    if not set(map(type, values)) <= {int, float}:
        return False
    in_range = min(values) > -MOST_COORDINATE_PX and max(values) < MOST_COORDINATE_PX
    return in_range and math.isfinite(sum(values))  # the sum finds a NaN that min and max pass over
