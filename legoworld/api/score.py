"""`score_photo`: one program or scene against one photo's ground truth."""

from __future__ import annotations

from pathlib import Path

from legoworld.api import one_photo, settings
from legoworld.api.arguments import check_arguments
from legoworld.api.listener import SILENT, Listener
from legoworld.api.one_photo import PhotoRequest, PhotoScore
from legoworld.errors import UsageError
from legoworld.scene.folder import Source
from legoworld.tasks.shipped import DEFAULT
from legoworld.workers.scratch import scratch_folder


@check_arguments
def score_photo(
    program_or_scene: str | Path,
    output: str | Path,
    *,
    photo: str | Path,
    truth: str | Path,
    task: str = DEFAULT,
    image: str | None = None,
    source: Source = "blend",
    cache: settings.Cache = True,
    time_limit_s: float = settings.TIME_LIMIT_S,
    memory_limit_gib: float = settings.MEMORY_LIMIT_GIB,
    listener: Listener = SILENT,
) -> PhotoScore:
    """Execute, read out and evaluate one scene; what is wrong with it, and what to do.

    program_or_scene: a .py, any .blend or .glb, or a scene folder, which are only read; UsageError
    for anything else. image: the photo's id or file name in the ground truth, None for its own
    name. Below output: the scene of a program, run, evaluation, overlay and report. It reads ground
    truth: no agent that builds scenes may see it.
    """
    what = Path(program_or_scene)
    if not what.is_dir() and what.suffix not in (".py", ".blend", ".glb"):
        raise UsageError(f"{what} is not a .py, .blend, .glb or scene folder")
    with scratch_folder("legoworld-score-") as scratch:
        request = PhotoRequest(
            program_or_scene=what,
            photo=Path(photo),
            truth=Path(truth),
            task=task,
            image=image,
            source=source,
            cache=settings.snapshot_cache(cache or scratch / "snapshots"),
            limits=settings.make_limits(time_limit_s, memory_limit_gib),
        )
        return one_photo.score_photo(request, Path(output), listener.notice, listener.trace)
