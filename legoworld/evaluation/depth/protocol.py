"""The depth protocol: its card, and errors as sums over bands of pixels and as metrics."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any, Final

import numpy as np

from legoworld.cards import Card
from legoworld.evaluation.pixels.family import F64, PixelMetric, PixelProtocol, pixel_protocol
from legoworld.records.pixels import Metrics

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


def depth_protocol(card: Card) -> DepthProtocol:
    """A card's protocol; InstallationError if a fixed value differs from the code's."""
    common = pixel_protocol(card, fixed=_FIXED, declared=_DECLARED)
    return DepthProtocol(
        **vars(common),
        delta_base=float(card.value("scoring.delta_base")),
        hole_abs_rel=float(card.value("holes.error_1_abs_rel")),
    )


@dataclass(frozen=True, kw_only=True)
class ErrorSums:
    """Sums over n pixels. delta1..3 count hits; log_* are of ln(predicted / true)."""

    n: int = 0
    abs_rel: float = 0.0
    delta1: int = 0
    delta2: int = 0
    delta3: int = 0
    square_m2: float = 0.0
    abs_log10: float = 0.0
    log: float = 0.0
    log_square: float = 0.0

    def __add__(self, other: ErrorSums) -> ErrorSums:
        return ErrorSums(
            **{f.name: getattr(self, f.name) + getattr(other, f.name) for f in fields(self)}
        )


def error_sums(predicted_z_m: F64, true_z_m: F64, delta_base: float) -> ErrorSums:
    """Sums over pixels, both (n,) float64 positive metres along camera z.

    AbsRel |p - t| / t, delta_k: max(p / t, t / p) < base^k, squared error, |log10(p / t)| (Eigen
    et al. 2014).
    """
    error = predicted_z_m - true_z_m
    ratio = predicted_z_m / true_z_m
    worst = np.maximum(ratio, 1.0 / ratio)
    log = np.log(ratio)
    hits = [int(np.count_nonzero(worst < delta_base**k)) for k in (1, 2, 3)]
    return ErrorSums(
        n=len(error),
        abs_rel=float(np.sum(np.abs(error) / true_z_m)),
        delta1=hits[0],
        delta2=hits[1],
        delta3=hits[2],
        square_m2=float(np.sum(error * error)),
        abs_log10=float(np.sum(np.abs(log))) / math.log(10.0),
        log=float(np.sum(log)),
        log_square=float(np.sum(log * log)),
    )


def compute_metrics(predicted: ErrorSums, holes_far: ErrorSums, protocol: DepthProtocol) -> Metrics:
    """Every metric under every policy for which it is defined.

    predicted: pixels with a prediction, at least one; holes_far: pixels without one, scored at the
    depth of the deepest ground truth. Under error_1 each hole has a fixed error and fails every
    delta. silog is the standard deviation of ln(p / t) as a fraction (KITTI prints it times 100).
    """
    n, n_all = predicted.n, predicted.n + holes_far.n
    far = predicted + holes_far
    mean_log = predicted.log / n
    metrics: Metrics = {
        "abs_rel": _policies(
            error_1=(predicted.abs_rel + protocol.hole_abs_rel * holes_far.n) / n_all,
            exclude=predicted.abs_rel / n,
            far=far.abs_rel / n_all,
        )
    }
    for name in ("delta1", "delta2", "delta3"):
        hits = getattr(predicted, name)
        metrics[name] = _policies(
            error_1=hits / n_all, exclude=hits / n, far=getattr(far, name) / n_all
        )
    metrics["rmse_m"] = {"exclude": math.sqrt(predicted.square_m2 / n)}
    metrics["log10"] = {"exclude": predicted.abs_log10 / n}
    variance = predicted.log_square / n - mean_log * mean_log
    metrics["silog"] = {"exclude": math.sqrt(max(0.0, variance))}
    return metrics


def _policies(**values: float) -> dict[str, float]:
    return {policy: values[policy] for policy in HOLE_POLICIES}
