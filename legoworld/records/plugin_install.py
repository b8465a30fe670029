"""The plugin's parts that can be off, and legoworld-plugin.json, the record of `plugin install`."""

from __future__ import annotations

from typing import Literal

from legoworld.records.base import Record

Module = Literal["evidence", "initialisation", "measurement", "transactions", "records", "looking"]


class PluginUsed(Record, frozen=True, kw_only=True):
    """`plugin` of provenance.json: the plugin a scene was built with. modules: those that were on.

    Without the plugin the field is null.
    """

    name: Literal["legoworld"] = "legoworld"
    version: str
    modules: tuple[Module, ...]


class SettingsChange(Record, frozen=True, kw_only=True):
    """What was put into one file, in the order it was put there.

    path: in the project. skeleton: the file's text when it was made, null where it was there.
    """

    path: str
    skeleton: str | None
    fragments: tuple[str, ...]


class InstalledFile(Record, frozen=True, kw_only=True):
    """All files of one harness."""

    schema_version: Literal[1] = 1
    files: tuple[SettingsChange, ...]
