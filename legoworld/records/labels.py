"""labels.json: categories given to objects and collections beside the scene."""

from __future__ import annotations

from typing import Any, Literal

from legoworld.records.base import Record


class LabelsFile(Record, frozen=True, kw_only=True):
    """labels.json. An entry has "object" or "collection", and keys ending in "category"."""

    version: Literal[1]
    labels: tuple[dict[str, Any], ...]
