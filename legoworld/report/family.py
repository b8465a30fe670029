"""The page of a family: how an evaluation is told in a sentence, plotted, and shown by image."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from legoworld.evaluation.stored import Evaluated
from legoworld.records.report_summary import Span
from legoworld.records.report_tables import PageSection
from legoworld.tasks.registry import family_of

if TYPE_CHECKING:
    from legoworld.report.page_content import PageDocument, Photos
    from legoworld.report.sources import Section


def _no_notes(_side: Evaluated) -> list[str]:
    return []


@dataclass(frozen=True, kw_only=True)
class PageFamily:
    """How answers of one kind are shown.

    sentence: an evaluation's name and summary to its first metric with denominators. forest: the
    main metrics, as comparisons call them, with the page's names; span: a metric of a summary, None
    where it has none. fill: a section with its tables and photos, whose views go into the document;
    None for a section of tables alone. notes: an evaluation's sentences about its counts.
    by_folder: whether several runs of scenes are told apart by their folders.
    """

    sentence: Callable[[str, Any], str]
    forest: Mapping[str, str]
    span: Callable[[Any, str], Span | None]
    lower_is_better: frozenset[str] = field(default_factory=frozenset)
    fill: Callable[[Section, PageSection, PageDocument, Photos], PageSection] | None = None
    notes: Callable[[Evaluated], list[str]] = _no_notes
    by_folder: bool = False


def page_of(task: str) -> PageFamily:
    """The page of a task. UsageError, InstallationError."""
    return family_of(task).load("page", PageFamily)
