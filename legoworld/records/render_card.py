"""The card of a picture that is compared with a photo's or a reference's."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from legoworld.records.base import Record
from legoworld.records.track import Pixels


class RenderCard(Record, frozen=True, kw_only=True):
    """How the evaluator renders a submission for A; equal cards, equal pixels on one machine.

    longest_side_px: the other side is rounded from the image's aspect.
    """

    version: str
    engine: Literal["CYCLES"]
    device: Literal["CPU"]
    samples: Annotated[int, Meta(ge=1)]
    seed: int
    longest_side_px: Pixels
    adaptive_sampling: Literal[False]
    denoiser: Literal[False]
    compositor: Literal[False]
    sequencer: Literal[False]
    border: Literal[False]
    film_transparent: Literal[False]
    resolution_percentage: Literal[100]
