"""Running a scene program and exporting its scene. Runs in the worker process only."""

from __future__ import annotations

import io
import os
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import bpy

from legoworld.errors import LegoWorldError, one_line
from legoworld.records.scene_folder import ProgramError, ProgramReport, Stage
from legoworld.scene.folder import BLEND, GLB, PICTURE
from legoworld.scene.programs.report import MOST_WARNINGS

#: Object types that can render as something; a program must add or change one of them.
_SHOWS: Final = ("MESH", "CURVE", "SURFACE", "META", "FONT", "CURVES", "POINTCLOUD", "VOLUME",
                 "EMPTY")  # fmt: skip
_PICTURE_SAMPLES: Final = 16
_PICTURE_MAX_SIDE: Final = 1024


class ProgramBuiltNothingError(LegoWorldError):
    """The program ended and Blender's start-up scene is as it was."""

    code = "built_nothing"


class BlenderQuitError(BaseException):
    """Stands for the program's own call to quit Blender."""


class ReplacedOperator:
    """A group of operators with one of them replaced.

    bpy.ops makes its groups anew at every access, so the replacement has to stand for the group.
    """

    def __init__(self, operators: object, name: str, replacement: Callable[..., set[str]]) -> None:
        self._operators = operators
        setattr(self, name, replacement)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._operators, name)


def execute_program(program: Path, output: Path, begin: Callable[[Stage], None]) -> ProgramReport:
    """Run a program in the current folder and export scene.blend and scene.glb into `output`.

    A program that raises is exported with what it had built, and its error is part of the answer.
    begin: gets "program" and "export". Raises ProgramBuiltNothingError when there is
    nothing to export.
    """
    begin("program")
    before = _fingerprint()
    skipped: list[str] = []
    host = os.getpid()
    error = _run(program, skipped)
    if os.getpid() != host:  # a fork of the program's, which has come to the same end
        os._exit(0)
    if not any(entry[2] in _SHOWS for entry in _fingerprint() - before):
        raise ProgramBuiltNothingError(
            "the program built nothing",
            found=_describe(error) if error else "Blender's start-up scene, unchanged",
            expected="a program that adds objects to the scene",
            next_step="correct the program and execute it again",
        )
    begin("export")
    warnings = [*pack_images(), *export_scene(output)]
    return ProgramReport(
        ok=True,
        error=error,
        skipped=tuple(sorted(set(skipped))),
        warnings=tuple(warnings[:MOST_WARNINGS]),
    )


def render_picture(output: Path) -> dict[str, Any]:
    """Render final.png of the scene that `execute_program` exported, with Cycles on the CPU."""
    # Opened anew: this may be another process than the one that ran the program.
    bpy.ops.wm.open_mainfile(
        filepath=str(output / BLEND), load_ui=False, use_scripts=False, display_file_selector=False
    )
    scene = bpy.context.scene
    render = scene.render
    width = render.resolution_x * render.resolution_percentage / 100
    height = render.resolution_y * render.resolution_percentage / 100
    shrink = min(1.0, _PICTURE_MAX_SIDE / max(width, height))
    # Blender takes no side of less than 4 pixels, and makes it 4.
    render.resolution_x, render.resolution_y = round(width * shrink), round(height * shrink)
    render.resolution_percentage = 100
    render.engine = "CYCLES"
    render.use_border = render.use_sequencer = render.use_compositing = False
    render.image_settings.media_type = "IMAGE"
    render.image_settings.file_format = "PNG"
    scene.cycles.device = "CPU"
    scene.cycles.samples = _PICTURE_SAMPLES
    scene.cycles.seed = 0
    # The denoiser is left off: it is not the same on every machine.
    scene.cycles.use_denoising = False
    render.filepath = str(output / PICTURE)
    bpy.ops.render.render(write_still=True)
    return {}


def _run(program: Path, skipped: list[str]) -> ProgramError | None:
    """Run the program's text; the error that stopped it, None when it came to its end."""

    def no_render(*_args: object, **_kwargs: object) -> set[str]:
        skipped.append("render")
        return {"FINISHED"}

    def no_quit(*_args: object, **_kwargs: object) -> set[str]:
        raise BlenderQuitError

    bpy.ops.render = ReplacedOperator(bpy.ops.render, "render", no_render)
    bpy.ops.wm = ReplacedOperator(bpy.ops.wm, "quit_blender", no_quit)
    # A program's exit() closes standard input, which is where the next request comes from.
    stdin, sys.stdin = sys.stdin, io.StringIO()
    arguments, sys.argv = sys.argv, ["blender", "--background", "--python", str(program)]
    path, sys.path[:] = list(sys.path), [str(program.parent), *sys.path]
    try:
        source = program.read_bytes()
        code = compile(source, str(program), "exec")
        exec(code, {"__name__": "__main__", "__file__": str(program)})
    except (BlenderQuitError, KeyboardInterrupt):
        return None
    except SystemExit as done:
        if done.code in (None, 0):
            return None
        return _error(done, program)
    except BaseException as error:  # noqa: BLE001  any error of an untrusted program is its verdict
        return _error(error, program)
    finally:
        # A program may have taken any of it away.
        for name in ("render", "wm"):
            vars(bpy.ops).pop(name, None)
        sys.argv, sys.stdin = arguments, stdin
        sys.path[:] = path
    return None


def _error(error: BaseException, program: Path) -> ProgramError:
    """What stopped a program, and the line of the program it was at."""
    line = None
    if isinstance(error, SyntaxError) and error.filename == str(program):
        line = error.lineno
    for frame in traceback.extract_tb(error.__traceback__):
        if frame.filename == str(program):
            line = frame.lineno
    kind, message = type(error).__name__, _message(error)
    if isinstance(error, SystemExit):
        kind = one_line(f"{kind} {error.code}", 100)
        message = f"the program ended itself with {_exit_code(error)}"
    message = message.replace(str(program), program.name).removeprefix("Error: ")
    return ProgramError(type=kind, message=one_line(message, 300), line=line or None)


def _message(error: BaseException) -> str:
    """The error's text; a class of the program's own may have none."""
    try:
        return str(error)
    except Exception as worse:  # noqa: BLE001  program code: report its failure instead
        return f"an error whose text cannot be made: {type(worse).__name__}"


def _exit_code(error: SystemExit) -> str:
    return (
        f"exit code {error.code}" if isinstance(error.code, int) else f"exit code 1: {error.code}"
    )


def _describe(error: ProgramError) -> str:
    where = f"line {error.line}: " if error.line else ""
    return f"{where}{error.type}: {error.message}"


def export_scene(output: Path) -> list[str]:
    """Save the scene; what glTF cannot hold is a warning, not a failure."""
    bpy.ops.wm.save_as_mainfile(
        filepath=str(output / BLEND), compress=True, relative_remap=False, check_existing=False
    )
    return export_glb(output / GLB)


def export_glb(path: Path) -> list[str]:
    """Export the open file as scene.glb; a warning where glTF cannot hold it, and no file."""
    try:
        bpy.ops.export_scene.gltf(
            filepath=str(path),
            export_format="GLB",
            export_extras=True,
            export_cameras=True,
            export_apply=True,
            use_renderable=True,
            export_current_frame=True,  # the saved frame, not the first
            export_hierarchy_full_collections=True,  # collections carry labels
        )
    except (RuntimeError, ValueError, TypeError, AttributeError, KeyError) as error:
        path.unlink(missing_ok=True)
        return [f"{GLB} was not exported: {one_line(str(error), 200)}"]
    return []


def pack_images() -> list[str]:
    """Put images the program loaded or painted into the file: its folder does not stay."""
    warnings = []
    for image in bpy.data.images:
        if image.packed_file is None and image.source in ("FILE", "GENERATED") and image.users:
            if image.source == "FILE" and not Path(bpy.path.abspath(image.filepath)).exists():
                warnings.append(f"image {image.name!r} has no file and is not packed")
                continue
            try:
                image.pack()
            except RuntimeError as error:
                warnings.append(f"image {image.name!r} is not packed: {one_line(str(error), 100)}")
    return warnings


def _fingerprint() -> set[tuple[Any, ...]]:
    """What the open file holds, finely enough to tell whether a program changed the scene."""
    return {
        (
            o.session_uid,
            o.name,
            o.type,
            tuple(x for row in o.matrix_basis for x in row),
            len(o.modifiers),
            len(o.data.vertices) if o.type == "MESH" else -1,
        )
        for o in bpy.data.objects
    }
