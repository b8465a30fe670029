"""`reconstruct --record`: a proxy between an agent's program and its API that counts tokens.

It listens on this machine alone and forwards each request as it came. A request's row has the
model, the tokens, the time and the status: no header, address, key, or word of it.
"""

from __future__ import annotations

import asyncio
import itertools
import socket
import threading
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Final, Self

import httpx2
import uvicorn
from msgspec.structs import replace
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse
from starlette.routing import Route

from legoworld.agents.api_usage import AnswerReader, request_api
from legoworld.endpoint.listener import HOST
from legoworld.endpoint.trial_record import append_row
from legoworld.errors import Raised, UsageError, cause
from legoworld.records.agents import ApiRequest, RequestEnd

_METHODS: Final = ["GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"]
#: Of one connection, not of what goes over it; and what the proxy asks for and writes itself.
_OF_A_CONNECTION: Final = frozenset(
    (b"connection", b"keep-alive", b"te", b"trailer", b"transfer-encoding", b"upgrade",
     b"proxy-authorization", b"proxy-authenticate", b"proxy-connection")
)  # fmt: skip
_NOT_SENT: Final = _OF_A_CONNECTION | {b"host", b"content-length", b"accept-encoding"}
_NOT_RETURNED: Final = _OF_A_CONNECTION | {b"content-length"}
_DECODED: Final = ("gzip", "deflate")
_TIMEOUT: Final = httpx2.Timeout(None, connect=30.0)
#: What is still under way when the agent has ended is cut.
_END_WITHIN_S: Final = 1


class ApiRecorder:
    """Forwards to `api` until it is closed; a row in `rows` for each request, when it ends.

    used_s: of the trial's time, spent before this began.
    """

    def __init__(self, api: str, rows: Path, *, used_s: float = 0.0) -> None:
        self._api, self._rows = httpx2.URL(api.rstrip("/")), rows
        self._began = time.monotonic() - used_s
        self._numbers = itertools.count(1 + _lines(rows))
        self._client = open_client()
        self._socket = socket.create_server((HOST, 0))
        self.url = f"http://{HOST}:{self._socket.getsockname()[1]}"
        routes = [Route("/{path:path}", self._forward, methods=_METHODS)]
        app = Starlette(routes=routes, lifespan=self._connecting)
        config = uvicorn.Config(
            app, ws="none", lifespan="on", log_config=None, log_level="critical", access_log=False,
            server_header=False, date_header=False, timeout_graceful_shutdown=_END_WITHIN_S,
        )  # fmt: skip
        self._server = uvicorn.Server(config)
        self._thread = threading.Thread(
            target=self._server.run, kwargs={"sockets": [self._socket]}, daemon=True
        )

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_error: Raised) -> None:
        """Cut what is under way: its client has ended."""
        self._server.should_exit = True
        self._thread.join()
        self._socket.close()

    @asynccontextmanager
    async def _connecting(self, _app: Starlette) -> AsyncIterator[None]:
        async with self._client:
            yield

    async def _forward(self, request: Request) -> Response:
        wire = request_api(request.url.path) if request.method == "POST" else None
        row = ApiRequest(number=next(self._numbers), at_s=self._clock(), wire=wire)
        try:
            answer = await self._client.send(await self._outgoing(request), stream=True)
        except httpx2.TransportError as error:
            self._end(row, "unreachable")
            return Response(f"the API cannot be reached: {type(error).__name__}", 502)
        except asyncio.CancelledError:
            self._end(row, "cut")
            raise
        pieces = self._pieces(replace(row, status=answer.status_code), answer)
        response: Response
        if _is_stream(answer):
            response = StreamingResponse(pieces, answer.status_code)
        else:  # read to its end even where its client has left: its tokens are used
            response = Response(b"".join([piece async for piece in pieces]), answer.status_code)
        decoded = answer.headers.get("content-encoding") in _DECODED
        dropped = _NOT_RETURNED | ({b"content-encoding"} if decoded else set())
        own = [pair for pair in response.raw_headers if pair[0] == b"content-length"]
        if request.method == "HEAD" and not decoded:  # it is the length of what a GET would bring
            dropped, own = dropped - {b"content-length"}, []
        kept = [pair for pair in answer.headers.raw if pair[0].lower() not in dropped]
        response.raw_headers = [*own, *kept]
        return response

    async def _outgoing(self, request: Request) -> httpx2.Request:
        """The request as it came: the client itself would add its own headers and cookies."""
        query: bytes = request.scope["query_string"]
        path: bytes = self._api.raw_path.rstrip(b"/") + request.scope["raw_path"]
        kept = [pair for pair in request.headers.raw if pair[0] not in _NOT_SENT]
        return httpx2.Request(
            request.method,
            self._api.copy_with(raw_path=path + (b"?" + query if query else b"")),
            headers=[*kept, (b"accept-encoding", ", ".join(_DECODED).encode())],
            content=await request.body() or None,
            extensions={"timeout": _TIMEOUT.as_dict()},
        )

    async def _pieces(self, row: ApiRequest, answer: httpx2.Response) -> AsyncIterator[bytes]:
        """The answer's bytes, decoded, and read on the way."""
        reader = AnswerReader(row.wire, streamed=_is_stream(answer)) if row.wire else None
        how: RequestEnd = "cut"
        try:
            async for piece in answer.aiter_bytes():
                if reader is not None and answer.is_success:
                    reader.feed(piece)
                yield piece
            how = "whole"
        finally:
            self._end(row, how, reader)
            await answer.aclose()

    def _end(self, row: ApiRequest, how: RequestEnd, reader: AnswerReader | None = None) -> None:
        """Write a request's row."""
        if reader is not None:
            prompt, cached, completion = reader.tokens(whole=how == "whole")
            row = replace(
                row, model=reader.model, prompt_tokens=prompt, cached_tokens=cached,
                completion_tokens=completion,
            )  # fmt: skip
        seconds = round(self._clock() - row.at_s, 3)
        append_row(self._rows, replace(row, seconds=seconds, ended=how))

    def _clock(self) -> float:
        return round(time.monotonic() - self._began, 3)


def open_client() -> httpx2.AsyncClient:
    """The recorder's client. UsageError for a proxy of the environment that it cannot use."""
    try:
        return httpx2.AsyncClient()
    except (ImportError, ValueError, httpx2.InvalidURL) as error:
        raise UsageError(
            "--record cannot reach an API through the proxy that the environment names",
            found=cause(error),
            expected="an http:// or https:// address in HTTP_PROXY, HTTPS_PROXY and ALL_PROXY",
            next_step="unset or correct these variables, or leave out --record",
        ) from error


def _is_stream(answer: httpx2.Response) -> bool:
    return str(answer.headers.get("content-type")).startswith("text/event-stream")


def _lines(path: Path) -> int:
    return path.read_bytes().count(b"\n") if path.is_file() else 0
