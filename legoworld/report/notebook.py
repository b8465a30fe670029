"""Results as a notebook shows them: the report's sentence, plot, coverage and tables, as HTML."""

from __future__ import annotations

import base64
import html
from collections.abc import Mapping, Sequence
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from legoworld.comparison.tables import Document, headline_blocks, list_comparisons
from legoworld.comparison.verdict import noun, verdict_sentences
from legoworld.evaluation.family import load_evaluation_family
from legoworld.evaluation.metrics import metric_tables
from legoworld.records.evaluation import Summary
from legoworld.records.report_tables import ForestRow, Span
from legoworld.records.scene_folder import InstanceRow
from legoworld.report.forest import evaluated_sentence, forest_rows
from legoworld.tables.html import html as html_table
from legoworld.tables.table import Table

_LINE: Final = 26
_LEFT: Final = 150
_WIDTH: Final = 320
_DIFFERENCE: Final = 200
_GAP: Final = 70
#: Of the first side, the second, and others: seen alike on light and dark ground.
_COLOURS: Final = ("#3b74a8", "#b06abf", "#7f9f45")
_APART: Final = "#0b72d0"
_SOFT: Final = "#888"


def evaluation_html(summary: Summary) -> str:
    """An evaluation: one sentence, and its main metrics with their intervals."""
    name = "scene" if summary.kind == "scene" else f"{summary.kind or 'baseline'}"
    sentence = evaluated_sentence(noun(summary.task, name), summary)
    rows = forest_rows(summary.task, [summary], None)
    tables = metric_tables([("", load_evaluation_family(summary.task).metrics(summary))])
    return _block([sentence], _forest(rows, [name]), _statuses(summary) + _numbers(tables))


def comparison_html(document: Document) -> str:
    """A comparison: the verdict of every pair, both sides' metrics, and the differences."""
    parts = []
    for one in list_comparisons(document):
        sentences = [said for pair in one.pairs for said, _ in verdict_sentences(one.task, pair)]
        labels = [one.pairs[0].scene, *(pair.baseline for pair in one.pairs)] if one.pairs else []
        parts.append(_block(sentences, _forest(forest_rows(one.task, [], one), labels), ""))
    return "".join(parts) + _numbers(headline_blocks(document))


def picture_html(picture_rgb: NDArray[np.uint8], text: str) -> str:
    """An (H, W, 3) uint8 RGB picture above a line of text. ValueError if that has no PNG."""
    done, data = cv2.imencode(".png", np.ascontiguousarray(picture_rgb[:, :, ::-1]))
    if not done:
        raise ValueError(f"a picture of shape {picture_rgb.shape} cannot be encoded")
    encoded = base64.b64encode(data.tobytes()).decode("ascii")
    return (
        f'<div><img src="data:image/png;base64,{encoded}" alt="{html.escape(text)}" '
        f'style="max-width:100%;max-height:480px"><p>{html.escape(text)}</p></div>'
    )


def instances_text(instances: Sequence[InstanceRow]) -> str:
    """How many instances of each category are visible."""
    counts: dict[str, int] = {}
    for instance in instances:
        name = instance.category or "without a category"
        counts[name] = counts.get(name, 0) + 1
    listed = sorted(counts.items(), key=lambda one: (-one[1], one[0]))
    return ", ".join(f"{n} x {name}" if n > 1 else name for name, n in listed) or "no instances"


def statuses_html(title: str, by_status: Mapping[str, int]) -> str:
    """Counts of images by status in a line."""
    listed = ", ".join(f"{n} {status}" for status, n in by_status.items())
    return f"<p><b>{html.escape(title)}</b>: {html.escape(listed)}</p>"


def _statuses(summary: Summary) -> str:
    return statuses_html("images", summary.coverage.by_status)


def _numbers(tables: Sequence[Table]) -> str:
    """Every number, folded."""
    return f"<details><summary>numbers</summary>{''.join(map(html_table, tables))}</details>"


def _block(sentences: Sequence[str], drawing: str, more: str) -> str:
    text = "".join(f"<p><b>{html.escape(s)}</b></p>" for s in sentences)
    return f'<div style="max-width:760px">{text}{drawing}{more}</div>'


def _forest(rows: Sequence[ForestRow], labels: Sequence[str]) -> str:
    """The plot as SVG; text takes the notebook's own colour."""
    compared = any(any(row.differences) for row in rows)
    width = _LEFT + _WIDTH + _GAP + (_DIFFERENCE if compared else 0)
    high = len(rows) * _LINE + 44
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {high}" width="{width}" '
        f'height="{high}" role="img" aria-label="main metrics with 95 % intervals" '
        'style="max-width:100%;height:auto;font:12px system-ui,sans-serif" fill="currentColor">'
    ]
    parts += _legend(labels)
    for share in (0, 0.25, 0.5, 0.75, 1):
        parts += _tick(_LEFT + share * _WIDTH, f"{share:g}", high)
    reach = max([0.1, *(abs(v) for row in rows for d in row.differences for v in _known_values(d))])
    middle = _LEFT + _WIDTH + _GAP + _DIFFERENCE / 2
    if compared:
        for at in (-reach, 0, reach):
            parts += _tick(middle + at / reach * (_DIFFERENCE / 2 - 20), f"{at:+.2g}", high)
    for i, row in enumerate(rows):
        y = 30 + i * _LINE
        parts.append(f'<text x="0" y="{y + 4}">{html.escape(row.name)}</text>')
        for k, span in enumerate(row.sides):
            at = y + (k - (len(row.sides) - 1) / 2) * 9
            x = [_LEFT + min(max(v, 0), 1) * _WIDTH for v in _known_values(span)]
            parts += _interval(x, at, _COLOURS[min(k, 2)])
            if span and span.value is not None:
                parts.append(
                    f'<text x="{_LEFT + _WIDTH + 10}" y="{at + 4}" fill="{_COLOURS[min(k, 2)]}">'
                    f"{span.value:.3f}</text>"
                )
        for k, span in enumerate(row.differences):
            at = y + (k - (len(row.differences) - 1) / 2) * 9
            known = _known_values(span)
            apart = len(known) == 3 and (known[1] > 0 or known[2] < 0)
            x = [middle + v / reach * (_DIFFERENCE / 2 - 20) for v in known]
            parts += _interval(x, at, _APART if apart else _SOFT)
    return "".join([*parts, "</svg>"])


def _known_values(span: Span | None) -> list[float]:
    """Value, low and high; the value alone where there is no interval; nothing without one."""
    if span is None or span.value is None:
        return []
    if span.low is None or span.high is None:
        return [span.value]
    return [span.value, span.low, span.high]


def _interval(x: Sequence[float], y: float, colour: str) -> list[str]:
    if not x:
        return []
    line = (
        f'<line x1="{x[1]:.1f}" x2="{x[2]:.1f}" y1="{y}" y2="{y}" stroke="{colour}" '
        'stroke-width="2"/>'
        if len(x) == 3
        else ""
    )
    return [line, f'<circle cx="{x[0]:.1f}" cy="{y}" r="4" fill="{colour}"/>']


def _tick(x: float, text: str, high: int) -> list[str]:
    return [
        f'<line x1="{x:.1f}" x2="{x:.1f}" y1="18" y2="{high - 22}" stroke="{_SOFT}" '
        'stroke-opacity=".3"/>',
        f'<text x="{x:.1f}" y="{high - 8}" text-anchor="middle" fill="{_SOFT}">{text}</text>',
    ]


def _legend(labels: Sequence[str]) -> list[str]:
    parts, x = [], float(_LEFT)
    for k, label in enumerate(labels):
        parts.append(f'<circle cx="{x + 4}" cy="8" r="4" fill="{_COLOURS[min(k, 2)]}"/>')
        parts.append(f'<text x="{x + 12}" y="12">{html.escape(label)}</text>')
        x += 30 + 7 * len(label)
    return parts
