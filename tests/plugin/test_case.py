"""Transactions over a real endpoint: good edits commit, harmful ones return to the same bytes."""

from __future__ import annotations

import socket

import pytest
from plugin.live_room import reopen_case

from legoworld.plugin.connection import Address, BlenderConnection, BlenderUnreachableError
from legoworld.plugin.ledger import LedgerBrokenError, read_ledger
from legoworld.plugin.open_ledger import TransactionError
from legoworld.records import plugin_requirements as kinds
from legoworld.records.plugin_ledger import Declaration

pytestmark = pytest.mark.blender

ON_TABLE = kinds.Support(entity="Cup", on="Table")
MOVE_CUP = Declaration(
    editable=("Cup",), protected=("Table",), kinds=("transform",), requirements=(ON_TABLE,)
)
ACROSS = "import bpy; bpy.data.objects['Cup'].location.x += 0.3"


def test_a_good_edit_commits(case, blender_code):
    begun = case.begin(MOVE_CUP)
    blender_code.run(ACROSS)
    judgement, report = case.commit()
    assert judgement.accepted
    assert [(c.entity, c.kind) for c in judgement.allowed] == [("Cup", "transform")]
    assert report.scene_signature != begun.scene_signature
    assert case.phase == "idle"


HARMFUL = {
    "moved into the air": ("o['Cup'].location.z += 0.4", "blocked"),
    "moved the table": (
        "o['Cup'].location.x += 0.3; o['Table'].location.x += 0.01",
        "protected",
    ),
    "moved what was not declared": (
        "o['Cup'].location.x += 0.3; o['Chair'].location.x += 1",
        "undeclared",
    ),
    "changed the camera": ("bpy.context.scene.camera.data.lens = 80", "undeclared"),
    "deleted a mesh": ("bpy.data.objects.remove(o['Cup'])", "kind not declared"),
    "swapped a material": (
        "o['Table'].data.materials[0] = bpy.data.materials.new('Gold')",
        "protected",
    ),
    "added what was not declared": ("bpy.ops.mesh.primitive_cube_add()", "undeclared"),
    "changed the resolution": ("bpy.context.scene.render.resolution_x = 7", "undeclared"),
    "did nothing": ("pass", "nothing"),
}


@pytest.mark.parametrize("name", HARMFUL)
def test_a_harmful_edit_is_refused_and_rolled_back_to_the_same_signature(
    case, blender_code, endpoint, name
):
    code, why = HARMFUL[name]
    on_disk = (endpoint.workspace / "room.blend").read_bytes()
    begun = case.begin(MOVE_CUP)
    blender_code.run(f"import bpy; o = bpy.data.objects; {code}")
    judgement, report = case.commit()
    assert not judgement.accepted
    if why == "blocked":
        assert [r.verdict for r in report.results] == ["fail"]
    elif why != "nothing":
        assert why in {v.why for v in judgement.violations}
    assert case.phase == "open"
    state = case.rollback()
    assert state.scene_signature == begun.scene_signature
    assert case.measure([ON_TABLE]).scene_signature == begun.scene_signature
    assert case.phase == "idle"
    said = blender_code.run("import bpy; print(bpy.data.filepath)").strip()
    assert said == str(endpoint.workspace / "room.blend")
    assert (endpoint.workspace / "room.blend").read_bytes() == on_disk
    assert sorted(p.name for p in endpoint.workspace.glob("*legoworld*")) == []


def test_a_refused_edit_can_be_corrected(case, blender_code):
    case.begin(MOVE_CUP)
    blender_code.run("import bpy; bpy.data.objects['Cup'].location.z += 0.4")
    assert not case.commit()[0].accepted
    blender_code.run("import bpy; bpy.data.objects['Cup'].location = (0.3, 0, 0)")
    assert case.commit()[0].accepted


def test_limits_are_the_servers(tmp_path, blender_code, blender):
    case = reopen_case(tmp_path, blender_code, blender, transactions=2, rollbacks=1, rounds=1)
    case.begin(MOVE_CUP)
    for _ in range(2):
        assert not case.commit()[0].accepted
    with pytest.raises(TransactionError, match="no corrections left"):
        case.commit()
    case.rollback()
    case.begin(MOVE_CUP)
    with pytest.raises(TransactionError, match="no rollbacks left"):
        case.rollback()
    blender_code.run(ACROSS)
    assert case.commit()[0].accepted
    with pytest.raises(TransactionError, match="no transactions left"):
        case.begin(MOVE_CUP)


def test_without_corrections_and_rollbacks_left_the_way_back_is_free(
    tmp_path, blender_code, blender
):
    """What was committed before can still be delivered."""
    case = reopen_case(tmp_path, blender_code, blender, transactions=3, rollbacks=0, rounds=0)
    case.begin(MOVE_CUP)
    blender_code.run(ACROSS)
    assert case.commit()[0].accepted
    begun = case.begin(MOVE_CUP)
    with pytest.raises(TransactionError, match="no rollbacks left"):
        case.rollback()
    assert not case.commit()[0].accepted
    with pytest.raises(TransactionError, match="no corrections left"):
        case.commit()
    assert case.rollback().scene_signature == begun.scene_signature
    assert case.phase == "idle"


@pytest.mark.parametrize("tool", ["commit", "rollback", "diff"])
def test_without_a_transaction_there_is_nothing_to_end(case, tool):
    with pytest.raises(TransactionError, match="no transaction is open"):
        getattr(case, tool)()
    assert case.ledger.entries[-1].error is not None


def test_one_transaction_at_a_time(case):
    case.begin(MOVE_CUP)
    with pytest.raises(TransactionError, match="is open"):
        case.begin(MOVE_CUP)
    assert case.phase == "open"


def test_protecting_what_is_not_there_is_refused(case):
    with pytest.raises(TransactionError, match="Tabel"):
        case.begin(Declaration(editable=("Cup",), protected=("Tabel",), kinds=("transform",)))
    assert case.phase == "idle"


def test_a_case_goes_on_from_its_ledger(tmp_path, case, blender_code, blender):
    begun = case.begin(MOVE_CUP)
    blender_code.run(ACROSS)
    with (tmp_path / "ledger.jsonl").open("ab") as stream:
        stream.write(b'{"seq": 2, "previous": "')  # killed while it wrote
    again = reopen_case(tmp_path, blender_code, blender)
    assert (again.phase, again.transaction) == ("open", 1)
    assert [(c.entity, c.kind) for c in again.diff()] == [("Cup", "transform")]
    assert again.rollback().scene_signature == begun.scene_signature


def test_a_dead_blender_is_an_error_and_no_edit(tmp_path, blender):
    with socket.socket() as bound:
        bound.bind(("127.0.0.1", 0))  # nobody listens, and nobody else can
        port = bound.getsockname()[1]
        case = reopen_case(tmp_path, BlenderConnection(Address(port=port)), blender)
        with pytest.raises(BlenderUnreachableError):
            case.begin(MOVE_CUP)
    (entry,) = read_ledger(tmp_path)
    assert (entry.phase, entry.answer) == ("idle", None)
    assert f"127.0.0.1:{port}" in entry.error


def test_a_ledger_that_was_changed_is_refused(tmp_path, case):
    case.measure([ON_TABLE])
    case.measure([ON_TABLE])
    path = tmp_path / "ledger.jsonl"
    whole = path.read_text()
    assert len(read_ledger(tmp_path)) == 2
    for broken in (
        whole.replace('"verdict":"pass"', '"verdict":"fail"', 1),
        whole.splitlines(keepends=True)[1],
        "".join(reversed(whole.splitlines(keepends=True))),
    ):
        path.write_text(broken)
        with pytest.raises(LedgerBrokenError):
            read_ledger(tmp_path)
