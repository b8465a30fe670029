"""The authoring guide of a task, as values and as the text of `legoworld list schema`.

The wording is in readouts/instructions/scene.toml; every value in it comes from the task's card.
"""

from __future__ import annotations

import json
import textwrap
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

from legoworld.cards import Card
from legoworld.errors import InstallationError
from legoworld.files import Json
from legoworld.pluralize import plural
from legoworld.readouts.family import Protocol
from legoworld.readouts.family import protocol as protocol_of_task
from legoworld.scene.blender_process import Limits
from legoworld.scene.folder import BLEND, GLB, PICTURE, PROGRAM
from legoworld.shipped import catalog
from legoworld.tracks.vocabulary import Vocabulary, normal_name

WORDING: Final = "instructions/scene.toml"
#: Who reads: a person with `legoworld` at hand, or an agent in a workspace with Blender alone.
Reader = Literal["person", "agent"]


@dataclass(frozen=True, kw_only=True)
class Section:
    """One topic with its statements in reading order."""

    id: str
    title: str
    statements: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Instructions:
    """A task's instructions.

    labels_file: an example of labels.json; None for tasks without labels.
    """

    protocol: Protocol
    sections: tuple[Section, ...]
    labels_file: Mapping[str, Json] | None


def instructions(protocol: Protocol, reader: Reader = "person") -> Instructions:
    """The instructions of a task with its vocabulary.

    Raises InstallationError when the wording has no sentence for a value of the card.
    """
    path = catalog.folder("readouts") / WORDING
    with path.open("rb") as stream:
        wording = tomllib.load(stream)
    example = _example(protocol, wording["examples"])
    labels_file = _labels_file(protocol, example)
    render = _Renderer(protocol, wording["rules"], example, labels_file, reader)
    return Instructions(
        protocol=protocol,
        sections=tuple(
            Section(
                id=section["id"],
                title=section["title"],
                statements=tuple(filter(None, map(render.text, section["says"]))),
            )
            for section in wording["sections"]
            if protocol.task.family.labelled or not section.get("labelled", False)
            if section.get("reader", reader) == reader
        ),
        labels_file=labels_file,
    )


def accepted_synonyms(vocabulary: Vocabulary) -> dict[str, str]:
    """Accepted labels other than the category names, with the category of each."""
    names = {normal_name(c.name) for c in vocabulary.categories}
    category_of = {}
    for category in vocabulary.categories:
        for synonym in (*category.synonyms, *vocabulary.list_bare_words(category)):
            matched = vocabulary.match(synonym)
            if normal_name(synonym) not in names and matched is not None:
                category_of[synonym] = matched.name
    return dict(sorted(category_of.items()))


class _Renderer:
    """Templates filled in with one task's card."""

    def __init__(
        self,
        protocol: Protocol,
        rules: Mapping[str, Mapping[str, str]],
        example: Mapping[str, str] | None,
        labels_file: Mapping[str, Json] | None,
        reader: Reader,
    ) -> None:
        from jinja2 import Environment, StrictUndefined

        self._environment = Environment(undefined=StrictUndefined, autoescape=False)
        self._card: Card = protocol.card
        self._rules = rules
        limits = Limits()
        self._facts = {
            "task": protocol.task.name,
            "reader": reader,
            "card": protocol.card.values,
            "vocabulary": protocol.vocabulary is not None,
            "files": {"blend": BLEND, "glb": GLB, "picture": PICTURE, "program": PROGRAM},
            "limits": {
                "time_s": f"{limits.time_s:g}",
                "memory_gib": f"{limits.memory_bytes / 2**30:g}",
            },
            "example": example,
            "own_vocabulary": _has_own_vocabulary(protocol),
            "labels_file_json": json.dumps(labels_file),
            "rule": self.rule,
        }

    def text(self, template: str) -> str:
        """One statement; empty if it does not apply to the task."""
        return self._environment.from_string(template).render(self._facts).strip()

    def rule(self, key: str) -> str:
        """The sentence for the card's value at a dotted key; its own [instructions] come first."""
        own = self._card.values.get("instructions", {}).get(key)
        if own is not None:
            return str(own)
        value = self._card.value(key)
        said = str(value).lower() if isinstance(value, bool) else str(value)
        sentences = self._rules.get(key, {})
        if said not in sentences:
            raise InstallationError(
                f"the instructions have no sentence for the card of {self._card.task}",
                found=f"{key} = {value!r}",
                expected=" or ".join(map(repr, sentences)) or f"a rule for {key}",
                next_step=f"add the sentence to [instructions] of {self._card.file}, or to "
                f"{Path('readouts') / WORDING}",
            )
        return self.text(sentences[said])


def _has_own_vocabulary(reading: Protocol) -> bool:
    """Whether the categories are a track's own instead of those that ship with the task."""
    shipped = protocol_of_task(reading.task.name, None).vocabulary
    return reading.vocabulary is not None and reading.vocabulary != shipped


def _example(
    protocol: Protocol, examples: Mapping[str, Mapping[str, str]]
) -> Mapping[str, str] | None:
    """The dataset's example, with categories of this vocabulary if it lacks the usual ones."""
    vocabulary = protocol.vocabulary
    if vocabulary is None:
        return None
    example = examples.get(protocol.task.dataset.name, next(iter(examples.values())))
    names = [category.name for category in vocabulary.categories]
    own = dict(zip(("object_category", "collection_category"), (names[0], names[-1]), strict=True))
    return {
        key: own[key] if key in own and vocabulary.match(text) is None else text
        for key, text in example.items()
    }


def _labels_file(protocol: Protocol, example: Mapping[str, str] | None) -> Mapping[str, Any] | None:
    rules = protocol.card.record.vocabulary
    if example is None or rules is None:
        return None
    key = rules.property
    return {
        "version": 1,
        "labels": [
            {kind: example[kind], key: example[f"{kind}_category"]}
            for kind in ("object", "collection")
        ],
    }


def instructions_text(instructions: Instructions) -> str:
    """What a scene's author needs to know, and nothing private. Ends with a newline."""
    task, card = instructions.protocol.task.name, instructions.protocol.card
    lines = [f"# How to write a scene for {task}: {card.record.readout.title} ({card.version})"]
    for section in instructions.sections:
        lines.append(f"\n## {section.title}")
        lines += [_wrap_text(statement, "- ", "  ") for statement in section.statements]
    if instructions.protocol.vocabulary is not None:
        names = [c.name for c in instructions.protocol.vocabulary.categories]
        lines.append(f"\n## Vocabulary: {plural(len(names), 'name', 'names')}")
        lines.append(_wrap_text(", ".join(names), "", ""))
    return "\n".join(lines) + "\n"


def _wrap_text(text: str, first: str, others: str) -> str:
    return textwrap.fill(
        text,
        width=100,
        initial_indent=first,
        subsequent_indent=others,
        break_long_words=False,
        break_on_hyphens=False,
    )
