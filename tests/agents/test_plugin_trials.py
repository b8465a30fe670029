"""`reconstruct --plugin`: recorded steps through both servers, over real MCP clients."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from agents.tracks import make_track, plan, run, server_or_skip

from legoworld import cli
from legoworld.agents.trial_plugin import PLUGIN, PluginOptions, plan_plugin
from legoworld.agents.workspaces import load_trial_setup
from legoworld.errors import UsageError
from legoworld.plugin.ledger import read_ledger
from legoworld.plugin.modules import TOOLS, modules_without
from legoworld.trajectories.folder import TRIAL, read_trial

pytestmark = pytest.mark.blender

BUILD = """
import bpy, os
bpy.context.scene.render.resolution_x, bpy.context.scene.render.resolution_y = 64, 48
camera = bpy.data.objects["Camera"]
camera.location, camera.rotation_euler = (0, -8, 0), (1.5707963, 0, 0)
bpy.data.objects["Cube"]["category"] = "chair"
bpy.data.objects["Cube"].location.x = 0.2
"""
SAVE = "import bpy, os; bpy.ops.wm.save_as_mainfile(filepath=os.getcwd() + '/scene.blend')"
ON_REGION = {"kind": "centroid", "entity": "Cube", "region": "chair 1", "tolerance": 0.1}
DECLARED = {"editable": ["Cube"], "kinds": ["transform"], "requirements": [ON_REGION]}
#: The cube in the middle of the picture, as the start-up scene has it.
REGION = {"image_id": 1, "category_id": 1, "score": 0.9, "bbox": [24.0, 16.0, 16.0, 16.0]}


def code(text):
    return {"tool": "execute_blender_code", "arguments": {"code": f"import bpy\n{text}"}}


def plugin(tool, **arguments):
    return {"server": "legoworld", "tool": tool, "arguments": arguments}


def session(transactions=True):
    """A good edit, and one that takes the cube out of its region and is rolled back."""
    if not transactions:
        return [code(BUILD), plugin("reference_evidence"), code(SAVE)]
    return [
        code(BUILD),
        plugin("reference_evidence"),
        plugin("begin", **DECLARED),
        code("bpy.data.objects['Cube'].location.x = 0.1"),
        plugin("commit"),
        plugin("begin", **DECLARED),
        code("bpy.data.objects['Cube'].location.x = 3"),
        plugin("commit"),
        plugin("rollback"),
        code(SAVE),
    ]


def with_plugin(folder, off=(), regions=()):
    options = PluginOptions(modules=modules_without(off), regions=tuple(regions), depth=None)
    made = plan(folder)
    work = load_trial_setup(folder / "track.json", folder / "photos", "bench", options.modules)
    return replace(made, work=work, plugin=plan_plugin(options, work))


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    """One photo built with the plugin, with a part of it, and without it: folders of scenes."""
    server_or_skip()
    folder = tmp_path_factory.mktemp("plugged")
    make_track(folder, ["room"])
    (folder / "regions.json").write_text(json.dumps([REGION]))
    plans = {
        "with": (session(), with_plugin(folder, regions=[folder / "regions.json"])),
        "part": (session(transactions=False), with_plugin(folder, off=["transactions"])),
        "without": ([code(BUILD), code(SAVE)], plan(folder)),
    }
    for name, (steps, made) in plans.items():
        path = folder / "programs" / "room.steps.jsonl"
        path.parent.mkdir(exist_ok=True)
        path.write_text("".join(json.dumps(step) + "\n" for step in steps))
        (row,) = run(made, folder / name)
        assert row.status == "ok", row
    return folder


def transcript(played, name):
    """trajectory.json as it is written."""
    return json.loads((played / name / "room" / "trajectory.json").read_text())


def answers_of_tool(played, name):
    """Each call of a tool with what it came back with."""
    return [
        (step["tool_calls"][0]["function_name"], step["observation"]["results"][0]["content"])
        for step in transcript(played, name)["steps"]
        if step["source"] == "agent"
    ]


def test_a_good_edit_commits_and_a_harmful_one_is_rolled_back(played):
    answers = [
        (tool, json.loads(text)) for tool, text in answers_of_tool(played, "with") if tool in TOOLS
    ]
    assert [tool for tool, _ in answers] == [
        "reference_evidence", "begin", "commit", "begin", "commit", "rollback",
    ]  # fmt: skip
    evidence, _, good, begun, bad, restored = [answer for _, answer in answers]
    assert [r["name"] for r in evidence["evidence"]["regions"]] == ["chair 1"]
    assert good["judgement"]["accepted"], good
    assert not bad["judgement"]["accepted"]
    assert bad["report"]["results"][0]["verdict"] == "fail"
    assert restored["restored"] == begun["scene_signature"] == good["scene_signature"]


def test_the_ledger_and_the_trial_tell_the_same(played):
    folder = played / "with" / "room"
    entries = read_ledger(folder / TRIAL / PLUGIN)
    assert [e.tool for e in entries] == [
        "serve", "begin", "commit", "begin", "commit", "rollback",
    ]  # fmt: skip
    used = read_trial(folder).about.plugin_calls
    assert used is not None
    assert (used.calls, used.failed, used.transactions) == (5, 0, 2)
    assert (used.committed, used.rolled_back, used.left_open) == (1, 1, False)


def test_calls_of_the_plugin_are_not_the_agents(played):
    trial = read_trial(played / "with" / "room")
    by = [call.by for call in trial.calls]
    assert by.count("agent") == trial.about.calls < len(by)
    numbers = {call.number for call in trial.calls if call.by == "agent"}
    named = [
        number
        for step in transcript(played, "with")["steps"]
        for number in step.get("extra", {}).get("legoworld", {}).get("calls", [])
    ]
    assert len(named) == 4
    assert set(named) <= numbers


def test_a_module_that_is_off_is_not_offered(played):
    offered = transcript(played, "part")["agent"]["tool_definitions"]
    tools = {tool["function"]["name"] for tool in offered}
    assert {"measure", "execute_blender_code"} <= tools
    assert not tools & {"begin", "commit", "rollback", "diff"}


def test_provenance_says_which_modules_were_on(played):
    recorded = {
        name: json.loads((played / name / "room" / "provenance.json").read_text())["plugin"]
        for name in ("with", "part", "without")
    }
    assert recorded["without"] is None
    assert recorded["with"]["modules"] == list(modules_without([]))
    assert recorded["part"]["modules"] == list(modules_without(["transactions"]))


def test_compare_pairs_a_run_with_the_plugin_and_one_without(played, tmp_path):
    """Through real run folders: each image once on both sides, and the difference said."""
    truth = json.loads((played / "track.json").read_text())
    box = {"bbox": REGION["bbox"], "area": 256.0, "iscrowd": 0, "category_id": 1}
    truth["annotations"] = [{"id": 1, "image_id": 1, **box}]
    (tmp_path / "truth.json").write_text(json.dumps(truth))
    for name in ("with", "without"):
        track = ["--task", "coco", "--track", str(played / "track.json")]
        scored = str(tmp_path / f"{name}-run")
        assert cli.run(["readout", str(played / name), *track, "-o", scored, "--no-cache"]) == 0
        evaluated = ["--truth", str(tmp_path / "truth.json"), "-o", str(tmp_path / name)]
        assert cli.run(["evaluate", scored, *evaluated]) == 0
    sides = [str(tmp_path / "with"), str(tmp_path / "without")]
    assert cli.run(["compare", *sides, "-o", str(tmp_path / "compared")]) == 0
    document = json.loads((tmp_path / "compared" / "comparison.json").read_text())
    assert [p["paired_image_ids"] for p in document["pairs"]] == [[1]], document["pairs"]
    told = document["provenance"]["plugin"]
    assert set().union(*told.values()) == {
        "null",
        json.dumps(
            json.loads((played / "with" / "room" / "provenance.json").read_text())["plugin"],
            separators=(",", ":"), sort_keys=True,
        ),
    }  # fmt: skip
    assert any("differ in plugin" in note for note in document["notes"])


def test_runs_of_other_modules_do_not_mix(played):
    with pytest.raises(UsageError, match="another campaign"):
        run(with_plugin(played, off=["records"]), played / "with")


def test_the_prompt_tells_of_the_modules_that_are_on(played):
    texts = {
        name: transcript(played, name)["steps"][0]["message"]
        for name in ("with", "part", "without")
    }
    assert "commit judges it" in texts["with"]
    assert "commit judges it" not in texts["part"]
    assert "reference_evidence" in texts["part"]
    assert "legoworld" not in texts["without"]


def test_regions_made_with_ground_truth_are_refused(tmp_path, played):
    run_folder = tmp_path / "sam3"
    run_folder.mkdir()
    (run_folder / "predictions.json").write_text(json.dumps([REGION]))
    used = {"sha256": "0" * 64, "what": "categories"}
    configuration = {"task": "lvis", "attempted": 1, "used_truth": used}
    (run_folder / "run.json").write_text(json.dumps({"configuration": configuration}))
    command = ["reconstruct", str(played / "track.json"), "--photos", str(played / "photos")]
    command += ["--agent", "program", "--programs", str(played / "programs"), "--plugin"]
    command += ["--regions", str(run_folder), "-o", str(tmp_path / "scenes")]
    assert cli.run(command) != 0
    assert not (tmp_path / "scenes").exists()


def test_plugin_options_need_the_plugin(played, tmp_path, capsys):
    command = ["reconstruct", str(played / "track.json"), "--photos", str(played / "photos")]
    command += ["--agent", "program", "--programs", str(played / "programs")]
    assert cli.run([*command, "--without", "records", "-o", str(tmp_path / "s")]) != 0
    assert "--plugin" in capsys.readouterr().err
