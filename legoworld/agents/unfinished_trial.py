"""The folder of an unfinished trial: begun, continued after a kill, and moved to its scene.

begun.json      whose trial it is; there once the workspace is whole
ended.json      there once the agent has ended
workspace/      what the agent and its Blender write to
made/           the scene folder as far as it is made; made/trial holds calls and checkpoints
agent/          of the agent's process; its login is removed when legoworld is killed
session/        what the agent continues from
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeVar

from legoworld.agents.trial_plan import TrialPlan
from legoworld.beneath import Beneath, RefusedFileError
from legoworld.endpoint.trial_record import LARGEST_FILE
from legoworld.errors import LegoWorldError
from legoworld.files import write_text
from legoworld.locks import take
from legoworld.records.agents import BegunTrial, EndedAgent
from legoworld.records.base import RecordError, decode, readable
from legoworld.tracks.track import TrackImage
from legoworld.trajectories.folder import TRIAL
from legoworld.workers.removal import remove_folder
from legoworld.workers.scratch import scratch_folder

_SCRATCH: Final = ".reconstructing-"
_UNFINISHED: Final = ".unfinished-"
BEGUN: Final = "begun.json"
WORKSPACE: Final = "workspace"
_TRANSCRIPT: Final = "transcript"
_LOCK: Final = "lock"
#: A killed run's processes are ended within moments; another run's are not.
_FREE_WITHIN_S: Final = 30.0
_LOOK_EVERY_S: Final = 0.1
_File = TypeVar("_File", BegunTrial, EndedAgent)


class TrialHeldError(LegoWorldError):
    """Another run builds the same trial."""

    code = "trial_held"


@dataclass(frozen=True, kw_only=True)
class UnfinishedTrial:
    """The folder. stays: whether it outlives a killed legoworld; lease: its lock's descriptor."""

    folder: Path
    stays: bool
    lease: int | None = None

    @property
    def scene_folder(self) -> Path:
        """The scene folder to be."""
        return self.folder / "made"

    @property
    def workspace(self) -> Path:
        """The agent's workspace."""
        return self.folder / WORKSPACE

    @property
    def agent(self) -> Path:
        """The folder of the agent's process."""
        return self.folder / "agent"

    @property
    def session(self) -> Path:
        """The saved session that the agent resumes."""
        return self.folder / "session"

    def read_begun(self) -> BegunTrial | None:
        """The trial that was started here earlier; None in a new folder."""
        return _read(self.folder / BEGUN, BegunTrial)

    def read_ended(self) -> EndedAgent | None:
        """How the agent ended; None if it has not ended."""
        return _read(self.folder / "ended.json", EndedAgent)

    def note_begun(self, begun_trial: BegunTrial) -> None:
        """Keep whose trial it is."""
        write_text(self.folder / BEGUN, readable(begun_trial))

    def note_ended(self, ended_agent: EndedAgent) -> None:
        """Keep how the agent ended."""
        write_text(self.folder / "ended.json", readable(ended_agent))

    def clear(self) -> None:
        """Delete everything: no trial was started here."""
        for path in self.folder.iterdir():
            if path.name != _LOCK and not path.name.startswith(".owner"):
                _remove(path)
        for path in (self.workspace, self.scene_folder):
            path.mkdir()

    def keep_trial_alone(self) -> None:
        """Remove what an ended finalisation has made; calls, checkpoints and transcripts stay."""
        for path in self.scene_folder.iterdir():
            if path.name != TRIAL:
                _remove(path)

    def transcripts(self) -> list[Path]:
        """The transcripts of the agent's parts, in order, the last without a number."""
        trial = self.scene_folder / TRIAL
        earlier = [trial / f"{_TRANSCRIPT}-{n}" for n in range(1, self._parts())]
        return [*earlier, trial / _TRANSCRIPT]

    def take_transcript(self, wrote: str) -> None:
        """Copy the transcript of an agent that has ended, where it left one that can be taken.

        wrote: its name in the folder of the agent's output.
        """
        self._take(f"output/{wrote}", self.transcripts()[-1])

    def put_part_aside(self, wrote: str) -> None:
        """Keep what a killed part of the agent wrote (see above), and what it continues from."""
        trial = self.scene_folder / TRIAL
        trial.mkdir(exist_ok=True)
        self._take(f"output/{wrote}", trial / f"{_TRANSCRIPT}-{self._parts()}")
        with suppress(RefusedFileError), Beneath(self.agent / "sandbox") as inside:
            if inside.names("output/session"):
                remove_folder(self.session)
                inside.move_out("output/session", self.session, folder=True)
        remove_folder(self.agent)

    def _take(self, name: str, target: Path) -> None:
        with suppress(RefusedFileError), Beneath(self.agent / "sandbox") as inside:
            inside.copy_out(name, target, most_bytes=LARGEST_FILE)

    def _parts(self) -> int:
        begun = self.read_begun()
        return 1 if begun is None else len(begun.parts)


@contextmanager
def unfinished_trial(scenes: Path, image: TrackImage, *, stays: bool) -> Iterator[UnfinishedTrial]:
    """The folder of one trial below its scenes. TrialHeldError where another run has it.

    At the end of the block it is removed, but for a trial that stays and is not `mark_finished`.
    """
    scenes.mkdir(parents=True, exist_ok=True)
    if not stays:
        with scratch_folder(_SCRATCH, scenes) as scratch:
            yield UnfinishedTrial(folder=scratch, stays=False)
        return
    folder = unfinished_folder(scenes, image)
    folder.mkdir(exist_ok=True)
    with (folder / _LOCK).open("ab") as lock:
        _hold(lock.fileno(), image)
        unfinished = UnfinishedTrial(folder=folder, stays=True, lease=lock.fileno())
        try:
            yield unfinished
        finally:
            if unfinished.read_begun() is None:
                remove_folder(folder)


def unfinished_folder(scenes: Path, image: TrackImage) -> Path:
    """Build folder of a trial that survives a kill."""
    return scenes / f"{_UNFINISHED}{image.id}"


def mark_finished(trial: UnfinishedTrial) -> None:
    """Mark the scene folder as published, so that the leftovers can be deleted."""
    (trial.folder / BEGUN).unlink(missing_ok=True)


def remove_finished(scenes: Path, image: TrackImage) -> None:
    """Remove what a kill has left of a trial after its scene folder was moved to its place."""
    if unfinished_folder(scenes, image).is_dir():
        # Another run that has it removes it itself.
        with suppress(TrialHeldError), unfinished_trial(scenes, image, stays=True) as unfinished:
            mark_finished(unfinished)


def begun_before(scenes: Path, image: TrackImage) -> BegunTrial | None:
    """The trial that a killed run has begun; None where there is none."""
    return UnfinishedTrial(folder=unfinished_folder(scenes, image), stays=True).read_begun()


def identity(plan: TrialPlan, image: TrackImage, parts: tuple[int, ...]) -> BegunTrial:
    """Record that identifies this trial."""
    return BegunTrial(
        scene=image.scene,
        agent=plan.card.name,
        card_sha256=plan.card.sha256,
        prompt_sha256=plan.work.prompt_sha256,
        time_limit_s=plan.limits.time_s,
        budget=plan.budget,
        record=plan.record,
        parts=parts,
    )


def _hold(descriptor: int, image: TrackImage) -> None:
    deadline = time.monotonic() + _FREE_WITHIN_S
    while True:
        if take(descriptor, Path(image.scene), wait=False):
            return
        if time.monotonic() > deadline:
            raise TrialHeldError(
                f"another run builds {image.scene}",
                found="its folder is locked",
                expected="one run at a time in a folder of scenes",
                next_step="wait for the other run, or end it",
            )
        time.sleep(_LOOK_EVERY_S)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        remove_folder(path)
    else:
        path.unlink()


def _read(path: Path, kind: type[_File]) -> _File | None:
    try:
        return decode(kind, path.read_bytes())
    except (OSError, RecordError):
        return None
