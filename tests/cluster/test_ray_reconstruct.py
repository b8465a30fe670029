"""Trials on a cluster: what does not depend on time is the local engine's, to the byte."""

from __future__ import annotations

from pathlib import Path

import pytest
from agents.tracks import make_track, plan, server_or_skip, snapshot_sha256, steps_file

from legoworld.agents.reconstruct import make_trials
from legoworld.api.listener import SILENT
from legoworld.records.agents import TrialRow
from legoworld.trajectories.folder import read_trial
from legoworld.workers.engines import EngineName

pytest.importorskip("ray")

pytestmark = [
    pytest.mark.cluster,
    pytest.mark.blender,
    pytest.mark.filterwarnings("default"),
]

NAMES = ["a", "b", "c"]
STEP = "import bpy\nbpy.ops.mesh.primitive_cube_add(location=({x}, 3, 0))"
SAVE = "import bpy, os\nbpy.ops.wm.save_as_mainfile(filepath=os.getcwd() + '/scene.blend')"


@pytest.fixture
def track(tmp_path: Path) -> Path:
    server_or_skip()
    make_track(tmp_path, [*NAMES, "gone"], task="bench")
    (tmp_path / "photos" / "gone.png").unlink()
    for x, name in enumerate(NAMES):
        steps_file(tmp_path / "programs" / f"{name}.steps.jsonl", [STEP.format(x=x), SAVE])
    steps_file(tmp_path / "programs" / "gone.steps.jsonl", [SAVE])
    return tmp_path


def rows_of(track: Path, scenes: Path, engine: EngineName, workers: int) -> list[TrialRow]:
    made = plan(track)
    return make_trials(
        made, scenes, images=made.work.track.images, repeat=1, workers=workers, engine=engine,
        listener=SILENT,
    )  # fmt: skip


def what_is_deterministic(scenes: Path, name: str) -> dict[str, object]:
    trial = read_trial(scenes / name)
    return {
        "snapshot": snapshot_sha256(trial.folder),
        "scene.glb": (trial.folder / "scene.glb").read_bytes(),
        "final.png": (trial.folder / "final.png").read_bytes(),
        "calls": [(c.number, c.command, c.code, c.status, c.checkpoint) for c in trial.calls],
        "checkpoints": [(c.ordinal, c.call, c.kind) for c in trial.checkpoints],
        "steps": [(s.source, s.tool_calls) for s in trial.trajectory.steps],
        "of": (trial.about.prompt_sha256, trial.about.card_sha256, trial.about.finalisation.source),
    }


def test_the_scenes_are_the_same_for_any_engine_and_any_workers(track: Path, two_nodes):
    local = rows_of(track, track / "local", "local", 1)
    remote = rows_of(track, track / "ray", "ray", 2)
    told = [(row.image_id, row.scene, row.run, row.status, row.calls) for row in local]
    assert [(r.image_id, r.scene, r.run, r.status, r.calls) for r in remote] == told
    assert [row.status for row in remote] == ["ok", "ok", "ok", "no_photo"]
    for name in NAMES:
        found = what_is_deterministic(track / "local", name)
        assert what_is_deterministic(track / "ray", name) == found, name
    assert sorted(path.name for path in (track / "ray").iterdir()) == NAMES
    again = rows_of(track, track / "ray", "ray", 2)
    assert [row.kept for row in again] == [True, True, True, False]
