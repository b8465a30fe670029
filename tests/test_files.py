"""JSON as people read it."""

from __future__ import annotations

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from legoworld.files import readable_json

SCALARS = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False).filter(
    math.isfinite
) | st.text(st.characters(exclude_categories=["Cs"]))  # fmt: skip
KEYS = st.text(st.characters(exclude_categories=["Cs"]), max_size=3)
VALUES = st.recursive(
    SCALARS,
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.tuples(inner, inner)
        | st.dictionaries(KEYS, inner, max_size=4)
        | st.dictionaries(st.integers(), inner, max_size=3)
    ),
)


@given(VALUES)
def test_it_is_what_the_standard_encoder_indents(value):
    expected = json.dumps(value, sort_keys=True, ensure_ascii=False, indent=1, allow_nan=False)
    assert readable_json(value) == expected + "\n"


@pytest.mark.parametrize("value", [math.nan, [math.inf], {"a": [-math.inf]}, {"a": {"b": {1j}}}])
def test_what_json_cannot_hold_is_refused(value):
    with pytest.raises((ValueError, TypeError)):
        readable_json(value)
