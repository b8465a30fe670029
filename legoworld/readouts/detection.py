"""Boxes and masks of a run: the results of each image, and what a run counts of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Final

from msgspec import structs

from legoworld.readouts.amodal import AMODAL, amodal_exports, amodal_table
from legoworld.readouts.boxes3d import BOXES_3D, box3d_exports, box3d_table
from legoworld.readouts.exports import box_exports, mask_exports
from legoworld.readouts.family import AnsweredImage, Export, ReadoutFamily, unusable_row
from legoworld.records.base import UNSET
from legoworld.records.run_file import RunSummary
from legoworld.records.run_rows import RunRow
from legoworld.tables.table import Table
from legoworld.visibility.layers import most_entries

_EXPORTERS: Final = {"boxes": box_exports, "masks": mask_exports}


def _exports(reads: str, image: AnsweredImage) -> list[Export]:
    if reads == AMODAL:
        return amodal_exports(image)
    if reads == BOXES_3D:
        return box3d_exports(image.image_id, image.instances, image.view, threads=image.threads)
    return _EXPORTERS[reads](image.image_id, image.instances, image.view)


def _cost(reads: str, image: AnsweredImage) -> str | None:
    """By what was measured (docs/performance.md); boxes in space take the same layers."""
    if reads not in (AMODAL, BOXES_3D):
        return None
    n, view = len(image.instances), image.view
    most = most_entries(view.surfaces, view.projection, view.size_wh)
    seconds = 1e-4 * n + 9e-8 * most + (5e-4 * n if reads == BOXES_3D else 0)
    return (
        f"{n:,} instances drawn as if alone: at most {most:,} pixels, {28 * most / 1e6:,.0f} MB, "
        f"about {seconds:,.0f} s"
    )


def _sum_up(summary: RunSummary, _rows: Sequence[RunRow], ok: Sequence[RunRow]) -> RunSummary:
    made = [_n_predictions(row) for row in ok]
    unmatched: Counter[str] = Counter()
    for row in ok:
        unmatched.update({u.label: u.count for u in row.unmatched or ()})
    return structs.replace(
        summary,
        coverage=structs.replace(summary.coverage, ok_empty=made.count(0)),
        predictions=sum(made),
        unmatched_labels=dict(unmatched),
        unexported_instances=dict(Counter(u.reason for r in ok for u in r.unexported or ())),
        nested_instances=sum(row.nested.instances for row in ok if row.nested),
    )


def _n_predictions(row: RunRow) -> int:
    if row.n_predictions is UNSET:
        raise unusable_row(row, "n_predictions")
    return row.n_predictions


def _table(reads: str, image: AnsweredImage) -> Table | None:
    if reads == BOXES_3D:
        return box3d_table(image.instances, image.view, threads=image.threads)
    return amodal_table(image) if reads == AMODAL else None


READOUT: Final = ReadoutFamily(exports=_exports, sum_up=_sum_up, table=_table, cost=_cost)
