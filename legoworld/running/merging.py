"""`legoworld merge`: the shards of one run, put together as if it had never been divided."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from legoworld.errors import ConfigurationMismatchError, UsageError
from legoworld.files import atomic_path
from legoworld.readouts.tasks import TASKS
from legoworld.running import run_folder
from legoworld.running.readout_run import RunResult, run_document, summarise

#: What one shard's configuration holds that another's of the same run does not.
_OWN = ("attempted", "partial", "shard")


def merge_shards(shards: Sequence[Path], output: Path, *, overwrite: bool) -> RunResult:
    """Write the run that the shards 1/n .. n/n make up: byte for byte the undivided run's.

    Raises ConfigurationMismatchError naming what differs between two shards, and UsageError when
    a folder is no shard, or one is missing or given twice.
    """
    configurations = [_shard_configuration(folder) for folder in shards]
    configuration = _whole(list(shards), configurations)
    with run_folder.locked(output):
        # Records of an earlier merge are not kept: the shards may have been run again since.
        run_folder.prepare(output, configuration, overwrite=overwrite)
        (output / run_folder.JOURNAL).unlink(missing_ok=True)
        records = []
        with run_folder.journal(output) as journal:
            for folder in shards:
                for record in run_folder.finished_records(folder):
                    _take_depth(folder, output, record["row"])
                    records.append(run_folder.append(journal, record))
        records.sort(key=lambda record: int(record["row"]["image_id"]))
        rows = [record["row"] for record in records]
        summary = summarise(configuration, rows)
        run_folder.finish(
            output,
            records=records,
            run=run_document(configuration),
            summary=summary,
            with_predictions=TASKS[configuration["task"]].predict is not None,
        )
    return RunResult(rows=tuple(rows), summary=summary)


def _shard_configuration(folder: Path) -> dict[str, Any]:
    try:
        document = json.loads((folder / run_folder.RUN).read_text(encoding="utf-8"))
        configuration: dict[str, Any] = document["configuration"]
        if (folder / run_folder.JOURNAL).exists():
            raise ValueError("it has not ended")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UsageError(
            f"{folder.name} is not a finished shard",
            found=getattr(error, "strerror", None) or str(error),
            expected="the output of `legoworld readout --shard i/n`",
            next_step="run its command again: it goes on where it stopped",
        ) from error
    if not configuration.get("shard"):
        raise UsageError(
            f"{folder.name} is not a shard",
            found="a run of its whole track",
            expected="the output of `legoworld readout --shard i/n`",
        )
    return configuration


def _whole(folders: list[Path], configurations: list[dict[str, Any]]) -> dict[str, Any]:
    """The configuration of the undivided run; refuses shards that do not make one up."""
    first = configurations[0]
    for folder, other in zip(folders[1:], configurations[1:], strict=True):
        changed = sorted(
            key for key in {*first, *other} - {*_OWN} if first.get(key) != other.get(key)
        )
        if changed or first["shard"]["of"] != other["shard"]["of"]:
            raise ConfigurationMismatchError(
                f"{folders[0].name} and {folder.name} are shards of different runs",
                found=f"different {', '.join(changed) or 'numbers of shards'}",
                expected="shards of one track, read with the same options and versions",
                next_step="run the odd one again",
            )
    of = first["shard"]["of"]
    indices = sorted(c["shard"]["index"] for c in configurations)
    if indices != list(range(1, of + 1)):
        missing = sorted({*range(1, of + 1)} - {*indices})
        twice = sorted({i for i in indices if indices.count(i) > 1})
        raise UsageError(
            "the shards do not make up the run",
            found="; ".join(
                f"{what}: {', '.join(f'{i}/{of}' for i in some[:10])}"
                for what, some in (("missing", missing), ("given twice", twice))
                if some
            ),
            expected=f"each of 1/{of} to {of}/{of} once",
            next_step="run the missing ones, then merge again",
        )
    return {**first, **first["shard"]["whole"], "shard": None}


def _take_depth(shard: Path, output: Path, row: dict[str, Any]) -> None:
    """Bring a row's depth file over: linked where one disk holds both, copied otherwise."""
    if "depth" not in row:
        return
    source, target = shard / row["depth"]["file"], output / row["depth"]["file"]
    target.parent.mkdir(parents=True, exist_ok=True)
    with atomic_path(target) as temporary:
        try:
            os.link(source, temporary)
        except OSError:
            shutil.copyfile(source, temporary)
