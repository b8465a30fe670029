"""A page document to one HTML file; what is too large for it lies beside it."""

from __future__ import annotations

import base64
import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

import jinja2
from markupsafe import Markup

from legoworld.files import write_text
from legoworld.pluralize import share, word_for
from legoworld.records.base import Storable, canonical
from legoworld.records.report_tables import PageSection
from legoworld.report.error_kinds import BACKGROUND_IOU, FOREGROUND_IOU, KINDS
from legoworld.report.page_assets import refuse_others, write_assets
from legoworld.report.page_content import PageDocument
from legoworld.report.page_script import SCRIPTS, page_script
from legoworld.report.tables import NO_SPECIALIST, tasks_table
from legoworld.tables.html import html
from legoworld.tracks.track import scene_name
from legoworld.version import __version__

#: More views than this, or more bytes of them, and they lie beside the page.
EMBEDDED_VIEWS: Final = 500
EMBEDDED_BYTES: Final = 64 << 20
#: More bytes of scenes than this, and they lie beside the page.
EMBEDDED_SCENE_BYTES: Final = 16 << 20

#: The first bytes of every page of ours: another file is never written over.
MARK: Final = "<!doctype html>\n<!-- legoworld report -->"
#: three.js with what the page uses of it; tools/page builds it, a test holds it to that.
THREE: Final = "three.bundle.js"
#: What the scripts know of a section.
SECTION_FIELDS: Final = ("key", "task", "family", "title", "sides", "first", "plots", "categories",
                       "errors", "images", "names", "bench", "pixels", "cohorts",
                       "tags")  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class WrittenPage:
    """assets_folder: the folder next to the page, None where all is inside.

    views: how many pictures of photos or cases it has, and how many of these have no photo;
    left_out: that in words, empty where all have one.
    """

    path: Path
    assets_folder: Path | None
    n_bytes: int
    views: int
    views_without_photo: int
    left_out: str


@dataclass(frozen=True, kw_only=True)
class PageAssets:
    """What lies in a folder next to the page."""

    folder: str
    pictures: bool
    scenes: bool

    @property
    def any(self) -> bool:
        """Whether there is such a folder."""
        return self.pictures or self.scenes


def page_link(to: Path | None, page: Path) -> str:
    """The address of another page as a page has it; empty for none."""
    return "" if to is None else quote(os.path.relpath(to, page.parent))


def write_page(
    document: PageDocument, path: Path, *, commands: Sequence[str], trajectories: str = ""
) -> WrittenPage:
    """Write the page. LegoWorldError where another file or folder is in the way.

    trajectories: the address of a page of trials, for a link from each photo.
    """
    refuse_others(path, MARK)
    views = [script_json(view) for view in document.views]
    pictures = [p for kind in document.pictures.values() for p in kind]
    n_bytes = sum(map(len, views)) + sum(len(p) * 4 // 3 for p in pictures)
    beside = PageAssets(
        folder=f"{path.stem}_files",
        pictures=not document.single_photo
        and (len(views) > EMBEDDED_VIEWS or n_bytes > EMBEDDED_BYTES),
        scenes=not document.single_photo
        and sum(map(len, document.scenes.glbs)) * 4 // 3 > EMBEDDED_SCENE_BYTES,
    )
    folder = path.with_name(beside.folder)
    if beside.any:
        write_assets(
            folder,
            views=views if beside.pictures else (),
            pictures=document.pictures if beside.pictures else {},
            scenes=document.scenes.glbs if beside.scenes else (),
        )
    text = page_text(document, views, assets=beside, commands=commands, trajectories=trajectories)
    write_text(path, text)
    return WrittenPage(
        path=path,
        assets_folder=folder if beside.any else None,
        n_bytes=len(text.encode("utf-8")),
        views=len(views),
        views_without_photo=len(document.without_photo),
        left_out=_left_out(document),
    )


def page_text(
    document: PageDocument,
    views: Sequence[str],
    *,
    assets: PageAssets,
    commands: Sequence[str],
    trajectories: str = "",
) -> str:
    """The HTML, with views, photos, renders and scenes in it or beside it."""
    script = page_script()
    three = (SCRIPTS / THREE).read_text(encoding="utf-8") if document.in_3d else ""
    style = (SCRIPTS / "report.css").read_text(encoding="utf-8")
    texts: dict[str, str] = {}
    for kind, pictures in () if assets.pictures else document.pictures.items():
        texts |= _texts(kind, pictures)
    texts |= {} if assets.scenes else _texts("scene", document.scenes.glbs)
    return (
        _environment()
        .get_template("report.html")
        .render(
            mark=Markup(MARK),
            version=__version__,
            alone=document.single_photo,
            sections=document.sections,
            tasks=tasks_table(document.sections) if len(document.sections) > 1 else None,
            commands=commands,
            kinds=KINDS,
            foreground=FOREGROUND_IOU,
            background=BACKGROUND_IOU,
            no_specialist=NO_SPECIALIST,
            said=sorted({view.said for view in document.without_photo}),
            left_out=_left_out(document),
            beside=assets,
            style=Markup(style),
            scripts=[Markup(text) for text in (three, script) if text],
            script_sha256=[_sha256_base64(text) for text in (three, script) if text],
            trajectories=trajectories,
            data=_raw(script_json(_data(document, assets) | {"trajectories": trajectories})),
            views=[] if assets.pictures else [_raw(v) for v in views],
            texts=texts,
        )
    )


def _left_out(document: PageDocument) -> str:
    missing = len(document.without_photo)
    of_all = share(missing, len(document.views), "view", "views")
    return f"{of_all} {word_for(missing, 'has', 'have')} no photo" if missing else ""


def _data(document: PageDocument, assets: PageAssets) -> dict[str, Any]:
    """What the scripts start with; records.d.ts calls it PageData."""
    return {
        "sections": [_for_scripts(section) for section in document.sections],
        "views": [[view.section, view.id, scene_name(view.file_name)] for view in document.views],
        "kinds": [*KINDS, "failed"],
        "beside": {
            "folder": assets.folder if assets.any else "",
            "pictures": assets.pictures,
            "scenes": assets.scenes,
        },
        "version": __version__,
        "alone": document.single_photo,
    }


def _for_scripts(section: PageSection) -> dict[str, Any]:
    given = {name: getattr(section, name) for name in SECTION_FIELDS}
    return given | {"names": section.names or {}}


def _texts(kind: str, files: Sequence[bytes]) -> dict[str, str]:
    """Base64 by the id of its script element; nothing of an empty file."""
    return {f"{kind}-{k}": base64.b64encode(f).decode("ascii") for k, f in enumerate(files) if f}


def _environment() -> jinja2.Environment:
    """Templates in which every value is escaped, and one that is not given is an error."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(SCRIPTS),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["metric"] = _metric
    environment.filters["table"] = lambda table: Markup(html(table))
    return environment


def script_json(value: Storable) -> str:
    """JSON that neither ends a script element nor opens a comment in one."""
    text = canonical(value)
    for sign in "<>&\u2028\u2029":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return text


def _sha256_base64(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii")


def _raw(text: str) -> Markup:
    """JSON of script_json, which needs no further escaping."""
    return Markup(text)


def _metric(value: float | None, places: int = 3) -> str:
    """A number for a table; a dash where there is none."""
    return "-" if value is None else f"{value:.{places}f}"
