"""What the command line decides of a bench evaluation; the card decides the rest."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Choices:
    """sampling: of the reference, raster, all or random:SEED; diagnostics: beside R, or R alone."""

    sampling: str = "raster"
    diagnostics: bool = True
