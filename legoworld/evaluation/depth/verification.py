"""Re-checking a depth evaluation: its summary from its rows, and rows from the arrays again."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

from legoworld.errors import LegoWorldError
from legoworld.evaluation.depth.predictions import read_depth_run
from legoworld.evaluation.depth.protocol import depth_protocol
from legoworld.evaluation.depth.rows import score_row
from legoworld.evaluation.depth.summary import Settings, summarise
from legoworld.evaluation.depth.truth import TruthFile, find_truth
from legoworld.evaluation.evidence import Check, located
from legoworld.evaluation.run import RunImage
from legoworld.records.base import as_json
from legoworld.records.evaluation_rows import DepthRow
from legoworld.records.evaluation_summary import DepthSummary
from legoworld.records.evidence import DepthEvidence
from legoworld.records.folders.evaluation_reading import SUMMARY

#: Images scored again, spread evenly over the track: a full-size one takes seconds.
_SCORED_AGAIN: Final = 10
#: Logarithms differ in the last bits between machines.
_RELATIVE: Final = 1e-9
_LISTS: Final = (tuple, list)


def depth_checks(
    folder: Path, evidence: DepthEvidence, summary: DepthSummary, rows: Sequence[DepthRow]
) -> Iterator[Check]:
    """Means, intervals and counts of the summary against those that follow from the rows."""
    again = summarise(
        rows,
        kind=str(summary.kind),
        partial=summary.partial,
        protocol=depth_protocol(),
        settings=_settings(summary),
    )
    # All that the file says: a key that no reader knows follows from no row.
    found, recorded = as_json(again), json.loads((folder / SUMMARY).read_bytes())
    for key in sorted({*found, *recorded}):
        yield _agreement(f"{key} from the rows", found.get(key), recorded.get(key))
    yield _agreement("metrics in the evidence", evidence.metrics, summary.metrics)


def depth_rows(
    folder: Path,
    evidence: DepthEvidence,
    summary: DepthSummary,
    rows: Sequence[DepthRow],
    root: Path | None,
) -> Iterator[Check]:
    """Rows of up to ten images, scored again from the run and the truth, which are all there."""
    paths = {
        role: [located(folder, i.path, root) for i in evidence.inputs if i.role == role]
        for role in ("run", "truth")
    }
    protocol, warped = depth_protocol(), summary.protocol.camera_model == "dataset"
    run = read_depth_run(_known(paths["run"][0]).parent)
    files = _truth_files(_known(paths["truth"][0]), [image.image for image in run.images])
    recorded = {row.image_id: as_json(row) for row in rows}
    step = max(1, math.ceil(len(run.images) / _SCORED_AGAIN))
    for image, file in list(zip(run.images, files, strict=True))[::step]:
        row = score_row(image, file, file.camera if warped else None, protocol).row
        again = as_json(row)
        yield _agreement(f"row of image {image.image.id}", again, recorded.get(image.image.id))


def _settings(summary: DepthSummary) -> Settings:
    return Settings(
        camera_model=summary.protocol.camera_model,
        draws=summary.bootstrap.draws,
        seed=summary.bootstrap.seed,
    )


def _truth_files(first: Path, images: Sequence[RunImage]) -> tuple[TruthFile, ...]:
    """The truth of every image, from the folder above the first one's that holds them all."""
    refusal: LegoWorldError | None = None
    for folder in first.parents:
        try:
            files = find_truth(folder, images)
        except LegoWorldError as error:
            refusal = refusal or error
            continue
        if files[0].path == first:
            return files
    assert refusal is not None
    raise refusal


def _known(path: Path | None) -> Path:
    assert path is not None
    return path


def _agreement(what: str, found: object, recorded: object) -> Check:
    place = _first_difference(found, recorded, "")
    if place is None:
        return Check("ok", what, "the same")
    return Check("DIFFERS", what, place[:100])


def _first_difference(found: object, recorded: object, place: str) -> str | None:
    """Where two JSON values differ by more than rounding, with both; None where they do not."""
    if isinstance(found, Mapping) and isinstance(recorded, Mapping):
        if found.keys() != recorded.keys():
            return f"{place} keys {sorted(found.keys() ^ recorded.keys())}"
        pairs = [(found[k], recorded[k], f"{place} {k}") for k in sorted(found)]
    elif isinstance(found, _LISTS) and isinstance(recorded, _LISTS) and len(found) == len(recorded):
        pairs = [
            (a, b, f"{place} {i}") for i, (a, b) in enumerate(zip(found, recorded, strict=True))
        ]
    elif isinstance(found, float) and isinstance(recorded, float | int):
        same = math.isclose(found, recorded, rel_tol=_RELATIVE, abs_tol=1e-12)
        return None if same else f"{place} {found!r}, on record {recorded!r}".strip()
    else:
        return None if found == recorded else f"{place} {found!r}, on record {recorded!r}".strip()
    return next((d for d in (_first_difference(*pair) for pair in pairs) if d is not None), None)
