"""A section's tables: numbers with interval and denominator, coverage, categories, comparison."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from legoworld.evaluation.protocols import detection_protocol
from legoworld.evaluation.stored import Evaluated
from legoworld.evaluation.text import metric_rows, notes
from legoworld.records.base import UNSET, as_json
from legoworld.records.comparison import Comparison, Difference, Measured
from legoworld.records.evaluation_summary import DepthSummary
from legoworld.wording import counted, share

#: What stands where no specialist's number is.
NO_SPECIALIST: Final = "no specialist was run"

Cell = dict[str, str]
Rows = list[dict[str, Any]]


def headline_rows(sides: Sequence[Evaluated]) -> Rows:
    """The evaluator's own numbers and the tie orders: {"name", "cells": one of each side}."""
    return [r for r in _detection_rows(sides) if not r["name"].startswith("class_")]


def score_free_rows(sides: Sequence[Evaluated]) -> Rows:
    """The numbers of one-to-one pairs, which need no ranking, by name."""
    rows = [r for r in _detection_rows(sides) if r["name"].startswith("class_")]
    return sorted(rows, key=lambda r: str(r["name"]))


def _detection_rows(sides: Sequence[Evaluated]) -> Rows:
    found: dict[str, list[Cell | None]] = {}
    for k, side in enumerate(sides):
        for name, value, spread, over in metric_rows(side.detection, detection_protocol(side.task)):
            cell = {"value": value, "spread": spread, "over": over}
            found.setdefault(name, [None] * len(sides))[k] = cell
    return [{"name": name, "cells": cells} for name, cells in found.items()]


def depth_rows(sides: Sequence[Evaluated]) -> Rows:
    """Means of every metric and hole policy, with the constant depth's beside them."""
    rows: Rows = []
    for metric, by_policy in sides[0].depth.metrics.items():
        for policy in by_policy:
            cells = [_depth_cell(side.depth, metric, policy) for side in sides]
            rows.append({"name": metric, "policy": policy, "cells": cells})
    for policy in sides[0].depth.all_attempted.abs_rel:
        cells = []
        for side in sides:
            every = side.depth.all_attempted
            over = (
                f"{counted(every.images, 'image', 'images')} with truth, {every.missing} of them "
            )
            over += f"without a score at {every.missing_abs_rel:g}"
            value = _number(every.abs_rel[policy])
            cells.append({"value": value, "spread": "-", "over": over, "constant": "-"})
        rows.append({"name": "abs_rel, all attempted", "policy": policy, "cells": cells})
    return rows


def _depth_cell(summary: DepthSummary, metric: str, policy: str) -> Cell:
    ends = summary.intervals[metric][policy].ends
    groups, coverage = summary.bootstrap, summary.coverage
    scenes = counted(groups.groups, "scene", "scenes")
    by_scene = f", {scenes}" if groups.unit == "scene" else ""
    return {
        "value": _number(summary.metrics[metric][policy]),
        "spread": "{:.4f} .. {:.4f}".format(*ends) if ends else "-",
        "over": share(coverage.scored, coverage.attempted, "image", "images") + by_scene,
        "constant": _number(summary.constant[metric][policy]),
    }


def coverage_rows(sides: Sequence[Evaluated]) -> Rows:
    """Attempted, scored, with truth, and every status, a side a column."""
    coverages = [side.summary.coverage for side in sides]
    names = ["attempted", "scored", "with_truth", "scored_with_truth", "scored_without_predictions"]
    rows: Rows = [
        {"name": name.replace("_", " "), "cells": [getattr(c, name, "-") for c in coverages]}
        for name in names
        if any(hasattr(c, name) for c in coverages)
    ]
    for status in sorted({s for c in coverages for s in c.by_status}):
        cells = [c.by_status.get(status, 0) for c in coverages]
        rows.append({"name": f"status {status}", "cells": cells})
    return rows


def coverage_notes(side: Evaluated) -> list[str]:
    """The evaluation's own sentences about its counts."""
    if side.task != "eth3d":
        return notes(side.detection)
    summary = side.depth
    lines = [
        f"mean share of holes {_number(summary.mean_hole_share)}, outside the view "
        f"{_number(summary.mean_outside_view_share)}, clamped "
        f"{_number(summary.mean_clamped_share)}",
        f"{summary.resampled} resampled, {summary.worse_than_constant} worse than a constant",
    ]
    lines += [f"{r.status}: {r.file_name}: {r.reason}" for r in summary.not_scored]
    return lines + (["partial run: only some images of its track"] if summary.partial else [])


def category_rows(sides: Sequence[Evaluated]) -> Rows:
    """A row of each category that has truth or predictions on any side, ascending id."""
    found: dict[int, dict[str, Any]] = {}
    for k, side in enumerate(sides):
        for row in side.categories:
            mine = found.setdefault(
                row.category_id,
                {
                    "id": row.category_id,
                    "name": row.name,
                    "frequency": None if row.frequency is UNSET else row.frequency,
                    "n_truth": row.n_truth,
                    "n_images": row.n_images,
                    "cells": [None] * len(sides),
                },
            )
            mine["cells"][k] = {
                "ap": row.AP,
                "ap50": row.AP50,
                "miou": row.miou_gt,
                "n": row.n_predictions,
                **as_json(row.greedy_50),
            }
    return [found[key] for key in sorted(found)]


def comparison_tables(comparison: Comparison) -> Rows:
    """Each pair of a comparison with its rows as text; level 1 is the headline."""
    return [
        {
            "scene": pair.scene,
            "baseline": pair.baseline,
            "coverage": pair.coverage,
            "dropped": pair.dropped,
            "rows": [
                {
                    "name": _short_name(row.metric, row.policy),
                    "policy": row.policy.replace("_", " "),
                    "images": row.images,
                    "better": row.better,
                    "scene": _compared(row.scene),
                    "baseline": _compared(row.baseline),
                    "difference": _compared(row.difference, signed=True),
                    "level": row.level,
                }
                for row in pair.rows
            ],
        }
        for pair in comparison.pairs
    ]


def _short_name(metric: str, policy: str) -> str:
    """A metric without the policy, which has a column of its own."""
    return metric.removeprefix(f"{policy}.").removesuffix(f".{policy}")


def _compared(cell: Difference, *, signed: bool = False) -> Cell:
    spread, over = "-", ""
    if cell.ends:
        sign = "+" if signed else ""
        spread = f"{cell.ends[0]:{sign}.4f} .. {cell.ends[1]:{sign}.4f}"
    if isinstance(cell, Measured):
        if not cell.ends and isinstance(cell.sd, float):
            spread = f"sd {cell.sd:.4f}"
        counts = sorted(cell.over.items(), key=lambda c: (c[0] != "images", c[0]))
        over = ", ".join(f"{n} {name.replace('_', ' ')}" for name, n in counts)
        if isinstance(cell.constant, float):
            over += f"; a constant: {cell.constant:.4f}"
    return {"value": _number(cell.value, signed=signed), "spread": spread, "over": over}


def _number(value: float | None, *, signed: bool = False) -> str:
    if value is None:
        return "-"
    return f"{value:+.4f}" if signed else f"{value:.4f}"
