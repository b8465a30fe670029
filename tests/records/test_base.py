"""Records: what a type refuses, in which words, and that reading and writing lose nothing."""

from __future__ import annotations

import json
import pickle
import sys
import types

import pytest
from hypothesis import given
from hypothesis import strategies as st

from legoworld.records.base import (
    UNSET,
    Record,
    RecordError,
    UnsetType,
    canonical,
    decode,
    decode_foreign,
    decode_lines,
    to_record,
)


class Part(Record, frozen=True, kw_only=True):
    id: int
    score: int | float = 1
    name: str | UnsetType = UNSET
    note: str | None = None


class Whole(Record, frozen=True, kw_only=True):
    parts: tuple[Part, ...]


parts = st.builds(
    Part,
    id=st.integers(-(2**70), 2**70),
    score=st.one_of(st.integers(), st.floats(allow_nan=False, allow_infinity=False)),
    name=st.one_of(st.just(UNSET), st.text(st.characters(codec="utf-8"))),
    note=st.one_of(st.none(), st.text(st.characters(codec="utf-8"))),
)


@given(st.builds(Whole, parts=st.lists(parts).map(tuple)))
def test_what_is_written_reads_back_and_writes_the_same_bytes(whole):
    text = canonical(whole)
    again = decode(Whole, text)
    assert again == whole
    assert canonical(again) == text


@given(st.lists(parts))
def test_lines_are_read_as_they_are_written(whole):
    data = "".join(canonical(part) + "\n" for part in whole).encode()
    assert decode_lines(Part, data) == whole


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ('{"parts": [{"id": 1}, {"id": "x"}]}', "expected int, got str at $.parts[1].id"),
        ('{"parts": [{"id": true}]}', "expected int, got bool at $.parts[0].id"),
        ('{"parts": [{}]}', "object missing required field id at $.parts[0]"),
        ("[1]", "expected object, got array"),
        ('{"parts": []} x', "not JSON: Extra data: line 1 column 15"),
        ('{"parts": NaN}', "not JSON: NaN, infinity"),
        ('{"parts": [], "other": "\\ud800"}', "half of a surrogate pair"),
        ('{"parts": [{"id": 1, "score": 1e999}]}', "number out of range at $.parts[0].score"),
        ('{"other": ' + "[" * 100_000 + "]" * 100_000 + "}", "nested too deeply"),
        (b"\xff", "not JSON: it is not UTF-8"),
        (b'{"parts": [{"id": 1, "name": "\xff"}]}', "not JSON: it is not UTF-8"),
        ("", "not JSON"),
    ],
)
def test_an_error_says_what_was_found_and_where(text, found):
    with pytest.raises(RecordError) as error:
        decode(Whole, text)
    assert found in str(error.value)
    assert "`" not in str(error.value)


def test_an_error_in_lines_says_in_which():
    with pytest.raises(RecordError, match=r"line 3: expected int, got float at \$\.id"):
        decode_lines(Part, b'{"id": 1}\n\n{"id": 2.5}\n')
    with pytest.raises(RecordError, match="line 2: not JSON: it is not UTF-8"):
        decode_lines(Part, b'{"id": 1}\n{"id": 2, "name": "\xff"}\n')


def test_values_of_other_formats_are_checked_alike():
    assert to_record(Whole, {"parts": [{"id": 1}]}) == Whole(parts=(Part(id=1),))
    with pytest.raises(RecordError, match=r"expected int, got str at \$\.parts\[0\]\.id"):
        to_record(Whole, {"parts": [{"id": "1"}]})


def test_keys_a_type_does_not_name_are_ignored_and_fields_left_out_stay_out():
    part = decode(Part, '{"id": 1, "later": [1, 2]}')
    assert canonical(part) == '{"id":1,"note":null,"score":1}'


def test_records_do_not_change():
    with pytest.raises(AttributeError):
        Part(id=1).id = 2


@given(st.integers(1, 80), st.integers(1, 80))
def test_nesting_is_counted_in_lists_and_objects(levels, limit):
    value = 1
    for level in range(levels):
        value = [0, value] if level % 2 else {"a": value, "b": []}
    # An empty list beside the innermost value is as deep as a list around it.
    text = json.dumps({"parts": [], "ignored": value})
    if levels + 2 <= limit:
        assert decode_foreign(Whole, text, levels=limit) == Whole(parts=())
    else:
        with pytest.raises(RecordError, match=f"nested beyond {limit} levels"):
            decode_foreign(Whole, text, levels=limit)


@pytest.mark.parametrize(
    ("ignored", "found"),
    [("1e999", "number out of range"), ('"\xff"', "it is not UTF-8"), ("9" * 5000, "out of range")],
)
def test_what_a_type_ignores_is_checked_where_a_stranger_wrote_it(ignored, found):
    text = b'{"parts": [], "ignored": ' + ignored.encode("latin-1") + b"}"
    assert decode(Whole, text) == Whole(parts=())
    with pytest.raises(RecordError, match=found):
        decode_foreign(Whole, text, levels=9)


def test_a_field_left_out_is_pickled_by_a_module_that_every_process_can_import(monkeypatch):
    """msgspec names the first module that has UNSET, which may be a script."""
    script = types.ModuleType("a_script")
    script.UNSET = UNSET
    monkeypatch.setattr(sys, "modules", {"a_script": script, **sys.modules})
    pickled = pickle.dumps(UNSET)
    assert b"a_script" not in pickled
    assert pickle.loads(pickled) is UNSET
