"""Tokens of steps, streamed messages and pictures, as the four agents write them."""

from __future__ import annotations

import base64
import hashlib
import json

import pytest

from legoworld.records.atif import AtifTrajectory
from legoworld.records.base import UNSET, canonical, decode
from legoworld.trajectories.steps import PICTURES, without_pictures
from legoworld.trajectories.transcripts import read_transcript, total_usage

PNG = b"\x89PNG\r\n\x1a\n" + bytes(range(256))
TEXT = base64.b64encode(PNG).decode()
SHOWN = f"[image/png, {len(PNG)} bytes, sha256 {hashlib.sha256(PNG).hexdigest()}]"
#: What the model's side counted: input, cached, output.
COUNTED = {
    "claude-2.1.330": ("claude", (9880, 1600, 428)),
    "codex-0.169.0": ("codex", (8610, 1400, 371)),
    "opencode-1.18.33": ("opencode", (8610, 1400, 371)),
    "gemini-0.61.0": ("gemini", (9810, 1600, 421)),
}


def read(tmp_path, kind: str, *events: dict):
    path = tmp_path / "transcript.jsonl"
    path.write_text("".join(json.dumps(event) + "\n" for event in events), encoding="utf-8")
    return read_transcript(path, kind, agent="a", version="1", prompt="p")


def completions(trajectory) -> list[int | None]:
    found = [s.metrics.completion_tokens for s in trajectory.steps if s.metrics is not UNSET]
    return [None if value is UNSET else value for value in found]


def claude(number: int, output: int) -> dict:
    usage = {"input_tokens": 10, "cache_read_input_tokens": 5, "output_tokens": output}
    content = [{"type": "text", "text": f"step {number}"}]
    return {
        "type": "assistant",
        "message": {"id": f"m{number}", "usage": usage, "content": content},
    }


@pytest.mark.parametrize(("each", "expected"), [((1, 1), [None, None]), ((30, 12), [30, 12])])
def test_claude_s_placeholders_are_no_counts(tmp_path, each, expected):
    total = {"input_tokens": 20, "cache_read_input_tokens": 10, "output_tokens": 42}
    lines = [claude(n, output) for n, output in enumerate(each)]
    found = read(tmp_path, "claude", *lines, {"type": "result", "usage": total})
    assert completions(found) == expected
    assert [s.metrics.prompt_tokens for s in found.steps if s.metrics is not UNSET] == [15, 15]
    assert total_usage(found).completion_tokens == 42


@pytest.mark.parametrize("messages", [1, 3])
def test_codex_counts_a_turn_and_not_its_last_step(tmp_path, messages):
    items = [
        {"type": "item.completed", "item": {"id": f"{n}", "type": "agent_message", "text": "x"}}
        for n in range(messages)
    ]
    usage = {"input_tokens": 100, "cached_input_tokens": 20, "output_tokens": 7}
    found = read(tmp_path, "codex", *items, {"type": "turn.completed", "usage": usage})
    assert completions(found) == ([7] if messages == 1 else [])
    assert total_usage(found).completion_tokens == 7


def test_gemini_s_streamed_pieces_are_one_step(tmp_path):
    def piece(text: str, *, delta: bool = True) -> dict:
        return {"type": "message", "role": "assistant", "content": text, "delta": delta}

    tool = {"type": "tool_use", "tool_id": "t", "tool_name": "look", "parameters": {}}
    found = read(tmp_path, "gemini", piece("a "), piece("b "), piece("c"), tool, piece("d"),
                 piece("whole", delta=False), piece("another", delta=False))  # fmt: skip
    said = [s.message for s in found.steps if s.source == "agent"]
    assert said == ["a b c", "", "d", "whole", "another"]


@pytest.mark.parametrize("text", [TEXT, f"data:image/png;base64,{TEXT}"])
def test_a_picture_is_its_size_and_hash(text):
    block = {"type": "image", "source": {"type": "base64", "data": text}}
    assert without_pictures([block])[0]["source"]["data"] == SHOWN


@pytest.mark.parametrize(
    ("begin", "kind"),
    [
        (b"\x89PNG\r\n\x1a\n", "png"), (b"\xff\xd8\xff\xe0", "jpeg"),
        (b"RIFF\0\0\0\0WEBP", "webp"), (b"GIF89a", "gif"), (b"GIF87a", "gif"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("length", [48, 47, 45, 42])
def test_every_kind_of_picture_from_64_letters_on(begin, kind, length):
    data = begin.ljust(length, b"\1")
    text = base64.b64encode(data).decode()
    sha256 = hashlib.sha256(data).hexdigest()
    shown = f"[image/{kind}, {length} bytes, sha256 {sha256}]"
    assert without_pictures(text) == (shown if len(text) >= 64 else text)
    assert without_pictures(text[:-1]) == text[:-1], "a part of one is no picture"


@pytest.mark.parametrize("text", ["short", "iVBORw0KGgo is how a PNG begins. " * 9, "a" * 400])
def test_other_text_stays(text):
    assert without_pictures({"a": [text, 3, None]}) == {"a": [text, 3, None]}


@pytest.mark.real_data
@pytest.mark.parametrize("name", COUNTED)
def test_real_recordings_count_what_the_model_s_side_counted(real_data, name):
    kind, counted = COUNTED[name]
    path = real_data / "transcripts" / f"{name}.jsonl"
    found = read_transcript(path, kind, agent="a", version="1", prompt="p")
    usage = total_usage(found)
    assert (usage.prompt_tokens, usage.cached_tokens, usage.completion_tokens) == counted
    steps = [value for value in completions(found) if value is not None]
    assert steps == [] or sum(steps) == counted[2]
    assert "iVBORw0KGgo" not in canonical(found)
    assert "/9j/" not in canonical(found)


def blocks_of(kind: str) -> list[dict]:
    """Lines of a transcript of this kind with one picture that a tool came back with."""
    if kind == "claude":
        picture = {"type": "image", "source": {"type": "base64", "data": TEXT}}
        call = {"type": "tool_use", "id": "c", "name": "look", "input": {}}
        result = {"type": "tool_result", "tool_use_id": "c", "content": [picture]}
        return [
            {"type": "assistant", "message": {"id": "m", "content": [call]}},
            {"type": "user", "message": {"content": [result]}, "again": {"base64": TEXT}},
        ]
    content = [{"type": "text", "text": "so"}, {"type": "image", "data": TEXT, "mimeType": "x"}]
    item = {"id": "i", "type": "mcp_tool_call", "tool": "look", "result": {"content": content}}
    return [{"type": "item.completed", "item": item}]


@pytest.mark.parametrize("kind", ["claude", "codex"])
def test_a_picture_is_a_file_that_its_part_names(tmp_path, kind):
    path = tmp_path / "transcript"
    path.write_text("".join(json.dumps(line) + "\n" for line in blocks_of(kind)))
    scene = tmp_path / "scene"
    found = read_transcript(
        path, kind, agent="a", version="1", prompt="p", scene_folder=scene
    )  # fmt: skip
    (result,) = [s.observation.results[0] for s in found.steps if s.observation]
    picture = result.content[-1]
    (file,) = (scene / PICTURES).iterdir()
    assert picture == {
        "type": "image",
        "source": {"media_type": "image/png", "path": f"{PICTURES}/{file.name}"},
    }
    assert file.read_bytes() == base64.b64decode(TEXT)
    assert file.stem == hashlib.sha256(file.read_bytes()).hexdigest()
    assert TEXT not in canonical(found)


def test_a_document_in_atif_names_its_pictures_and_an_old_one_is_read_as_it_is(tmp_path):
    old = {"type": "text", "text": json.dumps({"type": "image", "data": SHOWN})}
    new = {"type": "image", "source": {"type": "base64", "media_type": "image/png", "data": TEXT}}
    step = {"step_id": 1, "source": "agent", "message": [old, new]}
    agent = {"name": "a", "version": "1"}
    document = {"schema_version": "ATIF-v1.5", "agent": agent, "steps": [step]}
    path = tmp_path / "transcript.json"
    path.write_text(json.dumps(document))
    found = read_transcript(
        path, "atif", agent="a", version="1", prompt="p", scene_folder=tmp_path
    )  # fmt: skip
    kept, lifted = found.steps[0].message
    assert kept == old
    assert (tmp_path / lifted["source"]["path"]).read_bytes() == base64.b64decode(TEXT)
    read_again = decode(AtifTrajectory, json.dumps(document))
    assert read_again.steps[0].message == [old, new]
