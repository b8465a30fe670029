"""What runs of specialist models say of a photo, never ground truth: found by the photo's hash.

Beside runs there are results files and folders of arrays that no run stands for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Final

from legoworld.depth_files.errors import DepthFileError
from legoworld.depth_files.read_depth import npz_contents
from legoworld.errors import cause
from legoworld.files import sha256_of_file
from legoworld.plugin.evidence import EvidenceInvalidError
from legoworld.readouts.family import protocol
from legoworld.records.base import canonical
from legoworld.records.folders.read_run import (
    RUN,
    RunDamagedError,
    finished_records,
    finished_run,
)
from legoworld.records.plugin_evidence import DepthSpace
from legoworld.records.run_file import Configuration, ImageRecord
from legoworld.tracks.vocabulary import Vocabulary

#: The forms of depth arrays beside runs: numbers along the camera's axis.
_ARRAYS: Final = (".npz", ".npy", ".png")
_SPACES: Final[dict[str, DepthSpace]] = {"depth": "depth", "disparity": "disparity"}


@dataclass(frozen=True, kw_only=True)
class RunEvidence:
    """One photo's part of a run. results: a list of COCO results as JSON; None of a depth run.

    source: the baseline and its version; depth: the array's file, and what its numbers are.
    """

    image_id: int
    vocabulary: Vocabulary | None
    source: str
    results: bytes | None
    depth: Path | None
    space: DepthSpace


def find_run(path: Path) -> Path | None:
    """The run folder that a path is, or that a results file lies in; None for any other path."""
    folder = path if path.is_dir() else path.parent
    return folder if (folder / RUN).is_file() else None


def usable_run(folder: Path) -> Configuration:
    """The configuration of a finished run. EvidenceInvalidError for one the plugin cannot use.

    One that was prompted with ground truth is refused: evidence comes from the photo alone.
    """
    try:
        configuration = finished_run(folder).configuration
    except (RunDamagedError, OSError) as error:
        raise _refused_error(
            f"{folder.name} is not a finished baseline run", cause(error)
        ) from error
    if configuration.used_truth:
        raise _refused_error(
            f"{folder.name} was prompted with ground truth", "used_truth in run.json"
        )
    return configuration


def of_run(folder: Path, photo_sha256: str) -> RunEvidence:
    """A finished run's results for a photo. EvidenceInvalidError names what is missing.

    A run of other photos, or of scenes, is refused by the photos' hashes.
    """
    configuration = usable_run(folder)
    records = _records(folder)
    record = _of_photo(records, photo_sha256)
    if record is None:
        photos = sum(bool(r.scene is not None and r.scene.photo_sha256) for r in records)
        found = f"{photos} photos, none of this hash"
        raise _refused_error(f"{folder.name} is about other photos", found)
    if record.row.status != "ok":
        raise _refused_error(f"{folder.name} has no result for the photo", record.row.status)
    return _evidence(folder, configuration, record)


def read_photo_hashes(folder: Path) -> set[str]:
    """The hashes of a finished run's photos, with a result or without."""
    scenes = (record.scene for record in _records(folder))
    return {s.photo_sha256 for s in scenes if s is not None and s.photo_sha256}


def covers(folder: Path, photo_sha256: str) -> bool:
    """Whether a finished run has a result for a photo."""
    record = _of_photo(_records(folder), photo_sha256)
    return record is not None and record.row.status == "ok"


def depth_file(folder: Path, file_name: str) -> tuple[Path, DepthSpace] | None:
    """A photo's array in a folder of arrays that no run stands for; None where it has none."""
    stem = PurePosixPath(file_name).with_suffix("")
    paths = [folder / f"{stem}{suffix}" for suffix in _ARRAYS]
    file = next((path for path in paths if path.is_file()), None)
    return None if file is None else (file, _space(file))


def _space(path: Path) -> DepthSpace:
    """The space that a baseline's .npz declares; depth for any other array."""
    if path.suffix != ".npz":
        return "depth"
    try:
        said = str(npz_contents(path, ("space",)).labels.get("space", "depth"))
    except DepthFileError as error:
        raise EvidenceInvalidError(
            f"{path} cannot be read as depth", found=error.found, expected="an .npz of arrays"
        ) from error
    if said not in _SPACES:
        raise EvidenceInvalidError(
            f"{path} is not depth along the camera's axis",
            found=said,
            expected="depth or disparity",
        )
    return _SPACES[said]


def _records(folder: Path) -> list[ImageRecord]:
    try:
        return list(finished_records(folder))
    except (RunDamagedError, OSError) as error:
        raise _refused_error(
            f"{folder.name} is not a finished baseline run", cause(error)
        ) from error


def _of_photo(records: Sequence[ImageRecord], photo_sha256: str) -> ImageRecord | None:
    for record in records:
        if record.scene is not None and record.scene.photo_sha256 == photo_sha256:
            return record
    return None


def _evidence(folder: Path, configuration: Configuration, record: ImageRecord) -> RunEvidence:
    known = protocol(configuration.task, None)
    source = f"{configuration.baseline or 'import'} {configuration.baseline_version or ''}".strip()
    depth, space, results = None, "depth", None
    if written := record.row.depth:
        depth, space = folder / written.file, written.space or "depth"
        if not depth.is_file() or sha256_of_file(depth) != written.sha256:
            raise _refused_error(
                f"{folder.name} is damaged", f"{written.file} is not what was recorded"
            )
        if space not in _SPACES:
            raise _refused_error(f"the depth of {folder.name} is not planar", f"space {space}")
    else:
        results = canonical(record.predictions).encode()
    return RunEvidence(
        image_id=record.row.image_id,
        vocabulary=known.vocabulary if known else None,
        source=source,
        results=results,
        depth=depth,
        space=_SPACES[space],
    )


def _refused_error(what: str, found: str) -> EvidenceInvalidError:
    return EvidenceInvalidError(
        what,
        found=found,
        expected="a folder of `legoworld baseline run` over this photo",
        next_step="run the baseline on a track that has this photo, unchanged",
    )
