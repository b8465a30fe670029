"""`legoworld bench serve --http`: requests to orders, answers to responses.

Nothing that is sent is decoded in this process: it is written to disk as it comes, and a worker
unpacks it. Everything is refused as early as it can be: the token and the length by the headers
alone, room in the queue before a byte is read.
"""

from __future__ import annotations

import asyncio
import math
import secrets
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, Final

from msgspec.structs import replace
from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import Route

from legoworld.bench.admission import Admission, Counts, HttpOptions, Place
from legoworld.bench.score_worker import REFUSED, Order, ServeOptions
from legoworld.bench.server import ScoreServer
from legoworld.files import canonical_json
from legoworld.records.base import UNSET, Record, RecordError, UnsetType, canonical, decode
from legoworld.records.bench_results import (
    ObjectsAnswer,
    RewardsAnswer,
    RewardsRequest,
    ScalarAnswer,
    ServeAnswer,
)
from legoworld.records.reconstruction import EVALUATOR_ERROR
from legoworld.records.second_card import XNumbers, XScores

_JSON_BYTES: Final = 1 << 20
#: Of a refused request, so much is read before it is answered: a client that is still sending
#: would not see the answer otherwise.
_UNKNOWN_BYTES: Final = 1 << 16
_STATUS: Final = {REFUSED: 422, EVALUATOR_ERROR: 503}


class RefusedRequestError(Exception):
    """A request that is not scored: an HTTP status and why."""

    def __init__(self, status: int, reason: str, *, retry_s: int | None = None) -> None:
        super().__init__(reason)
        self.status, self.reason, self.retry_s = status, reason, retry_s


class ScoreApp:
    """The routes, on one server of workers."""

    def __init__(
        self,
        server: ScoreServer,
        options: ServeOptions,
        http: HttpOptions,
        notice: Callable[[str], None],
    ) -> None:
        self._server, self._options, self.http = server, options, http
        self._notice = notice
        self._admission = Admission(server.scratch, http.queue, http.spool_bytes)
        self._counts = Counts()

    def asgi(self) -> Starlette:
        """The application."""
        return Starlette(
            routes=[
                Route("/score", self._guard(self._score), methods=["POST"]),
                Route("/rewards", self._guard(self._rewards), methods=["POST"]),
                Route("/metrics", self._guard(self._metrics), methods=["GET"]),
                Route("/healthz", _healthz, methods=["GET"]),
            ]
        )

    def _guard(
        self, answer: Callable[[Request], Awaitable[Response]]
    ) -> Callable[[Request], Awaitable[Response]]:
        async def guarded(request: Request) -> Response:
            known = False
            try:
                known = self._knows(request)
                if not known:
                    raise RefusedRequestError(401, "the bearer token is missing or another one")
                return await answer(request)
            except RefusedRequestError as refused:
                self._counts.refusals[refused.status] += 1
                http = self.http
                room = (http.body_bytes, http.receive_s) if known else (_UNKNOWN_BYTES, 1.0)
                whole = refused.status != 408 and await _read_on(request, *room)
                return _refusal(refused, close=not whole)
            except ClientDisconnect:
                self._counts.refusals[499] += 1
                return Response(status_code=499)

        return guarded

    def _knows(self, request: Request) -> bool:
        scheme, _, token = request.headers.get("authorization", "").partition(" ")
        given, ours = token.strip().encode(), self.http.token.encode()
        return secrets.compare_digest(given, ours) and scheme.lower() == "bearer"

    async def _score(self, request: Request) -> Response:
        begin = time.monotonic()
        json = request.headers.get("content-type", "").startswith("application/json")
        line = b"" if json else self._line(request)
        length = self._length(request, _JSON_BYTES if json else self.http.body_bytes)
        place = self._place(spool_bytes=0 if json else max(1, length))
        try:
            if json:
                order = Order(line=await self._body(request, _JSON_BYTES))
            else:
                order = Order(line=line, upload=await self._spool(request, place))
        except BaseException:
            place.release()
            raise
        answer = await self._score_order(request, order, place, begin)
        status = _STATUS.get(answer.status, 200)
        return _json(self._public_answer(answer), status, retry_s=1 if status == 503 else None)

    async def _rewards(self, request: Request) -> Response:
        """OpenRLHF's form. A trainer's batch has a number for each query, or none at all."""
        begin = time.monotonic()
        try:
            batch = decode(RewardsRequest, await self._body(request, _JSON_BYTES))
            labels = [int(label) for label in batch.labels]
        except (RecordError, ValueError) as error:
            raise RefusedRequestError(422, f"no batch of queries and labels: {error}") from error
        if not 0 < len(labels) == len(batch.query) <= self.http.queue:
            raise RefusedRequestError(
                422, f"{len(batch.query)} queries, {len(labels)} labels; the most is "
                f"{self.http.queue}, as many labels as queries"
            )  # fmt: skip
        places = [p for _ in labels if (p := self._admission.take())]
        if len(places) < len(labels):
            for place in places:
                place.release()
            raise self._full()
        orders = [
            Order(line=canonical_json({"scene": scene, "image_id": image_id}).encode())
            for scene, image_id in zip(batch.query, labels, strict=True)
        ]
        scored = [
            self._score_order(request, order, place, begin)
            for order, place in zip(orders, places, strict=True)
        ]
        answers = [self._public_answer(answer) for answer in await asyncio.gather(*scored)]
        for number, answer in enumerate(answers):
            if answer.reward is None:
                raise RefusedRequestError(
                    _STATUS[answer.status], f"query {number}: {answer.reason}",
                    retry_s=1 if answer.status == EVALUATOR_ERROR else None,
                )  # fmt: skip
        return _json(RewardsAnswer(rewards=tuple(a.reward or 0.0 for a in answers)))

    async def _metrics(self, _request: Request) -> Response:
        gauges = (
            ("queue_places", self.http.queue),
            ("queue_taken", self._admission.places),
            ("spool_bytes", self._admission.spool_bytes),
            ("workers", self._server.workers),
            ("workers_lost_total", self._server.n_lost),
        )
        return Response(self._counts.text(gauges), media_type="text/plain; version=0.0.4")

    def _line(self, request: Request) -> bytes:
        """The request of a submission that is sent, from its query."""
        given = request.query_params
        try:
            image_id = int(given["image_id"])
        except (KeyError, ValueError):
            raise RefusedRequestError(422, "the query has no image_id=NUMBER") from None
        if image_id not in self._options.dataset.cases:
            raise RefusedRequestError(422, f"the dataset has no image {image_id}")
        more = {name: given[name] for name in ("id", "parts") if name in given}
        return canonical_json({"scene": "", "image_id": image_id, **more}).encode()

    def _length(self, request: Request, most: int) -> int:
        """How long the body is at most."""
        length = int(request.headers.get("content-length", most))
        if length > most:
            raise RefusedRequestError(413, f"a body of {length} bytes; the most is {most}")
        return length

    def _place(self, *, spool_bytes: int = 0) -> Place:
        place = self._admission.take(spool_bytes=spool_bytes)
        if place is None:
            raise self._full()
        return place

    def _full(self) -> RefusedRequestError:
        waiting = self._admission.places / self._server.workers
        wait_s = math.ceil(min(60.0, max(1.0, self._counts.mean_s, 0.05 * waiting)))
        return RefusedRequestError(429, "the queue is full", retry_s=wait_s)

    async def _body(self, request: Request, most: int) -> bytes:
        self._length(request, most)
        chunks: list[bytes] = []
        await self._receive(request, most, chunks.append)
        return b"".join(chunks)

    async def _spool(self, request: Request, place: Place) -> Path:
        assert place.folder is not None
        place.folder.mkdir()
        upload = place.folder / "upload"
        with upload.open("wb") as file:
            await self._receive(request, self.http.body_bytes, file.write)
        return upload

    async def _receive(self, request: Request, most: int, take: Callable[[bytes], object]) -> None:
        """The body as it comes, within its time."""
        received = 0
        try:
            async with asyncio.timeout(self.http.receive_s):
                async for chunk in request.stream():
                    received += len(chunk)
                    if received > most:
                        raise RefusedRequestError(413, f"a body of more than {most} bytes")
                    take(chunk)
        except TimeoutError:
            raise RefusedRequestError(
                408, f"the body did not come within {self.http.receive_s:g} s"
            ) from None
        request.state.received = True

    async def _score_order(
        self, request: Request, order: Order, place: Place, begin: float
    ) -> ServeAnswer:
        """The answer; what nobody waits for any more is not begun. ClientDisconnect."""
        future = self._server.submit(order)
        future.add_done_callback(lambda _: place.release())
        scored = asyncio.wrap_future(future)
        gone = asyncio.ensure_future(_until_gone(request))
        either: set[asyncio.Future[Any]] = {scored, gone}
        await asyncio.wait(either, return_when=asyncio.FIRST_COMPLETED)
        gone.cancel()
        if not scored.done():
            scored.cancel()
            raise ClientDisconnect
        answer = scored.result()
        self._counts.answer(answer.status, time.monotonic() - begin)
        if answer.status == EVALUATOR_ERROR:
            self._notice(f"{answer.status}: image {answer.image_id}: {answer.reason}")
        return answer

    def _public_answer(self, answer: ServeAnswer) -> ScalarAnswer:
        step = self.http.step
        r, a, s = (_round(value, step) for value in (answer.R, answer.A, answer.S))
        reason = answer.reason
        if answer.status == EVALUATOR_ERROR:  # it may name what is private
            reason = "the evaluator failed; the server's log says why"
        scalar = ScalarAnswer(
            id=answer.id,
            image_id=answer.image_id,
            status=answer.status,
            reason=reason,
            V=answer.V,
            R=r,
            A=a,
            S=s,
            reward=r if s is None else s,
            step=step,
            x=_public_numbers(answer.x, step, per_object=self.http.per_object),
        )
        if not self.http.per_object:
            return scalar
        return ObjectsAnswer(
            **{name: getattr(scalar, name) for name in scalar.__struct_fields__},
            objects=answer.objects,
            validity=answer.validity,
            flags=answer.flags,
            warnings=answer.warnings,
        )


def _public_numbers(
    x: XScores | UnsetType, step: float, *, per_object: bool
) -> XNumbers | UnsetType:
    """The second card's rounded numbers, with its objects and facts or alone."""
    if x is UNSET:
        return UNSET
    numbers: dict[str, Any] = {n: _round(getattr(x, n), step) for n in XNumbers.__struct_fields__}
    return replace(x, **numbers) if per_object else XNumbers(**numbers)


async def _healthz(_request: Request) -> Response:
    return Response("ok\n", media_type="text/plain")


async def _until_gone(request: Request) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass


def _round(value: float | None, step: float) -> float | None:
    """To the nearest multiple of the step; exact where that is 0."""
    return value if value is None or not step else float(f"{round(value / step) * step:.12g}")


async def _read_on(request: Request, most: int, time_s: float) -> bool:
    """Read what is left of a refused request; False where it is too much or too slow."""
    length = request.headers.get("content-length")
    if getattr(request.state, "received", False) or not length:
        return "transfer-encoding" not in request.headers
    if int(length) > most:
        return False
    try:
        async with asyncio.timeout(time_s):
            while (message := await request.receive())["type"] == "http.request":
                if not message.get("more_body"):
                    return True
    except TimeoutError:
        pass
    return False


def _refusal(error: RefusedRequestError, *, close: bool) -> Response:
    response = Response(
        canonical_json({"status": REFUSED, "reason": error.reason}),
        error.status,
        media_type="application/json",
    )
    if error.retry_s is not None:
        response.headers["retry-after"] = str(error.retry_s)
    if error.status == 401:
        response.headers["www-authenticate"] = "Bearer"
    if close:
        response.headers["connection"] = "close"
    return response


def _json(record: Record, status: int = 200, *, retry_s: int | None = None) -> Response:
    response = Response(canonical(record), status, media_type="application/json")
    if retry_s is not None:
        response.headers["retry-after"] = str(retry_s)
    return response
