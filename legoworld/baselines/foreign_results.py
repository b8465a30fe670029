"""Third-party detector outputs: accepted if complete, otherwise refused with instructions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final, cast

from legoworld.evaluation.detection.inputs.prediction_checks import PredictionsInvalidError
from legoworld.files import Json

#: One object of a third-party results file.
Entry = Mapping[str, Json]

RESULTS: Final = (
    'a list of {"image_id", "category_id", "bbox" or "segmentation", "score"}, JSON lines of '
    'these, or one {"image_id", "boxes", "labels", "scores"} an image'
)
_TENSORS: Final = (
    'write JSON: json.dump([{"image_id": i, **{k: v.tolist() for k, v in d.items()}} for i, d in '
    "outputs.items()], stream)"
)
_YOLO: Final = (
    "Ultralytics writes predictions.json with save_json=True; labels in YOLO's form become COCO "
    "by supervision's DetectionDataset.from_yolo(...).as_coco(...), without confidences"
)
#: Conversion instructions for other kinds of files, by suffix.
_CONVERTERS: Final = {
    **dict.fromkeys((".pt", ".pth", ".pkl", ".pickle"), _TENSORS),
    **dict.fromkeys((".npz", ".npy"), "write JSON: every array's tolist()"),
    ".txt": _YOLO,
    ".xml": "supervision's DetectionDataset.from_pascal_voc(...).as_coco(...) writes COCO",
    ".csv": "write JSON: one object a row",
}
_LABELME: Final = "labelme's examples/instance_segmentation/labelme2coco.py writes COCO"
_SAM: Final = (
    "name each mask's image and category: image_id, category_name, segmentation, and "
    "predicted_iou as score (output_mode='coco_rle')"
)


def next_step_for(path: Path) -> str:
    """Conversion instructions for a folder or a file that is not JSON."""
    if path.is_dir():
        suffixes = {p.suffix.lower() for p in sorted(path.iterdir())[:100]}
        return next((_CONVERTERS[s] for s in sorted(suffixes) if s in _CONVERTERS), "")
    return _CONVERTERS.get(path.suffix.lower(), "")


def refuse_other_documents(document: Json, path: Path) -> None:
    """Raise PredictionsInvalidError for masks without classes and for LabelMe files."""
    first = document[0] if isinstance(document, list) and document else document
    if not isinstance(first, dict):
        return
    keys, what, next_step = set(first), "", ""
    if {"predicted_iou", "segmentation"} <= keys and not keys & {"image_id", "category_id"}:
        what, next_step = "holds SAM's automatic masks: of no image and of no category", _SAM
    elif "shapes" in keys and "imagePath" in keys:
        what, next_step = "is one photo's file of LabelMe", _LABELME
    if what:
        raise PredictionsInvalidError(
            f"{path.name} {what}", found=f"keys {sorted(keys)[:8]}", expected=RESULTS,
            next_step=next_step,
        )  # fmt: skip


def per_image_outputs(document: Json) -> list[Entry] | None:
    """torchvision outputs, one {"boxes", "labels", "scores"} per image; None for anything else.

    A list whose objects name their image, or an object of them by image id or file name.
    """
    if isinstance(document, dict) and document and all(map(_is_output, document.values())):
        outputs = cast("dict[str, Entry]", document)
        return [{"image_id": image, **output} for image, output in outputs.items()]
    if isinstance(document, list) and document and all(map(_is_output, document)):
        return cast("list[Entry]", document)
    return None


def _is_output(value: Json) -> bool:
    return isinstance(value, dict) and "boxes" in value and "bbox" not in value


def output_entries(outputs: list[Entry], path: Path) -> Iterator[Entry]:
    """One entry per box, corners unchanged. PredictionsInvalidError for lists of unequal length."""
    for number, output in enumerate(outputs, start=1):
        image = {k: v for k, v in output.items() if k in ("image_id", "file_name")}
        columns = {k: v for k, v in output.items() if k in ("boxes", "labels", "scores", "masks")}
        lists = {k: v for k, v in columns.items() if isinstance(v, list)}
        lengths = {k: len(lists[k]) if k in lists else None for k in columns}
        lacks = {"boxes", "labels", "scores"} - columns.keys()
        if not image or lacks or None in lengths.values() or len({*lengths.values()}) > 1:
            raise PredictionsInvalidError(
                f"output {number} of {path.name} cannot be used",
                found=f"keys {sorted(output)[:8]}, of lengths {lengths}",
                expected='"image_id" or "file_name"; "boxes", "labels", "scores" of one length',
            )
        masks = lists.get("masks") or [None] * len(lists["boxes"])
        rows = zip(lists["boxes"], lists["labels"], lists["scores"], masks, strict=True)
        for box, label, score, mask in rows:
            entry = {**image, "bbox": box, "score": score}
            entry["category_name" if isinstance(label, str) else "category_id"] = label
            if mask is not None:
                entry["segmentation"] = mask
            yield entry
