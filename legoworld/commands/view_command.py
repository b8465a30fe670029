"""`legoworld view`."""

from __future__ import annotations

from pathlib import Path

import click

from legoworld.commands import options
from legoworld.commands.options import option
from legoworld.commands.output import Output
from legoworld.commands.param_types import EXISTING_FOLDER


@click.command("view")
@click.argument("folder", type=EXISTING_FOLDER)
@option("--photos", required=False)
@option("--scenes scene_folders", "Where the scene folders lie.", EXISTING_FOLDER, multiple=True)
@option("--port", "Port to listen on; 0: any free one.", click.IntRange(0, 65535), default=0)
@options.printing
def command(
    folder: Path, photos: Path | None, scene_folders: tuple[Path, ...], port: int, out: Output
) -> int:
    """Watch the runs, trials and results below FOLDER in a browser, while they go on.

    It serves 127.0.0.1 alone, at an address with a token of its own, writes nothing below FOLDER,
    and ends with Ctrl-C. What has ended has its page there, as `legoworld report` writes it. Needs
    the extra `serve`.

    \b
    Examples:
      legoworld view runs
      legoworld view . --photos photos --scenes scenes --port 8765
    """
    from legoworld.viewing.view import serving

    with serving(folder, photos, scene_folders, port) as served:
        out.show({"url": served.url}, f"open {served.url} in a browser; Ctrl-C ends it")
        served.run()
    return 0
