"""The protocol of a family of arrays, declared by a task's card."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from legoworld.cards import Card
from legoworld.files import Json
from legoworld.records.evaluation_summary import Evaluator

#: What every family's code implements.
_FIXED: Final[dict[str, Any]] = {
    "scoring.resolution": "truth",
    "scoring.images": "track",
    "scoring.failed_image": "left_out_and_listed",
    "holes.exclude": "not_scored",
}


@dataclass(frozen=True, kw_only=True)
class PixelProtocol:
    """A card, held to what the code implements. declared: its choices that summaries repeat."""

    card: Card
    declared: Sequence[str]

    @property
    def evaluator(self) -> Evaluator:
        """What scores."""
        value = self.card.value
        return Evaluator(
            name=str(value("scoring.evaluator")), version=str(value("scoring.evaluator_version"))
        )

    @property
    def min_valid_px(self) -> int:
        """Fewer pixels in truth or prediction are not scored."""
        return int(self.card.value("scoring.min_valid_px"))

    @property
    def choices(self) -> dict[str, Any]:
        """The choices that determine a number, by the last part of their card key."""
        keys = (*self.declared, "scoring.min_valid_px")
        return {key.split(".")[1]: self.card.value(key) for key in keys}


def pixel_protocol(
    card: Card, *, fixed: Mapping[str, Json], declared: Sequence[str]
) -> PixelProtocol:
    """A card's protocol; InstallationError if a fixed value differs from the code's."""
    card.hold_to({**_FIXED, **fixed})
    return PixelProtocol(card=card, declared=declared)
