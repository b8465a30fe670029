"""The recorder between a client and a model server that follows a script: tokens, and no secret."""

from __future__ import annotations

import http.client
import json
import socket
import threading
import urllib.error
import urllib.request
import zlib
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import httpx2
import pytest
from agent_programs.model_server import ModelServer, Turn
from waiting import until

from legoworld.agents.agent_cards import load_agent
from legoworld.agents.api_recorder import ApiRecorder
from legoworld.agents.api_usage import AnswerReader, request_api
from legoworld.agents.recorded_card import check_recordable
from legoworld.endpoint.trial_record import read_rows
from legoworld.errors import UsageError
from legoworld.records.agents import ApiRequest

KEY = "sk-a-secret-of-7351"
#: The path of a request of each API, without streaming and with it.
PATHS = {
    "messages": ("/v1/messages?beta=true", "/v1/messages?beta=true"),
    "responses": ("/v1/responses", "/v1/responses"),
    "chat": ("/v1/chat/completions", "/v1/chat/completions"),
    "gemini": (
        f"/v1beta/models/m:generateContent?key={KEY}",
        f"/v1beta/models/m:streamGenerateContent?key={KEY}&alt=sse",
    ),
}
HEADERS = {"Authorization": f"Bearer {KEY}", "x-api-key": KEY, "Content-Type": "application/json"}


def ask(url: str, wire: str, *, streamed: bool) -> bytes:
    """One request as a client sends it; the answer's body."""
    data = json.dumps({"messages": [], "input": [], "stream": streamed}).encode()
    request = urllib.request.Request(url + PATHS[wire][streamed], data, HEADERS)
    with urllib.request.urlopen(request) as answer:
        return answer.read()


def rows(folder: Path) -> list[ApiRequest]:
    return read_rows(folder / "requests.jsonl", ApiRequest)


@pytest.fixture
def model() -> Iterator[ModelServer]:
    with ModelServer([Turn(says="A scene.")]).serving() as server:
        yield server


@pytest.mark.parametrize("streamed", [True, False])
@pytest.mark.parametrize("wire", PATHS)
def test_tokens_are_those_of_the_api_and_the_answer_is_as_it_was(model, tmp_path, wire, streamed):
    with ApiRecorder(model.url, tmp_path / "requests.jsonl") as recorder:
        through = [ask(recorder.url, wire, streamed=streamed) for _ in range(2)]
    # The second request has other numbers: the first's answer is compared.
    with ModelServer(model.script).serving() as again:
        assert through[0] == ask(again.url, wire, streamed=streamed)
    found = rows(tmp_path)
    assert [row.number for row in found] == [1, 2]
    assert [(r.prompt_tokens, r.cached_tokens, r.completion_tokens) for r in found] == [
        (a.prompt_tokens, a.cached_tokens, a.completion_tokens) for a in model.asked
    ]
    assert {(r.wire, r.model, r.status, r.ended, r.uncounted) for r in found} == {
        (wire, "scripted", 200, "whole", False)
    }


def test_a_refusal_is_a_row_and_passes_and_what_is_no_model_s_counts_nothing(model, tmp_path):
    model.failing = 1
    with ApiRecorder(model.url, tmp_path / "requests.jsonl", used_s=50.0) as recorder:
        with pytest.raises(urllib.error.HTTPError) as refused:
            ask(recorder.url, "messages", streamed=True)
        assert (refused.value.code, b"overloaded" in refused.value.read()) == (529, True)
        with pytest.raises(urllib.error.HTTPError):
            urllib.request.urlopen(f"{recorder.url}/v1/models")
    refusal, other = rows(tmp_path)
    assert (refusal.status, refusal.uncounted, refusal.prompt_tokens) == (529, False, None)
    assert (other.status, other.wire, other.uncounted) == (404, None, False)
    assert refusal.at_s >= 50.0


def test_an_api_that_is_not_there_is_said_to_the_client(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    with ApiRecorder(f"http://127.0.0.1:{port}", tmp_path / "requests.jsonl") as recorder:
        with pytest.raises(urllib.error.HTTPError) as refused:
            ask(recorder.url, "chat", streamed=False)
        assert (refused.value.code, "cannot be reached" in refused.value.read().decode()) == (
            502, True,
        )  # fmt: skip
    (row,) = rows(tmp_path)
    assert (row.status, row.ended, row.uncounted) == (None, "unreachable", False)


@pytest.mark.parametrize(
    ("proxy", "said"), [("socks5://127.0.0.1:1", "socks"), ("gopher://127.0.0.1:1", "scheme")]
)
def test_a_proxy_that_cannot_be_used_is_refused_before_the_first_trial(monkeypatch, proxy, said):
    monkeypatch.setenv("ALL_PROXY", proxy)
    with pytest.raises(UsageError, match=rf"(?i)through the proxy .*found: .*{said}.*ALL_PROXY"):
        check_recordable(load_agent("codex"))


class _Long(BaseHTTPRequestHandler):
    """Says how long a GET's answer would be."""

    def log_message(self, *_: object) -> None:
        pass

    def do_HEAD(self) -> None:
        self.send_response(200)
        self.send_header("Content-Length", "1234")
        self.end_headers()


def test_the_length_that_a_head_tells_is_the_api_s(tmp_path):
    with ThreadingHTTPServer(("127.0.0.1", 0), _Long) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        api = f"http://127.0.0.1:{server.server_address[1]}"
        with ApiRecorder(api, tmp_path / "requests.jsonl") as recorder:
            request = urllib.request.Request(f"{recorder.url}/v1/files/1", method="HEAD")
            with urllib.request.urlopen(request) as answer:
                assert answer.headers.get_all("Content-Length") == ["1234"]
        server.shutdown()
    assert [row.status for row in rows(tmp_path)] == [200]


class _Sets(BaseHTTPRequestHandler):
    """Keeps the headers of each request, and sets a cookie."""

    def log_message(self, *_: object) -> None:
        pass

    def do_POST(self) -> None:
        self.rfile.read(int(self.headers["Content-Length"]))
        self.server.seen.append({key.lower(): value for key, value in self.headers.items()})  # type: ignore[attr-defined]
        self.send_response(200)
        self.send_header("Set-Cookie", "session=1; Path=/")
        self.send_header("Content-Length", "2")
        self.end_headers()
        self.wfile.write(b"{}")


def test_no_header_is_added_and_the_api_s_cookies_are_the_client_s_own(tmp_path):
    with ThreadingHTTPServer(("127.0.0.1", 0), _Sets) as server:
        server.seen = []  # type: ignore[attr-defined]
        threading.Thread(target=server.serve_forever, daemon=True).start()
        api = f"http://127.0.0.1:{server.server_address[1]}"
        with ApiRecorder(api, tmp_path / "requests.jsonl") as recorder:
            for _ in range(2):
                client = http.client.HTTPConnection(recorder.url.removeprefix("http://"))
                client.request("POST", "/v1/messages", b"{}", {"x-own": "1"})
                told = [(k.lower(), v) for k, v in client.getresponse().getheaders()]
                assert dict(told)["set-cookie"] == "session=1; Path=/"
                # What the API sent, its own `server` and `date` among it, and no second of either.
                names = ["content-length", "date", "server", "set-cookie"]
                assert sorted(name for name, _ in told if name != "connection") == names
                client.close()
        server.shutdown()
    # The proxy takes in what it can read: nothing that an installed decoder would add.
    sent = {"x-own": "1", "host": api.removeprefix("http://"), "content-length": "2"}
    assert server.seen == [{**sent, "accept-encoding": "gzip, deflate"}] * 2  # type: ignore[attr-defined]


class _Slow(BaseHTTPRequestHandler):
    """Sends the beginning of a stream in gzip, and the rest when it is told to go on."""

    protocol_version = "HTTP/1.1"
    go_on = threading.Event()
    gone = threading.Event()
    first = (
        b'data: {"type": "message_start", "message": {"model": "m", "usage": '
        b'{"input_tokens": 7, "cache_read_input_tokens": 2, "output_tokens": 1}}}\n\n'
    )
    rest = b'data: {"type": "message_delta", "usage": {"output_tokens": 9}}\n\n'

    def log_message(self, *_: object) -> None:
        pass

    def do_POST(self) -> None:
        self.rfile.read(int(self.headers["Content-Length"]))
        self.send_response(200)
        for name, value in (
            ("Content-Type", "text/event-stream"),
            ("Content-Encoding", "gzip"),
            ("Transfer-Encoding", "chunked"),
        ):
            self.send_header(name, value)
        self.end_headers()
        packing = zlib.compressobj(wbits=31)
        try:
            self._piece(packing, self.first)
            while not self.go_on.wait(0.01):
                self._piece(packing, b": alive\n\n")
            self._piece(packing, self.rest)
            self.wfile.write(b"0\r\n\r\n")
        except OSError:
            self.gone.set()

    def _piece(self, packing: Any, data: bytes) -> None:
        data = packing.compress(data) + packing.flush(zlib.Z_SYNC_FLUSH)
        self.wfile.write(b"%x\r\n%s\r\n" % (len(data), data))


@pytest.fixture
def slow() -> Iterator[tuple[str, type[_Slow]]]:
    handler = type("Handler", (_Slow,), {"go_on": threading.Event(), "gone": threading.Event()})
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{server.server_address[1]}", handler
    handler.go_on.set()
    server.shutdown()
    server.server_close()
    thread.join()


def test_a_stream_in_gzip_comes_piece_by_piece_and_is_counted(slow, tmp_path):
    url, handler = slow
    with (
        ApiRecorder(url, tmp_path / "requests.jsonl") as recorder,
        httpx2.stream("POST", f"{recorder.url}/v1/messages", json={}, timeout=300) as answer,
    ):
        lines = answer.iter_lines()
        assert next(lines) == handler.first.decode().rstrip()
        handler.go_on.set()
        assert handler.rest.decode().split("\n")[0] in list(lines)
    (row,) = rows(tmp_path)
    assert (row.prompt_tokens, row.cached_tokens, row.completion_tokens) == (9, 2, 9)


@pytest.mark.parametrize("who", ["client", "trial"])
def test_a_request_that_is_cut_is_not_counted_and_ends_at_the_api(slow, tmp_path, who):
    url, handler = slow
    with ApiRecorder(url, tmp_path / "requests.jsonl") as recorder:
        client = socket.create_connection(("127.0.0.1", int(recorder.url.rpartition(":")[2])))
        client.sendall(b"POST /v1/messages HTTP/1.1\r\nHost: x\r\nContent-Length: 2\r\n\r\n{}")
        begun = b""
        while b"input_tokens" not in begun:  # the event that counts them has passed the recorder
            begun += client.recv(4096)
        assert begun.startswith(b"HTTP/1.1 200")
        if who == "client":
            client.close()
            until(lambda: rows(tmp_path))
    client.close()
    (row,) = rows(tmp_path)
    assert (row.ended, row.prompt_tokens, row.completion_tokens) == ("cut", 9, None)
    assert row.uncounted
    until(handler.gone.is_set)


def test_no_key_is_kept(model, tmp_path):
    with ApiRecorder(model.url, tmp_path / "requests.jsonl") as recorder:
        for wire in PATHS:
            ask(recorder.url, wire, streamed=True)
    assert len(rows(tmp_path)) == 4
    assert not [p for p in tmp_path.rglob("*") if KEY.encode() in p.read_bytes()]


def test_rows_go_on_where_a_killed_part_of_the_trial_left_them(model, tmp_path):
    for _ in range(2):
        with ApiRecorder(model.url, tmp_path / "requests.jsonl") as recorder:
            ask(recorder.url, "chat", streamed=False)
    assert [row.number for row in rows(tmp_path)] == [1, 2]


@pytest.mark.parametrize(
    ("path", "wire"),
    [
        ("/v1/messages", "messages"),
        ("/v1/messages/count_tokens", None),
        ("/openai/v1/responses", "responses"),
        ("/v1beta/models/m:countTokens", None),
        ("/v1beta/models/m:streamGenerateContent", "gemini"),
    ],
)
def test_a_path_tells_the_api(path, wire):
    assert request_api(path) == wire


def test_gemini_s_thoughts_and_a_stream_without_sse_count_and_zeros_may_be_left_out():
    reader = AnswerReader("gemini", streamed=False)
    parts = [
        {"usageMetadata": {"promptTokenCount": 5}},
        {"usageMetadata": {"promptTokenCount": 5, "candidatesTokenCount": 2,
                           "thoughtsTokenCount": 3}},
    ]  # fmt: skip
    reader.feed(json.dumps(parts).encode())
    assert reader.tokens(whole=True) == (5, 0, 5)
    empty = AnswerReader("gemini", streamed=False)
    empty.feed(json.dumps(parts[0]).encode())
    assert empty.tokens(whole=True) == (5, 0, 0)


def test_an_answer_that_ends_early_without_an_error_states_no_completion():
    reader = AnswerReader("messages", streamed=True)
    reader.feed(_Slow.first)
    assert reader.tokens(whole=True) == (9, 2, None)
