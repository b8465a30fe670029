"""legoworld-plugin.json: what `plugin install` put into a harness's settings, to take it out."""

from __future__ import annotations

from typing import Literal

from legoworld.records.base import Record


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
