"""The bench protocol as its card declares it, and what the command line decides.

A card that declares something else is refused.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Final

from legoworld.cards import Card, load_card
from legoworld.evaluation.reconstruction.integrity import FlagThresholds
from legoworld.evaluation.reconstruction.points import Tolerance
from legoworld.tasks.shipped import BENCH

_FIXED: Final[dict[str, Any]] = {
    "scoring.protocol": "lego_bench",
    "scoring.primary_metric": "S",
    "scoring.metrics": ["V", "R", "A", "S"],
    "scoring.comparison": "<=",
    "scoring.object_average": "unweighted",
    "scoring.object_without_reference_points": "not_eligible",
    "scoring.object_without_submitted_points": 0.0,
    "scoring.reference_resize": "lanczos",
    "scoring.score": "V * (R + A) / 2",
    "scoring.images": "track",
    "scoring.failed_image": "zero",
    "scoring.bootstrap_unit": "family",
    "scoring.repeats_sd_ddof": 1,
}


@dataclass(frozen=True, kw_only=True)
class XRules:
    """The second card's numbers: F3D's, and from which measurement on something is flagged."""

    spacing: float
    found: float
    sub_pixel_drop: float
    one_view_drop: float
    same_surface: float
    geometry_drop: float
    surface_differs: float
    scales: tuple[tuple[tuple[int, int], float], ...]


@dataclass(frozen=True, kw_only=True)
class BenchProtocol:
    """The numbers of the card. headline: R's tolerance; others, flags: the diagnostics'.

    x: the second card's, None where the task has none.
    """

    card: Card
    evaluator: str
    evaluator_version: str
    headline: Tolerance
    others: tuple[Tolerance, ...]
    point_cap: int
    depth_limit_m: float
    delta: int
    flags: FlagThresholds
    x: XRules | None


def bench_protocol(card: Card | None = None) -> BenchProtocol:
    """The shipped card's protocol; InstallationError when a fixed value is not the code's."""
    card = card or load_card(BENCH)
    card.hold_to(_FIXED)
    main = float(card.value("scoring.tolerance"))
    relative = [float(t) for t in card.value("scoring.tolerances") if float(t) != main]
    absolute = [float(t) for t in card.value("scoring.tolerances_m")]
    return BenchProtocol(
        card=card,
        evaluator=str(card.value("scoring.evaluator")),
        evaluator_version=str(card.value("scoring.evaluator_version")),
        headline=Tolerance(name=_percent(main), relative=main),
        others=(
            *(Tolerance(name=_percent(t), relative=t) for t in relative),
            *(Tolerance(name=_centimetres(t), absolute_m=t) for t in absolute),
        ),
        point_cap=int(card.value("raster.point_cap")),
        depth_limit_m=float(card.value("scoring.depth_limit_m")),
        delta=int(card.value("scoring.delta")),
        flags=FlagThresholds(
            **{f.name: float(card.value(f"integrity.{f.name}")) for f in fields(FlagThresholds)}
        ),
        x=_x_rules(card) if "x" in card.values else None,
    )


def _x_rules(card: Card) -> XRules:
    names = [f.name for f in fields(XRules) if f.name != "scales"]
    sizes, least = card.value("x.picture_scales_wh"), card.value("x.picture_correlation")
    return XRules(
        **{name: float(card.value(f"x.{name}")) for name in names},
        scales=tuple(((w, h), float(r)) for (w, h), r in zip(sizes, least, strict=True)),
    )


def _percent(share: float) -> str:
    """F2, F5 and F10: relative tolerances in percent of the depth."""
    return f"F{100 * share:g}"


def _centimetres(metres: float) -> str:
    """F_5cm and F_10cm: the same distance at every depth."""
    return f"F_{100 * metres:g}cm"


@dataclass(frozen=True, kw_only=True)
class Choices:
    """sampling: of the reference, raster, all or random:SEED; diagnostics: beside R, or R alone."""

    sampling: str = "raster"
    diagnostics: bool = True
