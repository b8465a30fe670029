"""What `legoworld view` serves: a page, the state behind it, pictures and reports."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from hashlib import sha256
from html import escape
from importlib import resources
from pathlib import Path
from typing import Final

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.middleware.base import BaseHTTPMiddleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from legoworld.beneath import Beneath, RefusedFileError
from legoworld.errors import LegoWorldError
from legoworld.records.base import canonical
from legoworld.viewing.pages import PAGE, Pages
from legoworld.viewing.watched import Watch

_PAGE: Final = {
    "": ("view.html", "text/html; charset=utf-8"),
    "view.js": ("view.js", "text/javascript; charset=utf-8"),
    "view.css": ("view.css", "text/css; charset=utf-8"),
}
#: How a picture's bytes begin: what a program wrote is shown as what it is, or not at all.
_SIGNATURES: Final = {
    b"\x89PNG\r\n\x1a\n": "image/png",
    b"\xff\xd8\xff": "image/jpeg",
    b"RIFF": "image/webp",
}
_LARGEST_PICTURE: Final = 32 << 20
#: Of every answer. The address has the token: it is told to no other site.
_HEADERS: Final = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
_POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src 'self' data:"
)


class ViewApp:
    """The server's application. token: what every address begins with."""

    def __init__(self, watch: Watch, pages: Pages, token: str) -> None:
        self._watch, self._pages, self._token = watch, pages, token

    def asgi(self) -> Starlette:
        """The application: GET and HEAD alone, and only for this machine's own names."""
        routes = [
            Route("/", _file),
            Route("/state.json", self._state),
            Route("/picture/{path:path}", self._picture),
            Route("/report/{name:path}", self._report),
            Mount("/pages", StaticFiles(directory=self._pages.scratch)),
            Route("/{file}", _file),
        ]
        middleware = [
            Middleware(TrustedHostMiddleware, allowed_hosts=["127.0.0.1", "localhost"]),
            Middleware(BaseHTTPMiddleware, dispatch=_add_headers),
        ]
        return Starlette(routes=[Mount(f"/{self._token}", routes=routes)], middleware=middleware)

    async def _state(self, request: Request) -> Response:
        body = canonical(await run_in_threadpool(self._watch.look))
        tag = f'"{sha256(body.encode()).hexdigest()[:32]}"'
        if request.headers.get("if-none-match") == tag:
            return Response(status_code=304, headers={"ETag": tag})
        return Response(body, media_type="application/json", headers={"ETag": tag})

    async def _picture(self, request: Request) -> Response:
        data = await run_in_threadpool(_read_picture, self._watch.top, request.path_params["path"])
        kind = next((kind for start, kind in _SIGNATURES.items() if data.startswith(start)), None)
        if kind is None:
            return PlainTextResponse("no such picture", 404)
        return Response(data, media_type=kind)

    async def _report(self, request: Request) -> Response:
        name = request.path_params["name"] or "."  # which browsers leave out of an address
        try:
            state = await run_in_threadpool(self._watch.look)
            folder = await run_in_threadpool(self._pages.make, state, name)
        except (OSError, LegoWorldError) as error:  # files go while they are read
            text = f"<!doctype html><title>legoworld</title><p>{escape(str(error))}</p>"
            policy = {"Content-Security-Policy": "default-src 'none'"}
            return Response(text, 422, policy, "text/html; charset=utf-8")
        return RedirectResponse(f"/{self._token}/pages/{folder}/{PAGE}", 303)


async def _add_headers(
    request: Request, answer: Callable[[Request], Awaitable[Response]]
) -> Response:
    made = await answer(request)
    made.headers.update(_HEADERS)
    return made


async def _file(request: Request) -> Response:
    name, kind = _PAGE.get(request.path_params.get("file", ""), (None, ""))
    if name is None:
        return PlainTextResponse("no such address", 404)
    text = resources.files("legoworld.viewing").joinpath("page", name).read_text("utf-8")
    return Response(text, media_type=kind, headers={"Content-Security-Policy": _POLICY})


def _read_picture(top: Path, name: str) -> bytes:
    """A picture's bytes, b"" where there is none: an agent may be changing its folder."""
    try:
        with Beneath(top) as beneath:
            return beneath.read(name, most_bytes=_LARGEST_PICTURE) or b""
    except (OSError, RefusedFileError):
        return b""
