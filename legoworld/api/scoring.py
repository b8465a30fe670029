"""`score`: answers in memory against ground truth, with the official evaluators' numbers."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from legoworld.api.arguments import check_argument
from legoworld.api.scene_view import SceneView
from legoworld.errors import UsageError
from legoworld.evaluation.family import (
    LiveAnswers,
    LiveFamily,
    LiveTruth,
    Picture,
    Scores,
    load_evaluation_family,
)
from legoworld.tasks.shipped import TaskName

#: One image or several by id: a view, or an array; or results as in a results file.
Answers = SceneView | Picture | LiveAnswers | Mapping[int, SceneView]


@dataclass(frozen=True, kw_only=True, repr=False)
class Truth:
    """Ground truth in memory, checked once: every `score` against it costs its images alone.

    source: its file, or arrays by image id; held: what `family` made of it.
    """

    task: str
    source: str | Path | Mapping[int, Picture]
    family: LiveFamily
    held: Any

    @classmethod
    def open(cls, truth: LiveTruth, *, task: TaskName | str) -> Truth:
        """Read a ground truth.

        truth: the dataset's own annotations, COCO or LVIS JSON; of depth and normals the arrays by
        image id, or the one array, (H, W) planar metres or (H, W, 3) vectors towards the camera.
        Raises TruthInvalidError, UsageError.
        """
        check_argument("task", task)
        if isinstance(truth, str | Path):
            check_argument("folder", truth)
        family = load_evaluation_family(task).live
        if family is None:
            raise UsageError(f"{task} is not scored in memory", next_step="evaluate a run folder")
        source = {1: truth} if isinstance(truth, np.ndarray) else truth
        return cls(task=task, source=source, family=family, held=family.open(task, source))

    @property
    def sizes_wh(self) -> Mapping[int, tuple[int, int]]:
        """Width and height in pixels of each of its images, by id."""
        return self.family.sizes_wh(self.held)

    def score(self, answers: LiveAnswers, image_ids: Collection[int] | None) -> Scores:
        """Score answers; arrays are (H, W) or (H, W, 3). image_ids: None for all images."""
        return self.family.score(self.task, self.held, answers, image_ids)


def score(
    answers: Answers,
    truth: Truth | LiveTruth,
    *,
    task: TaskName | str | None = None,
    image_id: int | None = None,
) -> Scores:
    """Score answers in memory. The numbers are the official evaluator's over the same images.

    answers: views of a task, or arrays, (H, W) metres or (H, W, 3), by image id; one of them with
    image_id; or results as in a results file, such as `view.predictions()` or a model's own. truth:
    a `Truth`, or what `Truth.open` takes, which is then read for this call alone. task: of results
    and arrays where the truth does not say it. image_id: the image that one view or array is of
    (None where the truth has one only), or the only image of results to be scored; without it
    results are scored over every image of the truth, as the official evaluators do.

    Raises UsageError, PredictionsInvalidError, TruthInvalidError or TruthMismatchError.
    """
    given = given_answers(answers, truth, task=task, image_id=image_id)
    return given.truth.score(given.answers, given.image_ids)


@dataclass(frozen=True, kw_only=True)
class GivenAnswers:
    """Answers to images of a truth. image_ids: None for all of its images."""

    truth: Truth
    answers: LiveAnswers
    image_ids: list[int] | None


def given_answers(
    answers: Answers, truth: Truth | LiveTruth, *, task: str | None, image_id: int | None
) -> GivenAnswers:
    """What `score` is given, as results or (H, W, ...) arrays. UsageError, TruthInvalidError."""
    if image_id is not None:
        check_argument("image_id", image_id)
    one = isinstance(answers, SceneView | np.ndarray)
    views: Mapping[int, Any] = answers if isinstance(answers, Mapping) else {-1: answers}
    seen = [view.task for view in views.values() if isinstance(view, SceneView)]
    known = {*seen, *([task] if task else []), *([truth.task] if isinstance(truth, Truth) else [])}
    if len(known) != 1 or None in known:
        raise UsageError(
            "a score is of one task",
            found=", ".join(sorted(map(str, known))) or "none",
            expected="views, truth and task= of the same task",
        )
    (name,) = map(str, known)
    held = truth if isinstance(truth, Truth) else Truth.open(truth, task=name)
    if one:
        views = {_only_image(held) if image_id is None else image_id: answers}
    ids = list(views) if one or isinstance(answers, Mapping) else None
    if ids is None and image_id is not None:
        ids = [image_id]
    if seen:
        made = {
            i: view.scored_answer(i) for i, view in views.items() if isinstance(view, SceneView)
        }
        results: Any = made
        if all(isinstance(own, list) for own in made.values()):
            results = [entry for own in made.values() for entry in own]
    else:
        results = views if one or isinstance(answers, Mapping) else answers
    return GivenAnswers(truth=held, answers=results, image_ids=ids)


def _only_image(truth: Truth) -> int:
    if len(truth.sizes_wh) != 1:
        raise UsageError(
            "which image the answer is of is not said",
            found=f"a truth of {len(truth.sizes_wh)} images",
            expected="image_id=",
        )
    return next(iter(truth.sizes_wh))
