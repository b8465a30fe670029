"""The dataset version that a vocabulary belongs to."""

from __future__ import annotations

from legoworld.shipped import catalog
from legoworld.tasks.registry import find_task
from legoworld.tracks.vocabulary import Vocabulary, load


def find_dataset(task: str) -> str:
    """The dataset whose tracks, categories and truth a task uses; an unknown task is its own."""
    known = find_task(task)
    return known.dataset.name if known else task


def dataset_version(vocabulary: Vocabulary, task: str) -> str:
    """The version of a task's dataset, from its categories; "custom" if they match none."""
    known = find_task(task)
    if known is None or known.dataset.version is None:
        return "custom"
    dataset = known.dataset
    shipped = load(catalog.folder("datasets") / dataset.name / "categories.json")
    if vocabulary.sha256 == shipped.sha256:
        return known.dataset.version
    return dataset.by_categories.get(len(vocabulary.categories), "custom")
