"""Reading a finished run folder: its images are the denominator of every number."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from legoworld.errors import LegoWorldError
from legoworld.pluralize import counted
from legoworld.records.folders.evaluation_reading import read_rows
from legoworld.records.folders.prediction_files import (
    IMAGES_PER_FILE,
    prediction_files,
    stored_entries,
)
from legoworld.records.folders.result_hashes import altered
from legoworld.records.folders.run_folder import JOURNAL, ROWS, RUN


class RunUnusableError(LegoWorldError):
    """A run folder cannot be scored."""

    code = "run_unusable"


@dataclass(frozen=True, kw_only=True)
class RunImage:
    """One attempted image. status: ok, or why there is nothing to score."""

    id: int
    file_name: str
    size_wh: tuple[int, int] | None
    status: str


@dataclass(frozen=True, kw_only=True)
class Run:
    """A finished run. images: ascending id; configuration and document: run.json's."""

    folder: Path
    task: str
    configuration: dict[str, Any]
    images: tuple[RunImage, ...]
    document: dict[str, Any]

    @property
    def partial(self) -> bool:
        """Whether the run attempted only some of its track's images."""
        return bool(self.configuration.get("partial"))


def read_run(folder: Path) -> Run:
    """The run in a folder. RunUnusableError when it is absent, unfinished or inconsistent."""
    document = _read_json(folder / RUN, "a run folder holds run.json; make one with readout")
    if (folder / JOURNAL).exists():
        raise RunUnusableError(
            f"the run in {folder.name} has not ended",
            found=f"{JOURNAL} is still there",
            expected="a finished run",
            next_step="run its command again: it goes on where it stopped",
        )
    try:
        configuration = document["configuration"]
        _refuse_altered(folder, document, [folder / ROWS])
        task = configuration["task"]
        images = tuple(sorted(map(_image, read_rows(folder / ROWS)), key=lambda i: i.id))
        attempted = configuration["attempted"]
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError, OSError) as error:
        raise RunUnusableError(
            f"the run in {folder.name} cannot be read",
            found=f"{type(error).__name__}: {error}",
            expected=f"{RUN} and {ROWS} as a run writes them",
        ) from error
    if len({i.id for i in images}) != len(images) or len(images) != attempted or not images:
        raise RunUnusableError(
            f"the run in {folder.name} does not cover its own track",
            found=f"rows: {len(images)}, of different images: {len({i.id for i in images})}",
            expected=f"{counted(attempted, 'image', 'images')}, one row each",
            next_step="run its command again",
        )
    return Run(
        folder=folder,
        task=str(task),
        configuration=configuration,
        images=images,
        document=document,
    )


def _refuse_altered(folder: Path, document: Any, files: list[Path]) -> None:
    """RunUnusableError where a file is not the one the run wrote."""
    for name in altered(folder, document, files):
        raise RunUnusableError(
            f"{folder.name}/{name} is not the one that the run wrote",
            found="another sha256",
            expected=f"the sha256 in {RUN}",
            next_step="run its command again; altered rows need --overwrite",
        )


def read_predictions(run: Run) -> list[Any]:
    """Every prediction of the run, file after file, unchecked beyond being lists.

    PredictionsUnreadableError names a file that is absent or damaged, RunUnusableError one that is
    not as the run wrote it.
    """
    files = _prediction_files(run)
    entries = list(stored_entries(files))
    _refuse_altered(run.folder, run.document, files)
    return entries


def run_inputs(run: Run) -> list[tuple[str, Path]]:
    """Role and path of every file that a score of boxes or masks is computed from."""
    return [
        ("run", run.folder / RUN),
        ("per_image", run.folder / ROWS),
        *(("predictions", path) for path in _prediction_files(run)),
    ]


def _prediction_files(run: Run) -> list[Path]:
    per_file = run.configuration.get(IMAGES_PER_FILE)
    return prediction_files(run.folder, per_file, len(run.images))


def run_view(run: Run) -> dict[str, Any]:
    """view/run.json: what a report says of the run and of each of its images, without any time.

    Nor does it say into how many files the predictions are divided: no number depends on it.
    """
    document = _read_json(run.folder / RUN, "a finished run")
    document["configuration"].pop(IMAGES_PER_FILE, None)
    return {
        **{key: document.get(key) for key in ("configuration", "versions", "scenes", "baseline")},
        "images": sorted(read_rows(run.folder / ROWS), key=lambda row: int(row["image_id"])),
    }


def _image(row: dict[str, Any]) -> RunImage:
    size = row.get("size_wh")
    return RunImage(
        id=int(row["image_id"]),
        file_name=str(row["file_name"]),
        size_wh=(int(size[0]), int(size[1])) if size else None,
        status=str(row["status"]),
    )


def _read_json(path: Path, expected: str) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise RunUnusableError(
            f"{path.parent.name}/{path.name} cannot be read",
            found=getattr(error, "strerror", None) or str(error),
            expected=expected,
        ) from error
