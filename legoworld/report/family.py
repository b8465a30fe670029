"""The page of a family: which metrics stand first, and how its images are shown."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from legoworld.records.report_tables import PageSection
from legoworld.tasks.registry import find_family

if TYPE_CHECKING:
    from legoworld.report.page_content import PageDocument, Photos
    from legoworld.report.sources import Section


@dataclass(frozen=True, kw_only=True)
class PageFamily:
    """How answers of one kind are shown.

    forest: the main metrics, as comparisons call them, with the page's names; the first is told in
    a sentence. fill: a section with its tables and photos, whose views go into the document;
    None for a section of tables alone. by_folder: whether several runs of scenes are told apart by
    their folders.
    """

    forest: Mapping[str, str]
    fill: Callable[[Section, PageSection, PageDocument, Photos], PageSection] | None = None
    by_folder: bool = False


def load_page_family(task: str) -> PageFamily:
    """The page of a task. UsageError, InstallationError."""
    return find_family(task).load("page", PageFamily)
