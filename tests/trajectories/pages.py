"""Folders of trials and of their scores, made by hand: what a page is written from."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from legoworld.files import write_text
from legoworld.records.agents import Finalisation, ReconstructionFile, Usage
from legoworld.records.atif import AtifAgent, AtifMetrics, AtifStep, AtifTrajectory
from legoworld.records.base import readable
from legoworld.records.endpoint import Call, Checkpoint
from legoworld.records.scene_folder import Protected
from legoworld.records.trajectories import Moment, ScoredScene, TrajectoryFile
from legoworld.trajectories.curves import Trajectory, score_trajectory
from legoworld.trajectories.folder import RecordedTrial, read_trial
from legoworld.trajectories.score_checkpoints import slot_folder
from legoworld.trajectories.tables import SHARES, agent_tables

#: Call, and R and A of the scene it left; call 3 changes nothing, call 5 is without a camera.
LEFT = {1: (0.3, 0.5), 2: (0.7, 0.6), 4: (0.4, 0.55), 5: None, 6: (0.5, 0.6)}
SECONDS = 60.0
HELD = Protected(bubblewrap=None, why_not="not asked for", holds=[], does_not_hold=[])


def picture(path: Path, colour: tuple[int, int, int]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.full((96, 128, 3), colour, np.uint8))


def record_trial(scenes: Path, *, tokens: bool = True) -> RecordedTrial:
    """A trial of six calls; the last one saves as well, and is the submission."""
    folder, (calls, checkpoints) = scenes / "room", ([], [])
    for number in range(1, 7):
        code = f"import bpy\nbpy.context.scene['call'] = {number}  # <b>{'long ' * 40}</b>\n"
        said = "Info: Saved" if number == 6 else ""
        if number in LEFT:
            checkpoints.append(_checkpoint(len(checkpoints) + 1, number, "live"))
        if number == 6:
            checkpoints.append(_checkpoint(len(checkpoints) + 1, number, "saved"))
        calls.append(
            Call(
                number=number, command="execute_code", code=code, at_s=8.0 * number, seconds=1.0,
                status="success", said=said,
                checkpoint=checkpoints[-1].ordinal if number in LEFT else None,
            )
        )  # fmt: skip
    for name, rows in (("calls", calls), ("checkpoints", checkpoints)):
        lines = "".join(readable(row).replace("\n", "") + "\n" for row in rows)
        write_text(folder / "trial" / f"{name}.jsonl", lines)
    about = ReconstructionFile(
        schema_version=1, legoworld="0", image_id=1, file_name="room.png", scene="room",
        agent="codex", agent_version=None, card_sha256="0", model=None, prompt_sha256="0",
        status="ok", reason="", ended="itself", exit_code=0, time_limit_s=100.0, seconds=70.0,
        agent_seconds=SECONDS, calls=6, failed_calls=0, checkpoints=6, usage=Usage(),
        finalisation=Finalisation(source="saved", checkpoint=6, sha256="6"),
        agent_sandbox=HELD, blender_sandbox=HELD,
    )  # fmt: skip
    steps = [
        AtifStep(
            step_id=call.number, source="agent", extra={"legoworld": {"calls": [call.number]}},
            metrics=AtifMetrics(completion_tokens=10 * call.number) if tokens else None,
        )
        for call in calls
    ]  # fmt: skip
    agent = AtifAgent(name="codex", version="1")
    trajectory = AtifTrajectory(schema_version="ATIF-v1.6", agent=agent, steps=steps)
    write_text(folder / "reconstruction.json", readable(about))
    write_text(folder / "trajectory.json", readable(trajectory))
    picture(folder / "final.png", (60, 60, 200))
    return read_trial(folder)


def score_trial(output: Path, trial: RecordedTrial) -> TrajectoryFile:
    """trajectories.json of the trial, and the renders of its checkpoints."""
    scenes = []
    for number, checkpoint in enumerate(trial.live):
        scenes.append(_scene(checkpoint.ordinal, checkpoint.call))
        folder = slot_folder(output, trial, number)
        picture(folder / "room" / "final.png", (40 * checkpoint.call, 120, 90))
    final = _scene(None, 6)
    score = score_trajectory(
        Trajectory(
            image_id=1, scene="room", family="f", agent="codex", run=1, seconds=SECONDS,
            checkpoints=scenes, final=final,
        )
    )  # fmt: skip
    document = TrajectoryFile(
        schema_version=1, legoworld="0", evaluator={}, draws=10, seed=0, shares=SHARES,
        trials=(score,), agents=agent_tables([score], draws=10, seed=0), common=None,
        common_images=(),
    )  # fmt: skip
    write_text(output / "trajectories.json", readable(document))
    return document


def _checkpoint(ordinal: int, call: int, kind: str) -> Checkpoint:
    saved = kind == "saved"
    return Checkpoint(
        ordinal=ordinal, sha256=str(ordinal), bytes=1, call=call, at_s=8.0 * call + 1,
        kind="saved" if saved else "live",
    )  # fmt: skip


def _scene(ordinal: int | None, call: int) -> ScoredScene:
    measured = LEFT[call]
    r, a = measured or (None, None)
    share = 1.0 if ordinal is None else (8.0 * call + 1) / SECONDS
    return ScoredScene(
        ordinal=ordinal, call=call, R=r, A=a,
        Q=None if r is None or a is None else (r + a) / 2,
        when=Moment(at_s=share * SECONDS, wall_share=share, calls_share=call / 6,
                    tokens_share=None),
        reason="" if measured else "camera: none", camera_sha256="c", snapshot_sha256=f"s{r}",
    )  # fmt: skip
