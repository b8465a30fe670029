"""Recorded transcripts in each agent's own format: read as ATIF, without loss."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from legoworld.records.atif import AtifObservation, AtifTrajectory
from legoworld.records.base import as_json, canonical, decode
from legoworld.trajectories.steps import parse_content
from legoworld.trajectories.transcripts import parsed_lines, read_transcript, total_usage

NONE = AtifObservation(results=[])
FOLDER = Path(__file__).with_name("transcripts")
KINDS = ["codex", "claude", "gemini", "opencode"]


def read(kind: Any, path: Path | None = None) -> AtifTrajectory:
    path = path or FOLDER / f"{kind}.jsonl"
    return read_transcript(path, kind, agent=kind, version="1", prompt="Rebuild it.")


def leaves(value: Any) -> Counter[str]:
    """Every text and number in a JSON value, however deep; texts that are JSON are looked into."""
    if isinstance(value, dict):
        return sum((leaves(v) for v in value.values()), Counter())
    if isinstance(value, list):
        return sum((leaves(v) for v in value), Counter())
    return Counter() if value is None or isinstance(value, bool) else Counter([str(value)])


#: Words that say what a line or a block is: the step's own fields say it afterwards.
SAYS_WHAT_IT_IS = {
    "thread.started", "turn.started", "turn.completed", "item.started", "item.updated",
    "item.completed", "reasoning", "mcp_tool_call", "agent_message", "assistant", "user", "text",
    "thinking", "tool_use", "tool_result", "in_progress", "message", "tool", "result",
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_every_word_of_a_transcript_is_in_what_was_read(kind):
    lines = parsed_lines((FOLDER / f"{kind}.jsonl").read_bytes())
    said = set(leaves(lines)) - SAYS_WHAT_IT_IS
    text = canonical(read(kind))
    kept = set(leaves(as_json(read(kind))))
    lost = {word for word in said if word not in kept and canonical(word)[1:-1] not in text}
    assert lost == set()


@pytest.mark.parametrize("kind", ["gemini", "opencode"])
def test_what_has_a_field_of_its_own_is_not_kept_a_second_time(kind):
    lines = parsed_lines((FOLDER / f"{kind}.jsonl").read_bytes())
    said, kept = leaves(lines), leaves(as_json(read(kind)))
    assert {w: n for w, n in kept.items() if len(w) > 20 and w in said and n > said[w]} == {}


@pytest.mark.parametrize(
    ("value", "content"),
    [
        (None, None),
        ("words", "words"),
        ({"b": 1, "a": "é"}, [{"type": "text", "text": '{"a": "é", "b": 1}'}]),
        (7, [{"type": "text", "text": "7"}]),
        ([], ""),
        (["one", {"type": "text", "text": "two"}], "one\ntwo"),
        (
            [{"type": "text", "text": "a", "more": 1}, {"type": "image", "data": "x"}, "b"],
            [
                {"type": "text", "text": "a"},
                {"type": "text", "text": '{"data": "x", "type": "image"}'},
                {"type": "text", "text": "b"},
            ],
        ),
    ],
)
def test_content_as_atif_has_it(value, content):
    assert parse_content(value) == content


@pytest.mark.parametrize("kind", KINDS)
def test_what_was_read_is_atif_and_reads_the_same_again(kind, tmp_path):
    found = read(kind)
    again = decode(AtifTrajectory, canonical(found))
    assert again == found
    assert [step.step_id for step in found.steps] == list(range(1, len(found.steps) + 1))
    atif = pytest.importorskip("atif", reason="the models of ATIF are not installed")
    atif.Trajectory.model_validate(as_json(found))


def calls(found: AtifTrajectory) -> list[tuple[str, Any, Any]]:
    """(tool, code, what came back) of every call."""
    made: list[tuple[str, Any, Any]] = []
    for step in found.steps:
        results = {r.source_call_id: r.content for r in (step.observation or NONE).results}
        made += [
            (call.function_name, call.arguments.get("code"), results.get(call.tool_call_id))
            for call in step.tool_calls or []
        ]
    return made


def test_codex_calls_have_their_results_and_an_unfinished_one_has_none():
    assert calls(read("codex")) == [
        ("execute_blender_code", "import bpy\nbpy.ops.mesh.primitive_cube_add()",
         "Code executed successfully: "),
        ("look", None, "tool call error: timed out awaiting tools/call"),
        ("command_execution", None, "reference.png\ntask.json\n"),
        ("file_change", None, None),
        ("todo_list", None, None),
        ("web_search", None, None),
        ("execute_blender_code", "while True: pass", None),
    ]  # fmt: skip


def test_whether_a_call_failed_and_the_session_are_fields_of_their_own(tmp_path):
    lines = [
        {"type": "assistant", "session_id": "s", "message": {"id": "m", "content": [
            {"type": "tool_use", "id": f"t{k}", "name": "look", "input": {}} for k in range(3)]}},
        {"type": "user", "session_id": "s", "message": {"content": [
            {"type": "tool_result", "tool_use_id": "t0", "content": "a", "is_error": True},
            {"type": "tool_result", "tool_use_id": "t1", "content": "b", "is_error": False},
            {"type": "tool_result", "tool_use_id": "t2", "content": "c"}]}},
    ]  # fmt: skip
    path = tmp_path / "claude.jsonl"
    path.write_text("".join(canonical(line) + "\n" for line in lines))
    (step,) = [s for s in read("claude", path).steps if s.source == "agent"]
    results = (step.observation or NONE).results
    assert [(r.content, r.extra["is_error"]) for r in results] == [
        ("a", True), ("b", False), ("c", False),
    ]  # fmt: skip
    path.write_text(
        canonical({"type": "thread.started", "thread_id": "one"}) + "\n"
        + canonical({"type": "thread.started", "thread_id": "two", "new": 7}) + "\n"
    )  # fmt: skip
    found = read("codex", path)
    assert found.session_id == "two"
    (odd,) = [s for s in found.steps if s.source == "system"]
    assert (odd.message, odd.extra) == (
        "thread.started", {"event": {"type": "thread.started", "new": 7}}
    )  # fmt: skip


def test_claude_blocks_of_one_message_are_one_step_and_its_tokens_count_once():
    found = read("claude")
    first = next(step for step in found.steps if step.source == "agent")
    assert first.message == "I build the room first."
    assert first.reasoning_content == "A room with a chair."
    assert [call.tool_call_id for call in first.tool_calls] == ["toolu_1"]
    assert calls(found)[:2] == [
        ("mcp__blender__execute_blender_code", "import bpy\nprint(1)",
         "Code executed successfully: 1"),
        ("mcp__blender__look", None, "the scene has no active camera"),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "usage"),
    [
        ("codex", (25763, 152, 24448, None)),
        ("claude", (3675, 87, 3500, 0.0352)),
        ("gemini", (50, 200, 7, None)),
        ("opencode", (81, 12, 11, 0.0125)),
    ],
)
def test_tokens_and_cost_are_the_transcript_s(kind, usage):
    found = total_usage(read(kind))
    assert (
        found.prompt_tokens, found.completion_tokens, found.cached_tokens, found.cost_usd
    ) == usage  # fmt: skip


@pytest.mark.parametrize("kind", [*KINDS, "atif"])
def test_no_transcript_is_the_prompt_alone(kind, tmp_path):
    found = read(kind, tmp_path / "none")
    assert [step.message for step in found.steps] == ["Rebuild it."]


@pytest.mark.parametrize("kind", KINDS)
@given(data=st.data())
def test_no_line_breaks_a_reader(kind, data, tmp_path_factory):
    """Lines cut short, doubled and shuffled: agents are killed, and versions change."""
    lines = (FOLDER / f"{kind}.jsonl").read_bytes().splitlines()
    chosen = data.draw(st.lists(st.sampled_from(lines), max_size=12))
    cut = [line[: data.draw(st.integers(0, len(line)))] for line in chosen[:3]]
    path = tmp_path_factory.mktemp("t") / "lines"
    path.write_bytes(b"\n".join([*chosen, *cut]))
    found = read(kind, path)
    assert decode(AtifTrajectory, canonical(found)) == found


@pytest.mark.parametrize("version", ["1.2", "1.4", "1.6", "1.8"])
def test_atif_of_each_version_is_read(version, tmp_path):
    step: dict[str, Any] = {"step_id": 1, "source": "agent", "message": "x", "timestamp": None}
    if version >= "1.3":
        step["metrics"] = {"completion_tokens": 4, "completion_token_ids": [1, 2]}
    if version >= "1.6":
        step["message"] = [{"type": "text", "text": "x"}]
    document = {
        "schema_version": f"ATIF-v{version}", "session_id": "s", "of_tomorrow": 1,
        "agent": {"name": "a", "version": "1"}, "steps": [step],
    }  # fmt: skip
    (tmp_path / "t.json").write_text(canonical(document))
    found = read("atif", tmp_path / "t.json")
    assert found.schema_version == f"ATIF-v{version}"
    assert found.steps[0].message in ("x", [{"type": "text", "text": "x"}])
