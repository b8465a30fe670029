"""Category vocabularies: matching the names people write to the names a dataset has."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

from legoworld.errors import CatalogError
from legoworld.files import canonical_json, sha256_of_text
from legoworld.records.base import RecordError, to_record
from legoworld.records.repeats import repeated
from legoworld.records.track import CategoryInfo

#: Labels whose match is remembered, at most: a scene may bring any number.
_REMEMBERED: Final = 10_000


@dataclass(frozen=True, kw_only=True)
class Category:
    """One category of a vocabulary; ids are the dataset's own (COCO's are sparse)."""

    id: int
    name: str
    synonyms: tuple[str, ...] = ()


#: Stands for what was not looked up before, where None is an answer.
_UNASKED: Final = Category(id=-1, name="")


@dataclass(frozen=True)
class Vocabulary:
    """The categories a readout may name.

    bare_words: whether "mouse" may name "mouse_(computer_equipment)", where no other is meant.
    """

    categories: tuple[Category, ...]
    bare_words: bool = False

    def match(self, text: str) -> Category | None:
        """The category a label names: by name, else by a synonym, else by a bare word.

        A synonym that several categories have names none of them; nor does such a bare word.
        """
        found = self._matched.get(text, _UNASKED)
        if found is _UNASKED:
            key = normal_name(text)
            found = (
                self._by_name.get(key) or self._by_synonym.get(key) or self._by_bare_word.get(key)
            )
            if len(self._matched) < _REMEMBERED:
                self._matched[text] = found
        return found

    def candidates(self, text: str) -> list[str]:
        """The names of all categories that a bare word may mean; none without `bare_words`."""
        return sorted(self._bare_words.get(normal_name(text), ()))

    def bare_words_of(self, category: Category) -> tuple[str, ...]:
        """The bare word that names a category, as a sequence of at most one."""
        return tuple(word for word, owner in self._by_bare_word.items() if owner is category)

    def nearest(self, text: str, n: int = 3) -> list[str]:
        """The names most like `text`, for messages; what an ambiguous bare word may mean first."""
        key = normal_name(text), n
        if key not in self._near:  # a batch meets the same label in scene after scene
            import difflib  # only needed for a message

            spellings = self._by_bare_word | self._by_name
            close = difflib.get_close_matches(key[0], list(spellings), n=n, cutoff=0.6)
            names = [*self.candidates(text), *(spellings[name].name for name in close)]
            self._near[key] = list(dict.fromkeys(names))[:n]
        return list(self._near[key])

    def name_of(self, category_id: int) -> str:
        """The name of a category id of this vocabulary."""
        return self._names[category_id]

    @cached_property
    def sha256(self) -> str:
        """Hash of the ids and names, for comparing runs."""
        return sha256_of_text(canonical_json([[c.id, c.name] for c in self.categories]))

    @cached_property
    def _matched(self) -> dict[str, Category | None]:
        """What labels were matched to: a batch meets the same ones in scene after scene."""
        return {}

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

    @cached_property
    def _bare_words(self) -> dict[str, set[str]]:
        """Names and synonyms without their qualifier, and the categories that have them."""
        owners: dict[str, set[str]] = {}
        if self.bare_words:
            for category in self.categories:
                for name in (category.name, *category.synonyms):
                    word = _bare_word(name)
                    if word is not None:
                        owners.setdefault(word, set()).add(category.name)
        return owners

    @cached_property
    def _by_bare_word(self) -> dict[str, Category]:
        """Of a name's own words only: a synonym's say that a word is ambiguous, not what it is."""
        found = {}
        for category in self.categories:
            word = _bare_word(category.name)
            if word is not None and self._bare_words.get(word) == {category.name}:
                found[word] = category
        return found


def normal_name(text: str) -> str:
    """Lower case, "_" as a space, white space runs as one space."""
    return " ".join(text.replace("_", " ").casefold().split())


def _bare_word(name: str) -> str | None:
    """What stands before a name's qualifier in brackets; None where there is none."""
    word, bracket, _ = normal_name(name).partition("(")
    return word.strip() or None if bracket else None


def vocabulary_of(entries: Sequence[CategoryInfo], source: str) -> Vocabulary:
    """A vocabulary of a file's categories. CatalogError for an id or a name that is there twice."""
    if not entries:
        raise CatalogError(
            f"{source} has no categories",
            found="an empty list",
            expected='a list of {"id", "name"}',
        )
    categories = sorted(
        (Category(id=e.id, name=e.name, synonyms=e.synonyms or ()) for e in entries),
        key=lambda c: c.id,
    )
    for attribute in ("id", "name"):
        values = [normal_name(c.name) if attribute == "name" else c.id for c in categories]
        if twice := repeated(values):
            raise CatalogError(
                f"{source} names a category {attribute} twice",
                found=repr(twice[0]),
                expected=f"distinct {attribute}s",
            )
    return Vocabulary(tuple(categories))


def from_json(entries: object, source: str) -> Vocabulary:
    """A vocabulary of COCO-style category entries. CatalogError says what cannot be used."""
    return vocabulary_of(categories_in(entries, source), source)


def categories_in(entries: object, source: str) -> tuple[CategoryInfo, ...]:
    """COCO-style category entries. CatalogError says what cannot be used."""
    try:
        return to_record(tuple[CategoryInfo, ...], entries)
    except RecordError as error:
        raise CatalogError(
            f"{source} has categories that cannot be used",
            found=str(error),
            expected='a list of {"id": 0 to 2**53, "name": text}',
        ) from error


def load(path: Path) -> Vocabulary:
    """A vocabulary file: a JSON list of categories."""
    return from_json(json.loads(path.read_text(encoding="utf-8")), path.name)
