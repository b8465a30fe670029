"""The names of inputs in evidence.json when a command works on local copies of URLs."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from legoworld.records.folders.evaluation_folder import InputFile
from legoworld.remote import child


@dataclass(frozen=True, kw_only=True)
class Origins:
    """The URLs of the run that is scored and of the evaluation; None where it is a folder here."""

    run_url: str | None = None
    output_url: str | None = None


#: Nothing is a copy.
HERE = Origins()


def recorded_inputs(inputs: Sequence[InputFile], run: Path, origins: Origins) -> list[InputFile]:
    """The inputs with names that remain valid after the copies are deleted.

    A file of a run at a URL is named by its own URL. Where the evaluation goes to a URL, a file
    of this machine has no path relative to it, and is named by its whole path.
    """
    return [replace(file, recorded=_recorded(file.path, run, origins)) for file in inputs]


def _recorded(path: Path, run: Path, origins: Origins) -> str | None:
    if origins.run_url is not None and path.is_relative_to(run):
        # Strip credentials from the URL.
        url = re.sub(r"(?<=://)[^/@]*@", "", origins.run_url)
        return child(url, path.relative_to(run).as_posix())
    return path.resolve().as_posix() if origins.output_url is not None else None
