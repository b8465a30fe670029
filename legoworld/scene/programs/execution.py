"""`legoworld execute`: a scene program to a scene folder."""

from __future__ import annotations

import hashlib
import json
import os
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from msgspec.structs import replace

from legoworld.beneath import Beneath, RefusedFileError
from legoworld.conventions import SCHEMA_VERSION
from legoworld.errors import (
    LegoWorldError,
    SceneInvalidError,
    UnreadableBlendError,
    WorkerMemoryError,
    cause,
    from_reason,
)
from legoworld.files import atomic_path, sha256_of_file, write_text
from legoworld.records.base import as_json, readable
from legoworld.records.scene_folder import OK, ExecutionFile, ProgramReport, Verdict
from legoworld.scene.artefacts import check_glb, check_picture, without_metadata
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.cache import bpy_version
from legoworld.scene.folder import BLEND, EXECUTION, FROZEN, GLB, PICTURE, PROGRAM
from legoworld.scene.programs.report import REPORT, read_report
from legoworld.scene.programs.verdicts import (
    ProgramLimitError,
    ProgramOutputError,
    ended_early,
    over_limit,
)
from legoworld.version import __version__
from legoworld.workers.protections import Confinement, Protections, protections
from legoworld.workers.sandbox import Sandbox, SandboxLimits
from legoworld.workers.scratch import scratch_folder

#: A file or a module that an error names.
_QUOTED: Final = re.compile(r"""(['"])(.+?)\1""")


def execute(
    program: Path,
    output: Path,
    *,
    limits: Limits,
    picture: bool,
    sandbox: Confinement = "auto",
    inputs: Sequence[Path] = (),
    notice: Callable[[str], None] = lambda _: None,
) -> ExecutionFile:
    """Run a program in a sandbox and an empty folder, and export into `output`; its execution.json.

    inputs: files and folders that the program may read. notice: called with each step. The
    program's process exports the scene; another one, which it never touched, opens the scene and
    renders the picture. Raises the program's verdict (`execution_verdicts`, built nothing); what
    the output folder held is then as it was.

    output: a folder; or a .blend or .glb to be written alone, without picture or record.
    """
    if output.suffix.lower() in (".blend", ".glb") and not output.is_dir():
        return _execute_to_file(program, output, limits, sandbox, inputs, notice)
    held = protections(sandbox)
    source = program.read_bytes()
    output.mkdir(parents=True, exist_ok=True)
    with scratch_folder(".executing-", output) as scratch, BlenderProcess(limits) as reader:
        made = scratch / "made"
        made.mkdir()
        notice(f"running {program.name}")
        report, hints = _run(program, inputs, scratch, made, limits, held)
        warnings = list(report.warnings)
        if "render" in report.skipped:
            warnings.append(f"the program's own render calls were skipped; see {PICTURE}")
        warnings += hints
        check = _check(reader, made, warnings)
        if picture and check.code != "no_camera":
            notice(f"rendering {PICTURE}")
            warnings += final_picture(reader, made)
        return _deliver(source, made, output, report, warnings, check, held)


def _execute_to_file(
    program: Path,
    output: Path,
    limits: Limits,
    sandbox: Confinement,
    inputs: Sequence[Path],
    notice: Callable[[str], None],
) -> ExecutionFile:
    output.parent.mkdir(parents=True, exist_ok=True)
    with scratch_folder(".executing-", output.parent) as scratch:
        folder = scratch / "scene"
        result = execute(
            program, folder, limits=limits, picture=False, sandbox=sandbox, inputs=inputs,
            notice=notice,
        )  # fmt: skip
        made = folder / (GLB if output.suffix.lower() == ".glb" else BLEND)
        if not made.is_file():
            raise ProgramOutputError(
                f"the program left no {output.suffix}",
                found="; ".join(result.warnings),
                expected=f"a scene that Blender exports as {output.suffix}",
                next_step="mend what it warns about, and run it again",
            )
        made.replace(output)
    return replace(result, files=(output.name,))


def _run(
    program: Path,
    inputs: Sequence[Path],
    scratch: Path,
    made: Path,
    limits: Limits,
    protections: Protections,
) -> tuple[ProgramReport, list[str]]:
    """Run the program and move what it left into `made`; raises its verdict.

    With its report: what helps a program that failed at a file or a module.
    """
    workspace = scratch / "sandbox"
    workspace.mkdir()
    allowed = SandboxLimits(time_s=limits.time_s, memory_bytes=limits.memory_bytes)
    program = program.resolve()
    with Sandbox(workspace, allowed, protections, owner=scratch) as sandbox:
        request = {
            "program": str(program),
            "output": str(sandbox.path_inside("output")),
            "report": str(sandbox.path_inside("output") / REPORT),
            "deadline": sandbox.deadline,
        }
        sandbox.start(
            # Unbuffered: what a program printed before it crashed is its last word.
            [
                *(sys.executable, "-u", "-m", "legoworld.scene.blender.program_host"),
                json.dumps(request),
            ],
            [program, *(path.resolve() for path in inputs)],
        )
        ending = sandbox.wait()
        try:
            report = read_report(_take_file(workspace, REPORT, made))
        except ProgramOutputError:  # with its folder, or another thing in its place
            report = read_report(None)
        if ending.over is not None:
            raise over_limit(ending, ending.over, report.at, allowed, program)
        if report.ok is None:
            raise ended_early(ending, report.at, program)
        hints = []
        if (
            failed := report.reason.found
            if report.reason
            else report.error and report.error.message
        ):
            alone = protections.bubblewrap is not None
            hints = _hints(failed, ending.last_output, program, inputs, shown_alone=alone)
        _refuse_failure(report, allowed, hints)
        if _take_file(workspace, BLEND, made) is None:
            raise _no_scene("no such file")
        _take_file(workspace, GLB, made)
    return report, hints


def _take_file(workspace: Path, name: str, made: Path) -> Path | None:
    """A file of the program's output, moved into `made`; None where it left none."""
    try:
        with Beneath(workspace) as inside:
            return made / name if inside.move_out(f"output/{name}", made / name) else None
    except RefusedFileError as error:
        raise _no_scene(f"{name}: {error.found}") from error


def _no_scene(found: str) -> ProgramOutputError:
    return ProgramOutputError(
        f"the program replaced its own {BLEND}",
        found=found,
        expected=f"{BLEND} and {GLB} as they were exported",
        next_step="let the program leave its output folder alone: the scene is exported for it",
    )


def _refuse_failure(report: ProgramReport, allowed: SandboxLimits, hints: Sequence[str]) -> None:
    """Raise why there is no scene, where the report says so. hints: of what was not shown."""
    reason = report.reason
    if reason is None:
        return
    if reason.code == WorkerMemoryError.code:
        raise ProgramLimitError(
            "the program's scene did not fit into memory while it was exported",
            found="MemoryError",
            expected="a scene that Blender can export",
            next_step="build less geometry (subdivision, arrays, particles)",
        )
    if reason.code == "full":
        raise ProgramLimitError(
            "the program's scene could not be written",
            found=reason.found,
            expected=f"files of at most {allowed.disk_bytes / 2**30:g} GiB and room on the disk",
            next_step="build less geometry, or make room on the disk",
        )
    if reason.code == "export":
        raise ProgramOutputError(
            "the program's scene could not be exported",
            found=reason.found,
            expected="a scene that Blender can save",
            next_step="the program may have replaced what Blender needs: run it in Blender",
        )
    if reason.code == "built_nothing" and hints:
        reason = replace(reason, next=hints[0])
    raise from_reason(as_json(reason))


def _hints(
    error: str, printed: str, program: Path, inputs: Sequence[Path], *, shown_alone: bool
) -> list[str]:
    """A hint for each file that the caller has and the program has not, and for each such module.

    error: the program's; printed: its last output, where some libraries name a file that they
    cannot read. shown_alone: whether the program sees only itself and `inputs`. A module is looked
    for beside the program.
    """
    shown = [program.resolve(), *(path.resolve() for path in inputs)]
    hints = []
    for named in dict.fromkeys(name for _, name in _QUOTED.findall(f"{error}\n{printed}")):
        module = f"No module named '{named}'" in error
        beside = program.parent / (f"{named}.py" if module else named)
        here = os.path.exists if named.startswith("/") else os.path.isfile  # False for no path
        place = next((p.resolve() for p in (beside, Path(named)) if here(p)), None)
        hidden = shown_alone and not any(place and place.is_relative_to(path) for path in shown)
        if module and place is None:
            hints.append(f"{named} is not in Blender's Python, which runs the program")
        elif place and hidden and (module or named.startswith("/")):
            hints.append(f"bubblewrap does not show {place} to the program: --input {place}")
        elif place and not module and not named.startswith("/"):
            given = f"pass --input {place} and " if hidden else ""
            hints.append(f"the program runs in an empty folder: {given}read {named} as {place}")
    return hints


def _check(reader: BlenderProcess, made: Path, warnings: list[str]) -> Verdict:
    """Open what the program left, in a process it never touched; the verdict on scene.blend.

    Raises ProgramOutputError if it is not a .blend. An invalid scene.glb is not delivered.
    """
    glb = made / GLB
    if glb.is_file():
        try:
            check_glb(glb)
        except SceneInvalidError as error:
            glb.unlink()
            warnings.append(f"{GLB} is not delivered: {error}")
    try:
        reader.request({"kind": "check", "blend": str(made.resolve() / BLEND)})
    except UnreadableBlendError as error:
        raise _no_scene(f"{error.what}: {error.found}") from error
    except LegoWorldError as error:
        warnings.append(f"{BLEND} cannot be read as it is: {error}")
        return Verdict(status=error.status, code=error.code, reason=str(error))
    return OK


def final_picture(blender: BlenderProcess, made: Path) -> list[str]:
    """Render final.png of a folder's scene.blend; why there is none, which is still a scene."""
    try:
        blender.request({"kind": "picture", "output": str(made.resolve())})
        picture = made / PICTURE
        picture.write_bytes(without_metadata(picture.read_bytes()))
        check_picture(picture)
    except SceneInvalidError as error:
        return [str(error)]
    except (LegoWorldError, OSError) as error:
        (made / PICTURE).unlink(missing_ok=True)
        return [f"no {PICTURE}: {cause(error)}"]
    return []


def _deliver(
    source: bytes,
    made: Path,
    output: Path,
    report: ProgramReport,
    warnings: list[str],
    check: Verdict,
    protections: Protections,
) -> ExecutionFile:
    files = tuple(name for name in (BLEND, GLB, PICTURE) if (made / name).is_file())
    for name in (BLEND, GLB, PICTURE):
        if name in files:
            (made / name).replace(output / name)
        else:
            (output / name).unlink(missing_ok=True)  # of an earlier program
    _write_program(source, output / PROGRAM)
    if (output / FROZEN).is_file():
        warnings.append(f"{FROZEN} is of the earlier scene: freeze again")
    execution = ExecutionFile(
        schema_version=SCHEMA_VERSION,
        legoworld=__version__,
        bpy=bpy_version(),
        program_sha256=hashlib.sha256(source).hexdigest(),
        status="stopped" if report.error else "complete",
        error=report.error,
        files={name: sha256_of_file(output / name) for name in files},
        warnings=tuple(warnings),
        check=check,
        sandbox=protections.record(),
    )
    write_text(output / EXECUTION, readable(execution))
    return execution


def _write_program(source: bytes, path: Path) -> None:
    """The program as it was before it ran: it may have written to its own file since."""
    if not path.is_file() or path.read_bytes() != source:
        with atomic_path(path) as temporary:
            temporary.write_bytes(source)
