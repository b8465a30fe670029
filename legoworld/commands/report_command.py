"""`legoworld report`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from legoworld.commands import options
from legoworld.commands.options import option
from legoworld.commands.output import Output
from legoworld.commands.param_types import EXISTING_FILE, EXISTING_FOLDER, FILE
from legoworld.pluralize import plural


@click.command("report")
@click.argument("folders", nargs=-1, required=True, type=EXISTING_FOLDER)
@option(
    "--photos",
    "Folder of the photos, or of their train2017/ and val2017/ [default: a page without photos].",
    required=False,
)
@option(
    "--scenes scene_folders",
    "Where the scene folders lie, for renders and 3D; may be given again [default: without].",
    EXISTING_FOLDER,
    multiple=True,
)
@option(
    "--photo",
    "Only this photo: one small file that links nowhere, with no other photo's numbers.",
    click.STRING,
    metavar="NAME",
    required=False,
)
@option(
    "--tags",
    "CSV with the columns file_name and tag, a line for each tag of a photo: a filter of the page.",
    EXISTING_FILE,
    required=False,
)
@option("--trials", "Page of `trajectory report` to link to.", FILE, required=False)
@option("--output", "HTML file to write.", FILE)
@options.printing
def command(folders: tuple[Path, ...], output: Path, out: Output, **given: Any) -> int:
    """Write one HTML page of evaluations and comparisons (FOLDERS): numbers, errors, every photo.

    A folder of the evaluations or comparisons of several tasks stands for all of them.

    The page opens from disk and needs no network. It shows ground truth: keep it private. Above 500
    views or 64 MiB its pictures are in a folder beside it. An existing page is overwritten.
    Pictures of LEGO-Bench are found through its evaluations.

    \b
    Examples:
      legoworld report evals/coco --photos photos -o report.html
      legoworld report comparisons/coco --photos photos --scenes scenes -o report.html
      legoworld report evals/coco --photos photos --photo a.jpg -o a.html
      legoworld report evals/agent-1 evals/agent-2 -o bench.html
    """
    from legoworld.api.report_page import write_report

    page = write_report(folders, output, **given)
    if page.left_out:
        out.notice(f"{page.left_out}; the page says why")
    more = f" and {page.assets_folder}" if page.assets_folder else ""
    out.show(
        {
            "report": str(output),
            "beside": str(page.assets_folder) if page.assets_folder else None,
            "bytes": page.n_bytes,
            "views": page.views,
            "views_without_photo": page.views_without_photo,
        },
        f"{plural(page.views, 'view', 'views')}, {page.n_bytes / 1e6:.1f} MB -> {output}{more}",
    )
    return 0
