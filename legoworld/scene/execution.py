"""`legoworld execute`: a scene program to a scene folder."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from legoworld import __version__
from legoworld.conventions import SCHEMA_VERSION
from legoworld.errors import LegoWorldError, SceneInvalidError
from legoworld.files import readable_json, sha256_of_file, write_text
from legoworld.scene.artefacts import check_picture, without_metadata
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.cache import bpy_version
from legoworld.scene.folder import BLEND, FROZEN, GLB, PICTURE, PROGRAM
from legoworld.scene.scratch import scratch_folder

EXECUTION: Final = "execution.json"


@dataclass(frozen=True, kw_only=True)
class Execution:
    """How a program ended and what it left. error: {"type", "message", "line"} or None."""

    status: str  # complete | stopped
    error: dict[str, Any] | None
    files: tuple[str, ...]
    warnings: tuple[str, ...]


def execute(program: Path, output: Path, *, limits: Limits, picture: bool) -> Execution:
    """Run a program in its own process and an empty folder, and export into `output`.

    Raises the worker's errors (crash, time, memory) and ProgramBuiltNothing; what the output folder
    held is then as it was.
    """
    output.mkdir(parents=True, exist_ok=True)
    with (
        scratch_folder(".executing-", output) as made,
        BlenderProcess(limits) as blender,
    ):
        answer = blender.request(
            {
                "kind": "execute",
                "program": str(program.resolve()),
                "output": str(made.resolve()),
            }
        )
        warnings = list(answer["warnings"])
        if "render" in answer["skipped"]:
            warnings.append(f"the program's own render calls were skipped; see {PICTURE}")
        if picture:
            warnings += _picture(blender, made)
        return _deliver(program, made, output, answer["error"], warnings)


def _picture(blender: BlenderProcess, made: Path) -> list[str]:
    """Render final.png; a scene without one is still a scene."""
    try:
        blender.request({"kind": "picture", "output": str(made.resolve())})
        picture = made / PICTURE
        picture.write_bytes(without_metadata(picture.read_bytes()))
        check_picture(picture)
    except SceneInvalidError as error:
        return [str(error)]
    except (LegoWorldError, OSError) as error:
        (made / PICTURE).unlink(missing_ok=True)
        return [f"no {PICTURE}: {error}"]
    return []


def _deliver(
    program: Path,
    made: Path,
    output: Path,
    error: dict[str, Any] | None,
    warnings: list[str],
) -> Execution:
    files = tuple(name for name in (BLEND, GLB, PICTURE) if (made / name).is_file())
    for name in (BLEND, GLB, PICTURE):
        if name in files:
            (made / name).replace(output / name)
        else:
            (output / name).unlink(missing_ok=True)  # of an earlier program
    if program.resolve() != (output / PROGRAM).resolve():
        shutil.copyfile(program, output / PROGRAM)
    if (output / FROZEN).is_file():
        warnings.append(f"{FROZEN} is of the earlier scene: freeze again")
    execution = Execution(
        status="stopped" if error else "complete",
        error=error,
        files=files,
        warnings=tuple(warnings),
    )
    document = {
        "schema_version": SCHEMA_VERSION,
        "legoworld": __version__,
        "bpy": bpy_version(),
        "program_sha256": sha256_of_file(output / PROGRAM),
        "status": execution.status,
        "error": error,
        "files": {name: sha256_of_file(output / name) for name in files},
        "warnings": warnings,
    }
    write_text(output / EXECUTION, readable_json(document))
    return execution
