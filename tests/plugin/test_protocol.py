"""What a client is offered: schemas, hints, prompts, resources, progress, pages; and cancelling."""

from __future__ import annotations

import json
import socket
import threading

import anyio
import jsonschema
import pytest
from mcp import Client, MCPError
from plugin.talking import called

from legoworld.errors import UsageError
from legoworld.plugin import final_steps, tool_answers
from legoworld.plugin.case import STATES, Case
from legoworld.plugin.connection import Address, BlenderConnection
from legoworld.plugin.ledger import read_ledger
from legoworld.plugin.live import LiveBlender
from legoworld.plugin.server import plugin_server
from legoworld.plugin.tool_schemas import KINDS, decode_arguments, shown_schema
from legoworld.records.plugin_calls import MeasureArguments
from legoworld.records.plugin_ledger import TransactionLimits
from legoworld.scene.blender_process import BlenderProcess, Limits

#: What a model reads of the tools, in tokens of four characters: docs/plugin.md has the figures.
MOST_TOKENS = 1490
MOST_TOKENS_OF_AN_ANSWER = 220
#: Hints by name: read-only, destructive, idempotent.
HINTS = {
    "reference_evidence": (True, False, True),
    "initialize": (False, False, False),
    "plan": (True, False, True),
    "measure": (True, False, True),
    "begin": (False, False, False),
    "status": (True, False, True),
    "diff": (True, False, True),
    "commit": (False, False, False),
    "rollback": (False, True, False),
    "validate": (True, False, True),
    "look": (True, False, True),
    "review": (False, False, False),
    "export": (False, False, True),
    "history": (True, False, True),
    "more": (True, False, True),
}


def compact(value):
    return json.dumps(value, separators=(",", ":"))


def ask_server(server, *steps):
    """What a client is answered by each step, a function of it; an error of the protocol."""

    async def one(client, step):
        try:
            return await step(client)
        except MCPError as error:
            return error

    async def talk():
        async with Client(server) as client:
            return [await one(client, step) for step in steps]

    return anyio.run(talk)


@pytest.fixture
def case(tmp_path):
    return Case(tmp_path, None, None, TransactionLimits())


@pytest.fixture
def tools(case):
    (listed,) = ask_server(plugin_server(case, None), lambda client: client.list_tools())
    return {t.name: t for t in listed.tools}


def test_every_tool_has_a_title_hints_and_a_schema_of_its_answer(tools):
    found = {
        t.name: (
            t.annotations.read_only_hint,
            t.annotations.destructive_hint,
            t.annotations.idempotent_hint,
        )
        for t in tools.values()
    }
    assert found == HINTS
    for tool in tools.values():
        assert tool.title
        assert tool.annotations.open_world_hint is False
        jsonschema.Draft202012Validator.check_schema(tool.input_schema)
        if tool.name in ("look", "review"):  # text and a picture: clients show one or the other
            assert tool.output_schema is None
            continue
        jsonschema.Draft202012Validator.check_schema(tool.output_schema)
        says = tool.output_schema["description"]
        for field, schema in tool.output_schema["properties"].items():
            assert f"{field}:" in says or "$ref" in schema, (tool.name, field)
        assert "Existence" not in tool.output_schema.get("$defs", {})


def test_what_a_model_reads_of_the_tools_stays_short(tools):
    shown = [
        {"name": t.name, "description": t.description, "inputSchema": t.input_schema}
        for t in tools.values()
    ]
    assert len(compact(shown)) / 4 <= MOST_TOKENS


@pytest.mark.parametrize(
    ("requirement", "taken_by"),
    [
        ({"kind": "support", "entity": "Cup", "tolerance_m": 0.02}, "both"),
        ({"kind": "support", "entity": "Cup", "tolerance_m": 0}, "schema"),
        ({"kind": "support"}, "none"),
        ({"kind": "beauty", "entity": "Cup"}, "none"),
        ({"kind": "centroid", "entity": "Cup"}, "none"),
        ({"kind": "centroid", "entity": "Cup", "region": "cup", "accept": "improves"}, "both"),
        ({"kind": "depth_order", "matched": [["a", "b"], ["c", "d"]]}, "both"),
        ({"kind": "dimensions", "entity": "a", "low_m": [0, 0], "high_m": [1, 1, 1]}, "none"),
        ({"kind": "containment", "entity": "a", "inside": "b", "share": 1.5}, "none"),
        ({"kind": "containment", "entity": "a", "inside": "b", "share": -0.5}, "schema"),
    ],
)
def test_the_schema_takes_all_that_the_tool_takes(case, requirement, taken_by):
    """Ranges are left to the tool, whose error names them: a model reads the schema each time."""
    schema = shown_schema("measure", MeasureArguments)
    given = {"requirements": [requirement]}
    assert jsonschema.Draft202012Validator(schema).is_valid(given) is (taken_by != "none")
    if taken_by == "both":
        assert decode_arguments(MeasureArguments, given)
    else:
        with pytest.raises(UsageError, match="the arguments cannot be used"):
            decode_arguments(MeasureArguments, given)


def test_the_union_names_every_kind_and_what_it_needs(tools):
    schema = tools["measure"].input_schema["properties"]["requirements"]["items"]
    found = {}
    for option in schema["oneOf"]:
        kind = option["properties"]["kind"]
        found |= dict.fromkeys(kind.get("enum", [kind.get("const")]), option["required"])
    assert set(found) == set(KINDS)
    assert found["facing"] == ["entity", "towards"]
    assert schema["properties"]["tolerance_deg"]["description"] == "facing 15"
    check = jsonschema.Draft202012Validator(schema).is_valid
    facing = {"kind": "facing", "entity": "a", "towards": "b"}
    assert check(facing)
    assert not any(check({k: v for k, v in facing.items() if k != left}) for left in facing)


@pytest.mark.parametrize(
    ("name", "arguments", "said"),
    [
        ("mesure", {}, "one of reference_evidence, .*nearest: measure"),
        ("measure", {"requirement": []}, "no argument 'requirement'.*nearest: requirements"),
        ("measure", {}, "requirements"),
        (
            "measure",
            {"requirements": [{"kind": "suport", "entity": "Cup"}]},
            r"'suport' at \$.requirements\[0\].kind; expected: one of exist.*nearest: support",
        ),
        (
            "measure",
            {"requirements": [{"kind": "support", "entity": "Cup", "tolerance": 1}]},
            r"support has no argument 'tolerance' at \$.requirements\[0\].*nearest: tolerance_m",
        ),
        (
            "measure",
            {"requirements": [{"kind": "facing", "entity": "Cup", "towards": "a",
                               "tolerance_deg": -1}]},
            r"at \$.requirements\[0\].tolerance_deg; expected: number above 0",
        ),
        ("begin", {"editable": ["Cup"], "kinds": ["transfrom"]},
         r"'transfrom' at \$.kinds\[0\]; expected: one of added, .*nearest: transform"),
        ("begin", {"editable": [], "kinds": ["mesh"]}, r"\$.editable; expected: array at least 1"),
        ("review", {"render_sha256": "x"}, "render_sha256"),
        ("more", {"cursor": "x"}, "cursor names no page"),
        ("more", {"cursor": f"{'0' * 64}.{'9' * 4301}"}, "cursor names no page"),
        ("more", {"cursor": f"{'/' * 64}.1"}, "no such artefact"),
    ],
)  # fmt: skip
def test_an_error_names_what_is_valid_and_nothing_of_ours(case, name, arguments, said):
    import re

    ((failed, text),) = called(plugin_server(case, None), (name, arguments))
    assert failed
    assert re.search(said, text), text
    assert not re.search(r"https?://|Traceback|pydantic|msgspec|File \"|0x[0-9a-f]{6}", text)


def test_an_error_that_is_ours_says_so_and_no_more(case, monkeypatch):
    monkeypatch.setattr(Case, "diff", lambda _: {}["/secret/place"])
    (told,) = ask_server(plugin_server(case, None), lambda client: client.call_tool("diff", {}))
    assert "unexpected error in diff: KeyError; this is a bug in legoworld" in str(told)
    assert "secret" not in str(told)


def test_an_answer_is_compact_json_and_fits_its_schema(case, tools):
    (result,) = ask_server(plugin_server(case, None), lambda client: client.call_tool("status", {}))
    (text,) = result.content
    assert json.loads(text.text) == result.structured_content
    assert text.text == json.dumps(result.structured_content, sort_keys=True, separators=(",", ":"))
    jsonschema.validate(result.structured_content, tools["status"].output_schema)


def test_a_long_answer_comes_in_pages_that_are_the_whole(case, tools, monkeypatch):
    monkeypatch.setattr(tool_answers, "MOST_CHARACTERS", 2000)
    for number in range(150):
        case.record(f"tool {number}", {}, lambda: None)
    ask = plugin_server(case, None)

    async def all_pages(client):
        answer = (await client.call_tool("history", {"last": 200})).structured_content
        jsonschema.validate(answer, tools["history"].output_schema)
        entries, pages = answer["entries"], 1
        while "next_cursor" in answer:
            more = await client.call_tool("more", {"cursor": answer["next_cursor"]})
            assert len(more.content[0].text) < 2500
            answer = more.structured_content
            jsonschema.validate(answer, tools["more"].output_schema)
            assert answer["place"] == "entries"
            entries, pages = entries + answer["items"], pages + 1
        return entries, pages

    ((entries, pages),) = ask_server(ask, all_pages)
    assert [e["tool"] for e in entries] == [f"tool {n}" for n in range(150)]
    assert pages > 3


def test_prompts_and_resources_are_listed_and_read(case):
    sha256 = case.artefacts.keep(b'{"a":1}', "json")
    for number in range(120):
        case.artefacts.keep(b"%d" % number, "md")
    listed, page, more, prompts, prompt, templates, report = ask_server(
        plugin_server(case, None),
        lambda client: client.list_resources(),
        lambda client: client.read_resource("legoworld://requirements"),
        lambda client: client.list_resources(cursor="100"),
        lambda client: client.list_prompts(),
        lambda client: client.get_prompt("refine"),
        lambda client: client.list_resource_templates(),
        lambda client: client.read_resource(f"legoworld://reports/{sha256}"),
    )
    uris = [str(r.uri) for r in listed.resources]
    assert uris[:2] == ["legoworld://requirements", f"legoworld://reports/{sha256}"]
    assert listed.next_cursor == "100"
    assert (len(more.resources), more.next_cursor) == (22, None)
    for name in KINDS:
        assert f"## {name}: " in page.contents[0].text
    assert [p.name for p in prompts.prompts] == ["refine"]
    assert prompt.messages[0].content.text.startswith("# Measured refinement")
    assert {t.uri_template for t in templates.resource_templates} == {
        f"legoworld://{what}/{{sha256}}" for what in ("reports", "texts", "renders")
    }
    assert report.contents[0].text == '{"a":1}'


@pytest.mark.parametrize(
    ("uri", "said"),
    [
        ("legoworld://nothing", "expected: legoworld://requirements"),
        ("legoworld://reports/../../ledger", "no such artefact"),
    ],
)
def test_a_resource_that_is_none_is_refused(case, uri, said):
    (told,) = ask_server(plugin_server(case, None), lambda client: client.read_resource(uri))
    assert isinstance(told, MCPError)
    assert said in str(told)


def test_a_cursor_that_no_list_gave_is_refused(case):
    told = ask_server(
        plugin_server(case, None),
        lambda client: client.list_resources(cursor="9" * 4301),
        lambda client: client.list_resources(cursor="x"),
    )
    assert ["cursor names no page" in str(one) for one in told] == [True, True]


class SilentBlender:
    """A socket that takes a command and never answers."""

    def __init__(self):
        self.asked = threading.Event()
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port = self._listening.getsockname()[1]
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self):
        self._line, _ = self._listening.accept()
        self._line.recv(1 << 16)
        self.asked.set()

    def close(self):
        self._line.close()
        self._listening.close()


def test_a_cancelled_call_waits_for_blender_no_longer(tmp_path):
    silent = SilentBlender()
    (tmp_path / STATES).mkdir()
    with BlenderProcess(Limits()) as reader:
        live = LiveBlender(BlenderConnection(Address(port=silent.port)), reader, tmp_path / STATES)
        server = plugin_server(Case(tmp_path, live, None, TransactionLimits()), None)

        async def talk():
            async with Client(server, mode="legacy") as client:
                with anyio.CancelScope() as scope:

                    async def stop():
                        await anyio.to_thread.run_sync(silent.asked.wait)
                        scope.cancel()

                    async with anyio.create_task_group() as group:
                        group.start_soon(stop)
                        await client.call_tool("measure", {"requirements": []})
                with anyio.fail_after(20):  # Blender's own limit is 180 s
                    return (await client.call_tool("status", {})).structured_content

        assert anyio.run(talk)["phase"] == "idle"
    silent.close()
    (entry,) = read_ledger(tmp_path)
    assert (entry.tool, entry.answer) == ("measure", None)
    assert "the client cancelled the call" in entry.error


@pytest.mark.blender
@pytest.mark.parametrize("last_step", [1, 2])
def test_a_cancelled_review_ends_its_render_and_the_case_goes_on(
    tmp_path, blender_code, blender, last_step, monkeypatch
):
    monkeypatch.setattr(final_steps, "_SAMPLES", 100_000)  # only a cancellation ends it
    (tmp_path / STATES).mkdir(exist_ok=True)
    live = LiveBlender(blender_code, blender, tmp_path / STATES)
    server = plugin_server(Case(tmp_path, live, None, TransactionLimits()), None)
    cup = {"requirements": [{"kind": "existence", "entity": "Cup"}]}

    async def talk():
        async with Client(server, mode="legacy") as client:
            begun = {"editable": ["Cup"], "kinds": ["transform"]}
            assert not (await client.call_tool("begin", begun)).is_error
            with anyio.CancelScope() as scope:

                async def stop_at_the_render(step, _of, _what):
                    if step == last_step:
                        scope.cancel()

                await client.call_tool("review", {}, progress_callback=stop_at_the_render)
            assert scope.cancelled_caught
            monkeypatch.setattr(final_steps, "_SAMPLES", 4)
            steps = []

            async def note(step, of, what):
                steps.append((step, of, what))

            status = await client.call_tool("status", {})
            measured = await client.call_tool("measure", cup)
            looked = await client.call_tool("review", {}, progress_callback=note)
            back = await client.call_tool("rollback", {})
            return status, measured, looked, back, steps

    status, measured, looked, back, steps = anyio.run(talk)
    assert status.structured_content["phase"] == "open"
    assert measured.structured_content["report"]["results"][0]["verdict"] == "pass"
    assert not looked.is_error
    assert not back.is_error
    assert [(step, of) for step, of, _ in steps] == [(0, 3), (1, 3), (2, 3)]
    entries = read_ledger(tmp_path)
    assert [e.tool for e in entries] == ["begin", "review", "measure", "review", "rollback"]
    assert "cancelled" in entries[1].error


@pytest.mark.blender
def test_a_typical_answer_is_short(tmp_path, blender_code, blender, tools):
    (tmp_path / STATES).mkdir(exist_ok=True)
    live = LiveBlender(blender_code, blender, tmp_path / STATES)
    server = plugin_server(Case(tmp_path, live, None, TransactionLimits()), None)
    wanted = [
        {"kind": "existence", "entity": "Cup"},
        {"kind": "support", "entity": "Cup", "on": "Table"},
        {"kind": "collision", "entity": "Cup", "other": "Table"},
        {"kind": "visibility", "entity": "Cup"},
    ]
    move = {"editable": ["Cup"], "kinds": ["transform"], "requirements": wanted}

    async def talk():
        async with Client(server) as client:
            await client.call_tool("begin", move)
            blender_code.run("import bpy; bpy.data.objects['Cup'].location.x += 0.1")
            return await client.call_tool("commit", {})

    answer = anyio.run(talk)
    jsonschema.validate(answer.structured_content, tools["commit"].output_schema)
    assert answer.structured_content["judgement"]["accepted"]
    assert len(answer.content[0].text) / 4 <= MOST_TOKENS_OF_AN_ANSWER
    print(answer.content[0].text)
