"""Typed access to untrusted JSON: the last value that is taken, and the first that is not."""

from __future__ import annotations

import math

import pytest

from legoworld.scene.gltf.fields import Fields
from legoworld.scene.gltf.verdicts import UnreadableGltfError

INSIDE = Fields({}, "accessors[3]")


def assert_refused(get, value, expected):
    with pytest.raises(UnreadableGltfError) as caught:
        get(Fields({"x": value}, "accessors[3]"))
    assert caught.value.expected == expected
    assert str(caught.value.found).startswith("accessors[3].x is ")


def test_a_place_begins_at_the_document():
    assert Fields({}).at("x") == "x"
    assert INSIDE.at("x") == "accessors[3].x"
    assert INSIDE.child("y").place == "accessors[3].y"
    (inner,) = Fields({"y": [{}]}).children("y")
    assert inner.place == "y[0]"


@pytest.mark.parametrize(("value", "expected"), [(0, 0), (7.0, 7), (2**53, 2**53), (0.0, 0)])
def test_integers(value, expected):
    found = Fields({"x": value}).integer("x")
    assert (found, type(found)) == (expected, int)


@pytest.mark.parametrize(
    "value", [-1, 2**53 + 1, 1.5, math.inf, math.nan, True, "1", None, [], 10**400]
)
def test_what_is_no_integer(value):
    assert_refused(lambda f: f.integer("x", 3), value, "an integer from 0")


def test_what_is_absent():
    assert INSIDE.integer("x", 3) == 3
    assert INSIDE.number("x", 0.5) == 0.5
    assert INSIDE.index("x", 9) == -1
    assert (INSIDE.numbers("x", 3), INSIDE.indices("x", 3), INSIDE.texts("x")) == ((), (), ())
    assert INSIDE.text("x") == ""
    assert INSIDE.text("x", "y") == "y"
    assert INSIDE.flag("x") is False
    assert INSIDE.flag("x", default=True) is True
    assert INSIDE.children("x") == ()
    assert INSIDE.extension("x") is None
    for get in (INSIDE.integer, INSIDE.number):
        with pytest.raises(UnreadableGltfError, match=r"accessors\[3\]\.x is nothing"):
            get("x")
    assert "x" not in INSIDE
    assert "x" in Fields({"x": None})


def test_indices_are_below_the_length_and_distinct():
    assert [Fields({"x": i}).index("x", 2) for i in (0, 1)] == [0, 1]
    assert_refused(lambda f: f.index("x", 2), 2, "an index below 2")
    assert_refused(lambda f: f.index("x", 2), -1, "an integer from 0")
    assert Fields({"x": [1, 0]}).indices("x", 2) == (1, 0)
    for value in ([2], [-1], [0, 0], [True], [0.0], {}, 0):
        assert_refused(lambda f: f.indices("x", 2), value, "distinct indices below 2")


def test_numbers_are_finite():
    assert Fields({"x": 3}).number("x") == 3.0
    for value in (math.inf, math.nan, 10**400, True, "3", None):
        assert_refused(lambda f: f.number("x", 1.0), value, "a finite number")
    assert Fields({"x": [1, 2.5]}).numbers("x", 2) == (1.0, 2.5)
    assert Fields({"x": []}).numbers("x") == ()
    for value in ([1], [1, 2, 3], [1, math.nan], [1, "2"], [True, 1], {}, 1):
        assert_refused(lambda f: f.numbers("x", 2), value, "2 finite numbers")
    assert_refused(lambda f: f.numbers("x"), [None], "a list of finite numbers")


def test_texts_flags_and_objects():
    assert Fields({"x": "a\udcffb"}).text("x") == "a?b"
    assert Fields({"x": ["a", "\ud800"]}).texts("x") == ("a", "?")
    assert Fields({"x": True}).flag("x") is True
    assert Fields({"x": False}).flag("x", default=True) is False
    assert Fields({"x": {"y": 1}}).child("x").values == {"y": 1}
    assert [f.values for f in Fields({"x": [{}, {"y": 1}]}).children("x")] == [{}, {"y": 1}]
    assert_refused(lambda f: f.text("x"), 3, "a text")
    assert_refused(lambda f: f.flag("x"), 1, "true or false")
    assert_refused(lambda f: f.child("x"), [], "an object")
    for value in ("ab", ["a", 1], {}):
        assert_refused(lambda f: f.texts("x"), value, "a list of texts")
    for value in ({}, [{}, 1]):
        assert_refused(lambda f: f.children("x"), value, "a list of objects")
    extended = Fields({"extensions": {"KHR_a": {"y": 1}}}).extension("KHR_a")
    assert extended is not None
    assert (extended.values, extended.place) == ({"y": 1}, "extensions.KHR_a")


def test_a_value_is_shown_within_a_line():
    for value in ("x" * 1000, [[0] * 1000] * 1000, 10**5000):
        with pytest.raises(UnreadableGltfError) as caught:
            Fields({"x": value}).flag("x")
        assert len(str(caught.value.found)) < 100
