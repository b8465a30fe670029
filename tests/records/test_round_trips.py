"""Every record reads back as it was written, with None and with nothing wherever its type has it.

Values are made from the types themselves, so that a record that is added is tested as well.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator
from typing import Annotated, Any

import msgspec
import pytest
from msgspec import inspect

import legoworld.records
from legoworld.records.base import Record, RecordError, canonical, decode


def every_record() -> list[type[Record]]:
    """Each record type of legoworld/records that a file or a message is."""
    for module in pkgutil.walk_packages(legoworld.records.__path__, "legoworld.records."):
        importlib.import_module(module.name)
    found, pending = set(), [Record]
    while pending:
        kinds = pending.pop().__subclasses__()
        pending += kinds
        found |= {kind for kind in kinds if kind.__module__.startswith("legoworld.records.")}
    return sorted(found, key=lambda kind: f"{kind.__module__}.{kind.__name__}")


def values_of(kind: inspect.Type) -> list[Any]:
    """JSON values of a type: each kind of it once, the plainest first, None among the others."""
    match kind:
        case inspect.UnionType():
            return [value for part in kind.types for value in values_of(part)]
        case inspect.Metadata():
            return values_of(kind.type)
        case inspect.StructType():
            return [document(kind.cls)]
        case inspect.LiteralType():
            return [kind.values[0]]
        case inspect.NoneType():
            return [None]
        case inspect.BoolType():
            return [True]
        case inspect.IntType():
            return [_number(kind)]
        case inspect.FloatType():
            return [float(_number(kind))]
        case inspect.StrType():
            return [_text(kind)]
        case inspect.AnyType() | inspect.CustomType():  # object
            return [{"a": [None, 1]}]
        case inspect.TupleType():
            return [[values_of(part)[0] for part in kind.item_types]]
        case inspect.VarTupleType() | inspect.ListType():
            n = max(kind.min_length or 0, 1)
            return [[value] * n for value in values_of(kind.item_type)]
        case inspect.DictType():
            (key, *_) = values_of(kind.key_type)
            return [{str(key): value} for value in values_of(kind.value_type)]
    raise TypeError(f"no value of {kind}")


def _number(kind: inspect.IntType | inspect.FloatType) -> float:
    least, most = kind.ge if kind.ge is not None else kind.gt, kind.le
    value = 1 if least is None or least <= 1 else least + 1
    return value if most is None or value <= most else most


def _text(kind: inspect.StrType) -> str:
    meta = msgspec.Meta(
        pattern=kind.pattern, min_length=kind.min_length, max_length=kind.max_length
    )
    for text in ("a", "0" * 64, "coco/a.b-1", "1.0.0", "2026-01-01", "https://a.b"):
        try:
            msgspec.convert(text, Annotated[str, meta])
        except msgspec.ValidationError:
            continue
        return text
    raise TypeError(f"no text of {kind}")


def fields_of(kind: type[Record]) -> tuple[inspect.Field, ...]:
    info = inspect.type_info(kind)
    assert isinstance(info, inspect.StructType)
    return info.fields


def document(kind: type[Record]) -> dict[str, Any]:
    """A record as JSON, with its first kind of value everywhere."""
    config = kind.__struct_config__
    tag = {config.tag_field: config.tag} if config.tag_field else {}
    return tag | {field.encode_name: values_of(field.type)[0] for field in fields_of(kind)}


def variants(kind: type[Record]) -> Iterator[tuple[str, dict[str, Any]]]:
    """The record whole; each field with every kind of value it takes; each that may be left out."""
    whole = document(kind)
    yield "whole", whole
    for field in fields_of(kind):
        name = field.encode_name
        yield from ((name, whole | {name: value}) for value in values_of(field.type)[1:])
        if not field.required:
            yield name, {key: value for key, value in whole.items() if key != name}


@pytest.mark.parametrize("kind", every_record(), ids=lambda kind: kind.__name__)
def test_every_value_a_type_takes_comes_back(kind):
    for name, written in variants(kind):
        try:
            record = decode(kind, msgspec.json.encode(written))
        except RecordError as error:
            raise AssertionError(f"{kind.__name__}.{name}: {error}") from error
        assert decode(kind, canonical(record)) == record, name
        assert canonical(decode(kind, canonical(record))) == canonical(record), name


def test_the_values_made_hold_none_and_nothing():
    """Without them the test above would prove little."""
    documents = [written for kind in every_record() for _, written in variants(kind)]
    made = [value for written in documents for value in written.values()]
    assert sum(value is None for value in made) > 100
    left_out = [f for kind in every_record() for f in fields_of(kind) if not f.required]
    assert len(left_out) > 100
