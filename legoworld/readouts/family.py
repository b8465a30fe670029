"""The readout of a family: what is exported of one image, and how a run sums it up."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.cards import Card
from legoworld.records.folders.read_run import ANSWERS, ROWS, RunDamagedError
from legoworld.records.predictions import Prediction
from legoworld.records.run_file import RunSummary
from legoworld.records.run_rows import RunRow
from legoworld.tables.table import Table
from legoworld.tracks.track import Track

if TYPE_CHECKING:
    from legoworld.readouts.pictures import Rgb
    from legoworld.scene.instances import Instance
    from legoworld.tracks.vocabulary import Category, Vocabulary
    from legoworld.visibility.normals import Variant
    from legoworld.visibility.view import View

__all__ = ["ANSWERS", "AnsweredImage", "Export", "ReadoutFamily", "answer_file", "unusable_row"]

Export = tuple[Prediction, "Instance"]
"""A prediction and its instance."""


#: Instances of a scene from which on it is said what its answer takes.
MANY: Final = 1000


@dataclass(frozen=True, kw_only=True)
class AnsweredImage:
    """One image as it was drawn.

    name: of its scene or photo, without a suffix; run: the folder; normals: which of them are asked
    for; threads: to draw more with; vocabulary: None where answers have no categories; sky: the
    category of pixels without a hit, None for none.
    """

    image_id: int
    name: str
    run: Path
    instances: Sequence[Instance]
    view: View
    normals: Variant | None = None
    threads: int | None = None
    vocabulary: Vocabulary | None = None
    sky: Category | None = None


@dataclass(frozen=True, kw_only=True)
class ReadoutFamily:
    """How answers of one kind are read.

    exports: the results of an image in canonical order, of what the card says is read; None where
    the answers are files. write: writes an image's files, and returns its row with them; None where
    there are none. complete: writes what a run has of all its images, `ANSWERS` and the files of
    images without a result, from all rows. picture: how an answer looks; notes: what its author
    must know. sum_up: a run's summary with what is its own, of the rows that have a result.
    file_bytes: an upper bound of an image's files by its (width, height) in pixels. rules: what
    scenes are read by where a family reads them in its own way, from card, track, source and the
    family's options. table: what `inspect` shows of an image besides its instances, by what the
    card says is read. cost: of an image with MANY instances or more, what an answer takes at most,
    said before it is made. normals: whether the picture is drawn with normals. array: an image's
    answer where it is one array. sum_up raises RunDamagedError for rows that no run writes.
    """

    sum_up: Callable[[RunSummary, Sequence[RunRow], Sequence[RunRow]], RunSummary] = (
        lambda summary, _rows, _ok: summary
    )
    exports: Callable[[str, AnsweredImage], list[Export]] | None = None
    write: Callable[[RunRow, AnsweredImage], RunRow] | None = None
    complete: Callable[[Path, Sequence[RunRow]], None] | None = None
    file_bytes: Callable[[tuple[int, int]], int] | None = None
    picture: Callable[[AnsweredImage], Rgb] | None = None
    notes: Callable[[AnsweredImage], list[str]] | None = None
    rules: Callable[[Card, Track, str, Mapping[str, Any]], Any] | None = None
    table: Callable[[str, AnsweredImage], Table | None] | None = None
    cost: Callable[[str, AnsweredImage], str | None] | None = None
    needs_instances: bool = True
    normals: bool = False
    array: Callable[[AnsweredImage], NDArray[np.float32]] | None = None


def answer_file(name: str, suffix: str) -> str:
    """Path of an image's own file, relative to the run. suffix: ".json", ".npz" or ".png"."""
    return f"answer/{name}{suffix}"


def unusable_row(row: RunRow, missing: str) -> RunDamagedError:
    """What to raise for a row that lacks what its run writes."""
    return RunDamagedError(
        f"a row of {ROWS} cannot be used",
        found=f"no {missing} of image {row.image_id}",
        expected="rows as a run writes them",
        next_step="run its command again with --overwrite",
    )
