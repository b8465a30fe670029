"""An evaluation's files by their task: what is read back from a folder of any of them."""

from __future__ import annotations

from collections.abc import Sequence

from legoworld.records.base import Record, decode, decode_lines
from legoworld.records.evaluation_rows import DepthRow, DetectionRow, depth_rows
from legoworld.records.evaluation_summary import DepthSummary, DetectionSummary
from legoworld.records.reconstruction_rows import ReconstructionRow
from legoworld.records.reconstruction_summary import ReconstructionSummary

TaskSummary = DetectionSummary | DepthSummary | ReconstructionSummary
TaskRow = DetectionRow | DepthRow | ReconstructionRow


class _Task(Record, frozen=True, kw_only=True):
    task: str


def summary_of(data: bytes) -> TaskSummary:
    """The content of a summary.json, by its task. RecordError."""
    task = decode(_Task, data).task
    if task == "eth3d":
        return decode(DepthSummary, data)
    if task == "bench":
        return decode(ReconstructionSummary, data)
    return decode(DetectionSummary, data)


def rows_of(data: bytes, summary: TaskSummary) -> Sequence[TaskRow]:
    """The lines of a per_image.jsonl, by the task of its summary. RecordError."""
    if isinstance(summary, DepthSummary):
        return depth_rows(data)
    if isinstance(summary, ReconstructionSummary):
        return decode_lines(ReconstructionRow, data)
    return decode_lines(DetectionRow, data)
