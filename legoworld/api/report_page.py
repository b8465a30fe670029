"""`write_report`: evaluations and comparisons as one HTML page."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from legoworld.api.arguments import check_arguments, optional_path
from legoworld.api.by_task import task_folders
from legoworld.errors import UsageError
from legoworld.records.folders.read_evaluation import EVIDENCE
from legoworld.report.alone import photo_alone
from legoworld.report.document import page_document
from legoworld.report.page_file import WrittenPage, page_link, write_page
from legoworld.report.sources import read_sources


@check_arguments
def write_report(
    folders: Sequence[str | Path],
    output: str | Path,
    *,
    photos: str | Path | None = None,
    scene_folders: Sequence[str | Path] = (),
    trials: str | Path | None = None,
    photo: str | Path | None = None,
    tags: str | Path | None = None,
) -> WrittenPage:
    """Write one HTML page of evaluations and comparisons: numbers, errors, every photo.

    folders: of evaluations or comparisons, or of those of several tasks. photos: the folder of the
    photos; scene_folders: where the scenes lie, for renders and 3D; trials: the page of
    `trajectory_report` that its photos link to; photo: the file name of one, for a small page of it
    alone that links nowhere and holds no others' numbers; tags: a CSV with the columns `file_name`
    and `tag`, to select photos by. The page shows ground truth. An earlier
    page is replaced; above 500 views or 64 MiB its pictures are in a folder beside it. UsageError
    for `photo` with `trials`, and for tags of no photo of the page.
    """
    tops, places = [Path(folder) for folder in folders], [Path(one) for one in scene_folders]
    sources = [one for folder in tops for one in task_folders(folder, EVIDENCE)]
    document = page_document(
        read_sources(sources), optional_path(photos), places, optional_path(tags)
    )
    if photo is not None:
        if trials is not None:
            raise UsageError(
                "a page of one photo links nowhere",
                found="`trials` and `photo`",
                expected="one of them",
            )
        document = photo_alone(document, str(photo))
    words = ["legoworld", "report", *(folder.resolve().name for folder in tops)]
    words += ["--photos", "PHOTOS"] if photos else []
    words += ["--scenes", "SCENES"] * len(places)
    command = shlex.join([*words, "-o", "report.html"])
    link = page_link(optional_path(trials), Path(output))
    return write_page(document, Path(output), commands=[command], trajectories=link)
