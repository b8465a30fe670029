"""Readout cards: the declared protocol of each task, checked against what the code does."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

from legoworld.conventions import ALPHA_THRESHOLD, NO_DEPTH, NO_INSTANCE
from legoworld.errors import CatalogError, InstallationError, cause
from legoworld.files import Json, sha256_of_file, sha256_of_text
from legoworld.records.base import RecordError, to_record
from legoworld.records.cards import ReadoutCard
from legoworld.shipped import catalog
from legoworld.tasks.registry import require_task

T = TypeVar("T")

#: The values the code implements, by card key; a card that declares another value is refused.
_FIXED: dict[str, Any] = {
    "visibility.samples_per_pixel": 1,
    "visibility.sample_xy_px": [0.5, 0.5],
    "visibility.tie_order": ["depth_z_m", "instance_id"],
    "visibility.alpha_threshold": ALPHA_THRESHOLD,
    "visibility.transmission": "surface",
    "visibility.volumes": "ignored",
    "visibility.sides": "double",
    "visibility.clip": "camera",
    "visibility.geometry": "render",
    "visibility.frame": "saved",
    "visibility.camera": "active",
    "visibility.no_hit_instance": NO_INSTANCE,
    "visibility.no_hit_depth": NO_DEPTH,
}


@dataclass(frozen=True, kw_only=True)
class Card:
    """One task's card. values: the card's tables as read; declared: the values the code uses.

    file: its name in messages.
    """

    task: str
    file: str
    sha256: str
    values: dict[str, Any]

    @property
    def version(self) -> str:
        """The card's version, which a run records."""
        return self.record.readout.version

    @property
    def reads(self) -> str:
        """What is read: "boxes", "masks", "depth" or others."""
        return self.record.readout.reads

    @cached_property
    def record(self) -> ReadoutCard:
        """The card as a typed record. InstallationError when it does not decode."""
        try:
            return to_record(ReadoutCard, self.values)
        except RecordError as error:
            raise InstallationError(
                f"the readout card of {self.task} cannot be used",
                found=str(error),
                expected="a card with [readout] and, for answers with categories, [vocabulary]",
                next_step=f"correct {self.file}",
            ) from error

    def value(self, key: str) -> Any:
        """A value by its dotted key, such as "scoring.max_detections".

        Raises InstallationError where the card lacks it.
        """
        found: Any = self.values
        for part in key.split("."):
            if not isinstance(found, dict) or part not in found:
                raise InstallationError(
                    f"the readout card of {self.task} lacks a value",
                    found=f"no {key}",
                    expected=f"{key} in {self.file}",
                )
            found = found[part]
        return found

    def hold_to(self, fixed: Mapping[str, Json]) -> None:
        """InstallationError where the card declares another value than the code implements.

        fixed: those values by their dotted keys.
        """
        for key, expected in fixed.items():
            if self.value(key) != expected:
                raise InstallationError(
                    f"{self.file} declares a protocol the code does not implement",
                    found=f"{key} = {self.value(key)!r}",
                    expected=f"{key} = {expected!r}",
                    next_step="restore the card; another protocol needs other code",
                )


def load_card(task: str) -> Card:
    """The card of a task."""
    shipped = catalog.folder("readouts") / f"{task}.toml"
    return read_card(require_task(task).card or shipped, task)


def read_card(path: Path, task: str) -> Card:
    """Read a card; InstallationError when a fixed value is not the one the code implements."""
    card = read_values(path, task)
    names = {"readout.name": task, "readout.task": task}
    card.hold_to({**names, **_FIXED, **require_task(task).fixed})
    return card


def read_values(path: Path, task: str) -> Card:
    """Read a card without checking its values.

    base: file name of a card beside it; it supplies the tables that this card does not declare.
    Raises InstallationError for a file that cannot be read as TOML.
    """
    file = f"readouts/{path.name}" if path.parent == catalog.folder("readouts") else str(path)
    try:
        values = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InstallationError(
            f"the readout card of {task} cannot be read",
            found=cause(error),
            expected=f"{file}, a TOML file",
            next_step="install the package that has the task again",
        ) from error
    sha256 = sha256_of_file(path)
    if base := values.pop("base", None):
        below = read_values(path.with_name(f"{base}.toml"), task)
        values = {**below.values, **values}
        sha256 = sha256_of_text(f"{sha256} {below.sha256}")
    return Card(task=task, file=file, sha256=sha256, values=values)


def read_toml(kind: type[T], path: Path, *, what: str, expected: str, next_step: str = "") -> T:
    """A TOML file as a value of its type. CatalogError, with these words, for any other content."""
    try:
        return to_record(kind, tomllib.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError) as error:
        raise CatalogError(
            f"{what} cannot be used", found=cause(error), expected=expected, next_step=next_step
        ) from error
