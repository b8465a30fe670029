"""Which of several independent runs over one photo fits its regions best."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from legoworld.errors import LegoWorldError, UsageError
from legoworld.plugin.evidence import EVIDENCE, read_evidence
from legoworld.plugin.region_fit import region_fit
from legoworld.plugin.state import read_live
from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.folder import BLEND
from legoworld.trajectories.folder import TRIAL, RecordedTrial

#: Of a trial with the plugin: what it measured against.
_OWN_EVIDENCE: Final = f"{TRIAL}/plugin/evidence"
#: By region, its IoU with the object that is matched to it.
Fit = dict[str, float]


def best_run(
    runs: Sequence[RecordedTrial],
    evidence: Path | None,
    blender: BlenderProcess,
    notice: Callable[[str], None],
) -> tuple[RecordedTrial, list[Fit]]:
    """The run whose submission has the largest mean IoU, of equals the first; each run's fit.

    evidence: a folder of evidence.json, None for the runs' own. What shows nothing fits nowhere.
    UsageError without regions.
    """
    known = read_evidence(evidence or runs[0].folder / _OWN_EVIDENCE)
    if not known.file.regions:
        raise UsageError(
            f"there is nothing to choose {runs[0].about.scene} by",
            found=f"no regions in its {EVIDENCE}",
            expected="the photo's regions",
            next_step="make them with `legoworld plugin evidence --regions`",
        )
    fits: list[Fit] = []
    for run in runs:
        try:
            fits.append(region_fit(read_live(run.folder / BLEND, blender), known))
        except LegoWorldError as error:
            notice(f"{run.folder.name} of {run.folder.parent.name}: {error}")
            fits.append({})
    best = max(range(len(runs)), key=lambda k: sum(fits[k].values()))
    return runs[best], fits
