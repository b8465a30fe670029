"""Cutting a stream into messages: every way a stream can be cut gives the same messages."""

from __future__ import annotations

import itertools
import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from legoworld.endpoint.message_frames import FramingError, MessageSplitter

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)
MESSAGES = st.lists(st.dictionaries(st.text(), VALUES, max_size=3), max_size=4)


@given(MESSAGES, st.sampled_from(["", "\n", " \r\n"]), st.booleans(), st.lists(st.integers(0, 400)))
def test_a_stream_gives_its_messages_however_it_is_cut(messages, between, ascii_only, cuts):
    data = b"".join(
        (json.dumps(m, ensure_ascii=ascii_only) + between).encode("utf-8", "surrogatepass")
        for m in messages
    )
    splitter, received = MessageSplitter(), []
    at = [0, *sorted(min(cut, len(data)) for cut in cuts), len(data)]
    for begin, end in itertools.pairwise(at):
        received += splitter.feed(data[begin:end])
    assert [json.loads(m.decode("utf-8", "surrogatepass")) for m in received] == messages


def test_whoever_ends_messages_with_newlines_is_told_apart():
    unframed, framed = MessageSplitter(), MessageSplitter()
    assert list(unframed.feed(b'{"type":"ping"}')) == [b'{"type":"ping"}']
    assert list(framed.feed(b'{"type":"ping"}\n{"type":"ping"}\n')) == [b'{"type":"ping"}'] * 2
    assert (unframed.newlines, framed.newlines) == (False, True)


@pytest.mark.parametrize("data", [b"hello", b"5", b'"text"', b"\xff\xfe", b"GET / HTTP/1.1\r\n"])
def test_what_begins_no_object_is_refused_at_once(data):
    with pytest.raises(FramingError):
        list(MessageSplitter().feed(data))


def test_a_message_without_an_end_is_refused_at_the_limit():
    splitter = MessageSplitter(most_bytes=1000)
    assert list(splitter.feed(b'{"code": "' + b"x" * 900)) == []
    with pytest.raises(FramingError, match="1,000"):
        list(splitter.feed(b"x" * 200))


def test_a_message_has_64_mib_where_nothing_is_said():
    splitter = MessageSplitter()
    assert list(splitter.feed(b'{"' + bytes((64 << 20) - 2))) == []
    with pytest.raises(FramingError, match="67,108,864"):
        list(splitter.feed(b"x"))


def test_a_large_message_in_small_pieces_is_looked_at_once():
    """With a parse for each piece, 32 MB in pieces of 8 kB would take minutes."""
    data = json.dumps(
        {"type": "execute_code", "params": {"code": "x = '\\n'\n" * 3_000_000}}
    ).encode()
    splitter, received = MessageSplitter(), []
    for at in range(0, len(data), 8192):
        received += splitter.feed(data[at : at + 8192])
    assert received == [data]
