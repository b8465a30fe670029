"""Category vocabularies: matching the names people write to the names a dataset has."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

from legoworld.errors import CatalogError
from legoworld.files import canonical_json, sha256_of_text

#: Ids above this lose digits where JSON numbers are read as doubles.
LARGEST_ID: Final = 2**53


@dataclass(frozen=True, kw_only=True)
class Category:
    """One category of a vocabulary; ids are the dataset's own (COCO's are sparse)."""

    id: int
    name: str
    synonyms: tuple[str, ...] = ()


@dataclass(frozen=True)
class Vocabulary:
    """The categories a readout may name."""

    categories: tuple[Category, ...]

    def match(self, text: str) -> Category | None:
        """The category a label names: by name, or by a synonym that only one category has."""
        key = normal_name(text)
        return self._by_name.get(key) or self._by_synonym.get(key)

    def nearest(self, text: str, n: int = 3) -> list[str]:
        """The names most like `text`, for messages."""
        key = normal_name(text), n
        if key not in self._near:  # a batch meets the same label in scene after scene
            import difflib  # only needed for a message

            close = difflib.get_close_matches(key[0], list(self._by_name), n=n, cutoff=0.6)
            self._near[key] = [self._by_name[name].name for name in close]
        return list(self._near[key])

    def name_of(self, category_id: int) -> str:
        """The name of a category id of this vocabulary."""
        return self._names[category_id]

    @cached_property
    def sha256(self) -> str:
        """Hash of the ids and names, for comparing runs."""
        return sha256_of_text(canonical_json([[c.id, c.name] for c in self.categories]))

    @cached_property
    def _near(self) -> dict[tuple[str, int], list[str]]:
        return {}

    @cached_property
    def _names(self) -> dict[int, str]:
        return {c.id: c.name for c in self.categories}

    @cached_property
    def _by_name(self) -> dict[str, Category]:
        return {normal_name(c.name): c for c in self.categories}

    @cached_property
    def _by_synonym(self) -> dict[str, Category]:
        owners: dict[str, list[Category]] = {}
        for category in self.categories:
            for synonym in {normal_name(s) for s in category.synonyms}:
                owners.setdefault(synonym, []).append(category)
        return {name: found[0] for name, found in owners.items() if len(found) == 1}


def normal_name(text: str) -> str:
    """Lower case, "_" as a space, white space runs as one space."""
    return " ".join(text.replace("_", " ").casefold().split())


def from_json(entries: object, source: str) -> Vocabulary:
    """A vocabulary from COCO-style category entries. CatalogError names what is wrong."""
    if not isinstance(entries, list) or not entries:
        raise CatalogError(
            f"{source} has no categories",
            found=type(entries).__name__,
            expected='a list of {"id", "name"}',
        )
    categories = []
    for entry in entries:
        if (
            not isinstance(entry, dict)
            or type(entry.get("id")) is not int
            or not isinstance(entry.get("name"), str)
        ):
            raise CatalogError(
                f"{source} has a category that cannot be used",
                found=repr(entry)[:80],
                expected='an integer "id" and a text "name"',
            )
        if not 0 <= entry["id"] <= LARGEST_ID:
            raise CatalogError(
                f"{source} has a category id that cannot be used",
                found=f"{entry['id']} ({entry['name']!r:.60})",
                expected="0 to 2**53, the integers that every JSON reader keeps",
            )
        synonyms = entry.get("synonyms") or ()
        categories.append(
            Category(id=entry["id"], name=entry["name"], synonyms=tuple(map(str, synonyms)))
        )
    categories.sort(key=lambda c: c.id)
    for attribute in ("id", "name"):
        values = [normal_name(c.name) if attribute == "name" else c.id for c in categories]
        if len(set(values)) != len(values):
            twice = next(v for v in values if values.count(v) > 1)
            raise CatalogError(
                f"{source} names a category {attribute} twice",
                found=repr(twice),
                expected=f"distinct {attribute}s",
            )
    return Vocabulary(tuple(categories))


def load(path: Path) -> Vocabulary:
    """A vocabulary file: a JSON list of categories."""
    return from_json(json.loads(path.read_text(encoding="utf-8")), path.name)
