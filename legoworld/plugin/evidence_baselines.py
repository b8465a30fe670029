"""What a run of a baseline says of one photo, found in its folder by the photo's hash."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from legoworld.files import sha256_of_file
from legoworld.plugin.evidence import EvidenceInvalidError
from legoworld.readouts.tasks import protocol
from legoworld.records.base import canonical
from legoworld.records.folders.run_reading import RunDamagedError, finished_records, finished_run
from legoworld.records.plugin_evidence import DepthSpace
from legoworld.records.run_file import Configuration, ImageRecord
from legoworld.tracks.vocabulary import Vocabulary

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


def of_run(folder: Path, photo_sha256: str) -> RunEvidence:
    """What a finished run says of a photo. EvidenceInvalidError names what it lacks.

    A run of other photos is refused by their hashes, and so are one that was prompted with ground
    truth, and one of scenes: the plugin's evidence comes from the photo alone.
    """
    name = folder.name
    try:
        configuration = finished_run(folder).configuration
        records = list(finished_records(folder))
    except (RunDamagedError, OSError) as error:
        raise _refused(f"{name} is no finished run of a baseline", str(error)) from error
    if configuration.used_truth:
        raise _refused(f"{name} was prompted with ground truth", "used_truth in run.json")
    record = _of_photo(name, records, photo_sha256)
    if record.row.status != "ok":
        raise _refused(f"{name} has no result for the photo", record.row.status)
    return _evidence(folder, configuration, record)


def _of_photo(name: str, records: Sequence[ImageRecord], photo_sha256: str) -> ImageRecord:
    for record in records:
        if record.scene is not None and record.scene.photo_sha256 == photo_sha256:
            return record
    photos = sum(bool(r.scene is not None and r.scene.photo_sha256) for r in records)
    raise _refused(f"{name} is about other photos", f"{photos} photos, none of this hash")


def _evidence(folder: Path, configuration: Configuration, record: ImageRecord) -> RunEvidence:
    known = protocol(configuration.task, None)
    source = f"{configuration.baseline or 'import'} {configuration.baseline_version or ''}".strip()
    depth, space, results = None, "depth", None
    if written := record.row.depth:
        depth, space = folder / written.file, written.space or "depth"
        if not depth.is_file() or sha256_of_file(depth) != written.sha256:
            raise _refused(f"{folder.name} is damaged", f"{written.file} is not what was recorded")
        if space not in _SPACES:
            raise _refused(f"the depth of {folder.name} is not planar", f"space {space}")
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


def _refused(what: str, found: str) -> EvidenceInvalidError:
    return EvidenceInvalidError(
        what,
        found=found,
        expected="a folder of `legoworld baseline run` over this photo",
        next_step="run the baseline on a track that has this photo, unchanged",
    )
