"""The numbers of a study: of each copy and measure the set's value, and each family's own.

A measure is one column of the matrix. The set's value is the official evaluator's over all cases;
a case's is what differences and correlations are made of, higher is better.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

Row = dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class Measure:
    """One column. value: of a summary; case: of a row of per_image.jsonl, None where undefined.

    error: lower is better, so cases have a minus. seen: the mean change of a case's score from
    which on a fault counts as seen; full: the change that the picture draws in full colour.
    """

    name: str
    task: str
    value: Callable[[Row], float | None]
    case: Callable[[Row], float | None]
    error: bool = False
    seen: float = 0.005
    full: float = 1.0


def pairs(row: Row) -> float | None:
    """2 x the sum of IoU of one-to-one pairs / (predictions + annotations)."""
    own = row["class_aware"]
    n = own["n_dt"] + own["n_gt"]
    return 2 * own["iou_sum"] / n if n else None


def hidden(row: Row) -> float | None:
    """IoU of the invisible parts over annotations that have one."""
    own = row["amodal"]
    return own["invisible_iou_sum"] / own["n_occluded"] if own["n_occluded"] else None


def order(row: Row) -> float | None:
    """F1 of who is in front of whom."""
    own = row["amodal"]
    n = own["n_order_predicted"] + own["n_order_truth"]
    return 2 * own["n_order_right"] / n if n else None


def segments(row: Row) -> float | None:
    """Panoptic quality with all categories as one."""
    hit, wrong, missed = (sum(c[i] for c in row["counts"].values()) for i in range(3))
    iou = sum(m["intersection"] / m["union"] for m in row["matched"])
    n = hit + wrong / 2 + missed / 2
    return iou / n if n else None


def classes(row: Row) -> float | None:
    """Mean IoU of the classes of this case."""
    shares = [c[0] / union for c in row["counts"].values() if (union := c[1] + c[2] - c[0])]
    return float(np.mean(shares)) if shares else None


def metric(name: str, policy: str | None = None) -> Callable[[Row], float | None]:
    """A metric of a summary."""

    def value(summary: Row) -> float | None:
        found: Any = summary["metrics"][name]
        if isinstance(found, dict):
            found = found[policy] if policy else found["value"]
        return None if found is None else float(found)

    return value


def amodal(name: str) -> Callable[[Row], float | None]:
    """A number that AP hides."""
    return lambda summary: summary["amodal"]["metrics"][name]  # type: ignore[no-any-return]


def questions(kind: str) -> Callable[[Row], float | None]:
    """The score of one kind of question of this case."""

    def case(row: Row) -> float | None:
        own = row["sums"].get(kind)
        return own["score"] / own["n"] if own and own["n"] else None

    return case


MEASURES: tuple[Measure, ...] = (
    Measure(name="boxes AP", task="coco", value=metric("AP"), case=pairs),
    Measure(name="masks AP", task="coco-masks", value=metric("AP"), case=pairs),
    Measure(name="LVIS AP", task="lvis", value=metric("AP"), case=pairs),
    Measure(name="amodal AP", task="amodal", value=metric("AP"), case=pairs),
    Measure(name="hidden IoU", task="amodal", value=amodal("invisible_iou"), case=hidden),
    Measure(name="order F1", task="amodal", value=amodal("order_f1"), case=order),
    Measure(name="panoptic PQ", task="coco-panoptic", value=metric("PQ"), case=segments),
    Measure(name="COCO mIoU", task="coco-semantic", value=metric("mIoU"), case=classes),
    Measure(name="VOC mIoU", task="voc-semantic", value=metric("mIoU"), case=classes),
    Measure(name="ADE20K mIoU", task="ade20k-semantic", value=metric("mIoU"), case=classes),
    Measure(name="Cityscapes mIoU", task="cityscapes-semantic", value=metric("mIoU"), case=classes),
    Measure(
        name="depth AbsRel", task="eth3d", value=metric("abs_rel", "error_1"), error=True,
        case=lambda row: -row["metrics"]["abs_rel"]["error_1"], seen=0.0005, full=0.1,
    ),
    Measure(
        name="normals deg", task="normals", value=metric("mean_deg", "error_90"), error=True,
        case=lambda row: -row["metrics"]["mean_deg"]["error_90"], seen=0.1, full=20.0,
    ),
    Measure(name="3D boxes AP", task="boxes3d", value=metric("AP"), case=pairs),
    Measure(
        name="relations", task="relations", value=metric("accuracy", "answers"),
        case=questions("accuracy"),
    ),
    Measure(name="lengths", task="relations", value=metric("mra", "answers"),
            case=questions("mra")),
    Measure(name="bench R", task="bench", value=metric("R"), case=lambda row: row["R"]),
    Measure(name="bench A", task="bench", value=metric("A"), case=lambda row: row["A"]),
    Measure(name="bench S", task="bench", value=metric("S"), case=lambda row: row["S"]),
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Scores:
    """values: (copies, measures) of the set; cases: (copies, measures, families); NaN for none."""

    copies: tuple[str, ...]
    families: tuple[str, ...]
    values: np.ndarray
    cases: np.ndarray

    def of(self, copy: str) -> int:
        """A copy's row."""
        return self.copies.index(copy)


def read_scores(study: Path, copies: list[str]) -> Scores:
    """Those of the copies that were scored, in the given order."""
    done = [c for c in copies if (study / "evals" / c / "bench" / "summary.json").is_file()]
    families = sorted(p.name.partition("__")[0] for p in (study / "itself").iterdir())
    values = np.full((len(done), len(MEASURES)), np.nan)
    cases = np.full((*values.shape, len(families)), np.nan)
    for i, copy in enumerate(done):
        for k, measure in enumerate(MEASURES):
            folder = study / "evals" / copy / measure.task
            value = measure.value(json.loads((folder / "summary.json").read_text("utf-8")))
            values[i, k] = np.nan if value is None else value
            for line in (folder / "per_image.jsonl").read_text("utf-8").splitlines():
                row = json.loads(line)
                number = measure.case(row) if row["status"] == "ok" else None
                family = families.index(row["file_name"].partition("__")[0])
                cases[i, k, family] = np.nan if number is None else number
    cases = np.round(cases, 6)  # else the last digits of what is equal would be ranked
    return Scores(copies=tuple(done), families=tuple(families), values=values, cases=cases)
