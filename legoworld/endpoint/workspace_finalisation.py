"""`legoworld blender finalise`: a workspace's submission, as a trial's is made."""

from __future__ import annotations

from pathlib import Path

from legoworld.endpoint.finalisation import finalise
from legoworld.endpoint.serve import record_path
from legoworld.endpoint.trial_record import TrialRecord
from legoworld.errors import UsageError
from legoworld.records.agents import Finalisation
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.workers.protections import Confinement, protections
from legoworld.workers.sandbox import SandboxLimits


def blender_finalise(
    workspace: str | Path,
    output: str | Path,
    *,
    sandbox: Confinement = "auto",
    memory_limit_gib: float = 8.0,
) -> Finalisation:
    """Export what a workspace and its record hold into a new folder; which scene was taken.

    The scene.blend of the workspace is the one that was saved last. UsageError for an output that
    is not empty.
    """
    workspace, output = Path(workspace), Path(output)
    limits = SandboxLimits(time_s=600.0, memory_bytes=int(memory_limit_gib * 2**30))
    held = protections(sandbox)
    if output.is_dir() and any(output.iterdir()):
        raise UsageError(
            "the output folder is not empty", found=str(output), expected="a new folder"
        )
    output.mkdir(parents=True, exist_ok=True)
    record = TrialRecord(record_path(workspace))
    calls = record.calls
    at_s = calls[-1].at_s + calls[-1].seconds if calls else 0.0
    record.keep_saved(workspace, call=len(calls), at_s=at_s)
    with BlenderProcess(Limits(memory_bytes=limits.memory_bytes)) as blender:
        return finalise(
            record, output, workspace=workspace, limits=limits, protections=held, blender=blender
        )
