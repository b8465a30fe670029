"""The protocol of normals declared by its card; a card with other values is refused."""

from __future__ import annotations

from typing import Any, Final

from legoworld.cards import Card
from legoworld.evaluation.normals.arrays import SIGNS
from legoworld.evaluation.pixels.family import PixelMetric, PixelProtocol, pixel_protocol

THRESHOLDS_DEG: Final = (5.0, 7.5, 11.25, 22.5, 30.0)
SHARES: Final = ("below_5", "below_7_5", "below_11_25", "below_22_5", "below_30")
ANGLES: Final = ("mean_deg", "median_deg", "rmse_deg")
#: Of a pixel without a prediction: an error of 90 degrees, left out, or in no share.
ERROR_90, EXCLUDE, FAILS = HOLE_POLICIES = ("error_90", "exclude", "fails")
HOLE_DEG: Final = 90.0
#: Of the counts of errors, which say where the pooled median lies.
RESOLUTION_DEG: Final = 0.01

METRICS: Final = (
    *(
        PixelMetric(
            name=name,
            better="lower",
            policies=(ERROR_90, EXCLUDE),
            headline=(ERROR_90, EXCLUDE) if name == ANGLES[0] else (),
        )
        for name in ANGLES
    ),
    *(
        PixelMetric(
            name=name,
            better="higher",
            policies=(FAILS, EXCLUDE),
            headline=(FAILS,) if name == "below_11_25" else (),
            detail=name in ("below_5", "below_7_5"),
        )
        for name in SHARES
    ),
)

_FIXED: Final[dict[str, Any]] = {
    "export.signs_accepted": list(SIGNS),
    "scoring.protocol": "angular_error",
    "scoring.primary_metric": ANGLES[0],
    "scoring.metrics": [*ANGLES, *SHARES],
    "scoring.thresholds_deg": list(THRESHOLDS_DEG),
    "scoring.aggregate": "pooled_pixels_and_unweighted_image_mean",
    "scoring.pooled_median": "exact",
    "scoring.resample": "bilinear_with_mask",
    "scoring.valid_truth": "length_above_half",
    "scoring.failed_image_mean_deg": HOLE_DEG,
    "scoring.bootstrap_unit": "image",
    "holes.policies": list(HOLE_POLICIES),
    "holes.primary": ERROR_90,
    "holes.error_90": HOLE_DEG,
    "holes.fails": "in_no_share",
}
#: Declared choices that are copied from the card into the summary.
_DECLARED: Final = (
    "scoring.aggregate",
    "scoring.pooled_median",
    "scoring.resolution",
    "scoring.resample",
    "scoring.valid_truth",
    "holes.policies",
    "holes.primary",
)


def normals_protocol(card: Card) -> PixelProtocol:
    """A card's protocol; InstallationError if a fixed value differs from the code's."""
    return pixel_protocol(card, fixed=_FIXED, declared=_DECLARED)
