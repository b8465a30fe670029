"""Small tracks with photos for trials, and the snapshot hash of what they leave."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from scene.snapshots import read_alone

from legoworld.agents.mcp_server import server_problems
from legoworld.agents.reconstruct import make_trials
from legoworld.agents.run_plan import plan_run
from legoworld.agents.trial_plan import TrialPlan
from legoworld.api.listener import SILENT
from legoworld.records.agents import TrialRow

#: An agent's first words, so that final.png takes no time: the start-up scene renders 1920 x 1080.
SMALL = "r = bpy.context.scene.render; r.resolution_x, r.resolution_y = 64, 48"


def server_or_skip() -> None:
    """Skip where mcp-for-blender has no environment."""
    if problems := server_problems():
        pytest.skip("; ".join(problems))


def make_track(folder: Path, names: Sequence[str], task: str = "coco") -> Path:
    """A track of grey photos by these names; photos/ and track.json in a folder."""
    photos = folder / "photos"
    photos.mkdir(parents=True, exist_ok=True)
    for name in names:
        cv2.imwrite(str(photos / f"{name}.png"), np.full((48, 64, 3), 128, np.uint8))
    images = [
        {"id": n, "file_name": f"{name}.png", "width": 64, "height": 48}
        for n, name in enumerate(names, start=1)
    ]
    categories = [{"id": 1, "name": "chair"}]
    track = {"info": {"task": task}, "images": images, "categories": categories}
    (folder / "track.json").write_text(json.dumps(track))
    return folder / "track.json"


def steps_file(path: Path, codes: Sequence[str]) -> None:
    """Recorded steps that run these pieces of code, one a call."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [{"tool": "execute_blender_code", "arguments": {"code": code}} for code in codes]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))


def plan(folder: Path, *, time_limit_s: float = 300.0, memory_bytes: int = 3 << 30) -> TrialPlan:
    """The plan of `program` over the track and programs of a folder."""
    return plan_run(
        folder / "track.json",
        photos=folder / "photos",
        agent="program",
        task="bench",
        programs=folder / "programs",
        model=None,
        time_limit_s=time_limit_s,
        memory_bytes=memory_bytes,
        sandbox="auto",
    )


def run(made: TrialPlan, output: Path, *, workers: int = 1, repeat: int = 1) -> list[TrialRow]:
    """All trials of a plan."""
    return make_trials(
        made,
        output,
        images=made.work.track.images,
        repeat=repeat,
        workers=workers,
        engine="local",
        listener=SILENT,
    )


def snapshot_sha256(folder: Path) -> str:
    """The content hash of a scene folder's snapshot."""
    return read_alone(folder).snapshot_sha256
