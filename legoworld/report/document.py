"""Evaluations to what the page holds: tables, a list of photos, and a view of each photo."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from msgspec.structs import replace

from legoworld.errors import UsageError
from legoworld.evaluation.family import load_evaluation_family
from legoworld.records.report_tables import PageSection, SideHead, SideNotes
from legoworld.report.family import load_page_family
from legoworld.report.first_screen import first_screen
from legoworld.report.page_content import PageDocument, Photos
from legoworld.report.provenance import compare_command, provenance
from legoworld.report.scene_files import SceneFiles
from legoworld.report.sources import Section
from legoworld.report.systems import photos_table, systems_table
from legoworld.report.tables import (
    comparison_tables,
    coverage_table,
    number_tables,
    without_specialist,
)
from legoworld.report.tags import read_tags, tag_images
from legoworld.tasks.registry import require_task


def page_document(
    sections: Sequence[Section],
    photos: Path | None,
    scenes: Sequence[Path] = (),
    tags: Path | None = None,
) -> PageDocument:
    """The whole page as values.

    photos: the folder they are looked up in, None for none; scenes: where the scene folders lie,
    for renders and 3D; tags: a CSV of tags of photos. UsageError for a CSV without a tag of these.
    """
    tagged = read_tags(tags) if tags else {}
    document = PageDocument(scenes=SceneFiles(folders=tuple(scenes)))
    places = Photos(folder=photos, document=document)
    for section in sections:
        made = _section_tables(section)
        if section.sides:
            fill = load_page_family(section.task).fill
            made = fill(section, made, document, places) if fill else replace(made, names={})
            made = replace(
                made,
                overview=(*made.overview, *systems_table(section)),
                numbers=(*made.numbers, *photos_table(section, made.images)),
                tags=tag_images(tagged, made.images),
            )
        document.sections.append(made)
    if tags and not any(section.tags for section in document.sections):
        names = sorted(set[str]().union(*tagged.values()))
        raise UsageError(
            f"{tags.name} has no tag of a photo of this page",
            found=", ".join(names[:3]) or "no line",
            expected="file names as the track has them",
        )
    return document


def _section_tables(section: Section) -> PageSection:
    sides = section.sides
    task = require_task(section.task)
    specialist = task.family.baseline is None or any(not s.is_scene for s in sides)
    made = PageSection(
        key=section.key,
        task=section.task,
        family=require_task(section.task).family.name,
        title=task.title,
        sides=tuple(
            SideHead(
                label=s.name,
                scored=s.summary.coverage.scored,
                scene=s.is_scene,
                used_truth=bool(s.used_truth),
            )
            for s in sides
        ),
        specialist=specialist,
        comparison=section.comparison,
        pairs=tuple(comparison_tables(section.comparison)) if section.comparison else (),
        compared=compare_command(section.comparison, sides) if section.comparison else None,
        first=first_screen(section),
    )
    if not sides:
        return made
    tables = [*number_tables(sides), coverage_table(sides)]
    return replace(
        made,
        evaluators=tuple(s.summary.evaluator for s in sides),
        partial=tuple(s.name for s in sides if s.summary.partial),
        numbers=tuple(tables if specialist else map(without_specialist, tables)),
        notes=tuple(
            SideNotes(label=s.name, lines=tuple(load_evaluation_family(s.task).notes(s.summary)))
            for s in sides
        ),
        provenance=tuple(provenance(s) for s in sides),
        attempted=sides[0].summary.coverage.attempted,
    )
