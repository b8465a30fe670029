"""Mapping of third-party label names to a vocabulary: by name, with a map for differences."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Final

from legoworld.errors import LegoWorldError
from legoworld.pluralize import plural
from legoworld.records.base import RecordError, decode
from legoworld.tasks.shipped import COCO
from legoworld.tracks.vocabulary import Category, Vocabulary, find_dataset, normal_name

#: Names that PASCAL VOC gave six of COCO's categories, and that many checkpoints still carry.
OLD_NAMES: Final[Mapping[str, str]] = MappingProxyType(
    {
        "motorbike": "motorcycle",
        "aeroplane": "airplane",
        "sofa": "couch",
        "pottedplant": "potted plant",
        "diningtable": "dining table",
        "tvmonitor": "tv",
    }
)

LabelMap = dict[str, str | None]
"""Maps their name to the vocabulary's; None drops their label."""


class LabelsUnmatchedError(LegoWorldError):
    """Labels that match no category of the vocabulary."""

    code = "labels_unmatched"


def label_map(path: Path | None, vocabulary: Vocabulary, task: str) -> LabelMap:
    """The known aliases for this vocabulary, overridden by the user's own map.

    path: JSON {"their label": "category name", "another": null}. LabelsUnmatchedError if a category
    name is not in the vocabulary, with the nearest names.
    """
    labels: LabelMap = {
        old: name
        for old, name in OLD_NAMES.items()
        if find_dataset(task) == COCO.name and vocabulary.match(name) and not vocabulary.match(old)
    }
    if path is not None:
        own = _read(path)
        unknown = [name for name in own.values() if name and not vocabulary.match(name)]
        if unknown:
            raise _unmatched_error(
                f"{path} maps to {len(unknown)} unknown names", unknown, vocabulary
            )
        taken = {normal_name(label) for label in own}
        labels = {old: name for old, name in labels.items() if normal_name(old) not in taken} | own
    return labels


class Matcher:
    """Finds the category of a label, and collects unmatched labels for one message."""

    def __init__(self, vocabulary: Vocabulary, names: LabelMap) -> None:
        self._vocabulary = vocabulary
        self._names = {normal_name(label): name for label, name in names.items()}
        self.unmatched: dict[str, int] = {}
        self.left_out: dict[str, int] = {}

    def knows(self, label: str) -> bool:
        """Whether the map contains this label."""
        return normal_name(label) in self._names

    def match(self, label: str) -> Category | None:
        """The label's category; None, counted, if it is dropped or unmatched."""
        name = self._names.get(normal_name(label), label)
        if name is None:
            self.left_out[label] = self.left_out.get(label, 0) + 1
            return None
        category = self._vocabulary.match(name)
        if category is None:
            self.unmatched[label] = self.unmatched.get(label, 0) + 1
        return category

    def refuse_unmatched(self) -> None:
        """Raise LabelsUnmatchedError if a label was not matched."""
        if self.unmatched:
            raise _unmatched_error(
                plural(len(self.unmatched), "label names", "labels name") + " no category",
                list(self.unmatched),
                self._vocabulary,
            )


def _unmatched_error(what: str, labels: list[str], vocabulary: Vocabulary) -> LabelsUnmatchedError:
    shown = []
    for label in labels[:6]:
        near = vocabulary.nearest(label)
        shown.append(f"{label!r}" + (f" (near: {', '.join(near)})" if near else ""))
    return LabelsUnmatchedError(
        what,
        found=", ".join(shown) + (", ..." if len(labels) > len(shown) else ""),
        expected=f"one of the vocabulary's {len(vocabulary.categories)} names",
        next_step='pass --label-map FILE with {"their label": "category name"}, or null to drop it',
    )


def _read(path: Path) -> LabelMap:
    try:
        return decode(dict[str, str | None], path.read_bytes())
    except (OSError, RecordError) as error:
        raise LabelsUnmatchedError(
            f"the label map {path} cannot be used",
            found=str(error),
            expected='{"their label": "category name" or null}',
        ) from error
