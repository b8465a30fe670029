"""A page document to one HTML file; past some hundred views, pictures lie beside it."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import jinja2
from markupsafe import Markup

from legoworld import __version__
from legoworld.errors import LegoWorldError
from legoworld.files import atomic_path, write_text
from legoworld.records.base import canonical
from legoworld.report.document import PageDocument
from legoworld.report.error_kinds import BACKGROUND_IOU, FOREGROUND_IOU, KINDS
from legoworld.report.tables import NO_SPECIALIST

PAGE: Final = Path(__file__).parent / "page"
#: More views than this, or more bytes of them, and they lie beside the page.
EMBEDDED_VIEWS: Final = 500
EMBEDDED_BYTES: Final = 64 << 20

#: The first bytes of every page of ours: another file is never written over.
MARK: Final = "<!doctype html>\n<!-- legoworld report -->"
_SCRIPTS: Final = ("place.js", "elements.js", "masks.js", "drawing.js", "depth.js", "views.js",
                   "detail.js", "lists.js", "main.js")  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class WrittenPage:
    """beside: the folder of views and photos next to the page, None where all is inside."""

    path: Path
    beside: Path | None
    n_bytes: int


def write_page(document: PageDocument, path: Path, *, commands: Sequence[str]) -> WrittenPage:
    """Write the page. LegoWorldError where another file or folder is in the way."""
    _refuse_others(path)
    views = [script_json(view) for view in document.views]
    n_bytes = sum(map(len, views)) + sum(len(p) * 4 // 3 for p in document.photos)
    beside = None
    if len(views) > EMBEDDED_VIEWS or n_bytes > EMBEDDED_BYTES:
        beside = path.with_name(f"{path.stem}_files")
        _write_beside(beside, views, document.photos)
    text = page_text(document, views, beside=beside.name if beside else None, commands=commands)
    write_text(path, text)
    return WrittenPage(path=path, beside=beside, n_bytes=len(text.encode("utf-8")))


def page_text(
    document: PageDocument, views: Sequence[str], *, beside: str | None, commands: Sequence[str]
) -> str:
    """The HTML. beside: the folder that holds views and photos, None to put them inside."""
    script = "".join((PAGE / name).read_text(encoding="utf-8") for name in _SCRIPTS)
    script = f'(function () {{\n"use strict";\n{script}}})();\n'
    style = (PAGE / "report.css").read_text(encoding="utf-8")
    sections = [
        {"key": s.key, "task": s.task, "sides": s.sides, **({"names": s.names} if s.sides else {})}
        for s in document.sections
    ]
    places = [[v.section, v.id] for v in document.views]
    return (
        _environment()
        .get_template("report.html")
        .render(
            mark=Markup(MARK),
            version=__version__,
            sections=document.sections,
            commands=commands,
            kinds=KINDS,
            foreground=FOREGROUND_IOU,
            background=BACKGROUND_IOU,
            no_specialist=NO_SPECIALIST,
            said=sorted({v.said for v in document.views if v.said}),
            beside=beside,
            style=Markup(style),
            script=Markup(script),
            script_sha256=_sha256_base64(script),
            data=_raw(script_json({"sections": sections, "views": places, "beside": beside})),
            views=[] if beside else [_raw(v) for v in views],
            photos=[] if beside else [base64.b64encode(p).decode("ascii") for p in document.photos],
        )
    )


def _environment() -> jinja2.Environment:
    """Templates in which every value is escaped, and one that is not given is an error."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(PAGE),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["metric"] = _metric
    return environment


def script_json(value: object) -> str:
    """JSON that neither ends a script element nor opens a comment in one."""
    text = canonical(value)
    for sign in "<>&\u2028\u2029":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return text


def _refuse_others(path: Path) -> None:
    """Only a page of ours is written over."""
    if not path.exists():
        return
    start = path.read_bytes()[: len(MARK)] if path.is_file() else b""
    if start != MARK.encode("ascii"):
        raise LegoWorldError(
            f"{path.name} is in the way",
            found="something that is not a page of legoworld",
            expected="a new file name, or an earlier page",
            next_step="choose another -o",
        )


def _write_beside(folder: Path, views: Sequence[str], photos: Sequence[bytes]) -> None:
    """Views as scripts, since a page opened from file:// may load those; photos as they are."""
    ours = ("view-*.js", "photo-*.webp")
    if folder.is_dir():
        known = {p for pattern in ours for p in folder.glob(pattern)}
        strangers = sorted(p.name for p in folder.iterdir() if p not in known)
        if strangers:
            raise LegoWorldError(
                f"{folder.name} is in the way",
                found=", ".join(strangers[:5]),
                expected="no such folder, or that of an earlier page",
                next_step="choose another -o",
            )
        for path in known:
            path.unlink()
    for k, view in enumerate(views):
        write_text(folder / f"view-{k:06}.js", f"legoworldView({k}, {view});\n")
    for k, photo in enumerate(photos):
        with atomic_path(folder / f"photo-{k:06}.webp") as temporary:
            temporary.write_bytes(photo)


def _sha256_base64(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii")


def _raw(text: str) -> Markup:
    """JSON of script_json, which needs no further escaping."""
    return Markup(text)


def _metric(value: float | None, places: int = 3) -> str:
    """A number for a table; a dash where there is none."""
    return "-" if value is None else f"{value:.{places}f}"
