"""Grouping surfaces into instances: one object of the world as a viewer counts it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from legoworld.scene.labels import Label, Labels
from legoworld.scene.snapshot import Snapshot
from legoworld.tracks.vocabulary import Category

#: (owner's kind, owner's index, the occurrence it stands in, the placement within that)
_Key = tuple[Literal["object", "collection", "occurrence"], int, int, int]
_Owner = tuple[_Key, Label | None]


class _Chain(NamedTuple):
    ancestors: tuple[int, ...]
    label: Label | None  # of the last of them


@dataclass(frozen=True, kw_only=True)
class Instance:
    """One instance: its name, its parts, and its category (None: unlabelled)."""

    id: int
    name: str
    objects: tuple[str, ...]  # distinct names of the objects whose surfaces it has, sorted
    category: Category | None
    label_text: str | None


@dataclass(frozen=True, kw_only=True)
class Grouping:
    """All instances of a scene under one vocabulary.

    surface_instance: (S,) int32, the instance of each surface of the snapshot.
    enclosing_instance: instance id -> id of the labelled instance it was cut out of.
    outside_vocabulary: label texts the vocabulary lacks, with how many owners carry each.
    unseen_owners: labelled owners without any surface: (name, label text).
    """

    instances: tuple[Instance, ...]
    surface_instance: NDArray[np.int32]
    enclosing_instance: dict[int, int]
    outside_vocabulary: dict[str, int]
    unseen_owners: tuple[tuple[str, str], ...]
    warnings: tuple[str, ...]


def group(snapshot: Snapshot, labels: Labels) -> Grouping:
    """Resolve every surface to its nearest owner.

    Nearest: the object's own label, then its parents', then its collections' from the innermost
    outwards, then the same for what instanced it. Labels outside the vocabulary are transparent.
    """
    return _Resolver(snapshot, labels).grouping()


class _Resolver:
    """The lookups one grouping needs, each made once."""

    def __init__(self, snapshot: Snapshot, labels: Labels) -> None:
        self.snapshot = snapshot
        self.labels = labels
        self._object: list[int] = snapshot.occurrence_object.tolist()
        self._instancer: list[int] = snapshot.occurrence_instancer.tolist()
        self._frame: list[int] = snapshot.occurrence_frame.tolist()
        self._owners: dict[int, _Owner | None] = {}
        self._chains: dict[int, _Chain] = {}
        self._folders: dict[int, tuple[int, Label] | None] = {}
        self._holding: dict[int, frozenset[int]] = {}
        self._in_several: dict[tuple[str, ...], list[str]] = {}
        self._occurrence_at: dict[tuple[int, int, int], int] = {}
        for occurrence, place in enumerate(
            zip(self._object, self._instancer, self._frame, strict=True)
        ):
            self._occurrence_at.setdefault(place, occurrence)

    def grouping(self) -> Grouping:
        snapshot = self.snapshot
        ids: dict[_Key, int] = {}
        parts: list[set[str]] = []
        owners: list[_Owner] = []
        surface_instance = np.empty(len(snapshot.surface_mesh), np.int32)
        for s, occurrence in enumerate(snapshot.surface_occurrence.tolist()):
            owner = self._labelled_owner(occurrence) or (("occurrence", -1, occurrence, -1), None)
            instance = ids.setdefault(owner[0], len(owners))
            if instance == len(owners):
                parts.append(set())
                owners.append(owner)
            surface_instance[s] = instance
            parts[instance].add(snapshot.objects[self._object[occurrence]].name)
        instances = tuple(
            Instance(
                id=i,
                name=self._name(key),
                objects=tuple(sorted(parts[i])),
                category=label.category if label else None,
                label_text=label.text if label else None,
            )
            for i, (key, label) in enumerate(owners)
        )
        enclosing = self._find_nested(ids, owners)
        return Grouping(
            instances=instances,
            surface_instance=surface_instance,
            enclosing_instance=enclosing,
            outside_vocabulary=self._outside_vocabulary(),
            unseen_owners=self._unseen_owners(owners),
            warnings=self._warnings(),
        )

    def _labelled_owner(self, occurrence: int) -> _Owner | None:
        if occurrence not in self._owners:
            shown = self._object[occurrence]
            label = self._label(shown)
            self._owners[occurrence] = (
                (("object", shown, occurrence, -1), label)
                if label
                else self._owner_above(shown, self._instancer[occurrence], self._frame[occurrence])
            )
        return self._owners[occurrence]

    def _owner_above(self, shown: int, instancer: int, frame: int) -> _Owner | None:
        """The nearest owner of an object in that placement, its own label aside."""
        chain = self._chain(shown)
        if chain.label is not None:
            return self._ancestor_key(chain.ancestors, instancer, frame), chain.label
        if shown not in self._folders:
            held = self.snapshot.objects[shown]
            self._folders[shown] = self._labelled_collection(held.collections, held.name)
        folder = self._folders[shown]
        if folder is not None:
            return self._collection_key(folder[0], instancer, frame), folder[1]
        return self._labelled_owner(instancer) if instancer >= 0 else None

    def _chain(self, shown: int) -> _Chain:
        """The parents of an object, up to the first labelled one."""
        if shown not in self._chains:
            ancestors: list[int] = []
            label = None
            parent = self.snapshot.objects[shown].parent
            while parent >= 0 and parent not in ancestors and label is None:
                ancestors.append(parent)
                label = self._label(parent)
                parent = self.snapshot.objects[parent].parent
            self._chains[shown] = _Chain(ancestors=tuple(ancestors), label=label)
        return self._chains[shown]

    def _ancestor_key(self, ancestors: tuple[int, ...], instancer: int, frame: int) -> _Key:
        """The key of the last of these ancestors, as it occurs for a descendant placed so.

        An object may be an ancestor of what it instances (on its vertices): from there upwards
        the placement is the instancer's own.
        """
        for ancestor in ancestors:
            if instancer >= 0 and ancestor == self._object[instancer]:
                if ancestor == ancestors[-1]:
                    return ("object", ancestor, instancer, -1)
                instancer, frame = self._instancer[instancer], self._frame[instancer]
        occurrence = self._occurrence_at.get((ancestors[-1], instancer, frame))
        if occurrence is None:  # not in the placement itself, only its parts are
            return ("object", ancestors[-1], instancer, frame)
        return ("object", ancestors[-1], occurrence, -1)

    def _label(self, shown: int) -> Label | None:
        label = self.labels.objects.get(shown)
        return label if label and label.category else None

    def _labelled_collection(
        self, level: Sequence[int], held_name: str
    ) -> tuple[int, Label] | None:
        """The innermost labelled collection, outwards from `level`; by name where several are."""
        collections = self.snapshot.collections
        seen: set[int] = set()
        while level:
            labelled = sorted((collections[c].name, c) for c in level if self._collection_label(c))
            if len(labelled) > 1:
                names = tuple(name for name, _ in labelled)
                self._in_several.setdefault(names, []).append(held_name)
            if labelled:
                chosen = labelled[0][1]
                return chosen, self.labels.collections[chosen]
            seen.update(level)
            level = sorted({p for c in level for p in collections[c].parents} - seen)
        return None

    def _collection_label(self, collection: int) -> Label | None:
        label = self.labels.collections.get(collection)
        return label if label and label.category else None

    def _collection_key(self, collection: int, instancer: int, frame: int) -> _Key:
        """One instance per placement of the collection; one at all if the instancer is in it."""
        while instancer >= 0 and collection in self._containing_collections(
            self._object[instancer]
        ):
            instancer, frame = self._instancer[instancer], self._frame[instancer]
        return ("collection", collection, instancer, frame if instancer >= 0 else -1)

    def _containing_collections(self, shown: int) -> frozenset[int]:
        """The collections that hold an object, directly or not."""
        if shown not in self._holding:
            todo, holders = list(self.snapshot.objects[shown].collections), set()
            while todo:
                collection = todo.pop()
                if collection not in holders:
                    holders.add(collection)
                    todo.extend(self.snapshot.collections[collection].parents)
            self._holding[shown] = frozenset(holders)
        return self._holding[shown]

    def _find_nested(self, ids: Mapping[_Key, int], owners: list[_Owner]) -> dict[int, int]:
        """Labelled instances that are cut out of another labelled one, with that one's id."""
        enclosing = {}
        for key, label in owners:
            outer = self._owner_outside(key) if label else None
            if outer is not None and outer[0] in ids:
                enclosing[ids[key]] = ids[outer[0]]
        return enclosing

    def _owner_outside(self, key: _Key) -> _Owner | None:
        kind, index, level, frame = key
        if kind == "collection":
            held = self.snapshot.collections[index]
            folder = self._labelled_collection(held.parents, held.name)
            if folder is not None:
                return self._collection_key(folder[0], level, frame), folder[1]
            return self._labelled_owner(level) if level >= 0 else None
        if frame == -1:
            return self._owner_above(index, self._instancer[level], self._frame[level])
        return self._owner_above(index, level, frame)

    def _name(self, key: _Key) -> str:
        kind, index, level, _ = key
        if kind == "collection":
            return self.snapshot.collections[index].name
        if kind == "occurrence":
            return self.snapshot.objects[self._object[level]].name
        return self.snapshot.objects[index].name

    def _outside_vocabulary(self) -> dict[str, int]:
        counts: dict[str, int] = {}
        for label in (*self.labels.objects.values(), *self.labels.collections.values()):
            if label.category is None:
                counts[label.text] = counts.get(label.text, 0) + 1
        return dict(sorted(counts.items()))

    def _unseen_owners(self, resolved: list[_Owner]) -> tuple[tuple[str, str], ...]:
        owners = {(key[0], key[1]) for key, label in resolved if label}
        unseen = [
            (self.snapshot.objects[i].name, label.text)
            for i, label in self.labels.objects.items()
            if label.category and ("object", i) not in owners
        ]
        unseen += [
            (self.snapshot.collections[i].name, label.text)
            for i, label in self.labels.collections.items()
            if label.category and ("collection", i) not in owners
        ]
        return tuple(sorted(unseen))

    def _warnings(self) -> tuple[str, ...]:
        texts = []
        for names, held in sorted(self._in_several.items()):
            distinct = sorted(set(held))
            others = len(distinct) - 1
            who = f"{distinct[0]!r} and {others} more lie" if others else f"{distinct[0]!r} lies"
            texts.append(f"{who} in {len(names)} labelled collections; {names[0]!r} was taken")
        return tuple(texts)
