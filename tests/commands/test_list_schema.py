"""`legoworld list schema`: what a scene's author is told, out of the card, and nothing private."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from copy import deepcopy
from dataclasses import replace
from itertools import pairwise

import pytest

from legoworld import cli
from legoworld.errors import CatalogError
from legoworld.files import sha256_of_file
from legoworld.readouts.family import protocol
from legoworld.readouts.instructions import accepted_synonyms, instructions
from legoworld.shipped import catalog
from legoworld.tasks.shipped import TASKS as SHIPPED
from legoworld.tracks.vocabulary import Category, Vocabulary, find_dataset

MAPS = [task.name for task in SHIPPED if task.family.name in ("panoptic", "semantic")]
LABELLED = ["coco", "coco-masks", "amodal", "boxes3d", "lvis", *MAPS]
TASKS = [*LABELLED, "eth3d", "normals", "bench"]
#: Answers of others are imported until a specialist's card names the task.
IMPORTED = ("coco-masks", "amodal", "boxes3d", "normals", "bench", *MAPS)

#: Keys that only annotations have, or that are counted from annotations.
TRUTH_KEYS = {
    "annotations", "segmentation", "bbox", "area", "iscrowd", "images", "frequency", "image_count",
    "instance_count", "neg_category_ids", "not_exhaustive_category_ids", "depth",
}  # fmt: skip


def document(task: str, capsys: pytest.CaptureFixture[str]) -> dict:
    assert cli.run(["list", "schema", "--task", task, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def print_schema(task: str, capsys: pytest.CaptureFixture[str]) -> str:
    assert cli.run(["list", "schema", "--task", task]) == 0
    return capsys.readouterr().out


def text_of(reading) -> str:
    return "\n".join(s for section in instructions(reading).sections for s in section.statements)


def with_card(task: str, key: str, value: object):
    """A task's protocol with one value of its card changed."""
    reading = protocol(task, None)
    values = deepcopy(reading.card.values)
    table, name = key.split(".")
    assert name in values[table]
    values[table][name] = value
    return replace(reading, card=replace(reading.card, values=values))


@pytest.mark.parametrize("task", TASKS)
def test_the_text_and_the_document_say_the_same(task, capsys):
    told, shown = document(task, capsys), print_schema(task, capsys)
    flat = " ".join(shown.split())
    for section in told["sections"]:
        assert f"## {section['title']}" in shown
        assert section["statements"]
        for statement in section["statements"]:
            assert " ".join(statement.split()) in flat
    assert max(map(len, shown.splitlines())) <= 100


def test_what_an_author_needs_is_there(capsys):
    topics = [s["id"] for s in document("coco", capsys)["sections"]]
    assert topics == [
        "deliver", "camera", "units", "seen", "labels", "instances", "output", "check",
    ]  # fmt: skip
    text = print_schema("coco", capsys)
    for needed in (
        "scene.blend", "scene.glb", "final.png", "scene.py", "labels.json", "resolution_x",
        "scene.camera", "clip_end", "metre", "alpha", "Glass", "Volumes", "hide_render",
        '["category"]', "coco_category", "collection", "descendants", "predictions.json",
    ):  # fmt: skip
        assert needed in text, needed


@pytest.mark.parametrize("task", LABELLED)
def test_the_vocabulary_is_complete_and_in_the_datasets_order(task, capsys):
    told = document(task, capsys)
    path = catalog.folder("datasets") / find_dataset(task) / "categories.json"
    names = [c["name"] for c in sorted(json.loads(path.read_text()), key=lambda c: c["id"])]
    assert told["vocabulary"] == names
    after = print_schema(task, capsys).split("\n## Vocabulary: ")[1]
    heading, listed = after.split("\n", 1)
    assert heading == f"{len(names):,} names"
    assert " ".join(listed.split()) == ", ".join(names)
    assert told["vocabulary_sha256"] == protocol(task, None).vocabulary.sha256


def test_synonyms_listed_are_those_a_label_may_use(capsys):
    assert document("coco", capsys)["synonyms"] == {}
    told = document("lvis", capsys)
    lvis = protocol("lvis", None).vocabulary
    assert told["synonyms"]["couch"] == "sofa"
    for synonym, name in told["synonyms"].items():
        assert lvis.match(synonym).name == name
        assert synonym not in told["vocabulary"]


def test_a_synonym_of_two_categories_is_not_listed():
    two = Vocabulary(
        (
            Category(id=1, name="bass_(fish)", synonyms=("bass", "perch")),
            Category(id=2, name="bass_(instrument)", synonyms=("bass",)),
        )
    )
    assert accepted_synonyms(two) == {"perch": "bass_(fish)"}


def test_depth_has_no_labels(capsys):
    told = document("eth3d", capsys)
    assert told["vocabulary"] is told["synonyms"] is told["labels_file"] is None
    assert told["property"] is told["override_property"] is told["vocabulary_sha256"] is None
    text = print_schema("eth3d", capsys)
    assert "Labels play no part" in text
    assert "labels.json" not in text
    assert "Vocabulary" not in text


@pytest.mark.parametrize("task", LABELLED)
def test_the_example_of_labels_json_can_be_used_as_it_is(task, capsys, tmp_path):
    from legoworld.scene.labels import read_labels_file

    told = document(task, capsys)
    (tmp_path / "labels.json").write_text(json.dumps(told["labels_file"]))
    labels = read_labels_file(tmp_path / "labels.json")
    assert [label.kind for label in labels] == ["object", "collection"]
    vocabulary = protocol(task, None).vocabulary
    assert all(vocabulary.match(label.categories["category"]) for label in labels)
    shown = re.search(r'\{"version".*\]\}', " ".join(print_schema(task, capsys).split()))
    assert json.loads(shown.group()) == told["labels_file"]


@pytest.mark.parametrize(
    ("task", "key", "value"),
    [
        ("coco", "visibility.alpha_threshold", 0.25),
        ("coco", "visibility.alpha_sources", ["constant"]),
        ("coco", "visibility.projections", ["perspective"]),
        ("coco", "vocabulary.property", "kind"),
        ("coco", "vocabulary.override_property", "coco_kind"),
        ("coco", "vocabulary.labels_file", "names.json"),
        ("coco", "vocabulary.synonyms", "unambiguous"),
        ("coco", "vocabulary.case_sensitive", True),
        ("coco", "vocabulary.underscore_is_space", False),
        ("coco", "export.min_area_px", 9),
        ("coco", "export.score", 0.75),
        ("coco", "export.file", "boxes.json"),
        ("coco", "export.fields", ["image_id", "box"]),
        ("coco", "scoring.max_detections", 17),
        ("coco", "scoring.max_detections_per", "image"),
        ("lvis", "scoring.max_detections", 17),
        ("lvis", "readout.reads", "boxes"),
        ("eth3d", "holes.error_1_abs_rel", 0.5),
        ("eth3d", "alignment.space", "log_depth"),
        ("eth3d", "export.file", "z/{file_name_stem}.npz"),
    ],
)
def test_what_a_card_declares_is_read_from_it(task, key, value):
    assert text_of(with_card(task, key, value)) != text_of(protocol(task, None))


@pytest.mark.parametrize(
    ("task", "key"),
    [
        *[(task, "visibility." + key) for task in TASKS for key in (
            "camera", "view", "aspect_mismatch", "clip", "camera_object_scale", "frame",
            "geometry", "samples_per_pixel", "sides", "transmission", "volumes",
        ) if (task, key) != ("bench", "aspect_mismatch")],
        *[(task, "vocabulary." + key) for task in LABELLED for key in (
            "case_sensitive", "underscore_is_space", "synonyms", "qualifier", "unknown_name",
            "unlabelled", "nested_instances",
        )],
        *[(task, "scoring.max_detections_per") for task in LABELLED if task not in MAPS],
        *[(task, key) for task in MAPS for key in ("vocabulary.stuff", "export.sky")],
        *[(task, "readout.reads") for task in TASKS],
        ("eth3d", "export.hole"), ("eth3d", "holes.primary"), ("eth3d", "alignment.model"),
    ],
)  # fmt: skip
def test_another_rule_on_the_card_is_never_told_with_the_old_words(task, key):
    with pytest.raises(CatalogError, match=re.escape(f"{key} = 'another'")):
        instructions(with_card(task, key, "another"))


def test_limits_are_the_programs_own(monkeypatch):
    from legoworld.readouts import instructions as module
    from legoworld.scene.blender_process import Limits

    shown = Limits()
    assert f"has {shown.time_s:g} s and {shown.memory_bytes / 2**30:g} GiB" in text_of(
        protocol("coco", None)
    )
    monkeypatch.setattr(module, "Limits", lambda: Limits(time_s=7.0, memory_bytes=3 << 30))
    assert "has 7 s and 3 GiB" in text_of(protocol("coco", None))


@pytest.mark.parametrize("task", TASKS)
def test_the_card_is_named_by_version_and_hash(task, capsys):
    card = document(task, capsys)["card"]
    path = catalog.folder("readouts") / f"{task}.toml"
    assert card["sha256"] == sha256_of_file(path)
    assert f"({card['version']})" in print_schema(task, capsys).splitlines()[0]


def keys_of(value: object):
    if isinstance(value, dict):
        yield from value
        for inner in value.values():
            yield from keys_of(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from keys_of(inner)


@pytest.mark.parametrize("task", TASKS)
def test_no_key_of_truth_appears(task, capsys):
    assert not TRUTH_KEYS & set(keys_of(document(task, capsys)))


#: Each task's files are asked for in a fork: what one has read, no other one finds.
OPENED = """
import json, os, sys
from legoworld.shipped import catalog
opened = set()
def audit(event, arguments):
    if event == "open" and isinstance(arguments[0], str):
        opened.add(arguments[0])
sys.addaudithook(audit)
from legoworld.cli import run
answers = sys.stdout
for task in sys.argv[1:]:
    if child := os.fork():
        assert os.waitpid(child, 0)[1] == 0
        continue
    sys.stdout = open(os.devnull, "w")
    assert run(["list", "schema", "--task", task, "--json"]) == 0
    found = []
    for kind in ("readouts", "datasets", "baselines", "examples"):
        folder = str(catalog.folder(kind)) + "/"
        found += [kind + "/" + p[len(folder):] for p in opened if p.startswith(folder)]
    print(json.dumps([task, found]), file=answers, flush=True)
    os._exit(0)
"""


def test_no_file_but_card_wording_and_vocabulary_is_opened():
    done = subprocess.run(
        [sys.executable, "-c", OPENED, *TASKS], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    found = {task: set(names) for task, names in map(json.loads, done.stdout.splitlines())}
    assert list(found) == list(TASKS)
    for task, names in found.items():
        expected = {f"readouts/{task}.toml", "readouts/instructions/scene.toml"}
        if task in LABELLED:
            expected.add(f"datasets/{find_dataset(task)}/categories.json")
        assert names == expected, task


def test_sections_come_in_one_order_for_every_task(capsys):
    whole = [s["id"] for s in document("coco", capsys)["sections"]]
    for task in TASKS:
        places = [whole.index(s["id"]) for s in document(task, capsys)["sections"]]
        assert all(a < b for a, b in pairwise(places))


def list_names(capsys: pytest.CaptureFixture[str], kind: str, *more: str) -> list[str]:
    assert cli.run(["list", kind, "--json", *more]) == 0
    return [card["name"] for card in json.loads(capsys.readouterr().out)[kind]]


@pytest.mark.parametrize("kind", ["tasks", "datasets", "baselines"])
def test_a_task_leaves_what_is_for_it(kind, capsys):
    every = list_names(capsys, kind)
    by_task = {task: list_names(capsys, kind, "--task", task) for task in TASKS}
    if kind == "tasks":
        # No dataset of them is known, and no baseline: answers are imported, or scenes are scored.
        every = [name for name in every if name not in ("relations", "bench-x")]
    assert sorted({name for names in by_task.values() for name in names}) == every
    for task, names in by_task.items():
        if not names and kind != "tasks" and task in IMPORTED:
            continue  # the bench is made from scenes, and has no specialist
        assert 0 < len(names) < len(every)
        assert names == [name for name in every if name in names]
        if kind != "baselines":
            assert (find_dataset(task) if kind == "datasets" else task) in names
        assert cli.run(["list", kind, "--task", task]) == 0
        lines = capsys.readouterr().out.splitlines()
        # A line that begins with a space goes on with the row before it.
        assert [line.split()[0] for line in lines[2:] if line[0] != " "] == names


def test_baselines_of_a_task(capsys):
    assert list_names(capsys, "baselines", "--task", "lvis") == ["hf-segmenter", "sam3"]


def test_coco_is_the_schema_when_no_task_is_given(capsys):
    assert cli.run(["list", "schema"]) == 0
    assert capsys.readouterr().out == print_schema("coco", capsys)


@pytest.fixture
def own_track(tmp_path):
    """A track with a vocabulary of its own, and its task on record."""
    path = tmp_path / "own.json"
    document = {
        "info": {"task": "lvis"},
        "images": [{"id": 1, "file_name": "a.png", "width": 8, "height": 8}],
        "categories": [{"id": 4, "name": "lathe_(machine)"}, {"id": 9, "name": "vice"}],
    }
    path.write_text(json.dumps(document))
    return path


def test_a_tracks_own_vocabulary_is_what_the_author_is_told(own_track, capsys):
    assert cli.run(["list", "schema", "--track", str(own_track), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["task"] == "lvis"
    assert told["vocabulary"] == ["lathe_(machine)", "vice"]
    assert told["synonyms"] == {"lathe": "lathe_(machine)"}
    assert {e["category"] for e in told["labels_file"]["labels"]} == {"lathe_(machine)", "vice"}
    assert cli.run(["list", "schema", "--track", str(own_track)]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "--task lvis --track TRACK" in shown
    assert "couch" not in shown


@pytest.mark.parametrize("task", TASKS)
def test_no_track_is_asked_for_where_the_shipped_vocabulary_is_read(task):
    assert "--track" not in text_of(protocol(task, None))


def test_a_track_is_refused_where_it_says_nothing(own_track, tmp_path, capsys):
    assert cli.run(["list", "tasks", "--track", str(own_track)]) == 2
    assert "--track is for schema" in capsys.readouterr().err
    assert cli.run(["list", "schema", "--task", "coco", "--track", str(own_track)]) == 2
    assert "made for lvis, not for coco" in capsys.readouterr().err
    silent = json.loads(own_track.read_text()) | {"info": {}}
    (tmp_path / "silent.json").write_text(json.dumps(silent))
    assert cli.run(["inspect", str(tmp_path), "--track", str(tmp_path / "silent.json")]) == 2
    assert "does not record its task; next: pass the task" in capsys.readouterr().err
