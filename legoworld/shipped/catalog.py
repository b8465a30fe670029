"""Locations of the shipped cards, vocabularies, baselines and examples, in a checkout or wheel."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

Kind = Literal["readouts", "datasets", "baselines", "examples"]


def folder(kind: Kind) -> Path:
    """The folder of one kind of catalogue entry; only this function knows checkout from wheel."""
    shipped = Path(__file__).parents[1] / "_catalog" / kind
    return shipped if shipped.is_dir() else Path(__file__).parents[2] / kind
