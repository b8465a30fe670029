"""Labels: the categories people gave to objects and collections, resolved per vocabulary.

Labels are resolved after the snapshot, so an edited labels.json never reads a stale answer.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from legoworld.conventions import CATEGORY_KEY
from legoworld.errors import LabelsInvalidError, SideFileInvalidError, one_line
from legoworld.files import Json
from legoworld.pluralize import did_you_mean
from legoworld.records.scene_folder import LabelsFile
from legoworld.scene.folder import LABELS
from legoworld.scene.side_files import SideFile, invalid, read_side_file
from legoworld.scene.snapshot import Snapshot
from legoworld.tracks.vocabulary import Category, Vocabulary

Kind = Literal["object", "collection"]
#: Any `<vocabulary>_category` is read; these are the ones that a misspelt key may mean.
_KEYS: Final = ("object", "collection", CATEGORY_KEY, "coco_category", "lvis_category")


@dataclass(frozen=True, kw_only=True)
class OutsideLabel:
    """One entry of labels.json: categories for all objects or collections of a name.

    unread: keys that are none of the format's.
    """

    kind: Kind
    name: str
    categories: dict[str, str]  # by property: "category", "lvis_category", ...
    unread: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Label:
    """What a vocabulary makes of one owner's label."""

    text: str
    category: Category | None  # None: the vocabulary does not have it


@dataclass(frozen=True, kw_only=True)
class Labels:
    """Labels by index into the snapshot's objects and collections."""

    objects: dict[int, Label]
    collections: dict[int, Label]
    warnings: tuple[str, ...]


def read_labels_file(path: Path) -> tuple[OutsideLabel, ...]:
    """The entries of a labels.json; none when there is no such file. Raises LabelsInvalidError."""
    return labels_in(read_side_file(path.parent, path.name, LabelsFile))


def labels_in(file: SideFile[LabelsFile] | None) -> tuple[OutsideLabel, ...]:
    """The entries of a labels.json; none when there is no such file. Raises LabelsInvalidError."""
    entries = file.value.labels if file else ()
    labels = tuple(_outside_label(entry, place) for place, entry in enumerate(entries))
    _refuse_contradictions(labels)
    return labels


def _refuse_contradictions(labels: tuple[OutsideLabel, ...]) -> None:
    said: dict[tuple[str, str, str], str] = {}
    for label in labels:
        for key, category in label.categories.items():
            before = said.setdefault((label.kind, label.name, key), category)
            if before != category:
                raise _invalid(
                    f"{label.kind} {label.name!r} has {key} {before!r} and {key} {category!r}"
                )


def resolve_labels(
    snapshot: Snapshot,
    outside: Sequence[OutsideLabel],
    vocabulary: Vocabulary | None,
    override_property: str | None,
) -> Labels:
    """Each owner's label under one vocabulary; labels.json wins, then the override property.

    With vocabulary None every `category` counts, as it is written.
    """
    by_kind: dict[Kind, list[tuple[str, Mapping[str, str]]]] = {
        "object": [(o.name, dict(o.properties)) for o in snapshot.objects],
        "collection": [(c.name, dict(c.properties)) for c in snapshot.collections],
    }
    owners_of: dict[tuple[Kind, str], list[int]] = {}
    for kind, entries in by_kind.items() if outside else ():
        for i, (name, _) in enumerate(entries):
            owners_of.setdefault((kind, name), []).append(i)
    warnings = _unread_keys(outside)
    for label in _merge_entries(outside):
        owners = owners_of.get((label.kind, label.name), [])
        if not owners:
            warnings.append(f"{LABELS} names {label.kind} {label.name!r}: not in the scene")
        for i in owners:
            name, properties = by_kind[label.kind][i]
            by_kind[label.kind][i] = (name, _outside_wins(properties, label.categories))
    return Labels(
        objects=_match_labels(by_kind["object"], vocabulary, override_property),
        collections=_match_labels(by_kind["collection"], vocabulary, override_property),
        warnings=tuple(warnings),
    )


def _unread_keys(outside: Sequence[OutsideLabel]) -> list[str]:
    """A warning for each key that no entry of labels.json has a meaning for."""
    unread = sorted({key for label in outside for key in label.unread})
    return [
        f"{LABELS} has the key {key!r}, which is not read.{did_you_mean(key, _KEYS)}"
        for key in unread
    ]


def _merge_entries(outside: Sequence[OutsideLabel]) -> list[OutsideLabel]:
    """One entry per owner, whatever order its entries stand in."""
    merged: dict[tuple[Kind, str], dict[str, str]] = {}
    for label in outside:
        merged.setdefault((label.kind, label.name), {}).update(label.categories)
    return [
        OutsideLabel(kind=kind, name=name, categories=categories)
        for (kind, name), categories in merged.items()
    ]


def _outside_wins(inside: Mapping[str, str], outside: Mapping[str, str]) -> Mapping[str, str]:
    """labels.json replaces what the owner says; a plain category replaces overrides, too."""
    return dict(outside) if CATEGORY_KEY in outside else {**inside, **outside}


def _match_labels(
    owners: list[tuple[str, Mapping[str, str]]],
    vocabulary: Vocabulary | None,
    override_property: str | None,
) -> dict[int, Label]:
    labels = {}
    for i, (_, properties) in enumerate(owners):
        text = properties.get(override_property) if override_property else None
        if text is None:
            text = properties.get(CATEGORY_KEY)
        if text is None or not text.strip():
            continue
        if vocabulary is None:
            category: Category | None = Category(id=-1, name=text)
        else:
            category = vocabulary.match(text)
        labels[i] = Label(text=text, category=category)
    return labels


def _outside_label(entry: Mapping[str, Json], place: int) -> OutsideLabel:
    if ("object" in entry) == ("collection" in entry):
        raise _invalid(f"entry {place} is {one_line(json.dumps(entry), 80)}")
    kind: Kind = "object" if "object" in entry else "collection"
    categories = {
        key: value
        for key, value in entry.items()
        if key == CATEGORY_KEY or key.endswith("_" + CATEGORY_KEY)
    }
    texts = [entry[kind], *categories.values()]
    if not categories or not all(isinstance(t, str) and t.strip() for t in texts):
        raise _invalid(f"entry {place} is {one_line(json.dumps(entry), 80)}")
    unread = tuple(key for key in entry if key != kind and key not in categories)
    return OutsideLabel(
        kind=kind,
        name=str(entry[kind]),
        categories={key: str(value) for key, value in categories.items()},
        unread=unread,
    )


def _invalid(found: str) -> LabelsInvalidError | SideFileInvalidError:
    return invalid(LABELS, found)
