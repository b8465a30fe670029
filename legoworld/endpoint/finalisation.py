"""The end of a trial: the runtime exports one scene, the same way for every agent."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path, PurePath
from typing import Any, Final

from legoworld.beneath import Beneath, RefusedFileError
from legoworld.endpoint.blender import BlenderEndedError, LiveBlender, again_if_killed
from legoworld.endpoint.session import copy_into_workspace
from legoworld.endpoint.trial_record import LARGEST_FILE, TrialRecord
from legoworld.errors import LegoWorldError, SceneInvalidError, one_line
from legoworld.records.agents import Finalisation
from legoworld.records.endpoint import Checkpoint
from legoworld.scene.artefacts import check_glb
from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.folder import BLEND, GLB
from legoworld.scene.programs.execution import final_picture
from legoworld.workers.protections import Protections
from legoworld.workers.sandbox import SandboxLimits, workspace_bytes
from legoworld.workers.scratch import scratch_folder

_WITHIN_S: Final = 300.0
_TRIED: Final = 3


def finalise(
    record: TrialRecord,
    made: Path,
    *,
    workspace: Path,
    limits: SandboxLimits,
    protections: Protections,
    blender: BlenderProcess,
) -> Finalisation:
    """Export scene.blend, scene.glb and final.png into `made`, from the last saved scene.

    That is the scene.blend that the agent saved last and that opens, and where it saved none, the
    open scene as the last call left it. Images that the scene shows are packed, as `execute`
    does: the workspace does not stay. A new Blender does it, in the sandbox.
    """
    refused = [record.spoilt] if record.spoilt else []
    export = partial(
        export_submission,
        made=made,
        workspace=workspace,
        limits=limits,
        protections=protections,
        blender=blender,
    )
    for checkpoint in _candidates(record):
        try:
            warnings = again_if_killed(partial(export, record.blend(checkpoint)))
        except (BlenderEndedError, SceneInvalidError) as error:
            refused.append(f"{checkpoint.kind} {checkpoint.ordinal}: {one_line(str(error), 200)}")
            continue
        return Finalisation(
            source="saved" if checkpoint.kind == "saved" else "checkpoint",
            checkpoint=checkpoint.ordinal,
            sha256=checkpoint.sha256,
            refused=tuple(refused),
            warnings=tuple(warnings),
        )
    return Finalisation(source="none", checkpoint=None, sha256=None, refused=tuple(refused))


def export_submission(
    blend: Path,
    made: Path,
    *,
    workspace: Path,
    limits: SandboxLimits,
    protections: Protections,
    blender: BlenderProcess,
    place: str = ".",
) -> list[str]:
    """Export one .blend as a submission into `made`; what could not be delivered, in words.

    workspace: a folder that the .blend is opened in, so that its relative paths lead there; place:
    the name of a folder below it to open it in instead. Raises
    BlenderEndedError or SceneInvalidError where it cannot be opened or saved.
    """
    warnings = _export(blend, made, workspace, place, limits, protections)
    return [*warnings, *_check_files(made), *final_picture(blender, made)]


def _candidates(record: TrialRecord) -> Sequence[Checkpoint]:
    """The last few of each kind, each content once: one that does not open is passed over."""
    return [*record.newest("saved")[:_TRIED], *record.newest("live")[:_TRIED]]


def _export(
    blend: Path,
    made: Path,
    workspace: Path,
    place: str,
    limits: SandboxLimits,
    protections: Protections,
) -> list[str]:
    """Open, pack and export in the sandbox; what glTF cannot hold is a warning."""
    # An agent that has filled its workspace has used up its own room, not the runtime's.
    room = workspace_bytes(workspace) + limits.disk_bytes
    allowed = SandboxLimits(time_s=_WITHIN_S, memory_bytes=limits.memory_bytes, disk_bytes=room)
    with scratch_folder(".finalising-", made) as scratch:
        # Relative paths of the scene are the workspace's: it is opened from there.
        opened = copy_into_workspace(blend, workspace, PurePath(place, ".finalised.blend"))
        try:
            with LiveBlender(workspace, allowed, protections, blend=opened) as live:
                reply = live.ask("finalise", {"output": live.path_inside("")}, _WITHIN_S / 2)
                if reply.error is not None:
                    raise _not_exported(reply.error)
                with Beneath(live.files) as inside:
                    for name in (BLEND, GLB):
                        inside.copy_out(
                            live.output_name(name), scratch / name, most_bytes=LARGEST_FILE
                        )
        except RefusedFileError as error:
            raise _not_exported(str(error)) from error
        finally:
            with Beneath(workspace.resolve()) as inside:
                inside.unlink(PurePath(place, opened.name))
        if not (scratch / BLEND).is_file():
            raise _not_exported("Blender left no scene.blend")
        for name in (BLEND, GLB):
            if (scratch / name).is_file():
                (scratch / name).replace(made / name)
    said: Any = reply.result
    return [one_line(str(word), 200) for word in said["warnings"]] if said else []


def _check_files(made: Path) -> list[str]:
    glb = made / GLB
    if not glb.is_file():
        return []
    try:
        check_glb(glb)
    except LegoWorldError as error:
        glb.unlink()
        return [f"{GLB} is not delivered: {error}"]
    return []


def _not_exported(found: str) -> SceneInvalidError:
    return SceneInvalidError(
        "the scene could not be exported", found=found, expected="a scene that Blender can save"
    )
