"""The hooks of three harnesses from one program, as their shells run it."""

from __future__ import annotations

import json
import subprocess
import sys
from types import SimpleNamespace

import pytest

from legoworld.plugin.hooks import MOST_BLOCKS, HookInputError, HookRules, edits, hook_answer
from legoworld.plugin.ledger import Ledger
from legoworld.plugin.remaining_work import list_unfinished, standing_requirements
from legoworld.records.base import as_json
from legoworld.records.plugin_ledger import Declaration, HookMark
from legoworld.records.plugin_requirements import Centroid

TOOL = {"claude": "mcp__blender__execute_blender_code", "codex": "mcp__b__execute_code",
        "cursor": "execute_blender_code"}  # fmt: skip
BEFORE = {"claude": "PreToolUse", "codex": "PreToolUse", "cursor": "beforeMCPExecution"}
STOP = {"claude": "Stop", "codex": "Stop", "cursor": "stop"}
A, B = "a" * 64, "b" * 64
DIALECTS = list(TOOL)


class Told:
    """A ledger, and a hook that is asked about it."""

    def __init__(self, folder, dialect, **rules):
        self.folder = folder
        self.dialect = dialect
        self.ledger = Ledger(folder)
        self.rules = HookRules(dialect=dialect, ledger=folder, **rules)

    def entry(self, tool, answer=None, phase="idle", signature=A, transaction=None):
        return self.ledger.append(
            tool=tool, request={}, answer=answer, error=None, phase=phase,
            transaction=transaction, signatures=(signature, signature), base_sha256=None,
        )  # fmt: skip

    def ask(self, event, **fields):
        payload = {"hook_event_name": event, "session_id": "s", "cwd": "/", **fields}
        return json.loads(hook_answer(self.rules, json.dumps(payload).encode()))

    def edit(self):
        return self.ask(BEFORE[self.dialect], tool_name=TOOL[self.dialect], tool_input={})

    def stop(self, **fields):
        return self.ask(STOP[self.dialect], **fields)

    def why(self, **fields):
        """Why the agent may not finish; None where it may."""
        answer = self.stop(**fields)
        if self.dialect == "cursor":
            return answer.get("followup_message")
        assert answer == {} or answer["decision"] == "block"
        return answer.get("reason")

    def finish(self):
        self.entry("validate", {"blocked": False})
        self.entry("review", {"render_sha256": B, "findings": ["the lamp is too dark"]})


@pytest.fixture(params=DIALECTS)
def told(request, tmp_path):
    return Told(tmp_path / "case", request.param)


def test_where_nothing_was_done_an_agent_may_finish(told):
    assert told.stop() == {}


def test_an_agent_may_finish_once_all_is_validated_and_reviewed(told):
    assert told.edit() == ({"permission": "allow"} if told.dialect == "cursor" else {})
    assert "call validate" in told.why()
    told.entry("validate", {"blocked": False})
    assert "call review" in told.why()
    told.entry("review", {"render_sha256": B, "findings": None})
    assert B in told.why()
    told.entry("review", {"render_sha256": B, "findings": []})
    assert told.why() is None


def test_an_edit_after_the_end_makes_everything_stale(told):
    told.edit()
    told.finish()
    told.edit()
    assert "stale" in told.why()
    told.finish()
    assert told.why() is None


def test_a_scene_that_was_read_changed_is_stale_without_any_hook(told):
    told.finish()
    told.entry("measure", {"blocked": False}, signature=B)
    assert "stale" in told.why()


def test_an_open_transaction_and_a_failed_requirement_keep_the_agent(told):
    told.finish()
    told.entry("begin", {}, phase="open", transaction=1)
    assert "Transaction 1 is open" in told.why()
    told.entry("commit", [{"accepted": True}, {"blocked": False}], transaction=1)
    told.entry("validate", {"blocked": True})
    assert "does not pass" in told.why()


def test_blocks_end_as_the_harnesses_end_them(told):
    """Eight in a row without a call of the plugin; a call, or being let go, counts anew."""
    told.edit()
    for _ in range(MOST_BLOCKS):
        assert told.why()
    assert told.stop().keys() <= {"systemMessage"}
    assert told.why()
    told.entry("status")
    for _ in range(MOST_BLOCKS):
        assert told.why()


def test_cursor_s_own_count_and_a_turn_that_the_user_ended_are_heeded(tmp_path):
    told = Told(tmp_path, "cursor")
    told.edit()
    assert told.stop(status="completed", loop_count=MOST_BLOCKS) == {}
    assert told.stop(status="aborted", loop_count=0) == {}
    assert "followup_message" in told.stop(status="completed", loop_count=0)


def test_a_transaction_can_be_required_for_every_edit(tmp_path):
    for dialect in DIALECTS:
        told = Told(tmp_path / dialect, dialect, require_transaction=True)
        refused = json.dumps(told.edit())
        assert "deny" in refused
        assert "call begin" in refused
        assert told.stop() == {}  # what was refused is no edit
        told.entry("begin", {}, phase="open", transaction=1)
        assert "deny" not in json.dumps(told.edit())


def test_a_ledger_that_was_changed_blocks_edits_and_the_end(told):
    told.finish()
    path = told.folder / "ledger.jsonl"
    path.write_text(path.read_text().replace("lamp", "lump"))
    assert "cannot be trusted" in told.why()
    assert "deny" in json.dumps(told.edit())


@pytest.mark.parametrize(
    ("tool", "may_edit"),
    [("mcp__blender__execute_blender_code", True), ("MCP:blender:execute_code", True),
     ("mcp__blender__download_polyhaven_asset", True), ("mcp__blender__get_scene_info", False),
     ("mcp__legoworld__commit", False), ("Bash", False), ("", False)],
)  # fmt: skip
def test_which_tools_may_edit(tool, may_edit):
    assert edits(tool) is may_edit


@pytest.mark.parametrize("data", [b"", b"{}", b'{"hook_event_name": "SessionStart"}', b"\xff"])
def test_what_is_no_event_is_an_error(tmp_path, data):
    with pytest.raises(HookInputError):
        hook_answer(HookRules(dialect="claude", ledger=tmp_path), data)


def test_half_a_line_of_a_killed_hook_counts_for_nothing(told):
    told.edit()
    with (told.folder / "hooks.jsonl").open("ab") as stream:
        stream.write(b'{"ledger_seq"')
    assert told.why()


def test_marks_before_a_report_do_not_make_it_stale():
    assert list_unfinished([], [HookMark(ledger_seq=0, what="block")]) == ()


def test_the_command_reads_an_event_with_a_byte_order_mark(tmp_path):
    event = b'\xef\xbb\xbf{"hook_event_name": "Stop", "stop_hook_active": false}'
    command = [sys.executable, "-m", "legoworld", "plugin", "hook", "--dialect", "codex",
               "--ledger", str(tmp_path)]  # fmt: skip
    done = subprocess.run(command, input=event, capture_output=True, check=False)
    assert (done.returncode, done.stdout) == (0, b"{}\n")


def entry(
    tool, *, error=None, phase="idle", answer=None, seq=1, transaction=None, wanted=(), scene="s"
):
    """An entry as far as what is left to do depends on it. wanted: requirements of a begin."""
    asked = as_json(
        Declaration(editable=("room",), kinds=("transform",), requirements=tuple(wanted))
    )
    return SimpleNamespace(
        tool=tool, error=error, phase=phase, answer=answer, seq=seq, transaction=transaction,
        request=asked, scene_signature=scene,
    )  # fmt: skip


def test_what_committed_transactions_required_stands_each_once():
    one, two, three = (Centroid(entity=name, region="r") for name in ("a", "b", "c"))
    entries = [
        entry("begin", wanted=[one, two]), entry("commit", phase="open"),
        entry("begin", error="no", wanted=[three]), entry("commit", error="no"), entry("commit"),
        entry("begin", wanted=[three, one]), entry("rollback"), entry("measure"),
        entry("begin", wanted=[two]), entry("commit"),
    ]  # fmt: skip
    assert standing_requirements(entries) == (one, two)
    assert standing_requirements(entries[:4]) == ()
    assert standing_requirements([*entries[:6], entry("commit")]) == (one, two, three)


def todo(*entries, marks=()):
    """What is left to do, a sentence each, by how it begins and what it asks for."""
    return [" ".join(said.split()[:3]) for said in list_unfinished(entries, marks)]


def test_what_is_left_is_told_in_its_order():
    one, two = (Centroid(entity=name, region="r") for name in ("a", "b"))
    begun = entry("begin", wanted=[one], phase="open", transaction=3, seq=4)
    assert todo(begun) == ["Transaction 3 is"]
    assert todo(entry("serve")) == []
    assert todo(entry("measure")) == ["Nothing was validated:", "No render shows"]
    judged = [{"accepted": True}, {"blocked": False}]
    committed = [begun, entry("commit", answer=judged, seq=5, transaction=3)]
    assert todo(*committed) == ["No render shows"], "a commit that measured all is a report"
    for wanted, stale in (([two], ["The report of"]), ([one, two], [])):
        again = entry("begin", wanted=wanted, phase="open", transaction=4, seq=6)
        commit = entry("commit", answer=judged, seq=7, transaction=4, scene="t")
        assert todo(*committed, again, commit) == [*stale, "No render shows"]
    edit = HookMark(ledger_seq=5, what="edit")
    assert todo(*committed, marks=[edit]) == ["The report of", "No render shows"]
    assert todo(*committed, marks=[HookMark(ledger_seq=4, what="edit")]) == ["No render shows"]
    assert todo(*committed, marks=[HookMark(ledger_seq=5, what="block")]) == ["No render shows"]
    blocked = [committed[0], entry("commit", answer=[judged[0], {"blocked": True}], seq=5)]
    assert todo(*blocked)[0] == "A hard requirement"
    validated = entry("validate", answer={"report": {"blocked": True}, "blocked": True}, seq=8)
    assert todo(*committed, validated)[0] == "A hard requirement"
    broken = entry("validate", error="no", seq=9)
    assert todo(entry("measure"), broken)[0] == "Nothing was validated:"
    looked = entry("review", answer={"render_sha256": "5", "findings": None}, seq=9)
    told = list_unfinished([*committed, looked], ())
    assert told == ("The render 5 is not reviewed: call review with it and your findings.",)


@pytest.mark.parametrize("dialect", DIALECTS)
def test_each_harness_gets_its_own_words(dialect, tmp_path):
    """As their pages state them; after a tool there is nothing to decide."""
    strict = Told(tmp_path / "case", dialect, require_transaction=True)
    why = "No transaction is open: call begin of legoworld with what the edit may change."
    told = {"permission": "deny", "user_message": why, "agent_message": why}
    if dialect != "cursor":
        told = {"hookSpecificOutput": {
            "hookEventName": "PreToolUse", "permissionDecision": "deny",
            "permissionDecisionReason": why,
        }}  # fmt: skip
    assert strict.edit() == told
    after = {"cursor": "afterMCPExecution"}.get(dialect, "PostToolUse")
    assert strict.ask(after, tool_name=TOOL[dialect]) == {}
    look = strict.ask(BEFORE[dialect], tool_name="get_scene_info")
    assert look == ({"permission": "allow"} if dialect == "cursor" else {})
    why = strict.why()
    assert strict.stop() == (
        {"followup_message": why} if dialect == "cursor" else {"decision": "block", "reason": why}
    )
