"""Killed at any moment nothing is lost, and an open transaction is resumed, told so."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from legoworld.errors import UsageError
from legoworld.plugin.case import STATES, Case
from legoworld.plugin.ledger import read_ledger
from legoworld.plugin.live import LiveBlender
from legoworld.plugin.serve import one_server
from legoworld.records.plugin_ledger import Declaration, TransactionLimits

pytestmark = pytest.mark.blender

PROGRAM = Path(__file__).with_name("killed.py")
MOVE = Declaration(editable=("Cup",), kinds=("transform",))
#: The tools that the ledger has afterwards: a call that was not answered may be missing, no other.
POINTS = {
    "begin:before": [],
    "begin:half": [],
    "begin:after": ["begin"],
    "commit:half": ["begin"],
    "commit:after": ["begin", "commit"],
    "rollback:before": ["begin"],
}


def test_one_server_writes_a_ledger(tmp_path):
    with one_server(tmp_path), pytest.raises(UsageError, match="another server"):
        one_server(tmp_path).__enter__()
    with one_server(tmp_path):
        pass  # the lock ends with its holder


@pytest.mark.parametrize("point", POINTS)
def test_killed(point, endpoint, blender_code, blender, tmp_path):
    ended = subprocess.run(
        [sys.executable, str(PROGRAM), point, str(endpoint.server.port), str(tmp_path)],
        capture_output=True, text=True, check=False, cwd=Path(__file__).parents[2],
    )  # fmt: skip
    assert ended.returncode == -signal.SIGKILL, ended.stderr[-2000:]
    assert [entry.tool for entry in read_ledger(tmp_path)] == POINTS[point]
    live = LiveBlender(blender_code, blender, tmp_path / STATES)
    case = Case(tmp_path, live, None, TransactionLimits())
    if case.phase == "idle":  # nothing was begun, or it was committed
        assert case.resume() is None
        assert case.begin(MOVE).transaction == len(POINTS[point]) // 2 + 1
        return
    begun = case.ledger.entries[0]
    assert case.resume() == 1
    assert case.ledger.entries[-1].tool == "resume"
    assert case.phase == "open"
    assert case.rollback().scene_signature == begun.scene_signature
    assert case.phase == "idle"
    x = blender_code.run("import bpy; print(round(bpy.data.objects['Cup'].location.x, 6))")
    assert float(x) == 0.0
