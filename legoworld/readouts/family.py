"""The readout of a family: what is exported of one image; a task's card and vocabulary."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.cards import Card, load_card
from legoworld.errors import UsageError
from legoworld.records.folders.read_run import ANSWERS, ROWS, RunDamagedError
from legoworld.records.predictions import Prediction
from legoworld.records.run_file import RunSummary
from legoworld.records.run_rows import RunRow
from legoworld.shipped import catalog
from legoworld.tables.table import Table
from legoworld.tasks.registry import require_task
from legoworld.tasks.task import Task
from legoworld.tracks.track import Track
from legoworld.tracks.vocabulary import Category, Vocabulary, load

if TYPE_CHECKING:
    from legoworld.readouts.pictures import Rgb
    from legoworld.scene.instances import Instance
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


@dataclass(frozen=True, kw_only=True)
class Protocol:
    """A task with its card and vocabulary (None where its answers have no categories).

    override_property: the custom property that overrides `category` in this task.
    """

    task: Task
    card: Card
    vocabulary: Vocabulary | None
    override_property: str | None = None

    def category(self, name: str, option: str) -> Category:
        """The category that an option names. UsageError for no name of the vocabulary."""
        assert self.vocabulary is not None
        category = self.vocabulary.match(name)
        if category is None:
            raise UsageError(
                f"{option} names no category of {self.task.name}",
                found=repr(name),
                expected=" or ".join(self.vocabulary.nearest(name)) or "a name of its vocabulary",
                next_step=f"`legoworld list schema --task {self.task.name}` lists them",
            )
        return category

    @property
    def readout(self) -> ReadoutFamily:
        """How answers of this kind are read."""
        return load_readout_family(self.task)


def load_readout_family(task: Task) -> ReadoutFamily:
    """The readout of a task's family."""
    return task.family.load("readout", ReadoutFamily)


def protocol(
    name: str, track_vocabulary: Vocabulary | None, labels_of: str | None = None
) -> Protocol:
    """A task's protocol; a track's own categories override the shipped vocabulary.

    labels_of: another task whose vocabulary and label rules take the place of its own. UsageError
    for one without categories.
    """
    task = require_task(name)
    card = load_card(name)
    rules = (load_card(labels_of) if labels_of else card).record.vocabulary
    if rules is None and labels_of:
        raise UsageError(f"the task {labels_of} has no categories", expected="such as coco or lvis")
    if rules is None:
        return Protocol(task=task, card=card, vocabulary=None)
    vocabulary = track_vocabulary or load(catalog.folder("datasets") / rules.file)
    if rules.synonyms == "none":
        vocabulary = Vocabulary(tuple(replace(c, synonyms=()) for c in vocabulary.categories))
    if rules.qualifier == "where_ambiguous":
        vocabulary = replace(vocabulary, bare_words=True)
    return Protocol(
        task=task, card=card, vocabulary=vocabulary, override_property=rules.override_property
    )
