"""Depth as a family of evaluations: its arrays, how they are measured, and what is printed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Final

from msgspec.structs import asdict
from numpy.typing import NDArray

from legoworld.errors import UsageError
from legoworld.evaluation.depth.arrays import (
    DECLARATION,
    ERRORS,
    DepthArray,
    DepthTruthError,
    checked_array,
)
from legoworld.evaluation.depth.eth3d import parse_scene_name, training_images
from legoworld.evaluation.depth.labelled import read_prediction
from legoworld.evaluation.depth.protocol import (
    CAMERA_MODELS,
    METRICS,
    PRIMARY_POLICY,
    depth_protocol,
)
from legoworld.evaluation.depth.rows import measure_depth
from legoworld.evaluation.depth.scoring import valid_truth
from legoworld.evaluation.depth.truth import DepthTruthFile, find_truth, load_truth, make_truth
from legoworld.evaluation.family import EvaluationFamily
from legoworld.evaluation.metrics import (
    MetricPart,
    bounds,
    describe_evaluator,
    fraction,
    image_counts,
    metric_parts,
    number_cell,
)
from legoworld.evaluation.pixels.evaluate import evaluate_pixels, verify_pixels
from legoworld.evaluation.pixels.family import (
    Options,
    PixelFamily,
    PixelRecords,
    Settings,
)
from legoworld.evaluation.pixels.live import live_pixels
from legoworld.evaluation.pixels.rows import PixelRun
from legoworld.evaluation.pixels.summary import (
    attempted_rows,
    list_few_unscored,
    list_unscored,
    mean,
    means,
)
from legoworld.pluralize import plural
from legoworld.readouts.depth import DEPTH_FILE
from legoworld.records.base import UNSET, UnsetType
from legoworld.records.depth import (
    AllAttempted,
    DepthChoices,
    DepthConfiguration,
    DepthCoverage,
    DepthEvidence,
    DepthRow,
    DepthSummary,
    PartOfEth3d,
    ScoredDepthRow,
)
from legoworld.records.evaluation import Coverage
from legoworld.tasks.shipped import DEPTH


def short_depth(summary: DepthSummary) -> str:
    """AbsRel and delta1 under each hole policy with denominators, and the unscored images."""
    lines = [
        f"{describe_evaluator(summary)}, camera model {summary.protocol.camera_model}: "
        f"{image_counts(summary.coverage)}{_eth3d_note(summary.coverage)}"
    ]
    for metric in ("abs_rel", "delta1"):
        by_policy = summary.metrics.get(metric, {})
        shown = (
            f"{policy} {fraction(value)}{bounds(summary.intervals[metric][policy])}"
            for policy, value in by_policy.items()
        )
        lines.append(f"{metric}: {', '.join(shown)}")
    return "\n".join([*lines, *list_few_unscored(summary)])


def _eth3d_note(coverage: DepthCoverage) -> str:
    """How much of ETH3D was attempted, if the images are ETH3D's."""
    part = coverage.eth3d
    if not part:
        return ""
    return (
        f" ({part.images} of ETH3D's {part.of_images}, in {part.scenes} of "
        f"{plural(part.of_scenes, 'scene', 'scenes')})"
    )


def depth_metrics(summary: DepthSummary) -> list[MetricPart]:
    """Means per hole policy beside those of the constant, with intervals and denominators."""
    (part,) = metric_parts(summary)
    groups = summary.bootstrap
    scenes = plural(groups.groups, "scene", "scenes")
    rows = [
        replace(
            row,
            over=f"{row.over}, {scenes}" if groups.unit == "scene" else row.over,
            constant=number_cell(summary.constant[row.name][row.policy]),
        )
        for row in part.rows
    ]
    rows += attempted_rows(summary, "abs_rel")
    note = (
        "Every depth is aligned by one scale and one shift in disparity before it is scored. Holes "
        "are pixels with measured depth and no prediction: error_1 (primary) counts each as an "
        "error of 100 %, exclude leaves them out, far fills them with the deepest ground truth. "
        "constant is what one depth for the whole photo would score."
    )
    return [MetricPart(title=part.title, rows=rows, note=note)]


def depth_notes(summary: DepthSummary) -> list[str]:
    """What the means hide: flagged fits, images without ground truth, holes, clamped pixels."""
    by_status = summary.coverage.by_status
    flagged = [f"{by_status.get(name, 0)} {name}" for name in ("inverted", "degenerate", "no_gt")]
    others = [f"{n} {name}" for name, n in by_status.items() if f"{n} {name}" not in flagged]
    shares = {
        "holes": summary.mean_hole_share,
        "outside the view": summary.mean_outside_view_share,
        "clamped": summary.mean_clamped_share,
    }
    lines = [
        f"images: {', '.join([*others, *flagged])}; "
        f"{summary.worse_than_constant} worse than a constant, "
        f"{summary.resampled} resampled, {plural(summary.warnings, 'warning', 'warnings')}",
        "mean share of truth pixels: "
        + ", ".join(f"{name} {fraction(x)}" for name, x in shares.items()),
        *list_unscored(summary),
    ]
    return lines + ["partial run: only some images of its track"] * summary.partial


def own_fields(
    _rows: Sequence[DepthRow], scored: Sequence[ScoredDepthRow], _settings: Settings
) -> Mapping[str, Any]:
    """The fields of a summary that only depth has."""
    return {
        "constant": means([row.constant for row in scored], METRICS),
        "mean_outside_view_share": mean([row.outside_view_share for row in scored]),
        "mean_clamped_share": mean([row.clamped_share for row in scored]),
        "worse_than_constant": sum(bool(row.worse_than_constant) for row in scored),
    }


def depth_coverage(rows: Sequence[DepthRow], coverage: Coverage) -> DepthCoverage:
    """With how many images of ETH3D there are."""
    return DepthCoverage(**asdict(coverage), eth3d=_eth3d_share(rows))


def _eth3d_share(rows: Sequence[DepthRow]) -> PartOfEth3d | UnsetType:
    """The share of ETH3D's training set; UNSET if an image is from another dataset."""
    names = {row.file_name for row in rows}
    whole = {image.file_name for image in training_images()}
    if not names or not names <= whole:
        return UNSET
    scenes, of = ({parse_scene_name(name) for name in some} for some in (names, whole))
    return PartOfEth3d(
        images=len(names), of_images=len(whole), scenes=len(scenes), of_scenes=len(of)
    )


def _check(run: PixelRun, files: Sequence[DepthTruthFile], options: Options) -> None:
    camera_model = options["camera_model"]
    if camera_model not in CAMERA_MODELS:
        raise UsageError(
            "unknown camera model", found=repr(camera_model), expected=" or ".join(CAMERA_MODELS)
        )
    if camera_model == CAMERA_MODELS[0]:
        return
    if run.kind != "scene":
        raise UsageError(
            "only a scene's depth can be warped to the dataset's camera",
            found=f"a run of kind {run.kind!r}, which saw the distorted photo itself",
            expected="a run of `legoworld readout`",
            next_step="score it with --camera-model none",
        )
    without = [file.path.name for file in files if file.camera is None]
    if without:
        raise DepthTruthError(
            "--camera-model dataset needs the camera of every photo",
            found=f"{len(without)} of {len(files)} without one, such as {without[0]}",
            expected="<scene>/dslr_calibration_jpg/cameras.txt and images.txt",
        )


def _array(z_m: NDArray[Any]) -> DepthArray:
    return checked_array(z_m, space="depth", unit="m", intrinsics_px=None, source="the array")


def _group(file_name: str) -> str:
    return parse_scene_name(file_name) or file_name


PIXELS: Final = PixelFamily(
    family=DEPTH,
    noun="depth",
    stored=DEPTH_FILE,
    row=DepthRow,
    errors=ERRORS,
    metrics=METRICS,
    primary=PRIMARY_POLICY,
    declaration=DECLARATION,
    protocol=depth_protocol,
    valid=valid_truth,
    find_truth=find_truth,
    load_truth=load_truth,
    make_truth=make_truth,
    read=read_prediction,
    array=_array,
    measure=measure_depth,
    records=PixelRecords(
        summary=DepthSummary,
        choices=DepthChoices,
        attempted=AllAttempted,
        configuration=DepthConfiguration,
        evidence=DepthEvidence,
        coverage=depth_coverage,
    ),
    own=own_fields,
    group=_group,
    options={"camera_model": CAMERA_MODELS[0]},
    check=_check,
)

EVALUATION: Final = EvaluationFamily(
    evaluate=partial(evaluate_pixels, PIXELS),
    verify=partial(verify_pixels, PIXELS),
    short=short_depth,
    metrics=depth_metrics,
    notes=depth_notes,
    truth_is_file=False,
    live=live_pixels(PIXELS),
)
