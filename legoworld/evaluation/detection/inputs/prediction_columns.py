"""Predictions as columns: an object for each would be most of the memory of a score."""

from __future__ import annotations

import gc
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, repeat
from typing import Any, Final, Literal, cast, overload

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.detection.inputs.masks import TextBuilder, Texts
from legoworld.evaluation.detection.inputs.prediction_checks import compressed_counts
from legoworld.files import Json, canonical_json
from legoworld.records.base import UNSET
from legoworld.records.predictions import (
    Box,
    Corners,
    MaskPrediction,
    Number,
    Prediction,
    Rle,
    Scored,
)

Ints = NDArray[np.int64]
Sizes = Mapping[int, tuple[int, int]]
Shapes = tuple[Any, ...] | Texts
NumberField = Literal["bbox", "bbox3D"]
_ATTRIBUTES: Final[Mapping[NumberField, str]] = {"bbox": "bbox", "bbox3D": "corners"}


@dataclass(frozen=True, kw_only=True, eq=False)
class PredictionColumns(Sequence[Prediction]):
    """Predictions that are made each time they are asked for.

    image_id, category_id: (n,); score: (n,) float64, or objects where integers are among them;
    shape: (n,) boxes as given, corners in space, or compressed counts; sizes_wh: of the images,
    None where shapes are numbers; field: of a prediction, where numbers are;
    visible: of amodal masks, the compressed counts of their visible parts.
    """

    image_id: Ints
    category_id: Ints
    score: NDArray[Any]
    shape: Shapes
    sizes_wh: Sizes | None
    field: NumberField = "bbox"
    visible: Texts | None = None

    def take(self, places: Ints) -> PredictionColumns:
        """The predictions at these positions, in their order."""
        if isinstance(self.shape, Texts):
            shape: Shapes = self.shape.take(places)
        else:
            shape = cast("Shapes", tuple(self.shape[k] for k in places.tolist()))
        return PredictionColumns(
            image_id=self.image_id[places],
            category_id=self.category_id[places],
            score=self.score[places],
            shape=shape,
            sizes_wh=self.sizes_wh,
            field=self.field,
            visible=None if self.visible is None else self.visible.take(places),
        )

    def documents(self) -> Iterator[dict[str, Json]]:
        """Every prediction as JSON has it."""
        ids = self.image_id.tolist(), self.category_id.tolist()
        for image_id, category_id, shape, score, visible in zip(
            *ids, self.shape, self.score.tolist(), self._visible(), strict=True
        ):
            entry = {"image_id": image_id, "category_id": category_id, "score": score}
            if self.sizes_wh is None:
                yield {**entry, self.field: [list(n) if isinstance(n, tuple) else n for n in shape]}
                continue
            width, height = self.sizes_wh[image_id]
            entry["segmentation"] = {"size": [height, width], "counts": shape}
            if visible is not None:
                entry["visible_mask"] = {"size": [height, width], "counts": visible}
            yield entry

    def _visible(self) -> Iterable[str | None]:
        return repeat(None, len(self)) if self.visible is None else self.visible

    def lines(self) -> Iterator[str]:
        """`canonical_json` of every prediction."""
        columns = self.category_id, self.image_id, self.score
        values = zip(
            *(column.tolist() for column in columns), self.shape, self._visible(), strict=True
        )
        if self.field == "bbox3D":
            yield from map(canonical_json, self.documents())
            return
        if self.sizes_wh is None:
            for category_id, image_id, score, box, _ in values:
                numbers = ",".join(map(repr, box))
                yield (
                    f'{{"bbox":[{numbers}],"category_id":{category_id},"image_id":{image_id},'
                    f'"score":{score!r}}}'
                )
            return
        for category_id, image_id, score, counts, visible in values:
            width, height = self.sizes_wh[image_id]
            size = f'"size":[{height},{width}]'
            more = ""
            if visible is not None:
                more = f',"visible_mask":{{"counts":{canonical_json(visible)},{size}}}'
            yield (
                f'{{"category_id":{category_id},"image_id":{image_id},"score":{score!r},'
                f'"segmentation":{{"counts":{canonical_json(counts)},{size}}}{more}}}'
            )

    def results(self) -> list[dict[str, Json]]:
        """All predictions as an evaluator takes them: it may write into them.

        The garbage collector rests meanwhile: it would look through the millions of dicts again
        and again, and none can be part of a cycle.
        """
        collecting = gc.isenabled()
        gc.disable()
        try:
            return list(self.documents())
        finally:
            if collecting:
                gc.enable()

    def __len__(self) -> int:
        return len(self.score)

    def __iter__(self) -> Iterator[Prediction]:
        ids = self.image_id.tolist(), self.category_id.tolist()
        return map(self._prediction, *ids, self.shape, self.score.tolist(), self._visible())

    @overload
    def __getitem__(self, index: int) -> Prediction: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Prediction]: ...
    def __getitem__(self, index: int | slice) -> Prediction | Sequence[Prediction]:
        """The prediction at a position."""
        assert isinstance(index, int)
        return next(iter(self.take(np.array([index]))))

    def _prediction(
        self,
        image_id: int,
        category_id: int,
        shape: Box | Corners | str,
        score: Number,
        visible: str | None,
    ) -> Prediction:
        if self.sizes_wh is None:
            numbers: dict[str, Any] = {_ATTRIBUTES[self.field]: shape}
            return Prediction(image_id=image_id, category_id=category_id, score=score, **numbers)
        assert isinstance(shape, str)
        width, height = self.sizes_wh[image_id]
        return Prediction(
            image_id=image_id,
            category_id=category_id,
            segmentation=Rle(size=(height, width), counts=shape),
            score=score,
            visible_mask=UNSET if visible is None else Rle(size=(height, width), counts=visible),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class GivenColumns:
    """Predictions as they were given, before anything but their types is checked.

    size_hw: (n, 2) of masks, (0, 2) where shapes are boxes. n_boxed: masks that have a bbox, too.
    """

    columns: PredictionColumns
    size_hw: Ints
    n_uncompressed: int
    n_boxed: int


def number_columns(
    field: NumberField, batches: Iterable[Sequence[Scored]], _sizes_wh: Sizes
) -> GivenColumns:
    """The columns of boxes (BoxPrediction), or of boxes in space (Box3dPrediction)."""
    head, shapes = _Heads(), list[Any]()
    for batch in batches:
        head.add(batch)
        shapes.extend([getattr(prediction, _ATTRIBUTES[field]) for prediction in batch])
    return GivenColumns(
        columns=head.columns(tuple(shapes), None, field),
        size_hw=np.empty((0, 2), np.int64),
        n_uncompressed=0,
        n_boxed=0,
    )


def mask_columns(batches: Iterable[Sequence[MaskPrediction]], sizes_wh: Sizes) -> GivenColumns:
    """The columns of masks; their texts are kept in one piece.

    PredictionsInvalidError for run lengths that do not add up to the mask's own size.
    """
    head, counts, size_hw = _Heads(), TextBuilder(), array("q")
    n_uncompressed = n_boxed = 0
    for batch in batches:
        head.add(batch)
        size_hw.extend(chain.from_iterable([p.segmentation.size for p in batch]))
        plain = [p.segmentation.counts for p in batch]
        n_uncompressed += sum(not isinstance(c, str) for c in plain)
        counts.add(
            [
                c if isinstance(c, str) else compressed_counts(p)
                for c, p in zip(plain, batch, strict=True)
            ]
        )
        n_boxed += sum(p.bbox is not UNSET for p in batch)
    return GivenColumns(
        columns=head.columns(counts.texts(), sizes_wh),
        size_hw=np.array(size_hw, np.int64).reshape(-1, 2),
        n_uncompressed=n_uncompressed,
        n_boxed=n_boxed,
    )


def make_columns(predictions: Sequence[Prediction]) -> PredictionColumns:
    """The columns of checked predictions: all boxes, all in space, or all compressed masks."""
    head = _Heads()
    head.add(predictions)
    solids = tuple(p.corners for p in predictions if p.corners)
    if solids:
        return head.columns(solids, None, "bbox3D")
    boxes = tuple(p.bbox for p in predictions if p.bbox)
    if len(boxes) == len(predictions):
        return head.columns(boxes, None)
    counts, visible, sizes_wh = TextBuilder(), TextBuilder(), {}
    for prediction in predictions:
        mask = prediction.segmentation
        assert mask
        assert isinstance(mask.counts, str)
        counts.add([mask.counts])
        sizes_wh[prediction.image_id] = mask.size[1], mask.size[0]
        if prediction.visible_mask:
            visible.add([str(prediction.visible_mask.counts)])
    columns, seen = head.columns(counts.texts(), sizes_wh), visible.texts()
    return replace(columns, visible=seen) if len(seen) == len(columns) > 0 else columns


class _Heads:
    """The ids and scores of predictions, batch after batch."""

    def __init__(self) -> None:
        self._image_id, self._category_id = array("q"), array("q")
        self._score = list[NDArray[Any]]()

    def add(self, batch: Sequence[Scored]) -> None:
        self._image_id.extend([p.image_id for p in batch])
        self._category_id.extend([p.category_id for p in batch])
        self._score.append(score_column([p.score for p in batch]))

    def columns(
        self, shape: Shapes, sizes_wh: Sizes | None, field: NumberField = "bbox"
    ) -> PredictionColumns:
        """The columns, with their shapes."""
        floats = all(part.dtype == np.float64 for part in self._score)
        empty = np.empty(0, np.float64 if floats else object)
        return PredictionColumns(
            image_id=np.array(self._image_id, np.int64),
            category_id=np.array(self._category_id, np.int64),
            score=np.concatenate([empty, *self._score]),
            shape=shape,
            sizes_wh=sizes_wh,
            field=field,
        )


def score_column(scores: Sequence[Number]) -> NDArray[Any]:
    """Scores as an (n,) column that preserves each value, integers as integers."""
    floats = set(map(type, scores)) <= {float}
    return np.array(scores, np.float64 if floats else object)
