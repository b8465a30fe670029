"""Decoding and encoding records: JSON in, checked frozen values out, and back to the same bytes."""

from __future__ import annotations

import codecs
import copyreg
import json
import math
import re
import threading
from collections import Counter
from collections.abc import Hashable, Iterable, Mapping, Sequence
from typing import Any, Final, TypeAlias, TypeVar

import msgspec
from msgspec import UNSET as UNSET
from msgspec import Struct
from msgspec import UnsetType as UnsetType

from legoworld.files import Json, canonical_json, readable_json, utf8_text

_T = TypeVar("_T")
_H = TypeVar("_H", bound=Hashable)


def _unset() -> UnsetType:
    return UNSET


# msgspec pickles it by name, from the first module in sys.modules that has the name: in another
# process that may be a script, which cannot be imported there.
copyreg.pickle(UnsetType, lambda _: (_unset, ()))

#: What can be written as JSON.
Storable: TypeAlias = "_Plain | Struct | Sequence[Storable] | Mapping[str, Storable]"
_Plain = bool | int | float | str | UnsetType | None
#: Made once for each type: making one takes as long as reading a small file.
_DECODERS: Final[dict[Any, msgspec.json.Decoder[Any]]] = {}
_FILLING: Final = threading.Lock()
_ANYTHING: Final[msgspec.json.Decoder[Any]] = msgspec.json.Decoder()
_CONTAINERS: Final = frozenset((dict, list))
_MAY_BE_HALF: Final = re.compile(r"\\u[dD][89a-fA-F]")
_ESCAPE: Final = re.compile(r"\\(?:u([0-9a-fA-F]{4})|.)")
_AT: Final = re.compile(r" - at `(?:key in )?([^`]*)`$")


class Record(Struct, frozen=True, kw_only=True):
    """Base of every record: frozen, built by keyword, equal by value.

    Each type says `frozen=True, kw_only=True` again: msgspec hands neither down to fields that a
    type adds.
    A field that a file may leave out is `T | UnsetType = UNSET` and stays left out when it is
    written; `T | None` is written as null. Keys that a type does not name are ignored when it is
    read, so that a reader takes what a later minor version adds. A number that is written back as
    it was read is `int | float`: a plain `float` turns 2 into 2.0.
    """


class RecordError(ValueError):
    """A file's content is not what its type says; the text names what was found and where."""


def decode(kind: type[_T], data: bytes | str) -> _T:
    """JSON text as a value of a type, checked in full.

    Raises RecordError for what is not JSON (NaN, infinity and halves of surrogate pairs are not)
    and for a value of another type, with its place: "expected int, got str at $.images[3].id".
    """
    return _decode(_decoder(kind), data)


def decode_foreign(kind: type[_T], data: bytes | str, *, levels: int) -> _T:
    """`decode` for what a stranger wrote: what the type ignores is held to JSON's rules, too.

    levels: how deep lists and objects may be nested. RecordError for deeper ones.
    """
    document = _decode(_ANYTHING, data)
    if _nested_beyond(levels, document):
        raise RecordError(f"lists or objects are nested beyond {levels} levels")
    return to_record(kind, document)


def read_json(data: bytes) -> Any:
    """A stranger's JSON by Python's reader, which takes NaN; a UTF-8 byte order mark is left out.

    RecordError for another encoding, for what is not JSON, and for halves of surrogate pairs, which
    no result could hold.
    """
    try:
        text = utf8_text(data)
        value = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise RecordError(str(error)) from error
    if half := _half_pair(text):
        raise RecordError(half)
    return value


def _decode(decoder: msgspec.json.Decoder[_T], data: bytes | str) -> _T:
    if isinstance(data, bytes):
        data = data.removeprefix(codecs.BOM_UTF8)
    try:
        return decoder.decode(data)
    except msgspec.ValidationError as error:
        raise RecordError(_sentence(str(error))) from error
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise RecordError(_describe_malformed(data)) from error
    except RecursionError as error:
        raise RecordError("lists or objects are nested too deeply") from error


def decode_lines(kind: type[_T], data: bytes, *, first: int = 1) -> list[_T]:
    """JSON Lines as values of a type; the place of a RecordError begins with its line.

    first: the number of the first line.
    """
    decoder = _decoder(kind)
    data = data.removeprefix(codecs.BOM_UTF8)
    try:
        return decoder.decode_lines(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        for number, line in enumerate(data.split(b"\n"), start=first):
            if line.strip():
                try:
                    decode(kind, line)
                except RecordError as error:
                    raise RecordError(f"line {number}: {error}") from error
        raise


def _nested_beyond(levels: int, value: Json) -> bool:
    """Whether lists and objects of a JSON value are nested more than `levels` deep."""
    level: list[Any] = [value] if type(value) in _CONTAINERS else []
    for _ in range(levels):
        inside: list[Any] = []
        for container in level:
            values = container.values() if isinstance(container, dict) else container
            if not _CONTAINERS.isdisjoint(map(type, values)):  # most hold numbers alone
                inside += [inner for inner in values if type(inner) in _CONTAINERS]
        level = inside
    return bool(level)


def to_record(kind: type[_T], value: Json) -> _T:
    """A JSON value that is in memory already (of TOML, say) as a value of a type. RecordError."""
    _decoder(kind)
    try:
        return msgspec.convert(value, kind)
    except msgspec.ValidationError as error:
        raise RecordError(_sentence(str(error))) from error
    except RecursionError as error:
        raise RecordError("lists or objects are nested too deeply") from error


def as_json(record: Storable) -> Any:
    """A record as dicts, lists, texts and numbers: what `json.dumps` takes."""
    return msgspec.to_builtins(record)


def canonical(record: Storable) -> str:
    """One line of JSON with sorted keys: equal records give equal bytes. NaN is refused."""
    return canonical_json(as_json(record))


def readable(record: Storable) -> str:
    """Indented JSON with sorted keys and a final newline, for files people open."""
    return readable_json(as_json(record))


def number(value: float) -> float | None:
    """A metric as a JSON value: None for NaN and inf."""
    return float(value) if math.isfinite(value) else None


def short_json(value: Json) -> str:
    """A JSON value in at most 40 characters, for messages."""
    text = json.dumps(value)
    return text if len(text) <= 40 else text[:37] + "..."


def find_repeated(values: Iterable[_H]) -> list[_H]:
    """Each value that occurs more than once, in the order of first occurrences; in linear time."""
    return [value for value, n in Counter(values).items() if n > 1]


def _decoder(kind: type[_T]) -> msgspec.json.Decoder[_T]:
    """The decoder of a type, which every use of the type asks for first.

    msgspec 0.22 fills a type's tables, and those of the types inside it, at their first use; a
    second thread that uses one of them meanwhile reads NULL and the process ends (decision 032).
    One thread at a time fills tables, and no type is used before its own are full.
    """
    decoder = _DECODERS.get(kind)
    if decoder is None:
        with _FILLING:
            decoder = _DECODERS.setdefault(kind, msgspec.json.Decoder(kind))
    return decoder


def _sentence(text: str) -> str:
    """msgspec's message in one style: "expected int, got str at $.images[3].id"."""
    text = _AT.sub(r" at \1", text).replace("`", "")
    return text[:1].lower() + text[1:]


def _describe_malformed(data: bytes | str) -> str:
    """Why a text is not JSON, by line and column where Python's reader can tell."""
    try:
        text = data if isinstance(data, str) else utf8_text(data)
        json.loads(text)
    except (ValueError, RecursionError) as error:
        return f"not JSON: {error}"
    # What Python's reader takes:
    return f"not JSON: {_half_pair(text) or 'NaN, infinity or -infinity'}"


def _half_pair(text: str) -> str:
    """Where a JSON text escapes half of a surrogate pair; "" where it does not."""
    if not _MAY_BE_HALF.search(text):
        return ""
    high = None
    for escape in _ESCAPE.finditer(text):
        code = int(escape[1] or "0", 16)
        if high is not None:
            if escape.start() == high.end() and 0xDC00 <= code <= 0xDFFF:
                high = None
                continue
            return _half_at(text, high)
        if 0xDC00 <= code <= 0xDFFF:
            return _half_at(text, escape)
        high = escape if 0xD800 <= code <= 0xDBFF else None
    return "" if high is None else _half_at(text, high)


def _half_at(text: str, escape: re.Match[str]) -> str:
    line = text.count("\n", 0, escape.start()) + 1
    column = escape.start() - text.rfind("\n", 0, escape.start())
    return f"half of a surrogate pair, {escape[0]}: line {line} column {column}"
