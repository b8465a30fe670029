"""The depth protocol declared by its card; a card with other values is refused."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from legoworld.cards import Card
from legoworld.evaluation.pixels.family import PixelMetric, PixelProtocol, pixel_protocol

HOLE_POLICIES: Final = ("error_1", "exclude", "far")
PRIMARY_POLICY: Final = HOLE_POLICIES[0]
_OF_PREDICTED: Final = ("exclude",)
METRICS: Final = (
    PixelMetric(name="abs_rel", better="lower", policies=HOLE_POLICIES, headline=HOLE_POLICIES),
    PixelMetric(name="delta1", better="higher", policies=HOLE_POLICIES, headline=(PRIMARY_POLICY,)),
    PixelMetric(name="delta2", better="higher", policies=HOLE_POLICIES, detail=True),
    PixelMetric(name="delta3", better="higher", policies=HOLE_POLICIES, detail=True),
    PixelMetric(name="rmse_m", better="lower", policies=_OF_PREDICTED),
    PixelMetric(name="log10", better="lower", policies=_OF_PREDICTED),
    PixelMetric(name="silog", better="lower", policies=_OF_PREDICTED),
)
CAMERA_MODELS: Final = ("none", "dataset")

_FIXED: Final[dict[str, Any]] = {
    "scoring.protocol": "affine_invariant_depth",
    "scoring.primary_metric": "abs_rel",
    "scoring.metrics": [m.name for m in METRICS if m.policies == HOLE_POLICIES],
    "scoring.metrics_exclude_only": [m.name for m in METRICS if m.policies == _OF_PREDICTED],
    "scoring.aggregate": "unweighted_image_mean",
    "scoring.resample": "bilinear_in_disparity_with_mask",
    "scoring.valid_truth": "finite_and_positive",
    "scoring.camera_models": list(CAMERA_MODELS),
    "scoring.bootstrap_unit": "scene",
    "alignment.space": "disparity",
    "alignment.model": "scale_shift",
    "alignment.solver": "least_squares",
    "alignment.weights": "uniform",
    "alignment.precision": "float64",
    "alignment.chunked_centred_merge": True,
    "alignment.fit_pixels": "valid_truth_and_prediction",
    "alignment.disparity_floor": "1/max_valid_truth",
    "alignment.non_positive_scale": "inverted",
    "alignment.no_variance": "degenerate",
    "alignment.warn_above_constant_fit": True,
    "holes.policies": list(HOLE_POLICIES),
    "holes.primary": PRIMARY_POLICY,
    "holes.far": "max_valid_truth",
}

#: Declared choices that are copied from the card into the summary.
_DECLARED: Final = (
    "alignment.space",
    "alignment.model",
    "alignment.solver",
    "alignment.disparity_floor",
    "alignment.fit_pixels",
    "scoring.aggregate",
    "scoring.resolution",
    "scoring.resample",
    "scoring.valid_truth",
    "holes.policies",
    "holes.primary",
)


@dataclass(frozen=True, kw_only=True)
class DepthProtocol(PixelProtocol):
    """The card's numbers. hole_abs_rel: a hole's error under error_1."""

    delta_base: float
    hole_abs_rel: float
    failed_image_abs_rel: float


def depth_protocol(card: Card) -> DepthProtocol:
    """A card's protocol; InstallationError if a fixed value differs from the code's."""
    common = pixel_protocol(card, fixed=_FIXED, declared=_DECLARED)
    return DepthProtocol(
        **vars(common),
        delta_base=float(card.value("scoring.delta_base")),
        hole_abs_rel=float(card.value("holes.error_1_abs_rel")),
        failed_image_abs_rel=float(card.value("scoring.failed_image_abs_rel")),
    )
