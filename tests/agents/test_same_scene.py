"""A program cut into steps and played through the real MCP server builds what `execute` builds."""

from __future__ import annotations

from pathlib import Path

import pytest
from agents.tracks import make_track, plan, run, server_or_skip, snapshot_sha256

from legoworld.scene.blender_process import Limits
from legoworld.scene.programs.execution import execute
from legoworld.trajectories.folder import read_trial

pytestmark = pytest.mark.blender

EXAMPLES = Path(__file__).parents[2] / "examples"
#: A picture of that size takes ten seconds of a core, and is not what is compared.
WHOLE = "resolution_percentage = 100"
#: Cut into ten steps, which draw random numbers from one to the next, and into four.
PROGRAMS = [EXAMPLES / name / "scene.py" for name in ("coffee", "chelsea")]


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda p: p.parent.name)
def test_played_through_mcp_for_blender_it_is_the_scene_of_execute(program, tmp_path):
    server_or_skip()
    name = program.parent.name
    text = program.read_text()
    assert text.count(WHOLE) == 1
    make_track(tmp_path, [name])
    (tmp_path / "programs" / name).mkdir(parents=True)
    program = tmp_path / "programs" / name / "scene.py"
    program.write_text(text.replace(WHOLE, "resolution_percentage = 5"))
    execute(program, tmp_path / "executed", limits=Limits(), picture=False)
    (row,) = run(plan(tmp_path), tmp_path / "scenes")
    assert (row.status, row.reason) == ("ok", "")
    trial = read_trial(tmp_path / "scenes" / name)
    assert trial.about.failed_calls == 0
    assert len(trial.live) >= 2, "cut into steps, it is more than one scene"
    assert snapshot_sha256(tmp_path / "scenes" / name) == snapshot_sha256(tmp_path / "executed")
