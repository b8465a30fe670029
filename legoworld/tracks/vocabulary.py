"""Category vocabularies: matching labels to the category names of a dataset, of which version."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

from legoworld.errors import CatalogError
from legoworld.files import Json, canonical_json, sha256_of_text
from legoworld.pluralize import nearest_names
from legoworld.records.base import UNSET, RecordError, find_repeated, read_json, to_record
from legoworld.records.track import CategoryInfo
from legoworld.shipped import catalog
from legoworld.tasks.registry import find_task

#: Maximum number of cached matches: a scene may contain any number of labels.
_REMEMBERED: Final = 10_000


@dataclass(frozen=True, kw_only=True)
class Category:
    """One category of a vocabulary; ids are the dataset's own (COCO's are sparse).

    isthing: whether it is counted, one segment a thing; stuff is one segment a picture.
    """

    id: int
    name: str
    synonyms: tuple[str, ...] = ()
    isthing: bool = True


#: Marks a label not looked up yet, since None is a valid match.
_UNASKED: Final = Category(id=-1, name="")


@dataclass(frozen=True)
class Vocabulary:
    """The categories that a readout may use.

    bare_words: whether "mouse" may name "mouse_(computer_equipment)" if it is unambiguous.
    """

    categories: tuple[Category, ...]
    bare_words: bool = False

    def match(self, text: str) -> Category | None:
        """The category of a label: matched by name, else by synonym, else by bare word.

        A synonym or bare word shared by several categories matches none of them.
        """
        category = self._matched.get(text, _UNASKED)
        if category is _UNASKED:
            key = normal_name(text)
            category = (
                self._by_name.get(key) or self._by_synonym.get(key) or self._by_bare_word.get(key)
            )
            if len(self._matched) < _REMEMBERED:
                self._matched[text] = category
        return category

    def candidates(self, text: str) -> list[str]:
        """The names of all categories that a bare word may mean; empty without `bare_words`."""
        return sorted(self._bare_words.get(normal_name(text), ()))

    def list_bare_words(self, category: Category) -> tuple[str, ...]:
        """The bare word of a category, as a sequence of at most one."""
        return tuple(word for word, owner in self._by_bare_word.items() if owner is category)

    def nearest(self, text: str, n: int = 3) -> list[str]:
        """The names most similar to `text`, for messages; meanings of a bare word come first."""
        key = normal_name(text), n
        if key not in self._near:  # a batch repeats the same labels in many scenes
            spellings = self._by_bare_word | self._by_name
            close = nearest_names(key[0], spellings, n)
            names = [*self.candidates(text), *(spellings[name].name for name in close)]
            self._near[key] = list(dict.fromkeys(names))[:n]
        return list(self._near[key])

    def category_name(self, category_id: int) -> str:
        """The name of a category id of this vocabulary."""
        return self._names[category_id]

    @cached_property
    def sha256(self) -> str:
        """Hash of the ids and names, to compare runs."""
        return sha256_of_text(canonical_json([[c.id, c.name] for c in self.categories]))

    @cached_property
    def _matched(self) -> dict[str, Category | None]:
        """Cached matches of labels: a batch repeats the same labels in many scenes."""
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
        return {name: categories[0] for name, categories in owners.items() if len(categories) == 1}

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
        """Bare words of names only: those of synonyms make a word ambiguous, but match nothing."""
        by_word = {}
        for category in self.categories:
            word = _bare_word(category.name)
            if word is not None and self._bare_words.get(word) == {category.name}:
                by_word[word] = category
        return by_word


def normal_name(text: str) -> str:
    """Lower case, "_" as a space, white space runs as one space."""
    return " ".join(text.replace("_", " ").casefold().split())


def _bare_word(name: str) -> str | None:
    """The part of a name before its qualifier in brackets; None without one."""
    word, bracket, _ = normal_name(name).partition("(")
    return word.strip() or None if bracket else None


def make_vocabulary(entries: Sequence[CategoryInfo], source: str) -> Vocabulary:
    """A vocabulary from a file's categories. Raises CatalogError for a repeated id or name."""
    if not entries:
        raise CatalogError(
            f"{source} has no categories",
            found="an empty list",
            expected='a list of {"id", "name"}',
        )
    categories = sorted(
        (
            Category(
                id=e.id,
                name=e.name,
                synonyms=e.synonyms or (),
                isthing=e.isthing is UNSET or e.isthing == 1,
            )
            for e in entries
        ),
        key=lambda c: c.id,
    )
    for attribute in ("id", "name"):
        values = [normal_name(c.name) if attribute == "name" else c.id for c in categories]
        if twice := find_repeated(values):
            raise CatalogError(
                f"{source} has a category {attribute} twice",
                found=repr(twice[0]),
                expected=f"distinct {attribute}s",
            )
    return Vocabulary(tuple(categories))


def from_json(entries: Json, source: str) -> Vocabulary:
    """A vocabulary from COCO-style category entries. Raises CatalogError for unusable ones."""
    return make_vocabulary(categories_in(entries, source), source)


def categories_in(entries: Json, source: str) -> tuple[CategoryInfo, ...]:
    """COCO-style category entries. Raises CatalogError for unusable ones."""
    try:
        return to_record(tuple[CategoryInfo, ...], entries)
    except RecordError as error:
        raise CatalogError(
            f"{source} has categories that cannot be used",
            found=str(error),
            expected='a list of {"id": 0 to 2**53, "name": text}',
        ) from error


def load(path: Path) -> Vocabulary:
    """A vocabulary file: a JSON list of categories. CatalogError."""
    try:
        return from_json(read_json(path.read_bytes()), str(path))
    except RecordError as error:
        raise CatalogError(f"{path} cannot be read", found=str(error)) from error


def find_dataset(task: str) -> str:
    """The dataset whose tracks, categories and truth a task uses; an unknown task is its own."""
    known = find_task(task)
    return known.dataset.name if known else task


def dataset_version(vocabulary: Vocabulary, task: str) -> str:
    """The version of a task's dataset, from its categories; "custom" if they match none."""
    known = find_task(task)
    if known is None or known.dataset.version is None:
        return "custom"
    dataset = known.dataset
    shipped = load(catalog.folder("datasets") / dataset.name / "categories.json")
    if vocabulary.sha256 == shipped.sha256:
        return known.dataset.version
    return dataset.by_categories.get(len(vocabulary.categories), "custom")
