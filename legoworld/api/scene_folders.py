"""`execute`, `freeze` and `import_usd`: what makes scene folders, and the record of their files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from legoworld.api import settings
from legoworld.api.arguments import check_arguments
from legoworld.api.folders import note_folders_without_scene
from legoworld.api.listener import SILENT, Listener
from legoworld.api.settings import MEMORY_LIMIT_GIB, TIME_LIMIT_S, make_limits
from legoworld.errors import UsageError
from legoworld.records.base import to_record
from legoworld.records.run_rows import RunRow
from legoworld.records.scene_folder import ExecutionFile, FrozenRow
from legoworld.running.freeze_run import freeze_scenes
from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.folder import BLEND
from legoworld.scene.programs.execution import execute as execute_program
from legoworld.scene.usd_labels import LabelLayer, refuse_missing_usd
from legoworld.workers.engines import EngineName, engine_cores
from legoworld.workers.protections import Confinement, protections
from legoworld.workers.scratch import scratch_folder


@check_arguments
def execute(
    program: str | Path,
    output: str | Path,
    *,
    picture: bool = True,
    inputs: Sequence[str | Path] = (),
    sandbox: Confinement = "auto",
    time_limit_s: float = settings.TIME_LIMIT_S,
    memory_limit_gib: float = settings.MEMORY_LIMIT_GIB,
    listener: Listener = SILENT,
) -> ExecutionFile:
    """Run a scene program in its own process and export its scene; execution.json of the folder.

    picture: whether final.png is rendered. inputs: files and folders the program may read. sandbox:
    "auto" uses bubblewrap where it works, "bubblewrap" fails without it, "limits" never uses it. A
    program that stops leaves its partial scene and an `error`; `check` says whether the scene can
    be read. Raises a LegoWorldError where there is no scene: the folder is then as it was.
    """
    held = protections(sandbox)
    if held.bubblewrap is None:
        listener.warn(
            f"without bubblewrap ({held.why_not}) the program runs with your permissions; "
            f"limited: {', '.join(held.holds)}; not limited: {', '.join(held.does_not_hold)}"
        )
    return execute_program(
        Path(program),
        Path(output),
        limits=settings.make_limits(time_limit_s, memory_limit_gib),
        picture=picture,
        sandbox=sandbox,
        inputs=[Path(path) for path in inputs],
        notice=listener.notice,
    )


@check_arguments
def freeze(
    scenes: str | Path,
    *,
    workers: int | None = None,
    engine: EngineName = "local",
    cache: settings.Cache = True,
    time_limit_s: float = settings.TIME_LIMIT_S,
    memory_limit_gib: float = settings.MEMORY_LIMIT_GIB,
    listener: Listener = SILENT,
) -> list[FrozenRow]:
    """Check every scene below a folder and write its frozen.json; a row for each, by name.

    A scene that fails a check is a row whose status is not "ok". Arguments: as in `readout`.
    """
    note_folders_without_scene(Path(scenes), listener)
    return freeze_scenes(
        Path(scenes),
        engine=engine,
        workers=workers or engine_cores(engine),
        cache=settings.snapshot_cache(cache),
        limits=settings.make_limits(time_limit_s, memory_limit_gib),
        total=listener.total,
        row=lambda row: listener.row(RunRow(image_id=0, file_name=row.scene, status=row.status)),
    )


@check_arguments
def import_usd(
    usd: str | Path,
    output: str | Path,
    *,
    overwrite: bool = False,
    time_limit_s: float = TIME_LIMIT_S,
    memory_limit_gib: float = MEMORY_LIMIT_GIB,
) -> LabelLayer:
    """Have Blender import a USD file and save it as output/scene.blend.

    Labels of UsdSemantics and of the older SemanticsAPI become the property `category`. Raises
    UsageError without usd-core and for an existing scene, SceneInvalidError for an unreadable file,
    and what a Blender process does.
    """
    refuse_missing_usd()
    file, output = Path(usd), Path(output)
    blend = output / BLEND
    if blend.exists() and not overwrite:
        raise UsageError(f"{blend} already exists", next_step="pass --overwrite, or another -o")
    output.parent.mkdir(parents=True, exist_ok=True)
    with (
        BlenderProcess(make_limits(time_limit_s, memory_limit_gib)) as blender,
        scratch_folder(".importing-", output.parent) as scratch,
    ):
        made = scratch / BLEND
        answer = blender.request(
            {
                "kind": "import",
                "usd": str(file.resolve()),
                "layer": str((scratch / "labels.usda").resolve()),
                "output": str(made.resolve()),
            }
        )
        output.mkdir(exist_ok=True)
        made.replace(blend)
    return to_record(LabelLayer, answer)
