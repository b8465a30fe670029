"""How an evaluation opens: its inputs hashed and named, and its folder prepared for them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from legoworld.records.evidence import ScoreConfiguration
from legoworld.records.folders.evaluation_folder import InputFile, input_file, prepare_folder
from legoworld.remote import child


@dataclass(frozen=True, kw_only=True)
class Origins:
    """The URLs of the run that is scored and of the evaluation; None where it is a folder here."""

    run_url: str | None = None
    output_url: str | None = None


#: Nothing is a copy.
HERE = Origins()


def prepared_inputs(
    output: Path,
    files: Sequence[tuple[str, Path]],
    configuration: ScoreConfiguration,
    *,
    run: Path,
    origins: Origins,
    overwrite: bool,
) -> list[InputFile]:
    """Hash the files that a score depends on and prepare the evaluation folder for them.

    files: role and path of each, as it lies here. A file of a run at a URL is named by its own URL,
    which remains valid after the copy is deleted. Where the evaluation goes to a URL, a file of
    this machine has no path relative to it, and is named by its whole path. Raises as
    `prepare_folder` does.
    """
    inputs = [
        replace(input_file(role, path), recorded=_recorded_path(path, run, origins))
        for role, path in files
    ]
    prepare_folder(output, configuration=configuration, inputs=inputs, overwrite=overwrite)
    return inputs


def _recorded_path(path: Path, run: Path, origins: Origins) -> str | None:
    if origins.run_url is not None and path.is_relative_to(run):
        # Strip credentials from the URL.
        url = re.sub(r"(?<=://)[^/@]*@", "", origins.run_url)
        return child(url, path.relative_to(run).as_posix())
    return path.resolve().as_posix() if origins.output_url is not None else None
