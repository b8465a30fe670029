"""A task, and the family of tasks whose answers are of one kind."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from legoworld.errors import InstallationError, cause

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Family:
    """How answers of one kind are read, scored, compared and shown.

    Each storey is "module:NAME" of a value of the type that the storey's `family.py` declares; it
    is imported when it is first asked for, so a task loads nothing of another family. None: the
    family has no such storey, and the command that needs it says so.

    name: such as "depth"; noun: what it answers, in a sentence; labelled: whether answers have the
    categories of a vocabulary; by_policy: whether a metric has several values, by what is done with
    pixels that lack one; options: the parameters of the API that only some families take;
    draws: bootstrap samples of `evaluate` where nobody says how many.
    """

    name: str
    noun: str
    records: str
    readout: str
    evaluation: str
    comparison: str
    page: str
    track: str | None = None
    baseline: str | None = None
    labelled: bool = False
    by_policy: bool = False
    options: frozenset[str] = frozenset()
    draws: int = 2000

    def load(self, storey: str, kind: type[T]) -> T:
        """The value of a storey, such as "evaluation". KeyError where the family has none.

        kind: the type that the storey declares. InstallationError for a module that cannot be
        imported, lacks the name or holds another type there.
        """
        place = getattr(self, storey)
        if place is None:
            raise KeyError(storey)
        module, _, name = place.partition(":")
        expected = f"{name}, a {kind.__module__}.{kind.__name__}"
        try:
            value = getattr(importlib.import_module(module), name)
        except Exception as error:  # a package of others may raise anything
            raise InstallationError(
                f"the {storey} of the family {self.name} cannot be loaded from {module}",
                found=cause(error),
                expected=expected,
                next_step="mend or uninstall the package",
            ) from error
        if not isinstance(value, kind):
            raise InstallationError(
                f"the {storey} of the family {self.name} cannot be used",
                found=f"{place} is a {type(value).__name__}",
                expected=expected,
            )
        return value


@dataclass(frozen=True, kw_only=True)
class Dataset:
    """What tracks, categories and truth belong to.

    version: of datasets/NAME/categories.json, where there is one; by_categories: versions that are
    known by their number of categories alone; federated: whether an image lists the categories it
    was verified for, as LVIS does.
    """

    name: str
    version: str | None = None
    by_categories: Mapping[int, str] = field(default_factory=dict)
    federated: bool = False


@dataclass(frozen=True, kw_only=True)
class Task:
    """One question as a user names it.

    dataset: whose tracks, categories and truth it uses; title, noun: what pages and sentences call
    it; card: its readouts/NAME.toml, None for the shipped one; fixed: the values that the code
    implements, by the card's dotted keys.
    """

    name: str
    family: Family
    dataset: Dataset
    title: str
    noun: str
    card: Path | None = None
    fixed: Mapping[str, Any] = field(default_factory=dict)
