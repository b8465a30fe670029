"""`legoworld list`."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from legoworld import exit_codes
from legoworld.commands import options
from legoworld.commands.options import option
from legoworld.commands.output import Output, table
from legoworld.commands.param_types import Choice, TaskChoice
from legoworld.records.formats import FORMATS, schema_text
from legoworld.shipped import catalog
from legoworld.tasks.registry import broken_tasks, known_tasks
from legoworld.tasks.shipped import DEFAULT

if TYPE_CHECKING:
    from legoworld.readouts.family import Protocol
    from legoworld.readouts.instructions import Instructions
    from legoworld.records.cards import LicensedHead

C = TypeVar("C", bound="LicensedHead")


@click.command("list")
@click.argument("kind", type=Choice(["tasks", "datasets", "baselines", "formats", "schema"]))
@option(
    "--task",
    "List only entries for this task; schema: the task to describe [default: coco].",
    TaskChoice(),
)
@option("--track", "schema: track whose vocabulary is printed; sets the task if it records one.")
@option(
    "--format file_format",
    "schema: print the JSON Schema of a file format instead; `list formats` has the names.",
    Choice(sorted(FORMATS)),
    metavar="NAME",
)
@options.printing_json
def command(
    kind: str, task: str | None, track: Path | None, file_format: str | None, out: Output
) -> int:
    """List tasks, datasets, baselines or file formats, or print the authoring guide (schema).

    Exit code 1 when a task of an installed package cannot be loaded.

    \b
    Examples:
      legoworld list tasks
      legoworld list baselines --task lvis
      legoworld list schema --task coco --track track.json
      legoworld list schema --format track > track.schema.json
    """
    if kind == "schema" and file_format is not None:
        options.refuse_given(["task", "track"], "is for the authoring guide, not with --format")
        click.echo(schema_text(file_format), nl=False)
        return 0
    if kind == "schema":
        from legoworld.api.settings import load_protocol

        reading = load_protocol(task if task or track else DEFAULT, track)
        assert reading is not None
        return _schema(reading, out)
    options.refuse_given(["track", "file_format"], f"is for schema, not for {kind}")
    if kind == "formats":
        options.refuse_given(["task"], "is not for formats")
        rows = [(name, one.file) for name, one in sorted(FORMATS.items())]
        formats = [{"name": name, "file": file} for name, file in rows]
        out.show({"formats": formats}, table(("name", "file"), rows))
        return 0
    cards = _cards(kind, task)
    broken = broken_tasks() if kind == "tasks" else []
    for error in broken:
        click.echo(f"legoworld: {error}", err=True)
    keys = ("name", "version", "title", "licence")
    shown = [(*words, _truncate_cell(licence)) for *words, licence in cards]
    none = f"no {kind} are installed" + (f" for {task}" if task else "")
    out.show(
        {kind: [dict(zip(keys, card, strict=True)) for card in cards]},
        table(("name", "version", "what", "licence"), shown) if cards else none,
    )
    return exit_codes.INCOMPLETE if broken else exit_codes.DONE


def _truncate_cell(text: str, limit: int = 60) -> str:
    """A truncated table cell; --json has the full text."""
    return text if len(text) <= limit else f"{text[: limit - 1]}…"


def _cards(kind: str, task: str | None) -> list[tuple[str, ...]]:
    """Name, version, title and licence of every card of a kind, or of those for a task."""
    if kind == "tasks":
        from legoworld.cards import load_card

        readouts = [load_card(one.name).record.readout for one in known_tasks()]
        readouts.sort(key=lambda readout: readout.name)
        return [(r.name, r.version, r.title, "") for r in readouts if task in (None, r.task)]
    from legoworld.records.cards import BaselineCardFile, DatasetCardFile

    paths = sorted(
        catalog.folder("datasets" if kind == "datasets" else "baselines").glob("*/card.toml")
    )
    served: list[tuple[LicensedHead, Collection[str]]]
    if kind == "datasets":
        cards = [_card(DatasetCardFile, path) for path in paths]
        served = [(c, [t.name for t in known_tasks() if t.dataset.name in c.serves]) for c in cards]
    else:
        served = [(card, card.tasks) for card in (_card(BaselineCardFile, path) for path in paths)]
    return [
        (head.name, head.version, head.title, head.licence)
        for head, tasks in served
        if task is None or task in tasks
    ]


def _card(kind: type[C], path: Path) -> C:
    from legoworld.cards import read_toml

    return read_toml(
        kind,
        path,
        what=f"{path.parent.name}/{path.name}",
        expected="a card with name, version, title and licence",
        next_step="correct the card, or install legoworld again",
    )


def _schema(reading: Protocol, out: Output) -> int:
    """The authoring guide of a task; nothing in it is private."""
    from legoworld.readouts.instructions import instructions, instructions_text

    text = instructions(reading)
    out.show(lambda: _document(text), [instructions_text(text).removesuffix("\n")])
    return 0


def _document(instructions: Instructions) -> dict[str, Any]:
    from legoworld.readouts.instructions import accepted_synonyms

    reading = instructions.protocol
    vocabulary, rules = reading.vocabulary, reading.card.record.vocabulary
    return {
        "task": reading.task.name,
        "card": {"version": reading.card.version, "sha256": reading.card.sha256},
        "sections": [
            {"id": s.id, "title": s.title, "statements": list(s.statements)}
            for s in instructions.sections
        ],
        "property": rules.property if rules else None,
        "override_property": reading.override_property,
        "labels_file": instructions.labels_file,
        "vocabulary": [c.name for c in vocabulary.categories] if vocabulary else None,
        "synonyms": accepted_synonyms(vocabulary) if vocabulary else None,
        "vocabulary_sha256": vocabulary.sha256 if vocabulary else None,
    }
