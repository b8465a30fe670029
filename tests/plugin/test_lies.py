"""A client that lies about a transaction: each lie is refused, named or undone."""

from __future__ import annotations

import contextlib
import json
import math
import subprocess
import sys

import pytest
from plugin.live_room import reopen_case
from plugin.synthetic import evidence_with
from plugin.talking import called

from legoworld.errors import NonFiniteGeometryError, UsageError
from legoworld.plugin.connection import BlenderRefusedError
from legoworld.plugin.final_steps import export
from legoworld.plugin.ledger import LEDGER, LedgerBrokenError, read_ledger
from legoworld.plugin.open_ledger import TransactionError
from legoworld.plugin.remaining_work import list_unfinished
from legoworld.plugin.server import plugin_server
from legoworld.records import plugin_requirements as kinds
from legoworld.records.base import canonical
from legoworld.records.plugin_ledger import Declaration, TransactionLimits

pytestmark = pytest.mark.blender

ON_TABLE = kinds.Support(entity="Cup", on="Table")
MOVE_CUP = Declaration(editable=("Cup",), kinds=("transform",))
ACROSS = "import bpy; bpy.data.objects['Cup'].location.x += 0.3"
CHAIR = "import bpy; bpy.data.objects['Chair'].location.x += 0.3"


def test_the_number_of_another_transaction_is_refused(case, blender_code):
    server = plugin_server(case, None)
    begin = {"editable": ["Cup"], "kinds": ["transform"]}
    (_, said), (failed, why) = called(server, ("begin", begin), ("commit", {"transaction": 7}))
    assert json.loads(said)["transaction"] == 1
    assert failed
    assert "transaction 7 is not open" in why
    (failed, why), (wrong, _) = called(
        server, ("rollback", {"transaction": 2}), ("commit", {"transaction": "one"})
    )
    assert failed
    assert wrong
    assert "transaction 1 is" in why
    blender_code.run(ACROSS)
    ((failed, said),) = called(server, ("commit", {"transaction": 1}))
    assert not failed
    assert json.loads(said)["judgement"]["accepted"]


#: What makes the chair, which is undeclared, a part of what is declared: all in one edit.
ADOPTED = {
    "parented to what is declared": (
        "o['Chair'].parent = o['Cup']; o['Chair'].location.x += 1",
        ("transform", "parent"),
    ),
    "put into a declared collection": (
        "bpy.data.collections['Things'].objects.link(o['Chair']); o['Chair'].location.x += 1",
        ("transform", "collection"),
    ),
    "a camera of its own below what is declared": (
        "n = bpy.data.objects.new('Eye', bpy.data.cameras.new('Eye')); n.parent = o['Cup'];"
        "bpy.context.scene.collection.objects.link(n); bpy.context.scene.camera = n",
        ("added", "camera"),
    ),
    "declared afterwards by taking its name": (
        "o['Cup'].name = 'Old'; o['Chair'].name = 'Cup'",
        ("transform", "added", "removed", "mesh", "data", "property"),
    ),
    "in a collection that is only instanced": (
        "bpy.data.objects['Hidden'].data.vertices[0].co.z += 1; o['Cup'].location.x += 0.1",
        ("transform",),
    ),
    "in the compositor": (
        "s = bpy.context.scene; g = bpy.data.node_groups.new('C', 'CompositorNodeTree');"
        "s.compositing_node_group = g; o['Cup'].location.x += 0.1",
        ("transform",),
    ),
}
THINGS = """
import bpy
o, s = bpy.data.objects, bpy.context.scene
things, kept = bpy.data.collections.new("Things"), bpy.data.collections.new("Kept")
s.collection.children.link(things)
things.objects.link(o["Cup"])
s.collection.objects.unlink(o["Cup"])
hidden = bpy.data.objects.new("Hidden", o["Crate"].data.copy())
kept.objects.link(hidden)
shown = bpy.data.objects.new("Shown", None)
shown.instance_type, shown.instance_collection = "COLLECTION", kept
s.collection.objects.link(shown)
"""


@pytest.mark.parametrize("name", ADOPTED)
def test_what_was_not_declared_does_not_become_declared_within_the_edit(case, blender_code, name):
    code, wanted = ADOPTED[name]
    blender_code.run(THINGS)
    begun = case.begin(Declaration(editable=("Cup", "Things"), kinds=wanted))
    blender_code.run(f"import bpy; o = bpy.data.objects; {code}")
    judgement, _ = case.commit()
    assert not judgement.accepted
    assert "undeclared" in {v.why for v in judgement.violations}
    assert case.rollback().scene_signature == begun.scene_signature


#: A texture of the chair, and other bytes in its file: of the same size and modification time.
PAINTED = """
import bpy, os
image = bpy.data.images.new("Wood", 4, 4)
image.filepath_raw = os.path.join(os.path.dirname(bpy.data.filepath), "wood.png")
image.file_format = "PNG"
image.save()
image.source = "FILE"
material = bpy.data.materials.new("Wood")
material.use_nodes = True
material.node_tree.nodes.new("ShaderNodeTexImage").image = image
bpy.data.objects["Chair"].data.materials.append(material)
"""
REPAINTED = """
import bpy, os
path = bpy.path.abspath(bpy.data.images["Wood"].filepath)
about = os.stat(path)
with open(path, "r+b") as stream:
    stream.seek(-1, os.SEEK_END)
    stream.write(b"?")
os.utime(path, ns=(about.st_atime_ns, about.st_mtime_ns))
"""


def test_a_texture_file_that_keeps_its_time_is_a_change(case, blender_code):
    blender_code.run(PAINTED)
    case.begin(MOVE_CUP)
    assert case.diff() == ()
    blender_code.run(REPAINTED)
    assert {change.entity for change in case.diff()} == {"Chair"}


def test_an_edit_without_a_transaction_is_named_by_the_next_begin(tmp_path, case, blender_code):
    server = plugin_server(case, None)
    begin = {"editable": ["Cup"], "kinds": ["transform"]}
    ((_, first),) = called(server, ("begin", begin))
    assert json.loads(first)["unguarded"] == []
    blender_code.run(ACROSS)
    assert case.commit()[0].accepted
    blender_code.run(CHAIR)
    delivered = export(case, render_wh=(64, 48))
    assert any("Chair (transform)" in warning for warning in delivered.warnings)
    ((_, second),) = called(server, ("begin", begin))
    assert json.loads(second)["unguarded"] == [{"entity": "Chair", "kind": "transform"}]
    assert read_ledger(tmp_path)[-1].answer["unguarded"]


def test_what_could_not_be_read_again_is_not_written(tmp_path, case):
    with pytest.raises(UsageError, match="cannot be recorded"):
        case.record("measure", {"note": "\ud800"}, lambda: None)
    with pytest.raises(UsageError, match="cannot be recorded"):
        case.record("measure", {"tolerance": math.nan}, lambda: None)
    case.record("measure", {}, lambda: None)
    assert len(read_ledger(tmp_path)) == 1


def test_where_a_transaction_is_required_such_an_edit_is_refused_and_undone(
    tmp_path, blender_code, blender
):
    case = reopen_case(tmp_path, blender_code, blender, strict=True)
    case.begin(MOVE_CUP)
    blender_code.run(ACROSS)
    assert case.commit()[0].accepted
    committed = case.ledger.entries[-1].scene_signature
    with pytest.raises(TransactionError, match="no transaction is open"):
        case.rollback()  # nothing was edited since
    blender_code.run(CHAIR)
    for refused in (lambda: case.begin(MOVE_CUP), lambda: export(case, render_wh=(64, 48))):
        with pytest.raises(TransactionError, match=r"Chair \(transform\)"):
            refused()
    assert case.rollback().scene_signature == committed
    assert case.begin(MOVE_CUP).answer["unguarded"] == []


def test_a_commit_without_requirements_does_not_finish_what_another_required(case, blender_code):
    case.begin(Declaration(editable=("Cup",), kinds=("transform",), requirements=(ON_TABLE,)))
    blender_code.run(ACROSS)
    assert case.commit()[0].accepted
    assert not any("validate" in left for left in list_unfinished(case.ledger.entries, ()))
    case.begin(MOVE_CUP)
    blender_code.run("import bpy; bpy.data.objects['Cup'].location.z += 1")
    assert case.commit()[0].accepted
    left = list_unfinished(case.ledger.entries, ())
    assert any("validate" in sentence for sentence in left), left


def test_limits_do_not_come_from_a_client(case, blender_code):
    server = plugin_server(case, None)
    for asked in ({"limits": {"transactions": 99}}, {"transactions": 99}, {"rounds": 99}):
        begin = {"editable": ["Cup"], "kinds": ["transform"], **asked}
        called(server, ("begin", begin), ("rollback", asked))  # refused or ignored
    assert case.count("rollback") <= TransactionLimits().rollbacks
    with pytest.raises(TransactionError, match=r"no rollbacks left|no transaction is open"):
        case.rollback()


@pytest.mark.parametrize(
    "requirement",
    [
        {"kind": "support", "entity": "Cup", "tolerance_m": math.nan},
        {"kind": "support", "entity": "Cup", "tolerance_m": math.inf},
        {"kind": "support", "entity": "Cup", "tolerance_m": -1},
        {"kind": "dimensions", "entity": "Cup", "low_m": [math.nan] * 3, "high_m": [1, 1, 1]},
        {"kind": "visibility", "entity": "Cup", "area_px": -5},
        {"kind": "containment", "entity": "Cup", "inside": "Table", "share": 1.5},
        {"kind": "layout", "entities": ["Cup"]},
        {"kind": "existence", "entity": ""},
    ],
)
def test_a_number_that_is_none_is_refused_and_opens_nothing(case, requirement):
    begin = {"editable": ["Cup"], "kinds": ["transform"], "requirements": [requirement]}
    server = plugin_server(case, None)
    answers = called(server, ("begin", begin), ("measure", {"requirements": [requirement]}))
    assert all(failed for failed, _ in answers), answers
    assert case.phase == "idle"


@pytest.mark.parametrize("value", ["float('nan')", "float('inf')", "1e30"])
def test_a_place_that_is_none_is_an_error_and_is_rolled_back(case, blender_code, value):
    wanted = (ON_TABLE, kinds.ValidTransform(entity="Cup"))
    begun = case.begin(Declaration(editable=("Cup",), kinds=("transform",), requirements=wanted))
    blender_code.run(f"import bpy; bpy.data.objects['Cup'].location.x = {value}")
    with pytest.raises(NonFiniteGeometryError, match="Cup"):
        case.commit()
    assert "Cup" in case.ledger.entries[-1].error
    assert case.rollback().scene_signature == begun.scene_signature


def test_a_ledger_that_is_written_to_by_another_ends_the_server(tmp_path, case, blender_code):
    """Through the endpoint where that has no sandbox, else by any other program."""
    case.begin(MOVE_CUP)
    kept = (tmp_path / LEDGER).read_bytes()
    forged = kept.replace(b'"Cup"', b'"Cap"')
    tell = f"open({str(tmp_path / LEDGER)!r}, 'wb').write({forged!r})"
    with contextlib.suppress(BlenderRefusedError):  # the sandbox: the ledger cannot be reached
        blender_code.run(tell)
    if (tmp_path / LEDGER).read_bytes() == kept:
        (tmp_path / LEDGER).write_bytes(forged)
    with pytest.raises(LedgerBrokenError, match="changed by another program"):
        case.commit()
    with pytest.raises(LedgerBrokenError):
        read_ledger(tmp_path)


def test_an_older_ledger_in_its_place_is_refused(tmp_path, case, blender_code):
    case.begin(MOVE_CUP)
    older = (tmp_path / LEDGER).read_bytes()
    blender_code.run(ACROSS)
    case.commit()
    (tmp_path / LEDGER).write_bytes(older)
    with pytest.raises(LedgerBrokenError, match="changed by another program"):
        case.begin(MOVE_CUP)


def test_a_stored_state_that_was_changed_is_no_base(tmp_path, case, blender_code):
    case.begin(MOVE_CUP)
    (state,) = (tmp_path / "states").glob("*.json")
    state.write_text(state.read_text().replace('"Cup"', '"Mug"'))
    blender_code.run(ACROSS)
    with pytest.raises(LedgerBrokenError, match="another signature"):
        case.commit()
    assert case.ledger.entries[-1].error is not None


def test_other_evidence_does_not_continue_a_case(tmp_path, blender_code, blender):
    one, other = evidence_with([]), evidence_with([], hfov_deg=60)
    reopen_case(tmp_path, blender_code, blender, evidence=one).serve()
    reopen_case(tmp_path, blender_code, blender, evidence=one).serve()
    for evidence in (other, None):
        with pytest.raises(TransactionError, match="other evidence"):
            reopen_case(tmp_path, blender_code, blender, evidence=evidence).serve()
    assert [entry.tool for entry in read_ledger(tmp_path)] == ["serve"]
    assert list_unfinished(read_ledger(tmp_path), ()) == ()


#: Runs in Blender after each save: what the plugin then finds in its copy's place.
SWAP = """
import bpy, os, shutil
@bpy.app.handlers.persistent
def swap(path, *_):
    copy = os.path.join(os.path.dirname(bpy.data.filepath), ".legoworld-live.blend")
    if os.path.exists(copy):
        os.remove(copy)
        os.symlink({target!r}, copy)
bpy.app.handlers.save_post.append(swap)
"""


def test_a_link_in_the_copy_s_place_is_not_followed(tmp_path, case, blender_code):
    victim = tmp_path / "victim.blend"
    before = b"not the plugin's"
    victim.write_bytes(before)
    case.begin(MOVE_CUP)
    blender_code.run(SWAP.format(target=str(victim)))
    try:
        for call in (case.commit, case.rollback):
            with pytest.raises(BlenderRefusedError, match="cannot be read from here"):
                call()
    finally:
        blender_code.run("import bpy; bpy.app.handlers.save_post.clear()")
    assert victim.read_bytes() == before
    assert case.phase == "open"


def test_a_client_that_leaves_within_a_commit_leaves_a_whole_ledger(
    tmp_path, endpoint, blender_code, blender
):
    """Whether the commit was still made is open; it is on record or the transaction is open."""
    case = reopen_case(tmp_path, blender_code, blender)
    case.begin(MOVE_CUP)
    blender_code.run(ACROSS)
    hello = {"protocolVersion": "2025-06-18", "capabilities": {},
             "clientInfo": {"name": "liar", "version": "1"}}  # fmt: skip
    lines = [
        {"jsonrpc": "2.0", "id": 1, "method": "initialize", "params": hello},
        {"jsonrpc": "2.0", "method": "notifications/initialized"},
        {"jsonrpc": "2.0", "id": 2, "method": "tools/call",
         "params": {"name": "commit", "arguments": {}}},
    ]  # fmt: skip
    served_by = subprocess.run(
        [sys.executable, "-m", "legoworld", "plugin", "serve", "--ledger", str(tmp_path),
         "--blender", f"127.0.0.1:{endpoint.server.port}"],
        input="".join(canonical(line) + "\n" for line in lines).encode(),
        capture_output=True, timeout=300, check=False,
    )  # fmt: skip
    assert served_by.returncode == 0, served_by.stderr.decode()[-500:]
    again = reopen_case(tmp_path, blender_code, blender)
    if again.phase == "open":
        assert again.commit()[0].accepted
    entries = read_ledger(tmp_path)
    assert sum(e.tool == "commit" and e.phase == "idle" for e in entries) == 1
