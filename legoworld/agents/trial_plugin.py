"""The plugin beside one trial: evidence of its photo, made before the agent begins; its server."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from legoworld.agents.plugin_host import PluginHost
from legoworld.agents.workspaces import TrialSetup
from legoworld.endpoint.listener import HOST
from legoworld.endpoint.server import EndpointServer
from legoworld.endpoint.session import Session
from legoworld.errors import UsageError
from legoworld.files import sha256_of_file
from legoworld.plugin.evidence import EvidenceInvalidError
from legoworld.plugin.evidence_runs import (
    covers,
    depth_file,
    find_run,
    read_photo_hashes,
    usable_run,
)
from legoworld.plugin.ledger import read_ledger
from legoworld.plugin.make_evidence import UserEvidence, make_evidence
from legoworld.plugin.modules import MODULES
from legoworld.plugin.serve import require_server
from legoworld.pluralize import plural
from legoworld.records.agents import PluginCalls
from legoworld.records.folders.read_run import RUN
from legoworld.records.plugin_install import Module, PluginUsed
from legoworld.track_making.make_track import find_photo
from legoworld.tracks.track import TrackImage
from legoworld.tracks.vocabulary import Vocabulary
from legoworld.version import __version__

PLUGIN: Final = "plugin"
_EVIDENCE: Final = "evidence"


@dataclass(frozen=True, kw_only=True)
class PluginOptions:
    """The plugin options of a run.

    modules: those that are on; regions: run folders, or results files over the track's image ids;
    depth: a run folder, or a folder of arrays by the photos' names, None without.
    """

    modules: tuple[Module, ...]
    regions: tuple[Path, ...]
    depth: Path | None


@dataclass(frozen=True, kw_only=True)
class PluginPlan:
    """The plugin settings of every trial. vocabulary: of the track's category ids."""

    options: PluginOptions
    vocabulary: Vocabulary | None

    @property
    def provenance(self) -> PluginUsed:
        """The entry in provenance.json."""
        return PluginUsed(version=__version__, modules=self.options.modules)


def plan_plugin(options: PluginOptions, work: TrialSetup) -> PluginPlan:
    """The plan, checked before the first trial.

    InstallationError without the extra, EvidenceInvalidError for evidence made with ground truth or
    of none of the track's photos, UsageError for evidence whose module is off.
    """
    require_server()
    if (options.regions or options.depth) and "evidence" not in options.modules:
        raise UsageError(
            "evidence is given and the plugin's module `evidence` is off",
            found="--regions or --depth",
            expected="neither of them",
        )
    planned = PluginOptions(
        modules=options.modules,
        regions=tuple(_regions(path) for path in options.regions),
        depth=None if options.depth is None else _depth(options.depth),
    )
    _check_shared(_runs(planned), work)
    return PluginPlan(options=planned, vocabulary=work.track.vocabulary)


def _runs(options: PluginOptions) -> list[Path]:
    """The run folders among what is given, each once."""
    given = [*options.regions, *([] if options.depth is None else [options.depth])]
    return [path for path in dict.fromkeys(given) if find_run(path)]


def _check_shared(runs: list[Path], work: TrialSetup) -> None:
    """EvidenceInvalidError for a run that covers none of the trials' photos.

    It would give every trial a plugin without evidence. A run of some of them is used for those.
    """
    if not runs:
        return
    photos = [find_photo(work.photos, image) for image in work.track.images]
    hashes = {sha256_of_file(path) for path in photos if path is not None}
    for run in runs:
        theirs = read_photo_hashes(run)
        if hashes and not theirs & hashes:
            raise EvidenceInvalidError(
                f"{run.name} covers none of the track's photos",
                found=f"{plural(len(theirs), 'photo', 'photos')} in the run, none of the hashes "
                f"of the track's {len(hashes)}",
                expected="a run over photos of this track, unchanged",
                next_step="run the baseline on this track and --photos, or leave the run out",
            )


def _regions(path: Path) -> Path:
    """A run folder that can be used, or a results file that no run stands for."""
    run = find_run(path)
    if run is None and not path.is_file():
        raise EvidenceInvalidError(
            f"{path.name} holds no regions",
            found=f"no {RUN}",
            expected="a run of boxes or masks, or a COCO or LVIS results file",
        )
    if run is not None:
        usable_run(run)
    return run or path


def _depth(folder: Path) -> Path:
    """A run folder that can be used, or a folder of arrays."""
    run = find_run(folder)
    if run is not None:
        usable_run(run)
    return run or folder


@contextmanager
def served_plugin(
    plan: PluginPlan, image: TrackImage, photo: Path, session: Session, record: Path
) -> Iterator[PluginHost]:
    """A trial's plugin, with evidence of its photo; nothing of it is in the agent's workspace.

    photo: the track's own, since the agent can exchange its copy.
    record: a folder to make; it keeps the ledger, the states and the evidence.
    """
    record.mkdir()
    with EndpointServer(session, 0, by="plugin") as blender:
        command = [
            *(sys.executable, "-m", "legoworld", "plugin", "serve"),
            *("--ledger", str(record), "--blender", f"{HOST}:{blender.port}"),
            *(word for m in _disabled_modules(plan.options.modules) for word in ("--without", m)),
        ]
        if "evidence" in plan.options.modules:
            _make_evidence(plan, image, photo, record / _EVIDENCE)
            command += ["--evidence", str(record / _EVIDENCE), "--photo", str(photo)]
        with PluginHost(command, record / "server.log") as host:
            yield host


def read_plugin_calls(record: Path) -> PluginCalls:
    """Count a trial's plugin calls from its ledger."""
    ledger = read_ledger(record)
    entries = [entry for entry in ledger if entry.tool not in ("serve", "resume")]
    good = [entry.tool for entry in entries if entry.error is None]
    accepted = [e for e in entries if e.tool == "commit" and e.error is None and e.phase == "idle"]
    return PluginCalls(
        calls=len(entries),
        failed=len(entries) - len(good),
        transactions=good.count("begin"),
        committed=len(accepted),
        rolled_back=good.count("rollback"),
        left_open=bool(ledger) and ledger[-1].phase == "open",
    )


def _make_evidence(plan: PluginPlan, image: TrackImage, photo: Path, into: Path) -> None:
    options, photo_sha256 = plan.options, sha256_of_file(photo)
    array = None
    if options.depth is not None and not find_run(options.depth):
        array = depth_file(options.depth, image.file_name)
    make_evidence(
        UserEvidence(
            photo=photo,
            regions=[path for path in options.regions if not find_run(path)],
            image_id=image.id,
            vocabulary=plan.vocabulary,
            depth=array[0] if array else None,
            depth_space=array[1] if array else "depth",
            hfov_deg=image.hfov_deg,
            all_images=True,
            # A model may have found nothing in a photo of its track, or failed on it.
            runs=[run for run in _runs(options) if covers(run, photo_sha256)],
        ),
        into,
    )


def _disabled_modules(modules: tuple[Module, ...]) -> list[Module]:
    return [module for module in MODULES if module not in modules]
