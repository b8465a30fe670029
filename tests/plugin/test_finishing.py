"""validate, review and export over a real endpoint, and the resources they leave."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import anyio
import cv2
import msgspec
import numpy as np
import pytest
from mcp import Client
from plugin.talking import called

from legoworld.errors import SceneInvalidError
from legoworld.plugin import final_steps
from legoworld.plugin.final_steps import (
    StaleError,
    _review_size,
    export,
    note_review,
    render_for_review,
    validate,
)
from legoworld.plugin.open_ledger import TransactionError
from legoworld.plugin.remaining_work import list_unfinished
from legoworld.plugin.server import plugin_server
from legoworld.plugin.state import NOTHING, read_live
from legoworld.records import plugin_requirements as kinds
from legoworld.records.base import readable
from legoworld.records.plugin_ledger import Declaration

pytestmark = pytest.mark.blender

STANDS = kinds.Support(entity="Cup", on="Table")


@pytest.fixture
def run(blender_code):
    return blender_code.run


def test_a_case_from_a_commit_to_its_files(case, run, tmp_path):
    case.begin(Declaration(editable=("Cup",), kinds=("transform",), requirements=(STANDS,)))
    run("import bpy; bpy.data.objects['Cup'].location.x += 0.1")
    with pytest.raises(TransactionError, match="is open"):
        export(case)
    assert case.commit()[0].accepted

    report = validate(case, [kinds.Existence(entity="Chair"), STANDS])
    assert [r.requirement for r in report.results] == [STANDS, kinds.Existence(entity="Chair")]
    assert not report.blocked
    assert "No render" in list_unfinished(case.ledger.entries, [])[0]

    made, png = render_for_review(case)
    picture = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape == (120, 160, 3)  # the scene's own size: there is no photo
    assert case.artefacts.read(made.render_sha256, "png") == png
    assert render_for_review(case)[1] == png
    assert "is not reviewed" in list_unfinished(case.ledger.entries, [])[0]
    note_review(case, made.render_sha256, ["the cup stands too far left"])
    assert list_unfinished(case.ledger.entries, []) == ()

    done = export(case, render_wh=(96, 54))
    folder = tmp_path / "export"
    assert {"scene.blend", "scene.glb", "render.png"} <= set(done.files)
    assert {p.name for p in folder.iterdir()} == set(done.files)
    assert cv2.imread(str(folder / "render.png")).shape == (54, 96, 3)
    assert list_unfinished(case.ledger.entries, []) == ()
    last = case.ledger.entries[-1]
    assert (last.tool, last.request) == ("export", {"render_wh": [96, 54]})

    run("import bpy; bpy.data.objects['Cup'].location.z += 1")
    with pytest.raises(StaleError, match="no such render"):
        note_review(case, "0" * 64, [])
    again = validate(case, [])  # what the committed transaction required
    assert [r.verdict for r in again.results] == ["fail"]
    with pytest.raises(StaleError, match="another state"):
        note_review(case, made.render_sha256, [])
    assert len(list_unfinished(case.ledger.entries, [])) == 2


def test_an_export_that_reads_as_another_scene_is_refused(case, monkeypatch, tmp_path):
    def read_another(path, reader):
        found = read_live(path, reader)
        if other != NOTHING and path.parent != tmp_path / "export":
            return found
        return replace(found, state=msgspec.structs.replace(found.state, geometry_signature=other))

    monkeypatch.setattr(final_steps, "read_live", read_another)
    for other in ("f" * 64, NOTHING):
        with pytest.raises(SceneInvalidError, match=f"not the live one; found: {other}"):
            export(case, render_wh=(96, 54))
    assert case.ledger.entries[-1].error


def test_reports_and_renders_are_resources_by_hash(case):
    server = plugin_server(case, None)
    answers = called(
        server, ("validate", {"requirements": [{"kind": "existence", "entity": "Cup"}]})
    )
    report = json.loads(answers[0][1])

    async def talk():
        async with Client(server) as client:
            looked = await client.call_tool("review", {})
            said = json.loads(looked.content[0].text)
            kept = await client.read_resource(f"legoworld://reports/{report['report_sha256']}")
            shown = await client.read_resource(f"legoworld://renders/{said['render_sha256']}")
            noted = await client.call_tool(
                "review", {"render_sha256": said["render_sha256"], "findings": ["too dark"]}
            )
            return looked.content[1], kept.contents[0], shown.contents[0], noted

    picture, kept, shown, noted = anyio.run(talk)
    assert json.loads(kept.text)["scene_signature"] == report["scene_signature"]
    assert kept.text == readable(case.ledger.entries[0].answer)
    assert picture.type == "image"
    assert shown.blob == picture.data
    assert json.loads(noted.content[0].text)["findings"] == ["too dark"]


@pytest.mark.parametrize("sha256", ["0" * 64, "../../ledger", "x"])
def test_an_unknown_hash_is_refused(case, sha256):
    from legoworld.errors import UsageError

    with pytest.raises(UsageError, match="no such artefact"):
        case.artefacts.read(sha256, "json")


@pytest.mark.parametrize(
    ("size", "shown"),
    [((1600, 900), (800, 450)), ((900, 1600), (450, 800)), ((800, 600), (800, 600)),
     ((64, 48), (64, 48)), ((4000, 1), (800, 1))],
)  # fmt: skip
def test_a_review_is_800_pixels_long_at_most(size, shown):
    scene = SimpleNamespace(snapshot=SimpleNamespace(render=SimpleNamespace(size_wh=size)))
    assert _review_size(SimpleNamespace(evidence=None), scene) == shown
    other = SimpleNamespace(evidence=SimpleNamespace(size_wh=(80, 60)))
    assert _review_size(other, scene) == (80, 60), "the photo's where there is one"
