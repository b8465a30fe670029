"""One photo of a page as a page of its own: its view in every task, and nothing of the others."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import PurePosixPath

from msgspec.structs import replace

from legoworld.errors import UsageError
from legoworld.pluralize import nearest_names
from legoworld.records.report_page import BenchAnswer, LabelMapPageView, PageView
from legoworld.records.report_tables import FirstScreen, PageSection, Plots
from legoworld.report.cohorts import cohort_of_image
from legoworld.report.page_content import PageDocument
from legoworld.report.scene_files import SceneFiles
from legoworld.tracks.track import scene_name

_NOTHING_FIRST = FirstScreen(verdicts=(), costs=(), forest=(), coverage=())


def photo_alone(document: PageDocument, name: str) -> PageDocument:
    """The document with one photo, named as its file or without folder and extension.

    Its pictures keep their places; the others are empty. UsageError unless it is one photo.
    """
    photos = {scene_name(view.file_name): view.file_name for view in document.views}
    names = {photos[p]: {p, photos[p], PurePosixPath(p).name} for p in photos}
    found = [file for file, known in names.items() if name in known]
    if len(found) != 1:
        near = nearest_names(name, names, cutoff=0.0)
        raise UsageError(
            f"{name} names no photo of this page" if not found else f"{name} names several photos",
            found=", ".join(found or near),
            expected="the file name of one photo",
        )
    wanted = scene_name(found[0])
    views = [view for view in document.views if scene_name(view.file_name) == wanted]
    used: dict[str, set[int | None]] = {"photo": set(), "render": set(), "overlay": set()}
    glbs: set[int | None] = set()
    for view in views:
        for kind, place in _pictures(view):
            (glbs if kind == "glb" else used[kind]).add(place)

    def keep_places(files: list[bytes], places: set[int | None]) -> list[bytes]:
        return [data if k in places else b"" for k, data in enumerate(files)]

    scenes = document.scenes
    return PageDocument(
        sections=[
            _section(section, view, k)
            for k, view in enumerate(views)
            for section in document.sections
            if section.key == view.section
        ],
        views=views,
        photos=keep_places(document.photos, used["photo"]),
        overlays=keep_places(document.overlays, used["overlay"]),
        scenes=SceneFiles(
            folders=scenes.folders,
            renders=keep_places(scenes.renders, used["render"]),
            glbs=keep_places(scenes.glbs, glbs),
        ),
        single_photo=True,
    )


def _pictures(view: PageView) -> Iterator[tuple[str, int | None]]:
    """Kind and place of every picture and scene that a view shows."""
    yield "photo", view.photo
    for side in view.sides:
        if side.scene is not None:
            yield from (("render", side.scene.render), ("glb", side.scene.glb))
        if isinstance(side, BenchAnswer):
            yield from (("overlay", side.hit_picture), ("overlay", side.error_picture))
    if isinstance(view, LabelMapPageView):
        places = (view.maps.truth, *view.maps.answers, *view.maps.agreements)
        yield from (("overlay", place) for place in places)


def _section(section: PageSection, view: PageView, at: int) -> PageSection:
    """A section that holds one photo and no number of the others."""
    bench = section.bench
    if bench is not None:
        bench = replace(bench, board=replace(bench.board, rows=()), tiers=())
    return replace(
        section,
        first=_NOTHING_FIRST,
        comparison=None,
        images=tuple(replace(row, view=at) for row in section.images if row.id == view.id),
        plots=Plots(),
        categories=(),
        errors=(),
        cohorts=section.cohorts and cohort_of_image(section.cohorts, view.id),
        tags=(),
        bench=bench,
    )
