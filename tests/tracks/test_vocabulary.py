"""Words to categories."""

from __future__ import annotations

import pytest

from legoworld.errors import CatalogError
from legoworld.readouts.family import protocol
from legoworld.shipped.catalog import folder
from legoworld.tracks.vocabulary import from_json, load


def test_names_match_in_any_case_and_with_underscores():
    coco = load(folder("datasets") / "coco" / "categories.json")
    assert coco.match("Dining_Table").id == 67
    assert coco.match("  potted   plant ").id == 64
    assert coco.match("sofa") is None
    assert "couch" not in coco.nearest("sofaa")
    assert coco.nearest("dinning table") == ["dining table"]


def test_lvis_synonyms_match_when_only_one_category_has_them():
    lvis = load(folder("datasets") / "lvis" / "categories.json")
    assert lvis.match("aeroplane").name == "airplane"
    entries = [
        {"id": 1, "name": "a", "synonyms": ["x", "y"]},
        {"id": 2, "name": "b", "synonyms": ["x", "a"]},
    ]
    made = from_json(entries, "test")
    assert made.match("y").id == 1
    assert made.match("x") is None
    assert made.match("a").id == 1, "a name wins over another category's synonym"


LVIS_BARE = {
    "mouse": "mouse_(computer_equipment)",
    "Car": "car_(automobile)",
    "home_plate": "home_plate_(baseball)",
    "monitor": "monitor_(computer_equipment) computer_monitor",
}


@pytest.mark.parametrize(("word", "name"), LVIS_BARE.items())
def test_a_bare_word_names_the_only_lvis_category_it_can_mean(word, name):
    assert protocol("lvis", None).vocabulary.match(word).name == name


@pytest.mark.parametrize(
    ("word", "candidates"),
    [
        ("bow", ["bow_(decorative_ribbons)", "bow_(weapon)"]),
        ("Pan", ["pan_(for_cooking)", "pan_(metal_container)"]),
        ("cap", ["bottle_cap", "cap_(headwear)"]),  # one by its synonym cap_(container_lid)
    ],
)
def test_an_ambiguous_bare_word_is_refused_with_what_it_may_mean(word, candidates):
    vocabulary = protocol("lvis", None).vocabulary
    assert vocabulary.match(word) is None
    assert vocabulary.candidates(word) == candidates
    assert vocabulary.nearest(word)[:2] == candidates
    assert len(vocabulary.nearest(word)) == 3


def test_a_name_wins_over_a_synonym_and_a_synonym_over_a_bare_word():
    entries = [
        {"id": 1, "name": "tap_(dance)"},
        {"id": 2, "name": "faucet", "synonyms": ["tap"]},
        {"id": 3, "name": "fish"},
        {"id": 4, "name": "fish_(food)", "synonyms": ["cod_(fish)", "rock"]},
        {"id": 5, "name": "rock_(music)"},
    ]
    vocabulary = protocol("lvis", from_json(entries, "test")).vocabulary
    assert [vocabulary.match(w).id for w in ("tap", "fish", "rock")] == [2, 3, 4]
    assert vocabulary.match("cod") is None, "a synonym's bare word names nothing"
    exact = protocol("coco", from_json(entries, "test")).vocabulary
    assert exact.match("tap") is None, "coco's card asks for the qualifier"


def test_how_many_lvis_names_can_be_written_without_their_qualifier():
    """The numbers of docs/labels.md."""
    vocabulary = protocol("lvis", None).vocabulary
    qualified = [c for c in vocabulary.categories if "(" in c.name]
    words = {c.name: c.name.partition("(")[0].strip("_") for c in qualified}
    usable = [c for c in qualified if vocabulary.match(words[c.name]) is c]
    refused = {words[c.name] for c in qualified if vocabulary.match(words[c.name]) is None}
    assert (len(qualified), len(usable)) == (108, 97)
    assert refused == {"bow", "cap", "mailbox", "octopus", "pan", "salmon"}
    assert vocabulary.match("fish").name == "fish"
    for category in vocabulary.categories:
        assert vocabulary.match(category.name) is category


def test_a_bare_word_is_recorded_as_a_synonym_is():
    from legoworld.readouts.instructions import accepted_synonyms

    accepted = accepted_synonyms(protocol("lvis", None).vocabulary)
    assert accepted["mouse"] == "mouse_(computer_equipment)"
    assert accepted["couch"] == "sofa"
    assert not {"bow", "fish", "cod"} & set(accepted)


def test_coco_knows_no_synonyms_even_when_the_track_brings_some():
    made = from_json([{"id": 1, "name": "couch", "synonyms": ["sofa"]}], "test")
    assert protocol("coco", made).vocabulary.match("sofa") is None
    assert protocol("lvis", made).vocabulary.match("sofa").id == 1


@pytest.mark.parametrize(
    ("entries", "why"),
    [
        (None, "cannot be used; found: expected array, got null"),
        ([], "test has no categories; found: an empty list"),
        ([{"id": "1", "name": "a"}], "cannot be used; found: expected int, got str at"),
        ([{"id": True, "name": "a"}], "cannot be used; found: expected int, got bool at"),
        ([{"id": 1}], "cannot be used; found: object missing required field name"),
        ([{"id": -1, "name": "a"}], "cannot be used; found: expected int >= 0"),
        ([{"id": 1.0, "name": "a"}], "cannot be used; found: expected int, got float at"),
        ([{"id": 2**53 + 1, "name": "a"}], "cannot be used; found: .*9007199254740992"),
        ([{"id": 1, "name": "a"}, {"id": 1, "name": "b"}], "a category id twice; found: 1"),
        ([{"id": 1, "name": "a b"}, {"id": 2, "name": "A_b"}], "category name twice; found: 'a b'"),
    ],
)
def test_a_broken_vocabulary_is_refused(entries, why):
    with pytest.raises(CatalogError, match=why):
        from_json(entries, "test")
