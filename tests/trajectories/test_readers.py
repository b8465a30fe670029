"""Each line of a transcript as the step it becomes, to the last field."""

from __future__ import annotations

from typing import Any

import pytest

from legoworld.records.base import as_json
from legoworld.trajectories.claude_lines import claude_steps
from legoworld.trajectories.event_lines import codex_steps, gemini_steps, opencode_steps
from legoworld.trajectories.steps import ParsedStep, ParsedTranscript, parse_arguments

USAGE = {
    "input_tokens": 5, "cache_creation_input_tokens": 7, "cache_read_input_tokens": 100,
    "output_tokens": 11,
}  # fmt: skip
COUNTED = {"prompt_tokens": 112, "cached_tokens": 100, "completion_tokens": 11}


def steps(reading: ParsedTranscript) -> list[dict[str, Any]]:
    """The steps without what is the same in all: their place, and an empty message."""
    shown = []
    for step in reading.steps:
        row = as_json(step.atif(0))
        assert isinstance(row, dict)
        del row["step_id"]
        shown.append({k: v for k, v in row.items() if (k, v) != ("message", "")})
    return shown


def system(event: Any) -> dict[str, Any]:
    return {"source": "system", "message": event["type"], "extra": {"event": event}}


def tool(identity: str, name: str, arguments: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {"tool_call_id": identity, "function_name": name, "arguments": arguments, **more}


def result(identity: str, content: Any, **extra: Any) -> dict[str, Any]:
    found = {"source_call_id": identity, "content": content, "extra": extra}
    return {"results": [{k: v for k, v in found.items() if (k, v) != ("content", None)}]}


def said(identity, *content, model="m", time=None, usage=None, **event):
    message = {"id": identity, "model": model, "content": [*content]}
    message = {k: v for k, v in message.items() if v is not None}
    if usage is not None:
        message["usage"] = usage
    line = {"type": "assistant", "message": message, **event}
    return line if time is None else {**line, "timestamp": time}


def text(words):
    return {"type": "text", "text": words}


def test_claude_s_message_in_several_lines_is_one_step():
    reading = claude_steps(
        [
            said("1", {"type": "thinking", "thinking": "so", "signature": "s"}, time="t1",
                 usage=USAGE, uuid="u"),
            said("1", {"type": "thinking", "thinking": "and so"}, text("a"), model=None),
            said("1", text("b"), text(None), {"type": "new"}, 5, time="t2", model="m2",
                 usage={**USAGE, "output_tokens": 11}),
            said("1", {"type": "tool_use", "id": "c", "name": "n", "input": {"x": 1}, "more": 2}),
            said("2", {"type": "server_tool_use", "id": "d", "name": "o", "input": 3}),
            said("2", {"type": "tool_use", "name": "without an id"}),
        ]
    )  # fmt: skip
    first, second = steps(reading)
    assert first == {
        "source": "agent", "timestamp": "t2", "model_name": "m", "message": "a\nb",
        "reasoning_content": "so\nand so", "tool_calls": [tool("c", "n", {"x": 1})],
        "metrics": {**COUNTED, "extra": {"usage": USAGE}},
        "extra": {"message": {"id": "1"}, "event": {"uuid": "u"},
                  "blocks": [{"signature": "s"}, {"type": "new"}, 5, {"more": 2}]},
    }  # fmt: skip
    assert second == {
        "source": "agent", "model_name": "m", "tool_calls": [tool("d", "o", {"value": 3})],
        "extra": {"message": {"id": "2"}, "event": {},
                  "blocks": [{"type": "tool_use", "name": "without an id"}]},
    }  # fmt: skip
    assert (reading.model, reading.session_id, reading.total) == ("m", None, None)


def test_claude_s_messages_without_a_name_are_steps_of_their_own():
    reading = claude_steps([said(None, text("a")), said(None, text("b"), model=None)])
    assert [step["message"] for step in steps(reading)] == ["a", "b"]
    assert ["model_name" in step for step in steps(reading)] == [True, False]
    plain = claude_steps([{"type": "assistant", "message": {"content": "only words"}}])
    assert steps(plain)[0]["message"] == "only words"


def came(*blocks, **event):
    return {"type": "user", "message": {"role": "user", "content": [*blocks]}, **event}


def test_what_came_back_is_with_claude_s_call_and_the_rest_is_the_user_s():
    back = {"type": "tool_result", "tool_use_id": "c", "content": "done"}
    other = {"type": "tool_result", "tool_use_id": "of nobody"}
    words = {"type": "user", "message": {"content": "go on"}}
    nothing = {"type": "user", "message": {"role": "user"}}
    reading = claude_steps(
        [
            said("1", {"type": "tool_use", "id": "c", "name": "n", "input": {}}),
            came({**back, "is_error": True, "more": 1}, other, 7, session_id="s", uuid="u"),
            came(back, session_id="s"),
            words,
            nothing,
        ]
    )
    called, rest, said_on, empty = steps(reading)
    assert called["observation"]["results"] == [
        {"source_call_id": "c", "content": "done",
         "extra": {"is_error": True, "more": 1, "event": {"uuid": "u"}}},
        {"source_call_id": "c", "content": "done", "extra": {"is_error": False, "event": {}}},
    ]  # fmt: skip
    assert rest == {
        "source": "user", "extra": {"event": came(other, 7, session_id="s", uuid="u")}
    }  # fmt: skip
    assert said_on == {"source": "user", "message": "go on", "extra": {"event": words}}
    assert empty == {"source": "user", "extra": {"event": came()}}


@pytest.mark.parametrize("of_all", [11, 12])
def test_claude_s_totals_are_its_result_s_and_its_steps_count_where_they_sum_to_it(of_all):
    begun = {"type": "system", "session_id": "s", "model": "m0"}
    end = {"type": "result", "session_id": "s2", "total_cost_usd": 2,
           "usage": {**USAGE, "output_tokens": of_all}}  # fmt: skip
    odd = {"type": "rate"}
    reading = claude_steps([begun, said("1", text("a"), usage=USAGE), odd, 5, end])
    first, step, rate, number, last = steps(reading)
    assert (first, rate, last) == (system(begun), system(odd), system(end))
    assert number == {"source": "system", "message": "5"}
    assert (reading.session_id, reading.model) == ("s2", "m0")
    counted = dict(COUNTED) if of_all == 11 else {"prompt_tokens": 112, "cached_tokens": 100}
    assert step["metrics"] == {**counted, "extra": {"usage": USAGE}}
    assert as_json(reading.total) == {
        "total_prompt_tokens": 112, "total_cached_tokens": 100,
        "total_completion_tokens": of_all, "total_cost_usd": 2.0,
    }  # fmt: skip
    reading = claude_steps([begun, said("1", text("a"), usage={}), {"type": "result"}])
    assert (reading.session_id, reading.total) == ("s", None)
    assert steps(reading)[1]["metrics"] == {
        "prompt_tokens": 0, "cached_tokens": 0, "completion_tokens": 0, "extra": {"usage": {}},
    }  # fmt: skip


def message(role="assistant", **more):
    return {"type": "message", "role": role, **more}


def test_gemini_s_pieces_of_a_message_are_one_step_up_to_another_event():
    use = {"type": "tool_use", "tool_id": "c", "tool_name": "n", "parameters": {"x": 1},
           "timestamp": "t3"}  # fmt: skip
    wrong = {"type": "tool_use", "tool_name": "n"}
    reading = gemini_steps(
        [
            message(content="a", delta=True, timestamp="t1", more=1),
            message("model", content="b", delta=True, timestamp="t2"),
            message(content="c", timestamp="t2"),
            message(content="d", delta=True),
            use,
            message(content="e", delta=True),
            {**use, "tool_id": "d", "more": 2},
            wrong,
            message("user", content="f"),
        ]
    )
    assert steps(reading) == [
        {"source": "agent", "message": "ab", "timestamp": "t1",
         "extra": {"event": {"delta": True, "more": 1}}},
        {"source": "agent", "message": "c", "timestamp": "t2", "extra": {"event": {}}},
        {"source": "agent", "message": "d", "extra": {"event": {"delta": True}}},
        {"source": "agent", "timestamp": "t3", "tool_calls": [tool("c", "n", {"x": 1})]},
        {"source": "agent", "message": "e", "extra": {"event": {"delta": True}}},
        {"source": "agent", "timestamp": "t3", "tool_calls": [tool("d", "n", {"x": 1})],
         "extra": {"event": {"more": 2}}},
        system(wrong),
        system(message("user", content="f")),
    ]  # fmt: skip


def test_gemini_s_results_its_session_and_its_totals():
    use = {"type": "tool_use", "tool_id": "c", "tool_name": "n", "parameters": None}
    back = {"type": "tool_result", "tool_id": "c", "status": "error", "output": "no", "more": 1}
    end = {"type": "result", "stats": {"input_tokens": 3, "output_tokens": 4, "cached": 2}}
    init = {"type": "init", "session_id": "s", "model": "m"}
    strange = {"type": "tool_result", "tool_id": "x", "output": "no"}
    reading = gemini_steps([init, use, back, strange, end, {"type": "result"}])
    assert steps(reading) == [
        system(init),
        {"source": "agent", "tool_calls": [tool("c", "n", {})],
         "observation": result("c", "no", is_error=True, event={"status": "error", "more": 1})},
        system(strange), system(end), system({"type": "result"}),
    ]  # fmt: skip
    assert (reading.session_id, reading.model) == ("s", "m")
    assert as_json(reading.total) == {
        "total_prompt_tokens": 3, "total_completion_tokens": 4, "total_cached_tokens": 2,
    }  # fmt: skip
    reading = gemini_steps([use, {**back, "status": "success"}])
    assert steps(reading)[0]["observation"]["results"][0]["extra"]["is_error"] is False


def test_opencode_s_text_its_calls_and_what_they_used():
    state = {"status": "completed", "input": {"x": 1}, "output": "done", "error": "e", "title": "t"}
    part = {"callID": "c", "id": "p", "tool": "n", "type": "tool", "state": state}
    tokens = {"input": 5, "output": 3, "reasoning": 4, "cache": {"read": 2}}
    finish = {"type": "step_finish", "part": {"tokens": tokens, "cost": 1}}
    odd = {"type": "step_start", "sessionID": "s2"}
    nothing = {"type": "text", "part": 5}
    reading = opencode_steps(
        [
            finish,
            {"type": "text", "sessionID": "s", "part": {"text": "hello", "id": "q"}},
            {"type": "tool_use", "part": part},
            finish,
            {"type": "tool_use", "part": {"id": "p", "tool": "n",
                                          "state": {"status": "error", "error": "no"}}},
            {"type": "step_finish", "part": {"tokens": {"input": 5, "output": 3}}},
            {"type": "tool_use", "part": {"callID": "c"}},
            odd, nothing, "words",
        ]
    )  # fmt: skip
    rows = steps(reading)
    assert rows[0] == system(finish)
    assert rows[1] == {
        "source": "agent", "message": "hello",
        "extra": {"event": {"type": "text", "sessionID": "s"}, "part": {"id": "q"}},
    }  # fmt: skip
    assert rows[2] == {
        "source": "agent", "tool_calls": [tool("c", "n", {"x": 1})],
        "observation": result("c", "done", is_error=False),
        "metrics": {"prompt_tokens": 7, "cached_tokens": 2, "completion_tokens": 7,
                    "cost_usd": 1.0},
        "extra": {"event": {"type": "tool_use"}, "part": {"id": "p", "type": "tool"},
                  "state": {"status": "completed", "title": "t"}},
    }  # fmt: skip
    assert rows[3] == system(finish)
    assert rows[4]["tool_calls"] == [tool("p", "n", {})]
    assert rows[4]["observation"] == result("p", "no", is_error=True)
    assert rows[4]["metrics"]["prompt_tokens"] == 5
    assert (rows[4]["metrics"]["cached_tokens"], rows[4]["metrics"]["completion_tokens"]) == (0, 3)
    assert rows[4]["metrics"].get("cost_usd") is None
    assert rows[6]["tool_calls"] == [tool("c", "None", {})]
    assert rows[6]["extra"]["state"] == {}
    assert rows[7:] == [system(odd), system(nothing), {"source": "system", "message": "words"}]
    assert reading.session_id == "s2"


def item(kind, **more):
    return {"type": kind, "item": more}


def test_codex_s_items_are_steps_and_an_open_one_has_no_result():
    mcp = {"id": "1", "type": "mcp_tool_call", "server": "b", "tool": "n", "arguments": {"x": 1}}
    done = {"content": [text("done")], "structured_content": None}
    run = {"id": "2", "type": "command_execution", "command": "ls"}
    reading = codex_steps(
        [
            {"type": "thread.started", "thread_id": "t", "more": 1},
            {"type": "turn.started"},
            {"type": "turn.started", "more": 2},
            item("item.completed", id="0", type="agent_message", text="hello"),
            item("item.completed", id="0", item_type="assistant_message", text="old"),
            item("item.completed", id="0", type="reasoning", text="so"),
            item("item.started", **mcp, status="in_progress", early=1),
            item("item.completed", id="1", type="mcp_tool_call", result=done, status="completed"),
            item("item.completed", **{**mcp, "id": "3"}, error={"message": "no"}, status="failed"),
            item("item.completed", **run, aggregated_output="a", exit_code=0, status="completed"),
            item("item.completed", id="4", type="web_search", query="q"),
            item("item.completed", id="5", type="file_change", changes=[1], status="failed"),
            item("item.completed", id="6", type="todo_list", items=[2], status="completed"),
            item("item.completed", id="7", type="of tomorrow"),
            item("item.started", **run),
            item("item.updated", **run, more=1),
        ]
    )
    (thread, turn, hello, old, so, call, failed, ran, search, changed, todo, tomorrow,
     opened) = steps(reading)  # fmt: skip
    assert thread == system({"type": "thread.started", "more": 1})
    assert turn == system({"type": "turn.started", "more": 2})
    assert hello == {"source": "agent", "message": "hello", "extra": {"item": {"id": "0"}}}
    assert old == {"source": "agent", "message": "old", "extra": {"item": {"id": "0"}}}
    assert so == {"source": "agent", "reasoning_content": "so", "extra": {"item": {"id": "0"}}}
    asked = tool("1", "n", {"x": 1}, extra={"server": "b"})
    assert call == {
        "source": "agent", "tool_calls": [asked],
        "observation": result("1", "done", is_error=False),
        "extra": {"item": {"status": "completed", "early": 1, "result": done}},
    }  # fmt: skip
    assert failed["tool_calls"] == [{**asked, "tool_call_id": "3"}]
    assert failed["observation"] == result("3", "no", is_error=True)
    assert ran == {
        "source": "agent", "tool_calls": [tool("2", "command_execution", {"command": "ls"})],
        "observation": result("2", "a", is_error=False),
        "extra": {"item": {"exit_code": 0, "status": "completed"}},
    }  # fmt: skip
    assert search == {"source": "agent", "tool_calls": [tool("4", "web_search", {"query": "q"})]}
    assert changed["tool_calls"] == [tool("5", "file_change", {"changes": [1]})]
    (came_back,) = changed["observation"]["results"]
    assert (came_back.get("content"), came_back["extra"]) == (None, {"is_error": True})
    assert todo["tool_calls"] == [tool("6", "todo_list", {"items": [2]})]
    assert todo["observation"]["results"][0]["extra"] == {"is_error": False}
    assert tomorrow == {
        "source": "system", "message": "of tomorrow",
        "extra": {"item": {"id": "7", "type": "of tomorrow"}},
    }  # fmt: skip
    assert opened == {
        "source": "agent", "tool_calls": [tool("2", "command_execution", {"command": "ls"})],
        "extra": {"item": {"more": 1}},
    }  # fmt: skip
    assert (reading.session_id, reading.total) == ("t", None)


def test_codex_counts_a_turn_s_tokens_at_its_only_step():
    usage = {"input_tokens": 5, "cached_input_tokens": 2, "output_tokens": 3}
    turn = {"type": "turn.completed", "usage": usage}
    one = item("item.completed", id="0", type="agent_message", text="a")
    other = item("item.completed", id="7", type="error")
    bare = {"type": "turn.completed"}
    reading = codex_steps([one, other, {**turn, "more": 1}, one, one, turn, one, turn, turn, bare])
    rows = steps(reading)
    counted = {"prompt_tokens": 5, "cached_tokens": 2, "completion_tokens": 3}
    with_metrics = [row.get("metrics") for row in rows]
    assert with_metrics[0] == with_metrics[6] == {**counted, "extra": {"usage": usage}}
    assert sum(found is not None for found in with_metrics) == 2
    assert rows[2] == system({"type": "turn.completed", "more": 1})
    assert rows[5] == rows[7] == system(turn)
    assert rows[8] == system(bare)
    assert as_json(reading.total) == {
        "total_prompt_tokens": 20, "total_cached_tokens": 8, "total_completion_tokens": 12,
    }  # fmt: skip


@pytest.mark.parametrize("source", ["user", "system", "agent"])
def test_only_an_agent_s_step_has_what_only_an_agent_does(source):
    made = ParsedStep(source=source, model="m", reasoning="r", timestamp="t", extra={"x": 1})
    found = as_json(made.atif(4))
    both = {"step_id": 4, "source": source, "message": "", "timestamp": "t", "extra": {"x": 1}}
    own = {"model_name": "m", "reasoning_content": "r"} if source == "agent" else {}
    assert found == {**both, **own}


def test_arguments_are_an_object():
    assert [parse_arguments(v) for v in (None, {"a": 1}, [], 0)] == [
        {}, {"a": 1}, {"value": []}, {"value": 0},
    ]  # fmt: skip
