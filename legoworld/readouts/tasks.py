"""The table of tasks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

from legoworld.cards import Card, load_card
from legoworld.errors import UsageError
from legoworld.readouts.exports import Export, box_exports, mask_exports
from legoworld.scene.instances import Instance
from legoworld.shipped import catalog
from legoworld.tracks.vocabulary import Vocabulary, load
from legoworld.visibility.view import View

Predict = Callable[[int, Sequence[Instance], View], list[Export]]


@dataclass(frozen=True, kw_only=True)
class Task:
    """The exports of a readout. predict: None where these are files and not a list."""

    name: str
    predict: Predict | None
    exports: Literal["predictions", "depth", "surface"] = "predictions"


TASKS: Final = {
    task.name: task
    for task in (
        Task(name="coco", predict=box_exports),
        Task(name="coco-masks", predict=mask_exports),
        Task(name="lvis", predict=mask_exports),
        Task(name="eth3d", predict=None, exports="depth"),
        Task(name="bench", predict=None, exports="surface"),
    )
}


@dataclass(frozen=True, kw_only=True)
class Protocol:
    """A task with its card and vocabulary (None for depth)."""

    task: Task
    card: Card
    vocabulary: Vocabulary | None

    @property
    def override_property(self) -> str | None:
        """The custom property that overrides `category` in this task."""
        rules = self.card.declared.vocabulary
        return rules.override_property if rules else None


def protocol(name: str, track_vocabulary: Vocabulary | None) -> Protocol:
    """A task's protocol; a track's own categories override the shipped vocabulary."""
    if name not in TASKS:
        raise UsageError("unknown task", found=repr(name), expected=" or ".join(TASKS))
    card = load_card(name)
    rules = card.declared.vocabulary
    if rules is None:
        return Protocol(task=TASKS[name], card=card, vocabulary=None)
    vocabulary = track_vocabulary or load(catalog.folder("datasets") / rules.file)
    if rules.synonyms == "none":
        vocabulary = Vocabulary(tuple(replace(c, synonyms=()) for c in vocabulary.categories))
    if rules.qualifier == "where_ambiguous":
        vocabulary = replace(vocabulary, bare_words=True)
    return Protocol(task=TASKS[name], card=card, vocabulary=vocabulary)
