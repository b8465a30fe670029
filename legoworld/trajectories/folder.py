"""What a scene folder holds of its trial, and how it is read again."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from legoworld.endpoint.trial_record import CALLS, CHECKPOINTS, STORE, read_rows
from legoworld.errors import CatalogError, cause
from legoworld.records.agents import ReconstructionFile
from legoworld.records.atif import AtifTrajectory
from legoworld.records.base import RecordError, decode
from legoworld.records.endpoint import Call, Checkpoint

RECONSTRUCTION: Final = "reconstruction.json"
TRAJECTORY: Final = "trajectory.json"
TRIAL: Final = "trial"


@dataclass(frozen=True, kw_only=True)
class RecordedTrial:
    """One scene folder's trial. live: the checkpoints of the open scene, in order."""

    folder: Path
    about: ReconstructionFile
    trajectory: AtifTrajectory
    calls: list[Call]
    checkpoints: list[Checkpoint]

    @property
    def live(self) -> list[Checkpoint]:
        """The checkpoints of the open scene: the axis of every curve."""
        return [checkpoint for checkpoint in self.checkpoints if checkpoint.kind == "live"]

    def blend(self, checkpoint: Checkpoint) -> Path:
        """A checkpoint's .blend."""
        return self.folder / TRIAL / STORE / f"{checkpoint.sha256}.blend"


def recorded_trials(scenes: Path) -> list[RecordedTrial]:
    """Every trial below a folder, by name. CatalogError where there is none."""
    folders = sorted(path.parent for path in scenes.rglob(RECONSTRUCTION) if _visible(path, scenes))
    if not folders:
        raise CatalogError(
            "there is no trial to look at",
            found=f"no {RECONSTRUCTION} below {scenes.name}",
            expected="scenes that `legoworld reconstruct` made",
        )
    return [read_trial(folder) for folder in folders]


def read_trial(folder: Path) -> RecordedTrial:
    """The trial of one scene folder. CatalogError says which file cannot be used."""
    try:
        about = decode(ReconstructionFile, (folder / RECONSTRUCTION).read_bytes())
        trajectory = decode(AtifTrajectory, (folder / TRAJECTORY).read_bytes())
    except (OSError, RecordError) as error:
        raise CatalogError(
            f"the trial of {folder.name} cannot be read",
            found=cause(error),
            expected=f"{RECONSTRUCTION} and {TRAJECTORY} as `legoworld reconstruct` wrote them",
        ) from error
    return RecordedTrial(
        folder=folder,
        about=about,
        trajectory=trajectory,
        calls=read_rows(folder / TRIAL / CALLS, Call),
        checkpoints=read_rows(folder / TRIAL / CHECKPOINTS, Checkpoint),
    )


def _visible(path: Path, top: Path) -> bool:
    return not any(part.startswith(".") for part in path.relative_to(top).parts)
