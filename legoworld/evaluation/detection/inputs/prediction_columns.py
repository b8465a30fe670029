"""Checked predictions as columns: a dict for each would be most of the memory of a score."""

from __future__ import annotations

import gc
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.detection.inputs.texts import Texts, texts_of

Ints = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True, eq=False)
class PredictionColumns(Sequence[dict[str, Any]]):
    """A results list that makes an entry each time it is asked for; nothing in it is shared.

    image_id, category_id: (n,); score: (n,) float64, or objects where integers are among them;
    shape: (n,) boxes as given, or compressed counts; sizes_wh: of the images, None where shapes are
    boxes.
    """

    image_id: Ints
    category_id: Ints
    score: NDArray[Any]
    shape: tuple[Any, ...] | Texts
    sizes_wh: Mapping[int, tuple[int, int]] | None

    def take(self, places: Ints) -> PredictionColumns:
        """The predictions at these places, in their order."""
        if isinstance(self.shape, Texts):
            shape: tuple[Any, ...] | Texts = self.shape.take(places)
        else:
            shape = tuple(self.shape[k] for k in places.tolist())
        return PredictionColumns(
            image_id=self.image_id[places],
            category_id=self.category_id[places],
            score=self.score[places],
            shape=shape,
            sizes_wh=self.sizes_wh,
        )

    def results(self) -> list[dict[str, Any]]:
        """All entries, as an evaluator takes them: it may write into them.

        The garbage collector rests meanwhile: it would look through the millions of dicts again
        and again, and none can be part of a cycle.
        """
        collecting = gc.isenabled()
        gc.disable()
        try:
            return list(self)
        finally:
            if collecting:
                gc.enable()

    def __len__(self) -> int:
        return len(self.score)

    def __iter__(self) -> Iterator[dict[str, Any]]:
        ids = self.image_id.tolist(), self.category_id.tolist()
        yield from map(self._entry, *ids, self.shape, self.score.tolist())

    @overload
    def __getitem__(self, index: int) -> dict[str, Any]: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[dict[str, Any]]: ...
    def __getitem__(self, index: Any) -> Any:
        """The prediction at a place."""
        assert isinstance(index, int)
        columns = self.image_id, self.category_id, self.score
        image_id, category_id, score = (column[[index]].tolist()[0] for column in columns)
        return self._entry(image_id, category_id, self.shape[index], score)

    def _entry(self, image_id: int, category_id: int, shape: Any, score: float) -> dict[str, Any]:
        if self.sizes_wh is None:
            return {
                "image_id": image_id,
                "category_id": category_id,
                "bbox": list(shape),
                "score": score,
            }
        width, height = self.sizes_wh[image_id]
        return {
            "image_id": image_id,
            "category_id": category_id,
            "segmentation": {"size": [height, width], "counts": shape},
            "score": score,
        }


def columns_of(entries: Sequence[Mapping[str, Any]]) -> PredictionColumns:
    """The columns of checked entries: all of boxes, or all of compressed masks."""
    boxes = not entries or "bbox" in entries[0]
    masks = [] if boxes else [e["segmentation"] for e in entries]
    sizes = zip((e["image_id"] for e in entries), (m["size"] for m in masks), strict=False)
    return PredictionColumns(
        image_id=np.array([e["image_id"] for e in entries], np.int64),
        category_id=np.array([e["category_id"] for e in entries], np.int64),
        score=score_column([e["score"] for e in entries]),
        shape=tuple(e["bbox"] for e in entries)
        if boxes
        else texts_of([m["counts"] for m in masks]),
        sizes_wh=None if boxes else {image: (w, h) for image, (h, w) in sizes},
    )


def score_column(scores: Sequence[float]) -> NDArray[Any]:
    """Scores as a column that gives each back as it was, integers as integers."""
    floats = set(map(type, scores)) <= {float}
    return np.array(scores, np.float64 if floats else object)
