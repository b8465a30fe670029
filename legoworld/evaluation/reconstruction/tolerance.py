"""How far from a reference point a submitted one may be."""

from __future__ import annotations

from dataclasses import dataclass

from legoworld.evaluation.reconstruction.points import F64


@dataclass(frozen=True, kw_only=True)
class Tolerance:
    """tau(g) of a reference point g at planar depth z: relative * z + absolute_m."""

    name: str
    relative: float = 0.0
    absolute_m: float = 0.0

    def tau_m(self, z_m: F64) -> F64:
        """The tolerance at reference points of these depths, in their shape."""
        return self.relative * z_m + self.absolute_m
