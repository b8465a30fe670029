"""Relations: one JSON file of facts per photo."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from msgspec.structs import replace

from legoworld.files import sha256_of_file, write_text
from legoworld.readouts.family import AnsweredImage, ReadoutFamily, answer_file
from legoworld.readouts.relation_facts import MOST_OBJECTS, relation_facts
from legoworld.readouts.relation_kinds import FactBase
from legoworld.records.base import canonical
from legoworld.records.relations import AnswerFile
from legoworld.records.run_rows import RunRow
from legoworld.records.submission import WrittenFile
from legoworld.tables.table import Column, Number, Table

#: What is told of a scene: of a relation and its inverse, one.
TOLD: Final = frozenset(
    {
        "left_of",
        "above",
        "in_front_of",
        "on",
        "inside",
        "touching",
        "colliding",
        "near",
        "facing",
        "hides",
    }
)


def write_answers(run: Path, name: str, answers: AnswerFile) -> WrittenFile:
    """Write an image's file below a run; what its row says of it."""
    file = answer_file(name, ".json")
    path = run / file
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, canonical(answers) + "\n")
    return WrittenFile(file=file, sha256=sha256_of_file(path), bytes=path.stat().st_size)


def _write(row: RunRow, image: AnsweredImage) -> RunRow:
    facts = relation_facts(image.view, image.instances, threads=image.threads)
    warnings = row.warnings
    if facts.left_out:
        warnings += (
            f"relations are of the {MOST_OBJECTS} largest visible objects: "
            f"{facts.left_out} more are left out",
        )
    file = write_answers(image.run, image.name, AnswerFile(facts=facts))
    return replace(row, answer=file, warnings=warnings)


def _cost(_reads: str, image: AnsweredImage) -> str:
    shown = sum(i.category is not None and bool(image.view.area_px[i.id]) for i in image.instances)
    kept = min(shown, MOST_OBJECTS)
    return f"relations of {kept} of {shown:,} visible objects: {kept * (kept - 1) // 2:,} pairs"


def _table(_reads: str, image: AnsweredImage) -> Table:
    base = FactBase(relation_facts(image.view, image.instances, threads=image.threads))
    told = [row for row in base.rows() if row["asked"] and row["holds"]]
    columns = ("instance", "relation", "of", "margin", "unit")
    return Table(
        title="Relations beyond their slack",
        columns=tuple(Column(name=name) for name in columns),
        rows=tuple(
            (_describe_object(base, row["a"]), row["relation"], _describe_object(base, row["b"]),
             Number(value=row["margin"], digits=2), row["unit"])
            for row in told
            if row["relation"] in TOLD
        ),
    )  # fmt: skip


def _describe_object(base: FactBase, thing: int) -> str:
    return f"{thing} {base.objects[thing].category}"


READOUT: Final = ReadoutFamily(
    write=_write,
    table=_table,
    cost=_cost,
)
