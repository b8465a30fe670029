"""What a task is read by: its card and its vocabulary."""

from __future__ import annotations

from dataclasses import dataclass, replace

from legoworld.cards import Card, load_card
from legoworld.errors import UsageError
from legoworld.readouts.family import ReadoutFamily
from legoworld.shipped import catalog
from legoworld.tasks.registry import require_task
from legoworld.tasks.task import Task
from legoworld.tracks.vocabulary import Category, Vocabulary, load


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
