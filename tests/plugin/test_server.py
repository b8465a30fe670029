"""The tools as a client calls them, in memory; and the real server over standard input."""

from __future__ import annotations

import json
import shutil
import sys

import pytest
from endpoint.clients import serve_session
from mcp import StdioServerParameters
from plugin.talking import called, tools_of

from legoworld.plugin.case import Case
from legoworld.plugin.connection import Address, BlenderConnection
from legoworld.plugin.live import LiveBlender
from legoworld.plugin.server import plugin_server
from legoworld.records.plugin_ledger import TransactionLimits

pytestmark = pytest.mark.blender

TOOLS = {
    "look",
    "validate",
    "review",
    "export",
    "initialize",
    "plan",
    "reference_evidence",
    "measure",
    "begin",
    "status",
    "diff",
    "commit",
    "rollback",
    "history",
    "more",
}
STANDS = {"kind": "support", "entity": "Cup", "on": "Table"}


@pytest.fixture(scope="module")
def endpoint(tmp_path_factory, room_folders):
    with serve_session(tmp_path_factory.mktemp("endpoint")) as found:
        shutil.copy(room_folders / "none" / "scene.blend", found.workspace / "room.blend")
        path = str(found.workspace / "room.blend")
        found.client().run(f"import bpy; bpy.ops.wm.open_mainfile(filepath={path!r})")
        yield found


@pytest.fixture
def server(endpoint, blender, tmp_path):
    (tmp_path / "states").mkdir()
    connection = BlenderConnection(Address(port=endpoint.server.port))
    live = LiveBlender(connection, blender, tmp_path / "states")
    return plugin_server(Case(tmp_path, live, None, TransactionLimits()), None)


def test_the_tools_are_those_of_the_page(server):
    assert tools_of(server) == TOOLS


def test_a_session_from_begin_to_commit(server, endpoint):
    move = {"editable": ["Cup"], "kinds": ["transform"], "requirements": [STANDS]}
    ((failed, said),) = called(server, ("begin", move))
    assert not failed
    begun = json.loads(said)
    assert (begun["transaction"], begun["ledger_seq"]) == (1, 1)
    endpoint.client().run("import bpy; bpy.data.objects['Cup'].location.x += 0.1")
    answers = called(server, ("diff", {}), ("commit", {}), ("status", {}), ("history", {}))
    assert not any(failed for failed, _ in answers)
    diff, commit, status, history = (json.loads(said) for _, said in answers)
    assert diff["changes"] == [{"entity": "Cup", "kind": "transform"}]
    assert commit["judgement"]["accepted"]
    assert commit["report"]["results"][0]["verdict"] == "pass"
    assert commit["scene_signature"] != begun["scene_signature"]
    assert (status["phase"], status["ledger_seq"]) == ("idle", 3)
    assert [e["tool"] for e in history["entries"]] == ["begin", "diff", "commit"]


@pytest.mark.parametrize(
    ("name", "arguments", "why"),
    [
        ("measure", {"requirements": [{"kind": "beauty"}]}, "beauty"),
        ("measure", {"requirements": [{"kind": "support"}]}, "entity"),
        ("begin", {"editable": [], "kinds": ["transform"]}, "editable"),
        ("begin", {"editable": ["Cup"], "kinds": ["teleport"]}, "teleport"),
        ("commit", {}, "no transaction is open"),
    ],
)
def test_a_mistaken_call_is_an_error_that_names_the_mistake(server, name, arguments, why):
    ((failed, said),) = called(server, (name, arguments))
    assert failed
    assert why in said


def test_the_command_serves_over_standard_input(endpoint, tmp_path):
    served_by = StdioServerParameters(
        command=sys.executable,
        args=["-m", "legoworld", "plugin", "serve", "--ledger", str(tmp_path / "case"),
              "--blender", f"127.0.0.1:{endpoint.server.port}"],
    )  # fmt: skip
    ((failed, said),) = called(served_by, ("measure", {"requirements": [STANDS]}))
    assert not failed, said
    assert json.loads(said)["report"]["results"][0]["verdict"] == "pass"
