"""The render card with two samples a pixel in place of 32: what a test of other things renders."""

from __future__ import annotations

from dataclasses import replace

import pytest

from legoworld.records.render_card import RenderCard
from legoworld.running import submission
from legoworld.scene.open_scene import CardRender


def few_samples(patch: pytest.MonkeyPatch) -> None:
    """Runs in this process ask Blender for the card's size and seed, at a sixteenth of its time."""
    whole = submission.card_render

    def quick(card: RenderCard, size_wh: tuple[int, int], seed: int, threads: int) -> CardRender:
        return replace(whole(card, size_wh, seed, threads), samples=2)

    patch.setattr(submission, "card_render", quick)
