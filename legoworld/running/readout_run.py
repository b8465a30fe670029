"""A readout's run: what was asked, its images, its configuration and its summary."""

from __future__ import annotations

import platform
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from msgspec.structs import replace

from legoworld.conventions import SCHEMA_VERSION
from legoworld.errors import UsageError
from legoworld.files import as_unicode, canonical_json, sha256_of_text
from legoworld.readouts.family import Protocol, load_readout_family
from legoworld.records.base import UNSET, UnsetType
from legoworld.records.folders.read_run import RUN_SCHEMA
from legoworld.records.run_file import (
    BaselineAbout,
    Configuration,
    RunCoverage,
    RunFile,
    RunSummary,
    Shard,
    WholeRun,
)
from legoworld.records.run_rows import RunRow
from legoworld.running.image_record import ROW_SCHEMA, ImageOptions
from legoworld.scene.cache import bpy_version
from legoworld.scene.snapshot import SNAPSHOT_SCHEMA
from legoworld.tasks.registry import require_task
from legoworld.tracks.track import Track, TrackImage
from legoworld.version import __version__


@dataclass(frozen=True, kw_only=True)
class RunRequest:
    """All parameters of one run: a task over a track.

    shard: (i, n), 1 <= i <= n: only every n-th image, from the i-th on. images_per_file: None for
    one file of predictions.
    """

    image_options: ImageOptions
    track: Track
    overwrite: bool
    limit: int | None
    image_ids: tuple[int, ...]
    shard: tuple[int, int] | None
    images_per_file: int | None

    @property
    def partial(self) -> bool:
        """Whether only some of the track's images are requested, apart from sharding."""
        return self.limit is not None or bool(self.image_ids)


@dataclass(frozen=True, kw_only=True)
class RunResult:
    """The results of a run."""

    rows: tuple[RunRow, ...]
    summary: RunSummary


Progress = Callable[[RunRow], None]


def selected_images(track: Track, image_ids: Sequence[int], limit: int | None) -> list[TrackImage]:
    """The images to attempt: all of the track's, or those selected by --image-id and --limit.

    Raises UsageError for an id that the track does not have.
    """
    images = list(track.images)
    known = {image.id for image in images}
    unknown = [i for i in image_ids if i not in known]
    if unknown:
        raise UsageError(
            "the track has no such image",
            found=f"--image-id {unknown[0]}",
            expected=f"one of {len(known)} ids, such as {min(known)}",
        )
    if image_ids:
        images = [image for image in images if image.id in image_ids]
    return images[:limit] if limit is not None else images


def shard_images(request: RunRequest) -> list[TrackImage]:
    """The images of this run: in a shard i/n, every n-th of the selected ones."""
    images = selected_images(request.track, request.image_ids, request.limit)
    if request.shard is None:
        return images
    index, of = request.shard
    return images[index - 1 :: of]


def summarise(configuration: Configuration, rows: Sequence[RunRow]) -> RunSummary:
    """summary.json: coverage by status, exports, and labels without effect.

    RunDamagedError for rows of an earlier run that are not what a run writes.
    """
    ok = [row for row in rows if row.status == "ok"]
    family = load_readout_family(require_task(configuration.task))
    return family.sum_up(count_rows(configuration, rows), rows, ok)


def count_rows(configuration: Configuration, rows: Sequence[RunRow]) -> RunSummary:
    """What every run's summary.json counts, of a scene or of a baseline."""
    by_status = Counter(row.status for row in rows)
    return RunSummary(
        schema_version=SCHEMA_VERSION,
        task=configuration.task,
        partial=bool(configuration.partial) or len(rows) < configuration.attempted,
        coverage=RunCoverage(
            attempted=configuration.attempted, ok=by_status["ok"], by_status=dict(by_status)
        ),
        warnings=sum(len(row.warnings) for row in rows),
    )


def run_configuration(request: RunRequest, images: list[TrackImage]) -> Configuration:
    """Everything a run's results depend on, except the scenes; must be equal to resume."""
    options = request.image_options
    selected = selected_images(request.track, request.image_ids, request.limit)
    return replace(
        common_configuration(options.protocol, request.track, selected),
        kind="scene",
        attempted=len(images),
        partial=request.partial or request.shard is not None,
        shard=_shard_entry(request, len(selected)),
        source=options.source,
        require_frozen=options.require_frozen,
        max_side=options.max_side,
        variant=options.normals or UNSET,
        bpy=bpy_version(),
        snapshot_schema=SNAPSHOT_SCHEMA,
        row_schema=ROW_SCHEMA,
        images_per_file=request.images_per_file or UNSET,
        bench=options.bench.to_record() if options.bench else UNSET,
        sky=options.sky.name if options.sky else UNSET,
    )


def common_configuration(
    protocol: Protocol, track: Track, images: Sequence[TrackImage]
) -> Configuration:
    """What runs of scenes and of baselines depend on alike: the card and the images."""
    described = [[i.id, as_unicode(i.file_name), i.size_wh] for i in images]
    return Configuration(
        schema_version=SCHEMA_VERSION,
        task=protocol.task.name,
        card_version=protocol.card.version,
        card_sha256=protocol.card.sha256,
        vocabulary_sha256=protocol.vocabulary.sha256 if protocol.vocabulary else None,
        track_sha256=track.sha256,
        images_sha256=sha256_of_text(canonical_json(described)),
        attempted=len(images),
        legoworld=__version__,
    )


def _shard_entry(request: RunRequest, n_selected: int) -> Shard | None:
    """The data from which `merge` restores the whole run's configuration."""
    if request.shard is None:
        return None
    whole = WholeRun(attempted=n_selected, partial=request.partial)
    return Shard(index=request.shard[0], of=request.shard[1], whole=whole)


def run_document(
    configuration: Configuration, baseline: BaselineAbout | UnsetType = UNSET
) -> RunFile:
    """run.json without its scenes: the one file that holds a time."""
    import numpy as np

    own = {} if baseline else {"bpy": bpy_version()}
    return RunFile(
        schema_version=RUN_SCHEMA,
        finished_at=time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        configuration=configuration,
        baseline=baseline,
        versions={
            "legoworld": __version__,
            "numpy": np.__version__,
            "python": platform.python_version(),
            **own,
        },
    )
