"""Which of two equally confident predictions comes first: docs/protocols/ties.md has the rules."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final, Literal

#: canonical: by image id, category id, payload. given: by image id, then as the predictions were
#: given, which is the order of an imported file or of a model's own answer.
PredictionOrder = Literal["canonical", "given"]

#: The key of a run's configuration that holds its order; absent where it is canonical.
ORDER: Final = "prediction_order"

Entry = dict[str, Any]


def order_of(configuration: Mapping[str, Any]) -> PredictionOrder:
    """The order of a run's predictions, from the run's configuration."""
    return "given" if configuration.get(ORDER) == "given" else "canonical"


def in_order(entries: Iterable[Entry], order: PredictionOrder) -> list[Entry]:
    """The entries in one of the two orders.

    Sorting by image alone, and stably, changes no result: both official evaluators go through the
    images by ascending id, and break ties by place in the file only inside an image.
    """
    return sorted(entries, key=_image if order == "given" else canonical_key)


def canonical_key(entry: Entry) -> tuple[Any, ...]:
    """Image id, category id, payload (box numbers or RLE characters), higher score first."""
    payload = entry.get("bbox") or entry["segmentation"]["counts"]
    return entry["image_id"], entry["category_id"], payload, -entry["score"]


def _image(entry: Entry) -> int:
    return int(entry["image_id"])
