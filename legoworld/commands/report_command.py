"""`legoworld report`."""

from __future__ import annotations

import shlex
from pathlib import Path

import click

from legoworld.commands import options
from legoworld.commands.options import option
from legoworld.commands.output import Output
from legoworld.commands.param_types import EXISTING_FOLDER, FILE
from legoworld.pluralize import plural, share, word_for


@click.command("report")
@click.argument("folders", nargs=-1, required=True, type=EXISTING_FOLDER)
@option(
    "--photos",
    "Folder of the photos, or of their train2017/ and val2017/ [default: a page without photos].",
    required=False,
)
@option(
    "--scenes",
    "Where the scene folders lie, for renders and 3D; may be given again [default: without].",
    EXISTING_FOLDER,
    multiple=True,
)
@option("--output", "HTML file to write.", FILE)
@options.printing
def command(
    folders: tuple[Path, ...],
    photos: Path | None,
    scenes: tuple[Path, ...],
    output: Path,
    out: Output,
) -> int:
    """Write one HTML page of evaluations and comparisons (FOLDERS): numbers, errors, every photo.

    A folder of the evaluations or comparisons of several tasks stands for all of them.

    The page opens from disk and needs no network. It shows ground truth: keep it private. Above 500
    views or 64 MiB its pictures are in a folder beside it. An existing page is overwritten.
    Pictures of LEGO-Bench are found through its evaluations.

    \b
    Examples:
      legoworld report evals/coco --photos photos -o report.html
      legoworld report evals --photos photos -o report.html
      legoworld report comparisons/coco --photos photos --scenes scenes -o report.html
      legoworld report evals/agent-1 evals/agent-2 -o bench.html
    """
    from legoworld.api.by_task import folders_of_tasks
    from legoworld.records.folders.read_evaluation import EVIDENCE
    from legoworld.report.document import page_document
    from legoworld.report.page_file import write_page
    from legoworld.report.sources import read_sources

    sources = [one for folder in folders for one in folders_of_tasks(folder, EVIDENCE)]
    document = page_document(read_sources(sources), photos, scenes)
    words = ["legoworld", "report", *(f.resolve().name for f in folders)]
    words += ["--photos", "PHOTOS"] if photos else []
    words += ["--scenes", "SCENES"] * len(scenes)
    written = write_page(document, output, commands=[shlex.join([*words, "-o", "report.html"])])
    missing = sum(view.photo is None for view in document.views)
    if missing:
        views = share(missing, len(document.views), "view", "views")
        out.notice(f"{views} {word_for(missing, 'has', 'have')} no photo; the page says why")
    more = f" and {written.beside}" if written.beside else ""
    views = plural(len(document.views), "view", "views")
    out.show(
        {
            "report": str(output),
            "beside": str(written.beside) if written.beside else None,
            "bytes": written.n_bytes,
            "views": len(document.views),
            "views_without_photo": missing,
        },
        f"{views}, {written.n_bytes / 1e6:.1f} MB -> {output}{more}",
    )
    return 0
