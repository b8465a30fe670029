"""What an agent is told and shown of a photo, to the letter."""

from __future__ import annotations

import hashlib
import json
import re

import pytest
from agents.tracks import make_track

from legoworld.agents.workspaces import load_trial_setup, make_workspace, plan_workspace
from legoworld.errors import UsageError
from legoworld.plugin.modules import MODULES
from legoworld.readouts.family import protocol
from legoworld.readouts.instructions import instructions, instructions_text


def track_of(folder, *, task="bench", **entry):
    path = make_track(folder, ["Room"], task=task)
    (folder / "photos" / "Room.png").rename(folder / "photos" / "Room.PNG")
    document = json.loads(path.read_text())
    document["images"][0] |= {"file_name": "Room.PNG", **entry}
    document["categories"].append({"id": 2, "name": "table"})
    path.write_text(json.dumps(document))
    return path


def make_trial_workspace(folder, path, task=None, *, limit=90.0, modules=()):
    work = load_trial_setup(path, folder / "photos", task, modules)
    (folder / "work").mkdir(exist_ok=True)
    (image,) = work.track.images
    return work, image, make_workspace(work, image, folder / "work", time_limit_s=limit)


def test_an_agent_is_told_the_photo_its_view_the_folder_the_time_and_the_categories(tmp_path):
    _, _, workspace = make_trial_workspace(tmp_path, track_of(tmp_path, hfov_deg=61.25))
    folder = tmp_path / "work"
    assert workspace.folder == folder
    assert workspace.image == folder / "reference.png"
    text = workspace.prompt
    assert text.startswith(
        "You see one reference image, reference.png: 64 x 48 pixels, taken with a horizontal field "
        "of view of 61.25 degrees. It is the only"
    )
    assert f"Save the scene as {folder}/scene.blend" in text
    assert "scene.glb" not in text, "one file is asked for"
    assert "You have 1.5 minutes." in text
    assert text.endswith("\nThe categories of objects that may appear: chair, table.\n")
    assert (folder / "prompt.md").read_text() == text
    assert workspace.image.read_bytes() == (tmp_path / "photos" / "Room.PNG").read_bytes()
    assert list((folder / "tmp").iterdir()) == []


def test_what_is_public_is_the_track_s_entry_under_the_copy_s_name(tmp_path):
    path = track_of(tmp_path, hfov_deg=50.0, more="of its own")
    _, _, workspace = make_trial_workspace(tmp_path, path)
    entry = json.loads(path.read_text())["images"][0]
    assert json.loads((tmp_path / "work" / "task.json").read_text()) == {
        "image": {**entry, "file_name": "reference.png"},
        "image_sha256": hashlib.sha256(workspace.image.read_bytes()).hexdigest(),
        "task": "bench",
        "categories": ["chair", "table"],
    }


def test_without_a_view_or_categories_nothing_is_said_of_them(tmp_path):
    path = track_of(tmp_path)
    document = json.loads(path.read_text())
    document["categories"] = []
    path.write_text(json.dumps(document))
    work, _, workspace = make_trial_workspace(tmp_path, path, "bench")
    assert "64 x 48 pixels. It is" in workspace.prompt
    assert "categories" not in workspace.prompt
    assert work.categories == []
    assert (work.schema, work.vocabulary_sha256) == ("", None)
    assert workspace.prompt.endswith("save early, and again.\n")


def test_a_task_with_a_vocabulary_says_its_labels(tmp_path):
    work, _, workspace = make_trial_workspace(tmp_path, track_of(tmp_path, task="coco"))
    reading = protocol("coco", work.track.vocabulary)
    assert (work.task, work.vocabulary_sha256) == ("coco", reading.vocabulary.sha256)
    assert work.schema == instructions_text(instructions(reading, "agent"))
    assert '["category"] = "' in work.schema, "the label is shown by an example"
    assert not re.search(r"legoworld|labels\.json|scene\.glb|freeze", work.schema)
    assert workspace.prompt.endswith(f"and again.\n\n{work.schema}")
    both = f"{work.template}\n{work.schema}"
    assert work.prompt_sha256 == hashlib.sha256(both.encode()).hexdigest()
    asked, _, _ = make_trial_workspace(
        tmp_path / "other", track_of(tmp_path / "other", task="coco"), "bench"
    )
    assert asked.task == "bench", "what is asked for goes before what the track says"


def test_a_track_that_does_not_say_its_task_needs_one(tmp_path):
    path = track_of(tmp_path)
    document = json.loads(path.read_text())
    del document["info"]
    path.write_text(json.dumps(document))
    with pytest.raises(UsageError, match=r"does not say .*track\.json.*--task coco or .*pass"):
        load_trial_setup(path, tmp_path / "photos", None)


def test_each_module_of_the_plugin_that_is_on_has_a_line(tmp_path):
    path = track_of(tmp_path)
    plain = load_trial_setup(path, tmp_path / "photos", None).template
    some = load_trial_setup(path, tmp_path / "photos", None, ("records", "evidence")).template
    assert some.startswith(plain + "\nA second MCP server, `legoworld`")
    lines = some.splitlines()[-2:]
    assert [line.split()[1] for line in lines] == ["reference_evidence", "history"]
    assert some.endswith("- history and review show what was done and measured.\n")
    assert "- measure" not in some
    every = load_trial_setup(path, tmp_path / "photos", None, MODULES).template.splitlines()[-6:]
    assert [line.split()[1] for line in every] == [
        "reference_evidence", "initialize", "measure", "begin", "history", "look",
    ]  # fmt: skip
    assert "unknown, with residuals." in every[2]
    assert every[3].endswith("Declare every edit of a scene that stands already.")


def test_without_its_photo_there_is_no_workspace(tmp_path):
    path = track_of(tmp_path)
    (tmp_path / "photos" / "Room.PNG").unlink()
    work, image, workspace = make_trial_workspace(tmp_path, path)
    assert workspace is None
    assert plan_workspace(work, image, tmp_path / "work", time_limit_s=60.0) is None
    assert list((tmp_path / "work").iterdir()) == []
