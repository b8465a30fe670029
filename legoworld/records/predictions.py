"""One prediction: an entry of predictions.json, and a line of the files it is divided into."""

from __future__ import annotations

from legoworld.records.base import UNSET, Record, UnsetType
from legoworld.records.track import Id

# gc=False: none can be part of a cycle, and there are millions.

Number = int | float
#: x, y, width, height in pixels.
Box = tuple[Number, Number, Number, Number]


class Rle(Record, frozen=True, kw_only=True, gc=False):
    """A mask's run lengths, or pycocotools' compressed counts; size is (height, width)."""

    size: tuple[int, int]
    counts: str | tuple[int, ...]


class Scored(Record, frozen=True, kw_only=True, gc=False):
    """What every prediction says besides where it is."""

    image_id: Id
    category_id: Id
    score: Number


class BoxPrediction(Scored, frozen=True, kw_only=True, gc=False):
    """A prediction where boxes are scored, from any source; other fields are ignored."""

    bbox: Box


class MaskPrediction(Scored, frozen=True, kw_only=True, gc=False):
    """A prediction where masks are scored, from any source. bbox: allowed, not scored."""

    segmentation: Rle
    bbox: object = UNSET


class Prediction(Scored, frozen=True, kw_only=True, gc=False):
    """A prediction as legoworld writes it: a box or a mask."""

    bbox: Box | UnsetType = UNSET
    segmentation: Rle | UnsetType = UNSET
