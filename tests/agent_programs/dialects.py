"""The four APIs: what a request offers and holds, and a reply as each writes it."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

Body = dict[str, Any]
#: Claude Code's tool that shows the model tools which its request leaves out.
SEARCH = "ToolSearch"
#: Codex's tool that runs JavaScript, in which its other tools are functions.
EXEC = "functions.exec"
WAITING = "text('waiting');"


@dataclass(frozen=True, kw_only=True)
class Reply:
    """Words, then perhaps one call. usage: prompt, cached and completion tokens."""

    number: int
    says: str
    tool: str | None
    arguments: dict[str, Any]
    usage: tuple[int, int, int]


@dataclass(frozen=True, kw_only=True)
class Dialect:
    """One API. path: a pattern; tools: names offered; results: how many calls were answered."""

    path: str
    tools: Callable[[Body], list[str]]
    results: Callable[[Body], int]
    streams: Callable[[str, Body], bool]
    stream: Callable[[Reply], str]
    whole: Callable[[Reply], str]


def _events(events: list[Body], *, named: bool) -> str:
    lines = [
        (f"event: {event['type']}\n" if named else "") + f"data: {json.dumps(event)}\n\n"
        for event in events
    ]
    return "".join(lines)


# https://docs.anthropic.com/en/api/messages-streaming


def _anthropic_usage(reply: Reply) -> Body:
    prompt, cached, completion = reply.usage
    return {
        "input_tokens": prompt - cached, "cache_creation_input_tokens": 0,
        "cache_read_input_tokens": cached, "output_tokens": completion,
    }  # fmt: skip


def _anthropic_blocks(reply: Reply) -> list[Body]:
    blocks: list[Body] = [{"type": "text", "text": reply.says}]
    if reply.tool is not None:
        call = {"id": f"toolu_{reply.number:04}", "name": reply.tool, "input": reply.arguments}
        blocks.append({"type": "tool_use", **call})
    return blocks


def _anthropic_whole(reply: Reply) -> str:
    return json.dumps(_anthropic_message(reply, _anthropic_blocks(reply)))


def _anthropic_message(reply: Reply, content: list[Body]) -> Body:
    return {
        "id": f"msg_{reply.number:04}", "type": "message", "role": "assistant",
        "model": "scripted", "content": content, "stop_reason": _anthropic_stop(reply),
        "stop_sequence": None, "usage": _anthropic_usage(reply),
    }  # fmt: skip


def _anthropic_stop(reply: Reply) -> str:
    return "tool_use" if reply.tool else "end_turn"


def _anthropic_stream(reply: Reply) -> str:
    message = _anthropic_message(reply, []) | {"stop_reason": None}
    message["usage"] = message["usage"] | {"output_tokens": 1}
    events: list[Body] = [{"type": "message_start", "message": message}]
    for index, block in enumerate(_anthropic_blocks(reply)):
        if block["type"] == "text":
            empty, delta = {**block, "text": ""}, {"type": "text_delta", "text": block["text"]}
        else:
            empty = {**block, "input": {}}
            delta = {"type": "input_json_delta", "partial_json": json.dumps(block["input"])}
        events += [
            {"type": "content_block_start", "index": index, "content_block": empty},
            {"type": "content_block_delta", "index": index, "delta": delta},
            {"type": "content_block_stop", "index": index},
        ]
    events += [
        {"type": "message_delta", "usage": _anthropic_usage(reply),
         "delta": {"stop_reason": _anthropic_stop(reply), "stop_sequence": None}},
        {"type": "message_stop"},
    ]  # fmt: skip
    return _events(events, named=True)


def _blocks(body: Body) -> Iterator[Body]:
    for message in body.get("messages", []):
        if isinstance(message.get("content"), list):
            yield from message["content"]


def _anthropic_results(body: Body) -> int:
    """Answered calls but those of ToolSearch, which finds the tools that a script means."""
    searches = {b["id"] for b in _blocks(body) if b.get("name") == SEARCH}
    results = [b for b in _blocks(body) if b.get("type") == "tool_result"]
    return sum(result["tool_use_id"] not in searches for result in results)


ANTHROPIC = Dialect(
    path=r"/v1/messages$",
    tools=lambda body: [tool["name"] for tool in body.get("tools", [])],
    results=_anthropic_results,
    streams=lambda _path, body: bool(body.get("stream")),
    stream=_anthropic_stream,
    whole=_anthropic_whole,
)

# https://platform.openai.com/docs/api-reference/responses-streaming


def _responses_output(reply: Reply) -> list[Body]:
    text = {"type": "output_text", "text": reply.says, "annotations": []}
    output: list[Body] = [
        {"type": "message", "id": f"msg_{reply.number}", "role": "assistant",
         "status": "completed", "content": [text]}
    ]  # fmt: skip
    if reply.tool == EXEC:
        call = {"type": "custom_tool_call", "id": f"ctc_{reply.number}", "status": "completed",
                "call_id": f"call_{reply.number}", "name": "exec", "namespace": "functions",
                "input": reply.arguments["input"]}  # fmt: skip
        output.append(call)
    elif reply.tool is not None:
        space, _, name = reply.tool.rpartition(".")
        call = {"type": "function_call", "id": f"fc_{reply.number}", "status": "completed",
                "call_id": f"call_{reply.number}", "name": name,
                "arguments": json.dumps(reply.arguments)}  # fmt: skip
        output.append(call | ({"namespace": space} if space else {}))
    return output


def _response(reply: Reply) -> Body:
    prompt, cached, completion = reply.usage
    usage = {
        "input_tokens": prompt, "input_tokens_details": {"cached_tokens": cached},
        "output_tokens": completion, "output_tokens_details": {"reasoning_tokens": 0},
        "total_tokens": prompt + completion,
    }  # fmt: skip
    return {
        "id": f"resp_{reply.number}", "object": "response", "status": "completed",
        "model": "scripted", "output": _responses_output(reply), "usage": usage,
    }  # fmt: skip


def _responses_stream(reply: Reply) -> str:
    begun = _response(reply) | {"status": "in_progress", "output": [], "usage": None}
    events: list[Body] = [{"type": "response.created", "response": begun}]
    for index, item in enumerate(_responses_output(reply)):
        events.append({"type": "response.output_item.added", "output_index": index, "item": item})
        events.append({"type": "response.output_item.done", "output_index": index, "item": item})
    events.append({"type": "response.completed", "response": _response(reply)})
    return _events([{**e, "sequence_number": n} for n, e in enumerate(events)], named=True)


def _responses_tools(body: Body) -> list[str]:
    found = []
    later = [i["tools"] for i in body["input"] if i.get("type") == "additional_tools"]
    for tool in itertools.chain(body.get("tools", []), *later):
        if "tools" in tool:  # a namespace
            found += [f"{tool['name']}.{inner['name']}" for inner in tool["tools"]]
        elif "name" in tool:
            found.append(tool["name"])
    return found


def _responses_results(body: Body) -> int:
    """Answered calls but those that only waited."""
    idle = {item["call_id"] for item in body["input"] if item.get("input") == WAITING}
    results = [i for i in body["input"] if str(i.get("type")).endswith("call_output")]
    return sum(result["call_id"] not in idle for result in results)


RESPONSES = Dialect(
    path=r"/responses$",
    tools=_responses_tools,
    results=_responses_results,
    streams=lambda _path, body: bool(body.get("stream")),
    stream=_responses_stream,
    whole=lambda reply: json.dumps(_response(reply)),
)

# https://platform.openai.com/docs/api-reference/chat/streaming


def _chat(reply: Reply, kind: str) -> Body:
    message: Body = {"role": "assistant", "content": reply.says}
    if reply.tool is not None:
        function = {"name": reply.tool, "arguments": json.dumps(reply.arguments)}
        message["tool_calls"] = [
            {"index": 0, "id": f"call_{reply.number}", "type": "function", "function": function}
        ]
    prompt, cached, completion = reply.usage
    return {
        "id": f"chat_{reply.number}", "model": "scripted", "created": 0,
        "object": "chat.completion" if kind == "message" else "chat.completion.chunk",
        "choices": [
            {"index": 0, kind: message, "finish_reason": "tool_calls" if reply.tool else "stop"}
        ],
        "usage": {
            "prompt_tokens": prompt, "completion_tokens": completion,
            "total_tokens": prompt + completion, "prompt_tokens_details": {"cached_tokens": cached},
        },
    }  # fmt: skip


CHAT = Dialect(
    path=r"/chat/completions$",
    tools=lambda body: [tool["function"]["name"] for tool in body.get("tools", [])],
    results=lambda body: sum(m.get("role") == "tool" for m in body.get("messages", [])),
    streams=lambda _path, body: bool(body.get("stream")),
    stream=lambda reply: _events([_chat(reply, "delta")], named=False) + "data: [DONE]\n\n",
    whole=lambda reply: json.dumps(_chat(reply, "message")),
)

# https://ai.google.dev/api/generate-content


def _gemini(reply: Reply) -> Body:
    parts: list[Body] = [{"text": reply.says}]
    if reply.tool is not None:
        parts.append({"functionCall": {"name": reply.tool, "args": reply.arguments}})
    prompt, cached, completion = reply.usage
    return {
        "candidates": [
            {"index": 0, "content": {"role": "model", "parts": parts}, "finishReason": "STOP"}
        ],
        "usageMetadata": {
            "promptTokenCount": prompt, "cachedContentTokenCount": cached,
            "candidatesTokenCount": completion, "totalTokenCount": prompt + completion,
        },
        "modelVersion": "scripted",
    }  # fmt: skip


def _gemini_tools(body: Body) -> list[str]:
    groups = [tool.get("functionDeclarations", []) for tool in body.get("tools", [])]
    return [one["name"] for group in groups for one in group]


def _gemini_results(body: Body) -> int:
    return sum(
        "functionResponse" in part
        for content in body.get("contents", [])
        for part in content.get("parts", [])
    )


GEMINI = Dialect(
    path=r":(streamGenerateContent|generateContent)$",
    tools=_gemini_tools,
    results=_gemini_results,
    streams=lambda path, _body: path.endswith("streamGenerateContent"),
    stream=lambda reply: _events([_gemini(reply)], named=False),
    whole=lambda reply: json.dumps(_gemini(reply)),
)

DIALECTS = (ANTHROPIC, RESPONSES, CHAT, GEMINI)
