"""Tags that somebody gave photos, as a filter of the page."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from pathlib import Path

from legoworld.errors import UsageError
from legoworld.records.report_page import PhotoRow

_COLUMNS = ("file_name", "tag")


def read_tags(path: Path) -> dict[str, set[str]]:
    """The photos of each tag, by file name as in the track.

    path: a CSV in UTF-8 with the columns `file_name` and `tag`, a line for each tag of a photo;
    other columns are ignored. UsageError for any other file.
    """
    photos: dict[str, set[str]] = {}
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            lines = csv.DictReader(file, strict=True)
            if not set(_COLUMNS) <= set(lines.fieldnames or ()):
                raise _unusable(path, f"the columns {', '.join(lines.fieldnames or ()) or 'none'}")
            for line in lines:
                name, tag = (line[column] for column in _COLUMNS)
                if not name or not tag:
                    raise _unusable(path, f"line {lines.line_num} without a name or a tag")
                photos.setdefault(tag, set()).add(name)
    except (UnicodeDecodeError, csv.Error) as error:
        raise _unusable(path, str(error)) from None
    return photos


def tag_images(
    photos: Mapping[str, set[str]], rows: Iterable[PhotoRow]
) -> tuple[tuple[str, tuple[int, ...]], ...]:
    """Each tag that a section has photos of with their ids, both in order."""
    listed = [(row.file_name, row.id) for row in rows]
    found = [(tag, tuple(i for name, i in listed if name in photos[tag])) for tag in sorted(photos)]
    return tuple((tag, ids) for tag, ids in found if ids)


def _unusable(path: Path, found: str) -> UsageError:
    return UsageError(
        f"{path.name} does not list tags of photos",
        found=found,
        expected="a CSV in UTF-8, columns file_name and tag, a line for each tag of a photo",
    )
