"""The tables and the picture of a study that matrix.py made: FOLDER/tables.md, FOLDER/matrix.png.

    python benchmarks/matrix/tables.py FOLDER [--draws 2000]

A fault is seen by a measure where the mean drop of the families' scores from the reference's own
is at least the measure's `seen` and its 95 % interval, over samples of whole families, is above 0.
Correlations are Spearman's over all copies with one fault and all families; their intervals draw
families, each with all of its copies.
"""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path

import numpy as np
from matrix import FAULTS, ORACLES
from PIL import Image, ImageDraw, ImageFont
from scores import MEASURES, Scores, read_scores

SINGLE = [f"{fault}_{amount:g}" for fault, amounts in FAULTS.items() for amount in amounts]
MIXED = ["mix", *(f"mix+{oracle}" for oracle in (*ORACLES, "all"))]
#: The measures that the table of correlations has as columns.
AGAINST = ("masks AP", "panoptic PQ", "depth AbsRel", "3D boxes AP", "bench R", "bench A")
SEED, FEWEST = 0, 3


def shown(value: float) -> str:
    """A number as the tables have it."""
    if np.isnan(value):
        return "-"
    if abs(value - round(value)) < 1e-6:
        return f"{value:.0f}"
    return f"{value:.1f}" if abs(value) >= 10 else f"{value:.3f}"


def drops(scores: Scores, copy: str, drawn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean drop of each measure, and the lower end of its interval."""
    change = scores.cases[scores.of("itself")] - scores.cases[scores.of(copy)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a measure that no family has
        low = np.nanquantile(np.nanmean(change[:, drawn], axis=-1), 0.025, axis=-1)
        return np.nanmean(change, axis=-1), low


def seen(scores: Scores, copy: str, drawn: np.ndarray) -> np.ndarray:
    """(measures,) whether each sees the copy's fault."""
    drop, low = drops(scores, copy, drawn)
    least = np.array([measure.seen for measure in MEASURES])
    found: np.ndarray = (drop >= least) & (low > 0)
    return found


def matrix_table(scores: Scores, drawn: np.ndarray, chosen: list[int]) -> list[str]:
    """Values of some measures by copy; in bold where the fault is seen."""
    lines = ["| copy | " + " | ".join(MEASURES[k].name for k in chosen) + " |"]
    lines.append("|---|" + "---:|" * len(chosen))
    for copy in ["itself", *SINGLE]:
        if copy in scores.copies:
            bold = seen(scores, copy, drawn)
            cells = [
                f"**{shown(scores.values[scores.of(copy), k])}**" if bold[k]
                else shown(scores.values[scores.of(copy), k])
                for k in chosen
            ]  # fmt: skip
            lines.append(f"| {copy.replace('_', ' ')} | " + " | ".join(cells) + " |")
    return lines


def summary_table(scores: Scores, drawn: np.ndarray) -> list[str]:
    """What each measure sees at the small amount, what at the large alone, and what never."""
    lines = [
        "| measure | sees at the small amount | at the large one | blind to |",
        "|---|---|---|---|",
    ]
    found = {copy: seen(scores, copy, drawn) for copy in SINGLE if copy in scores.copies}
    for k, measure in enumerate(MEASURES):
        parts: tuple[list[str], ...] = ([], [], [])
        asked = {c for c in found if np.isfinite(scores.values[scores.of(c), k])}
        for fault, amounts in FAULTS.items():
            hits = [found[f"{fault}_{a:g}"][k] for a in amounts if f"{fault}_{a:g}" in asked]
            if hits:
                parts[0 if hits[0] and len(hits) > 1 else 1 if hits[-1] else 2].append(fault)
        lines.append(f"| {measure.name} | " + " | ".join(", ".join(p) or "-" for p in parts) + " |")
    return lines


def ranks(values: np.ndarray) -> np.ndarray:
    """Ranks, ties at their mean."""
    _, place, n = np.unique(values, return_inverse=True, return_counts=True)
    ends = np.cumsum(n)
    middle: np.ndarray = (ends - (n - 1) / 2)[place]
    return middle


def spearman(a: np.ndarray, b: np.ndarray) -> float:
    """Rank correlation of what both have; NaN where one is constant."""
    both = np.isfinite(a) & np.isfinite(b)
    if both.sum() < 3:
        return np.nan
    x, y = ranks(a[both]), ranks(b[both])
    return float(np.corrcoef(x, y)[0, 1]) if x.std() and y.std() else np.nan


def correlation(first: np.ndarray, second: np.ndarray, drawn: np.ndarray) -> str:
    """Of (copies, families) of two measures, with the interval over samples of families."""
    both = np.isfinite(first) & np.isfinite(second)
    if both.any(axis=0).sum() < FEWEST:
        return "-"
    value = spearman(first.ravel(), second.ravel())
    samples = [spearman(first[:, d].ravel(), second[:, d].ravel()) for d in drawn]
    low, high = np.nanquantile(samples, [0.025, 0.975])
    return f"{value:.2f} [{low:.2f}, {high:.2f}]"


def correlation_table(scores: Scores, drawn: np.ndarray) -> list[str]:
    """Each measure against some."""
    rows = [scores.of(copy) for copy in SINGLE if copy in scores.copies]
    names = [measure.name for measure in MEASURES]
    lines = ["| | " + " | ".join(AGAINST) + " |", "|---|" + "---|" * len(AGAINST)]
    for k, measure in enumerate(MEASURES):
        cells = [
            "1" if measure.name == other
            else correlation(scores.cases[rows, k], scores.cases[rows, names.index(other)], drawn)
            for other in AGAINST
        ]  # fmt: skip
        lines.append(f"| {measure.name} | " + " | ".join(cells) + " |")
    return lines


def oracle_table(scores: Scores, drawn: np.ndarray) -> list[str]:
    """What is left of the mix's drop, by the mean over families, when one thing is put right."""
    lines = ["| measure | mix | " + " | ".join(f"true {o}" for o in ORACLES) + " | all three |"]
    lines.append("|---|---:|" + "---:|" * (len(ORACLES) + 1))
    itself, mix = (scores.cases[scores.of(copy)] for copy in ("itself", "mix"))
    for k, measure in enumerate(MEASURES):
        gap, cells = itself[k] - mix[k], [shown(scores.values[scores.of("mix"), k])]
        if not (np.isfinite(gap).any() and np.nanmean(gap) >= measure.seen):
            lines.append(f"| {measure.name} | {cells[0]} |" + " |" * (len(ORACLES) + 1))
            continue
        for copy in MIXED[1:]:
            gain = scores.cases[scores.of(copy), k] - mix[k]
            shares = np.nanmean(gain[drawn], axis=1) / np.nanmean(gap[drawn], axis=1)
            low, high = np.nanquantile(shares, [0.025, 0.975])
            share = np.nanmean(gain) / np.nanmean(gap)
            cells.append(f"{share:.0%} [{low:.0%}, {high:.0%}]")
        lines.append(f"| {measure.name} | " + " | ".join(cells) + " |")
    return lines


def picture(scores: Scores, file: Path) -> None:
    """The drop of each measure by copy as colour: white for none, dark for `full` of its unit."""
    copies = [copy for copy in SINGLE if copy in scores.copies]
    cell_w, cell_h, left, top = 52, 24, 120, 108
    size = (left + cell_w * len(MEASURES) + 8, top + cell_h * len(copies) + 8)
    image = Image.new("RGB", size, "white")
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(size=13)
    for k, measure in enumerate(MEASURES):
        text = Image.new("RGB", (top, 18), "white")
        ImageDraw.Draw(text).text((0, 1), measure.name, fill="black", font=font)
        turned = text.rotate(90, expand=True)
        image.paste(turned, (left + k * cell_w + 17, 0))
    itself = scores.cases[scores.of("itself")]
    for i, copy in enumerate(copies):
        y = top + i * cell_h
        draw.text((6, y + 4), copy.replace("_", " "), fill="black", font=font)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            drop = np.nanmean(itself - scores.cases[scores.of(copy)], axis=-1)
        for k, measure in enumerate(MEASURES):
            share = float(np.clip(drop[k] / measure.full, 0, 1)) if np.isfinite(drop[k]) else 0.0
            color = tuple(int(255 - (255 - c) * share**0.5) for c in (24, 74, 120))
            x = left + k * cell_w
            draw.rectangle((x, y, x + cell_w - 2, y + cell_h - 2), fill=color)
            label = shown(scores.values[scores.of(copy), k])
            label = label[1:] if label.startswith("0.") else label
            ink = "white" if share > 0.3 else "black"
            draw.text((x + 6, y + 4), label, fill=ink, font=font)
    image.save(file)


def main() -> None:
    """Write both files."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("study", type=Path)
    parser.add_argument("--draws", type=int, default=2000)
    chosen = parser.parse_args()
    scores = read_scores(chosen.study, ["itself", *SINGLE, *MIXED])
    n = len(scores.families)
    drawn = np.random.default_rng(SEED).integers(0, n, (chosen.draws, n))
    tasks = [measure.task for measure in MEASURES]
    flat = [k for k, t in enumerate(tasks) if t in ("coco", "coco-masks", "lvis", "amodal")]
    maps = [k for k, t in enumerate(tasks) if "semantic" in t or "panoptic" in t]
    space = [k for k in range(len(tasks)) if k not in flat + maps]
    parts = {
        "Boxes and masks": matrix_table(scores, drawn, flat),
        "Segments and classes": matrix_table(scores, drawn, maps),
        "Space and appearance": matrix_table(scores, drawn, space),
        "What each sees": summary_table(scores, drawn),
        "Correlations": correlation_table(scores, drawn),
    }
    if all(copy in scores.copies for copy in MIXED):
        parts["Oracles"] = oracle_table(scores, drawn)
    text = "\n\n".join(f"### {name}\n\n" + "\n".join(lines) for name, lines in parts.items())
    (chosen.study / "tables.md").write_text(text + "\n", "utf-8")
    picture(scores, chosen.study / "matrix.png")


if __name__ == "__main__":
    main()
