"""`legoworld list`."""

from __future__ import annotations

import json
import tomllib
from typing import Any

import click

from legoworld import catalog
from legoworld.commands import options


@click.command("list", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("kind", type=click.Choice(["tasks", "datasets", "baselines", "schema"]))
@click.option(
    "--task",
    type=click.Choice(["coco", "lvis"]),
    default="coco",
    show_default=True,
    help="Whose schema.",
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
def command(kind: str, task: str, as_json: bool) -> int:
    """List the tasks, datasets and baselines there are, or how a scene is labelled.

    \b
    Examples:
      legoworld list tasks
      legoworld list datasets --json
      legoworld list schema --task coco
    """
    if kind == "schema":
        return _schema(task, as_json=as_json)
    cards = _cards(kind)
    if as_json:
        options.print_json({kind: cards})
    elif not cards:
        click.echo(f"no {kind} are installed")
    else:
        header = ("name", "version", "what", "licence")
        rows = [(c["name"], c["version"], c["title"], c["licence"]) for c in cards]
        click.echo(options.table(header, rows))
    return 0


def _cards(kind: str) -> list[dict[str, Any]]:
    if kind == "tasks":
        paths = sorted(catalog.folder("readouts").glob("*.toml"))
    else:
        folder = catalog.folder("datasets" if kind == "datasets" else "baselines")
        paths = sorted(folder.glob("*/card.toml"))
    cards = []
    for path in paths:
        values = tomllib.loads(path.read_text(encoding="utf-8"))
        top = values.get("readout", values)
        cards.append({key: top.get(key, "") for key in ("name", "version", "title", "licence")})
    return cards


def _schema(task: str, *, as_json: bool) -> int:
    """What a scene's author needs to know, and nothing private."""
    from legoworld.readouts.tasks import protocol

    reading = protocol(task, None)
    assert reading.vocabulary is not None
    names = [c.name for c in reading.vocabulary.categories]
    rules = {
        "property": "category",
        "override_property": reading.override_property,
        "labels_file": {
            "version": 1,
            "labels": [
                {"object": "Sofa", "category": names[0]},
                {"collection": "Table set", "category": names[-1]},
            ],
        },
        "vocabulary": names,
    }
    if as_json:
        options.print_json({"task": task, **rules})
        return 0
    click.echo(
        f"Set the custom property `category` (or `{reading.override_property}`, which wins) to a "
        "name below\non an object: it and all its descendants are one instance;\non a "
        "collection: everything in it is one instance;\non an object that instances a collection: "
        "each placement is one instance.\nOr put labels.json beside scene.blend:\n"
        f"{json.dumps(rules['labels_file'])}\n"
    )
    click.echo(", ".join(names))
    return 0
