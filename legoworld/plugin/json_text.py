"""Add a value to a JSON text and leave every other byte as it is."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any, Final

from legoworld.files import Json

_SPACE: Final = " \t\n\r"
_DECODER: Final = json.JSONDecoder()
_INDENT: Final = 2


def add_value(text: str, path: tuple[str, ...], value: Json) -> tuple[str, list[str]]:
    """A JSON text with one more value, and the fragments that were put in, one after the other.

    path: keys of objects from the root; missing ones are added. A list is appended to the list
    there, an item at a time; any other value becomes the last key's. Each fragment is whole: an
    empty container, a member or an item, so that it can be taken out again by itself. ValueError
    names the part of the path that is not an object or list, or a key that already exists.
    """
    fragments: list[str] = []
    for depth, key in enumerate(path):
        at = _place(text, path[:depth])
        if text[at] != "{":
            raise ValueError(f"{'.'.join(path[:depth]) or 'the file'} is not an object")
        members = dict(_members(text, at))
        last = depth == len(path) - 1
        if key in members:
            if last and not (isinstance(value, list) and text[members[key][0]] == "["):
                raise ValueError(f"{'.'.join(path)} is there already")
            continue
        empty: Any = ([] if isinstance(value, list) else value) if last else {}
        member = f"{json.dumps(key)}: {_format_value(empty, depth + 1)}"
        text = _insert_item(
            text, at, [end for _, end in members.values()], member, depth, fragments
        )
    for item in value if isinstance(value, list) else ():
        at = _place(text, path)
        ends = [end for _, end in _items(text, at)]
        text = _insert_item(
            text, at, ends, _format_value(item, len(path) + 1), len(path), fragments
        )
    return text, fragments


def remove_fragments(text: str, fragments: list[str]) -> str:
    """A JSON text without the fragments that `add_value` put in, everything else as it is.

    A container that has got other contents since stays. ValueError where a value is not found as
    it was put in.
    """
    containers = [f for f in fragments if f.rstrip().endswith(("{}", "[]"))]
    for fragment in reversed([f for f in fragments if f not in containers]):
        without = next(_without(text, fragment), None)
        if without is None:
            raise ValueError("what was added was edited since")
        text = without
    for fragment in reversed(containers):
        text = next(_without(text, fragment), text)
    return text


def _without(text: str, fragment: str) -> Iterator[str]:
    """The text without a fragment, where that is JSON: alone, or with a comma that follows it.

    An editor may have taken the white space at its end.
    """
    for part in (fragment, fragment.rstrip()):
        before, found, after = text.rpartition(part)
        for rest in (after, after.lstrip().removeprefix(",")) if found else ():
            try:
                json.loads(before + rest)
            except ValueError:
                continue
            yield before + rest


def _place(text: str, path: tuple[str, ...]) -> int:
    """Where the value at a path begins."""
    at = _skip(text, 0)
    for key in path:
        at = dict(_members(text, at))[key][0]
    return at


def _insert_item(
    text: str, at: int, ends: list[int], item: str, depth: int, fragments: list[str]
) -> str:
    """An item into the object or list that opens at `at`; ends: of the items it has."""
    pad = "\n" + " " * (_INDENT * (depth + 1))
    if ends:
        place, fragment = ends[-1], f",{pad}{item}"
    else:
        place, fragment = _skip(text, at + 1), f"{pad}{item}\n{' ' * (_INDENT * depth)}"
    fragments.append(fragment)
    return text[:place] + fragment + text[place:]


def _format_value(value: Json, depth: int) -> str:
    pad = "\n" + " " * (_INDENT * depth)
    return json.dumps(value, indent=_INDENT).replace("\n", pad)


def _members(text: str, at: int) -> Iterator[tuple[str, tuple[int, int]]]:
    """Keys of the object that opens at `at`, with where their values begin and end."""
    at = _skip(text, at + 1)
    while text[at] != "}":
        key, at = _DECODER.raw_decode(text, at)
        start = _skip(text, _skip(text, at) + 1)
        _, end = _DECODER.raw_decode(text, start)
        yield key, (start, end)
        at = _skip(text, end)
        if text[at] == ",":
            at = _skip(text, at + 1)


def _items(text: str, at: int) -> Iterator[tuple[int, int]]:
    at = _skip(text, at + 1)
    while text[at] != "]":
        _, end = _DECODER.raw_decode(text, at)
        yield at, end
        at = _skip(text, end)
        if text[at] == ",":
            at = _skip(text, at + 1)


def _skip(text: str, at: int) -> int:
    while at < len(text) and text[at] in _SPACE:
        at += 1
    return at
