"""A fault put into a set of known content, and whether a page's first screen names it."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from report.pages import document_of

from legoworld.records.report_tables import Cost, PageSection
from legoworld.report.page_content import PageDocument


@dataclass(frozen=True, kw_only=True)
class Planted:
    """What was planted. evaluations: of the page, the one with the fault at `side`.

    kind, says: of the line that must name it; size: what an evaluation without the fault gains, and
    within: how near the line's number must be; images: those that its link must lead to.
    """

    evaluations: tuple[Path, ...]
    kind: str
    says: tuple[str, ...]
    size: float
    images: frozenset[int]
    within: float = 1e-9
    metric: str = ""
    side: int = 0
    advice: dict[int, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Plant:
    """A fault by its name; make: into a folder, drawn by a random generator."""

    task: str
    name: str
    make: Callable[[Path, np.random.Generator], Planted]

    @property
    def id(self) -> str:
        return f"{self.task}: {self.name}"


def check(planted: Planted) -> PageDocument:
    """Hold the first screen to the fault: named, of the right size, within one click."""
    document = document_of(*planted.evaluations)
    (section,) = document.sections
    of = [c for c in section.first.costs if planted.metric in ("", c.metric)][planted.side]
    named = [
        c for c in of.most if c.kind == planted.kind and all(w in c.text for w in planted.says)
    ]
    assert named, (planted, of)
    cost = named[0]
    assert abs(cost.gain - planted.size) <= planted.within, (cost, planted.size)
    there = listed_photos(section, cost)
    whole = bool(there & planted.images) if len(there) == 1 else planted.images <= there
    assert whole, (cost, planted.images, there)
    advised = {v.id: v.sides[planted.side].advice for v in document.views}
    for image, words in planted.advice.items():
        said = [f"{a.what} => {a.do}" for a in advised[image]]
        assert any(re.search(words, one) for one in said), (words, said)
    return document


def listed_photos(section: PageSection, cost: Cost) -> set[int]:
    """The photos that a line's link shows, by the filters of gallery.js."""
    alone = re.fullmatch(r"/(\d+)", cost.link)
    if alone:
        return {int(alone[1])}
    asked = dict(part.split("=") for part in cost.link.removeprefix("?").split("&"))
    found = set()
    for row in section.images:
        cells = [row.cells[int(asked["of"])]] if "of" in asked else row.cells
        kinds = [getattr(cell, "errors", {}) for cell in cells]
        kind, category = asked.get("kind"), int(asked.get("cat", -1))
        if kind == "failed":
            shown = any(cell.status != "ok" or not getattr(cell, "valid", True) for cell in cells)
        elif kind:
            shown = any(category in errors.get(kind, ()) for errors in kinds)
        else:
            shown = category == -1 or category in row.categories
        found |= {row.id} if shown else set()
    return found
