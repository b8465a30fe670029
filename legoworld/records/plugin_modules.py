"""The parts of the plugin that can be off, for ablations."""

from __future__ import annotations

from typing import Literal

from legoworld.records.base import Record

Module = Literal["evidence", "initialisation", "measurement", "transactions", "records"]


class PluginUsed(Record, frozen=True, kw_only=True):
    """`plugin` of provenance.json: the plugin a scene was built with. modules: those that were on.

    Without the plugin the field is null.
    """

    name: Literal["legoworld"] = "legoworld"
    version: str
    modules: tuple[Module, ...]
