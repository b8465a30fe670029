"""Labels: properties, overrides, labels.json, and matching names to a vocabulary."""

from __future__ import annotations

import json

import pytest
from scene.by_hand import HandScene, categories, outside

from legoworld.errors import LabelsInvalidError
from legoworld.scene.labels import read_labels_file, resolve_labels
from legoworld.tracks.vocabulary import from_json

LVIS = from_json(
    [
        {"id": 1, "name": "sofa", "synonyms": ["couch", "lounge"]},
        {"id": 2, "name": "bat_(animal)", "synonyms": ["bat"]},
        {"id": 3, "name": "bat_(sport)", "synonyms": ["bat", "racket"]},
        {"id": 4, "name": "racket", "synonyms": []},
    ],
    "the test's vocabulary",
)


def one_label(**labels):
    scene = HandScene()
    scene.object("Sofa", **labels)
    scene.occurs("Sofa")
    return scene


@pytest.mark.parametrize(
    ("written", "expected"),
    [
        ("dining table", "dining table"),
        ("Dining_Table", "dining table"),
        ("  DINING   table ", "dining table"),
        ("diningtable", None),
        ("chairs", None),
        ("", None),
        ("   ", None),
    ],
)
def test_names_match_without_case_and_with_underscores_as_spaces(written, expected):
    assert categories(one_label(category=written).grouped()) == [expected]


def test_a_key_that_labels_json_does_not_have_is_a_warning(tmp_path):
    entries = [
        {"object": "Sofa", "category": "couch", "lvis_categry": "sofa", "note": "by hand"},
        {"object": "Chair", "category": "chair", "kitti_category": "seat", "note": "by hand"},
    ]
    path = tmp_path / "labels.json"
    path.write_text(json.dumps({"version": 1, "labels": entries}))
    scene = one_label()
    scene.object("Chair")
    warnings = resolve_labels(scene.snapshot(), read_labels_file(path), None, None).warnings
    assert warnings == (
        "labels.json has the key 'lvis_categry', which is not read. Did you mean 'lvis_category'?",
        "labels.json has the key 'note', which is not read.",
    )


def test_blank_labels_are_no_labels():
    grouping = one_label(category=" ").grouped()
    assert grouping.outside_vocabulary == {}
    assert grouping.instances[0].label_text is None


def test_names_outside_the_vocabulary_are_counted_by_text():
    scene = HandScene()
    for name, text in (("A", "couch"), ("B", "Couch"), ("C", "couch")):
        scene.object(name, category=text)
        scene.occurs(name)
    assert scene.grouped().outside_vocabulary == {"Couch": 1, "couch": 2}


@pytest.mark.parametrize(
    ("written", "expected"),
    [
        ("couch", "sofa"),
        ("Lounge", "sofa"),
        ("bat", None),  # two categories have it
        ("bat_(animal)", "bat_(animal)"),
        ("bat (sport)", "bat_(sport)"),
        ("racket", "racket"),  # a name wins over another category's synonym
    ],
)
def test_synonyms_count_where_only_one_category_has_them(written, expected):
    scene = one_label(category=written)
    assert categories(scene.grouped(vocabulary=LVIS, override="lvis_category")) == [expected]


def test_the_override_property_wins_in_its_own_vocabulary_only():
    scene = one_label(category="chair", lvis_category="sofa", coco_category="apple")
    assert categories(scene.grouped(vocabulary=LVIS, override="lvis_category")) == ["sofa"]
    assert categories(scene.grouped(override="coco_category")) == ["apple"]
    assert categories(scene.grouped(vocabulary=None, override=None)) == ["chair"]


def test_an_override_alone_labels_in_its_own_vocabulary_only():
    scene = one_label(lvis_category="sofa")
    assert categories(scene.grouped(vocabulary=LVIS, override="lvis_category")) == ["sofa"]
    assert categories(scene.grouped(override="coco_category")) == [None]


def test_labels_json_wins_over_the_scene():
    scene = one_label(category="apple")
    assert categories(scene.grouped(outside("object", "Sofa", category="chair"))) == ["chair"]


def test_a_plain_category_of_labels_json_wins_over_an_override_in_the_scene():
    scene = one_label(category="apple", coco_category="tree")
    assert categories(scene.grouped(outside("object", "Sofa", category="chair"))) == ["chair"]


def test_an_override_of_labels_json_leaves_the_scenes_category_to_others():
    scene = one_label(category="apple")
    label = outside("object", "Sofa", lvis_category="sofa")
    assert categories(scene.grouped(label)) == ["apple"]
    assert categories(scene.grouped(label, vocabulary=LVIS, override="lvis_category")) == ["sofa"]


def test_labels_json_labels_collections():
    scene = HandScene()
    scene.collection("Set")
    scene.object("A", collections=("Set",))
    scene.object("B", collections=("Set",))
    scene.occurs("A")
    scene.occurs("B")
    assert categories(scene.grouped(outside("collection", "Set", category="chair"))) == ["chair"]


def test_labels_json_may_name_what_is_not_there_with_a_warning():
    from legoworld.scene.labels import resolve_labels

    scene = one_label(category="apple")
    labels = resolve_labels(
        scene.snapshot(), [outside("object", "Stool", category="chair")], None, None
    )
    assert labels.warnings == ("labels.json names object 'Stool': not in the scene",)


def test_a_labels_json_is_read(tmp_path):
    path = tmp_path / "labels.json"
    entries = [
        {"object": "Sofa", "category": "couch", "lvis_category": "sofa"},
        {"collection": "Table set", "category": "dining table"},
    ]
    path.write_text(json.dumps({"version": 1, "labels": entries}), encoding="utf-8")
    first, second = read_labels_file(path)
    assert (first.kind, first.name) == ("object", "Sofa")
    assert first.categories == {"category": "couch", "lvis_category": "sofa"}
    assert (second.kind, second.name) == ("collection", "Table set")


def test_no_labels_json_is_no_label(tmp_path):
    assert read_labels_file(tmp_path / "labels.json") == ()


def test_one_thing_may_be_labelled_twice_without_contradiction(tmp_path):
    path = tmp_path / "labels.json"
    entries = [{"object": "A", "category": "chair"}, {"object": "A", "lvis_category": "sofa"}]
    path.write_text(json.dumps({"version": 1, "labels": entries}), encoding="utf-8")
    assert len(read_labels_file(path)) == 2


BROKEN = {
    "empty": b"",
    "no JSON": b"labels: none",
    "cut short": b'{"version": 1, "labels": [',
    "not UTF-8": b'{"version": 1, "labels": [{"object": "\xff", "category": "chair"}]}',
    "too deep": b"[" * 100_000,
    "a list": b"[]",
    "a number": b"1",
    "no version": b'{"labels": []}',
    "another version": b'{"version": 2, "labels": []}',
    "a text version": b'{"version": "1", "labels": []}',
    "a true version": b'{"version": true, "labels": []}',
    "no labels": b'{"version": 1}',
    "labels are an object": b'{"version": 1, "labels": {"Sofa": "chair"}}',
    "an entry is a text": b'{"version": 1, "labels": ["Sofa"]}',
    "neither object nor collection": b'{"version": 1, "labels": [{"category": "chair"}]}',
    "both": b'{"version": 1, "labels": [{"object": "A", "collection": "B", "category": "chair"}]}',
    "no category": b'{"version": 1, "labels": [{"object": "A"}]}',
    "a misspelt category": b'{"version": 1, "labels": [{"object": "A", "categroy": "chair"}]}',
    "an empty category": b'{"version": 1, "labels": [{"object": "A", "category": " "}]}',
    "a null category": b'{"version": 1, "labels": [{"object": "A", "category": null}]}',
    "a number for a category": b'{"version": 1, "labels": [{"object": "A", "category": 3}]}',
    "an empty name": b'{"version": 1, "labels": [{"object": "", "category": "chair"}]}',
    "a list for a name": b'{"version": 1, "labels": [{"object": ["A"], "category": "chair"}]}',
    "a contradiction": b'{"version": 1, "labels": [{"object": "A", "category": "chair"}, '
    b'{"object": "A", "category": "sofa"}]}',
}


@pytest.mark.parametrize("content", BROKEN.values(), ids=BROKEN)
def test_a_broken_labels_json_is_refused_with_what_was_found(tmp_path, content):
    path = tmp_path / "labels.json"
    path.write_bytes(content)
    with pytest.raises(LabelsInvalidError) as caught:
        read_labels_file(path)
    error = caught.value
    assert (error.code, error.status) == ("invalid_labels", "invalid")
    assert error.found
    assert error.expected
    assert error.next_step


def test_a_labels_json_that_is_a_folder_is_refused(tmp_path):
    (tmp_path / "labels.json").mkdir()
    with pytest.raises(LabelsInvalidError, match="it is a folder"):
        read_labels_file(tmp_path / "labels.json")
