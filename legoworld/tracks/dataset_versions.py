"""The dataset version that a vocabulary belongs to."""

from __future__ import annotations

from typing import Final

from legoworld.shipped import catalog
from legoworld.tracks.vocabulary import Vocabulary, load

#: Number of categories of LVIS v0.5; its ids differ from v1's for the same names.
_LVIS_V05_CATEGORIES: Final = 1230

#: COCO boxes and masks are two readouts of one dataset and share tracks and ground truth.
_DATASETS: Final = {"coco-masks": "coco"}


def dataset_of(task: str) -> str:
    """The dataset whose tracks, categories and ground truth a task uses."""
    return _DATASETS.get(task, task)


def dataset_version(vocabulary: Vocabulary, task: str) -> str:
    """The version of a task's dataset, from its categories; "custom" if they match none."""
    dataset = dataset_of(task)
    shipped = load(catalog.folder("datasets") / dataset / "categories.json")
    if vocabulary.sha256 == shipped.sha256:
        return {"coco": "2017", "lvis": "1.0"}[dataset]
    if dataset == "lvis" and len(vocabulary.categories) == _LVIS_V05_CATEGORIES:
        return "0.5"
    return "custom"
