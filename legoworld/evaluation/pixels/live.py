"""Arrays in memory, scored as the files of a run are."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from legoworld.cards import load_card
from legoworld.errors import UsageError
from legoworld.evaluation.family import LiveAnswers, LiveFamily, LiveTruth, Scores
from legoworld.evaluation.pixels.family import PixelFamily, PixelTruth
from legoworld.evaluation.pixels.rows import score_values
from legoworld.evaluation.pixels.summary import means
from legoworld.records.run_rows import RunImage

Truths = Mapping[int, PixelTruth]
_ARRAYS: Final = "an array of the picture, or a mapping of arrays by image id"


def live_pixels(family: PixelFamily) -> LiveFamily:
    """Scoring in memory of a family, by its own parameters' defaults."""

    def score(
        task: str, truths: Truths, answers: LiveAnswers, image_ids: Collection[int] | None
    ) -> Scores:
        given = _by_id(answers)
        ids = sorted(truths if image_ids is None else image_ids)
        unknown = [i for i in ids if i not in truths or i not in given]
        if unknown or len(given) > len(ids):
            raise UsageError(
                "answers and truth are of different images",
                found=f"answers {sorted(given)[:5]}, truth {sorted(truths)[:5]}",
                expected="the same image ids",
            )
        rows = []
        for i in ids:
            image = RunImage(image_id=i, file_name=str(i), status="ok")
            rows.append(score_values(image, given[i], truths[i], family, task).row)
        values = means([row.scores for row in rows if row.scores], family.metrics)
        evaluator = family.protocol(load_card(task)).evaluator
        return Scores(
            task=task,
            evaluator=f"{evaluator.name} {evaluator.version}",
            n_images=len(rows),
            metrics={
                name: by_policy.get(family.primary, next(iter(by_policy.values())))
                for name, by_policy in values.items()
            },
            by_policy=values,
            per_image=rows,
        )

    return LiveFamily(
        open=lambda _task, truth: {i: family.make_truth(a) for i, a in _by_id(truth).items()},
        sizes_wh=lambda truths: {i: truth.size_wh for i, truth in truths.items()},
        score=score,
        stored=family.stored,
    )


def _by_id(arrays: LiveAnswers | LiveTruth) -> dict[int, NDArray[Any]]:
    """Arrays by image id; one alone is image 1."""
    by_id: dict[Any, Any] = dict(arrays) if isinstance(arrays, Mapping) else {1: arrays}
    for image_id, array in by_id.items():
        shaped = isinstance(array, np.ndarray) and array.ndim >= 2 and array.size
        if not shaped or isinstance(image_id, bool) or not isinstance(image_id, int):
            raise UsageError(
                "an array in memory cannot be scored",
                found=f"{type(array).__name__} of image {image_id!r}"[:100],
                expected=_ARRAYS,
            )
    return by_id
