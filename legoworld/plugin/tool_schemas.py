"""JSON Schemas of the tools' arguments and answers, from their records; arguments decoded by them.

A model reads the schemas of arguments with every request, so they are short: no titles, nulls and
ranges, and the arguments of requirements once, beside a union that says which kind needs which.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any, Final, TypeVar, get_args

import msgspec

from legoworld.errors import UsageError
from legoworld.files import Json
from legoworld.pluralize import nearest_names
from legoworld.records.base import RecordError, to_record
from legoworld.records.plugin_requirements import AnyRequirement, Requirement

JsonObject = dict[str, Any]
_T = TypeVar("_T")
_S = TypeVar("_S", bound=msgspec.Struct)

#: The records of requirements, by the name of their kind.
KINDS: Final[Mapping[str, type[msgspec.Struct]]] = {
    str(kind.__struct_config__.tag): kind for kind in get_args(Requirement)
}
_REQUIREMENTS: Final = "requirements"
#: The tool that shows an argument of several whole.
_SHOWN_BY: Final = {_REQUIREMENTS: "measure", "structures": "initialize"}
_RANGES: Final = {"exclusiveMinimum", "minimum", "minItems", "pattern"}
_REFERENCE: Final = "#/$defs/{name}"
#: What every kind takes.
_OF_ALL: Final = ("hard", "accept")
_NULL: Final = {"type": "null"}
_UNSAID: Final = ("title", "default")
_DROPPED: Final = ("title", "default", "minLength", "maxLength", "maxItems")
_STEP: Final = re.compile(r"\.([^.\[]+)|\[(\d+|\.\.\.)\]")


@cache
def answer_schema(record: type[msgspec.Struct]) -> JsonObject:
    """What a tool answers: the record with its descriptions, self-contained."""
    _, parts = msgspec.json.schema_components([record], ref_template=_REFERENCE)
    own: JsonObject = _answer_schema(parts.pop(record.__name__))
    # Of every answer, what its base says, too.
    own["description"] = " ".join(_flat(kind.__doc__) for kind in record.__mro__[:-4])
    kinds = {kind.__name__ for kind in KINDS.values()}
    rest = {name: _answer_schema(part) for name, part in parts.items() if name not in kinds}
    return {**own, "$defs": rest} if rest else own


def _answer_schema(schema: Any) -> Any:
    """A schema as `tool_answers.brief` leaves it: what may be null may be absent.

    Without titles, descriptions on one line; a requirement, which the client sent, is any object.
    """
    if isinstance(schema, list):
        return [_answer_schema(item) for item in schema]
    if not isinstance(schema, dict):
        return _flat(schema) if isinstance(schema, str) else schema
    if "discriminator" in schema:
        return {"type": "object"}
    if "anyOf" in schema:
        known = [_answer_schema(option) for option in schema["anyOf"] if option != _NULL]
        return known[0] if len(known) == 1 else {"anyOf": known}
    made = {key: _answer_schema(value) for key, value in schema.items() if key not in _UNSAID}
    if isinstance(fields := schema.get("properties"), dict):
        made["required"] = [
            name for name in schema["required"] if _NULL not in fields[name].get("anyOf", ())
        ]
    return made


@cache
def shown_schema(tool: str, record: type[msgspec.Struct]) -> JsonObject:
    """What a tool takes, as a model reads it: what another tool shows whole is "as of" it.

    Without ranges, which an error names: few calls are outside of them.
    """
    schema = argument_schema(record)
    shown = {name: _without_ranges(of) for name, of in schema["properties"].items()}
    for name, by in _SHOWN_BY.items():
        if name in shown and by != tool:
            kind = {k: v for k, v in shown[name].items() if k in ("type", "items")}
            shown[name] = {**kind, "description": f"as of {by}"}
        elif name in shown and name == _REQUIREMENTS:
            shown[name] = {"type": "array", "items": _without_ranges(_requirement_schema())}
    return {**schema, "properties": shown}


def _without_ranges(schema: Any) -> Any:
    if not isinstance(schema, dict):
        return schema
    fixed = "minItems" in schema and "maxItems" in schema
    dropped = _RANGES - {"minItems"} if fixed else _RANGES
    return {key: _without_ranges(value) for key, value in schema.items() if key not in dropped}


@cache
def argument_schema(record: type[msgspec.Struct]) -> JsonObject:
    """What a tool takes, with ranges; of requirements only that they are objects."""
    (_,), parts = msgspec.json.schema_components([record], ref_template=_REFERENCE)
    schema: JsonObject = _short(parts[record.__name__], parts)
    schema.pop("description", None)
    if _REQUIREMENTS in schema["properties"]:
        schema["properties"][_REQUIREMENTS] = {"type": "array", "items": {"type": "object"}}
    return schema


@cache
def _requirement_schema() -> JsonObject:
    """All kinds: the properties of any, and a union by kind of what is needed."""
    shared: dict[str, JsonObject] = {}
    defaults: dict[str, dict[str, list[str]]] = {}
    union: dict[tuple[str, ...], list[str]] = {}
    for name, kind in KINDS.items():
        own = kind_schema(kind)
        needed = tuple(field for field in own["required"] if field != "kind")
        union.setdefault(needed, []).append(name)
        for field in msgspec.structs.fields(kind):
            schema = own["properties"][field.name]
            known = shared.setdefault(field.name, schema)
            shared[field.name] = {k: v for k, v in known.items() if schema.get(k) == v}
            if field.name not in (*needed, *_OF_ALL):
                value = "" if field.default is None else f" {field.default:g}"
                defaults.setdefault(field.name, {}).setdefault(value, []).append(name)
    for field_name, values in defaults.items():
        said = "; ".join(", ".join(names) + value for value, names in values.items())
        shared[field_name] = {**shared[field_name], "description": said}
    options = [
        {
            "properties": {"kind": {"const": names[0]} if len(names) == 1 else {"enum": names}},
            "required": [*needed],
        }
        for needed, names in union.items()
    ]
    return {"type": "object", "properties": shared, "required": ["kind"], "oneOf": options}


@cache
def kind_schema(kind: type[msgspec.Struct]) -> JsonObject:
    """The arguments of one kind of requirement."""
    _, parts = msgspec.json.schema_components([kind], ref_template=_REFERENCE)
    schema: JsonObject = _short(parts[kind.__name__], parts)
    return schema


def requirements_page() -> str:
    """Every kind with its arguments, from the records, as Markdown for a model."""
    lines = ["# Kinds of requirements"]
    for name, kind in KINDS.items():
        taken = []
        for field in msgspec.structs.fields(kind):
            if field.name not in _OF_ALL:
                default = f"={field.default}" if not field.required else ""
                taken.append(field.name + default)
        lines += ["", f"## {name}: {', '.join(taken)}", _flat(kind.__doc__)]
    return "\n".join(lines) + "\n\n" + _flat(AnyRequirement.__doc__) + "\n"


def _short(schema: Any, parts: Mapping[str, JsonObject]) -> Any:
    """A schema without references, titles, defaults, and nulls that a client may leave out."""
    if isinstance(schema, list):
        return [_short(item, parts) for item in schema]
    if not isinstance(schema, dict):
        return schema
    if "$ref" in schema:
        named = parts[schema["$ref"].rpartition("/")[2]]
        return _short({key: value for key, value in named.items() if key != "description"}, parts)
    if "anyOf" in schema:
        options = [o for o in schema["anyOf"] if o != _NULL]
        if len(options) == 1:
            rest = {key: value for key, value in schema.items() if key != "anyOf"}
            return _short({**options[0], **rest}, parts)
    made: JsonObject = {}
    for key, value in schema.items():
        if key == "properties":
            made[key] = {name: _short(of, parts) for name, of in value.items()}
        elif key == "prefixItems":  # a tuple: all of one type
            made.update(minItems=len(value), maxItems=len(value), items=_short(value[0], parts))
        elif key == "items":
            made.setdefault(key, _short(value, parts)) if value is not False else None
        elif key not in _DROPPED and not (key == "required" and not value):
            made[key] = value if key == "enum" else _short(value, parts)
    return made


def _flat(text: str | None) -> str:
    return " ".join((text or "").split())


def decode_arguments(record: type[_S], given: Mapping[str, Json]) -> _S:
    """A call's arguments as their record. UsageError names the place, and what is valid there.

    An argument of null is one that was left out.
    """
    _refuse_no_number(given)
    known = {key: value for key, value in given.items() if value is not None}
    fields = [field.encode_name for field in msgspec.structs.fields(record)]
    _refuse_unknown(known, fields, "the tool", "$")
    wanted = known.get(_REQUIREMENTS)
    if isinstance(wanted, list):
        for n, requirement in enumerate(wanted):
            _check_requirement(requirement, f"$.{_REQUIREMENTS}[{n}]")
    return _decode(record, known, argument_schema(record), "$")


def _check_requirement(given: Json, place: str) -> None:
    if not isinstance(given, dict):
        raise _refused_error(f"{type(given).__name__} at {place}", "an object with a kind")
    name = given.get("kind")
    if not isinstance(name, str) or name not in KINDS:
        raise _refused_error(f"{name!r} at {place}.kind", describe_choices(KINDS, name))
    schema = kind_schema(KINDS[name])
    _refuse_unknown(given, [*schema["properties"]], name, place)
    _decode(KINDS[name], given, schema, place)


def _decode(record: type[_T], given: Json, schema: JsonObject, place: str) -> _T:
    try:
        return to_record(record, given)
    except RecordError as error:
        what, at, path = str(error).rpartition(" at $")
        if not at:
            what, path = str(error), ""
        expected = _said_of(_schema_at(schema, path), what)
        raise _refused_error(f"{what} at {place}{path}", expected) from error


def _schema_at(schema: JsonObject, path: str) -> JsonObject:
    """The part of a schema for a place such as `.kinds[0]`."""
    for field, _ in _STEP.findall(path):
        properties = schema.get("properties", {})
        inner = schema.get("items") or schema.get("additionalProperties") or {}
        schema = properties.get(field, {}) if field else inner
    return schema


def _said_of(schema: JsonObject, what: str) -> str:
    """What a schema allows, in words: its values, or its type and limits."""
    if "enum" in schema:
        given = re.search(r"'(.*)'", what)
        return describe_choices(schema["enum"], given[1] if given else "")
    limits = {
        "minimum": "from {}", "maximum": "to {}", "exclusiveMinimum": "above {}",
        "minItems": "at least {} items",
    }  # fmt: skip
    said = [text.format(f"{schema[key]:g}") for key, text in limits.items() if key in schema]
    named = [f"({schema['description']})"] if "description" in schema else []
    required = schema.get("required", [])
    needs = [f"with {', '.join(required)}"] if required else []
    return " ".join([str(schema.get("type", "")), *said, *needs, *named]).strip()


def describe_choices(valid: Iterable[str], given: Json) -> str:
    """The valid values, and the nearest to what was given."""
    names = [*valid]
    near = nearest_names(str(given), names, 1)
    return f"one of {', '.join(names)}" + (f"; nearest: {near[0]}" if near else "")


def _refuse_unknown(given: Mapping[str, Json], valid: list[str], what: str, place: str) -> None:
    for key in given:
        if key not in valid:
            raise _refused_error(
                f"{what} has no argument {key!r} at {place}",
                describe_choices(valid, key) if valid else "no arguments",
            )


def _refused_error(found: str, expected: str) -> UsageError:
    return UsageError("the arguments cannot be used", found=found, expected=expected)


def _refuse_no_number(value: Json, place: str = "$") -> None:
    """UsageError for a NaN or infinity anywhere: a ledger cannot store them."""
    if isinstance(value, float) and not math.isfinite(value):
        raise _refused_error(f"{value} at {place}", "finite numbers")
    if isinstance(value, Mapping):
        for key, item in value.items():
            _refuse_no_number(item, f"{place}.{key}")
    elif isinstance(value, list):
        for n, item in enumerate(value):
            _refuse_no_number(item, f"{place}[{n}]")
