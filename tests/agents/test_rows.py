"""Rows of trials that come to nothing: which are tried again, and what is said of the others."""

from __future__ import annotations

import pytest
from agents.tracks import make_track, plan, run, server_or_skip, steps_file
from msgspec.structs import replace

from legoworld import __version__
from legoworld.agents import reconstruct
from legoworld.conventions import SCHEMA_VERSION
from legoworld.files import write_text
from legoworld.records.agents import Finalisation, Outcome, ReconstructionFile, Usage
from legoworld.records.base import readable
from legoworld.trajectories.folder import RECONSTRUCTION
from legoworld.workers.engines import ENGINES


@pytest.fixture
def made(tmp_path):
    server_or_skip()
    make_track(tmp_path, ["room"], task="bench")
    steps_file(tmp_path / "programs" / "room.steps.jsonl", ["1"])
    return plan(tmp_path)


def result(plan, image, status: Outcome) -> ReconstructionFile:
    return ReconstructionFile(
        schema_version=SCHEMA_VERSION, legoworld=__version__, image_id=image.id,
        file_name=image.file_name, scene=image.scene, agent="program", agent_version=None,
        card_sha256=plan.card.sha256, model=None, prompt_sha256=plan.work.prompt_sha256,
        status=status, reason="of this test", ended="itself", exit_code=1,
        time_limit_s=plan.limits.time_s, seconds=2.0, agent_seconds=1.0, calls=3, failed_calls=2,
        checkpoints=4, usage=Usage(),
        finalisation=Finalisation(source="none", checkpoint=None, sha256=None),
        agent_sandbox=plan.agent_held.record(), blender_sandbox=plan.blender_held.record(),
    )  # fmt: skip


def test_a_trial_whose_agent_failed_is_tried_again_and_one_without_a_scene_is_not(
    made, tmp_path, monkeypatch
):
    left: list[Outcome] = ["agent_failed", "no_scene"]

    def run_trial(plan, image, unfinished, *_):
        found = result(plan, image, left.pop(0))
        unfinished.clear()
        write_text(unfinished.scene_folder / RECONSTRUCTION, readable(found))
        return found

    monkeypatch.setattr(reconstruct, "run_trial", run_trial)
    rows = [run(made, tmp_path / "scenes")[0] for _ in range(3)]
    assert [(row.status, row.kept) for row in rows] == [
        ("agent_failed", False),
        ("no_scene", False),
        ("no_scene", True),
    ]
    assert replace(rows[2], kept=False) == rows[1]
    assert (rows[2].seconds, rows[2].calls, rows[2].checkpoints) == (2.0, 3, 4)


def test_a_trial_whose_machine_was_lost_is_a_row(made, tmp_path, monkeypatch):
    def lose_all(job, items, _workers):
        return (job.lost_result(item, "node 3 left") for item in items)

    monkeypatch.setitem(ENGINES, "local", lose_all)
    (row,) = run(made, tmp_path / "scenes")
    assert (row.image_id, row.scene, row.run, row.status) == (1, "room", 1, "failed")
    assert "node 3 left" in row.reason
