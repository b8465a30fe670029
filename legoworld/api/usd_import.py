"""A USD file as a scene folder, its semantic labels as categories."""

from __future__ import annotations

from pathlib import Path

from legoworld.api.arguments import check_arguments
from legoworld.api.settings import MEMORY_LIMIT_GIB, TIME_LIMIT_S, make_limits
from legoworld.errors import UsageError
from legoworld.records.base import to_record
from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.folder import BLEND
from legoworld.scene.usd_labels import LabelLayer, refuse_missing_usd
from legoworld.workers.scratch import scratch_folder


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
