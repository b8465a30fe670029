"""Arguments that name a local folder or a URL."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from urllib.parse import unquote, urlsplit

import click

from legoworld.commands import options
from legoworld.remote import Place, is_url


class PlaceType(click.ParamType[Place]):
    """A folder's path, or its URL. file:// is a path."""

    name = "folder or url"

    def __init__(self, *, exists: bool) -> None:
        self._path = options.EXISTING_FOLDER if exists else options.FOLDER

    def convert(
        self, value: str | PathLike[str], param: click.Parameter | None, ctx: click.Context | None
    ) -> Place:
        """Convert text to a path; a URL stays text."""
        if isinstance(value, str) and is_url(value):
            if urlsplit(value).scheme != "file":
                return value
            value = unquote(urlsplit(value).path)
        path: Path = self._path.convert(value, param, ctx)
        return path
