"""Grouping surfaces into instances: one object of the world as a viewer counts it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from legoworld.scene.labels import Label, Labels
from legoworld.scene.snapshot import Snapshot
from legoworld.vocabulary import Category

#: (owner's kind, owner's index, the occurrence it stands in, the placement within that)
_Key = tuple[Literal["object", "collection", "occurrence"], int, int, int]
_Owner = tuple[_Key, Label | None]


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
    nested: instance id -> id of the labelled instance it was cut out of.
    outside_vocabulary: label texts the vocabulary lacks, with how many owners carry each.
    unseen_owners: labelled owners without any surface: (name, label text).
    """

    instances: tuple[Instance, ...]
    surface_instance: NDArray[np.int32]
    nested: dict[int, int]
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
        self.warnings: set[str] = set()
        self._owners: dict[int, _Owner | None] = {}
        self._occurrence_at: dict[tuple[int, int, int], int] = {}
        for occurrence in range(len(snapshot.occurrence_object)):
            self._occurrence_at.setdefault(self._place(occurrence), occurrence)

    def grouping(self) -> Grouping:
        snapshot = self.snapshot
        ids: dict[_Key, int] = {}
        parts: list[set[str]] = []
        found: list[_Owner] = []
        surface_instance = np.empty(len(snapshot.surface_mesh), np.int32)
        for s, occurrence in enumerate(snapshot.surface_occurrence.tolist()):
            key, label = self.owner(occurrence)
            if key not in ids:
                ids[key] = len(ids)
                parts.append(set())
                found.append((key, label))
            surface_instance[s] = ids[key]
            shown = snapshot.objects[snapshot.occurrence_object[occurrence]]
            parts[ids[key]].add(shown.name)
        instances = tuple(
            Instance(
                id=i,
                name=self._name(key),
                objects=tuple(sorted(parts[i])),
                category=label.category if label else None,
                label_text=label.text if label else None,
            )
            for i, (key, label) in enumerate(found)
        )
        return Grouping(
            instances=instances,
            surface_instance=surface_instance,
            nested=self._nested(ids, found),
            outside_vocabulary=self._outside_vocabulary(),
            unseen_owners=self._unseen_owners(found),
            warnings=tuple(sorted(self.warnings)),
        )

    def owner(self, occurrence: int) -> _Owner:
        """The instance key of an occurrence, and the label that makes it one (None: none)."""
        return self._labelled_owner(occurrence) or (("occurrence", -1, occurrence, -1), None)

    def _labelled_owner(self, occurrence: int) -> _Owner | None:
        if occurrence not in self._owners:
            shown, instancer, frame = self._place(occurrence)
            label = self._label(shown)
            self._owners[occurrence] = (
                (("object", shown, occurrence, -1), label)
                if label
                else self._owner_above(shown, instancer, frame)
            )
        return self._owners[occurrence]

    def _owner_above(self, shown: int, instancer: int, frame: int) -> _Owner | None:
        """The nearest owner of an object, its own label aside."""
        stop = self._instancing_ancestor(shown, instancer)
        for ancestor in self._ancestors(shown):
            if ancestor == stop:
                # What holds the object holds its instancer too: it is found from there.
                return self._labelled_owner(instancer)
            label = self._label(ancestor)
            if label:
                return self._object_key(ancestor, instancer, frame), label
        folder = self._labelled_collection(
            list(self.snapshot.objects[shown].collections), self.snapshot.objects[shown].name
        )
        if folder is not None:
            return self._collection_key(folder[0], instancer, frame), folder[1]
        return self._labelled_owner(instancer) if instancer >= 0 else None

    def _place(self, occurrence: int) -> tuple[int, int, int]:
        snapshot = self.snapshot
        return (
            int(snapshot.occurrence_object[occurrence]),
            int(snapshot.occurrence_instancer[occurrence]),
            int(snapshot.occurrence_frame[occurrence]),
        )

    def _object_key(self, shown: int, instancer: int, frame: int) -> _Key:
        """Where the object itself occurs in that placement; the placement where it does not."""
        occurrence = self._occurrence_at.get((shown, instancer, frame))
        if occurrence is None:
            return ("object", shown, instancer, frame)
        return ("object", shown, occurrence, -1)

    def _label(self, shown: int) -> Label | None:
        label = self.labels.objects.get(shown)
        return label if label and label.category else None

    def _ancestors(self, shown: int) -> list[int]:
        chain = []
        parent = self.snapshot.objects[shown].parent
        while parent >= 0 and parent not in chain:
            chain.append(parent)
            parent = self.snapshot.objects[parent].parent
        return chain

    def _instancing_ancestor(self, shown: int, instancer: int) -> int:
        """The instancer's object when it is an ancestor of what it instances (on vertices)."""
        if instancer < 0:
            return -1
        maker = int(self.snapshot.occurrence_object[instancer])
        return maker if maker in self._ancestors(shown) else -1

    def _labelled_collection(
        self, level: list[int], object_name: str
    ) -> tuple[int, Label] | None:
        """The innermost labelled collection, outwards from `level`; by name where several are."""
        seen: set[int] = set()
        while level:
            labelled = sorted(
                ((self.snapshot.collections[c].name, c, label)
                 for c in level if (label := self._collection_label(c))),
                key=lambda found: found[:2],
            )  # fmt: skip
            if len(labelled) > 1:
                self.warnings.add(
                    f"object {object_name!r} lies in {len(labelled)} labelled collections; "
                    f"{labelled[0][0]!r} was taken"
                )
            if labelled:
                return labelled[0][1], labelled[0][2]
            seen.update(level)
            level = sorted(
                {p for c in level for p in self.snapshot.collections[c].parents} - seen
            )
        return None

    def _collection_label(self, collection: int) -> Label | None:
        label = self.labels.collections.get(collection)
        return label if label and label.category else None

    def _collection_key(self, collection: int, instancer: int, frame: int) -> _Key:
        """One instance per placement of the collection; one at all if the instancer is in it."""
        while instancer >= 0:
            maker = int(self.snapshot.occurrence_object[instancer])
            if collection not in self._all_collections(maker):
                break
            frame = int(self.snapshot.occurrence_frame[instancer])
            instancer = int(self.snapshot.occurrence_instancer[instancer])
        if instancer < 0:
            frame = -1
        return ("collection", collection, instancer, frame)

    def _all_collections(self, shown: int) -> set[int]:
        todo, found = list(self.snapshot.objects[shown].collections), set()
        while todo:
            collection = todo.pop()
            if collection not in found:
                found.add(collection)
                todo.extend(self.snapshot.collections[collection].parents)
        return found

    def _nested(self, ids: dict[_Key, int], found: list[_Owner]) -> dict[int, int]:
        """Labelled instances that are cut out of another labelled one, with that one's id."""
        nested = {}
        for key, label in found:
            if label is None:
                continue
            outer = self._owner_outside(key)
            if outer is not None and outer[0] in ids:
                nested[ids[key]] = ids[outer[0]]
        return nested

    def _owner_outside(self, key: _Key) -> _Owner | None:
        kind, index, level, frame = key
        if kind == "collection":
            parents = list(self.snapshot.collections[index].parents)
            folder = self._labelled_collection(parents, self.snapshot.collections[index].name)
            if folder is not None:
                return self._collection_key(folder[0], level, frame), folder[1]
            return self._labelled_owner(level) if level >= 0 else None
        if frame == -1:
            return self._owner_above(*self._place(level))
        return self._owner_above(index, level, frame)

    def _name(self, key: _Key) -> str:
        kind, index, level, _ = key
        if kind == "collection":
            return self.snapshot.collections[index].name
        if kind == "occurrence":
            return self.snapshot.objects[self.snapshot.occurrence_object[level]].name
        return self.snapshot.objects[index].name

    def _outside_vocabulary(self) -> dict[str, int]:
        counts: dict[str, int] = {}
        for label in (*self.labels.objects.values(), *self.labels.collections.values()):
            if label.category is None:
                counts[label.text] = counts.get(label.text, 0) + 1
        return dict(sorted(counts.items()))

    def _unseen_owners(
        self, found: list[_Owner]
    ) -> tuple[tuple[str, str], ...]:
        owners = {(key[0], key[1]) for key, label in found if label}
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
