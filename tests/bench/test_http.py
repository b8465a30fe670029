"""`bench serve --http` against clients of every kind; a stand-in scores, nothing starts Blender."""

from __future__ import annotations

import contextlib
import http.client
import json
import socket
import tempfile
import threading
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import pytest
from waiting import PATIENCE_S, until

from legoworld.bench import http_server as serving
from legoworld.bench import server as processes
from legoworld.bench.admission import HttpOptions, access_token
from legoworld.bench.http_app import ScoreApp
from legoworld.bench.http_server import http_server, listening
from legoworld.bench.score_worker import no_score
from legoworld.bench.server import ScoreServer
from legoworld.endpoint.listener import PortTakenError
from legoworld.errors import UsageError
from legoworld.records.base import UNSET, decode
from legoworld.records.bench_results import ObjectsAnswer, ServeAnswer, ServeRequest
from legoworld.records.second_card import Object3D, XScores

TOKEN = "0123456789abcdef"
OPTIONS = SimpleNamespace(dataset=SimpleNamespace(cases={1: None, 2: None, 3: None}))
SCORES = {1: (0.123456, 0.5, 0.311728), 2: (0.7, None, None)}
SECOND = XScores(
    R_p=0.123456, R_x=None, A_x=0.987654, F3D=0.5, found=1 / 3, R_empty=0.25123, R_above_empty=-0.3,
    objects=(Object3D(id=1, eligible=True, f1=0.1234, precision=1.0, recall=0.5, found=False),),
    A_x_seen=None, surface_differs=0.0123, unreadable_alpha=2,
)  # fmt: skip


def score_order(order) -> ServeAnswer:
    request = decode(ServeRequest, order.line)
    if request.image_id == 3:
        return no_score(request, "/private/depth", status="evaluator_error")
    if request.scene == "/etc" or (order.upload and order.upload.read_bytes() == b"bomb"):
        return no_score(request, "no")
    r, a, s = SCORES[request.image_id]
    return ServeAnswer(
        id=request.id, scene=request.scene, image_id=request.image_id, status="ok", reason=None,
        V=1, R=r, A=a, S=s, objects=(), validity=None, flags=(), warnings=("w",),
        x=SECOND if request.parts == "RAX" else UNSET,
    )  # fmt: skip


class Service:
    """A running service. hold: set it, and no answer is made until it is cleared."""

    def __init__(self, app, port, told) -> None:
        self.app, self.port, self.told = app, port, told
        self.server, self.scratch = None, None

    def ask(self, body=b"x", path="/score?image_id=1", token=TOKEN, method="POST", **headers):
        client = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE_S)
        given = {"authorization": f"Bearer {token}", **{k.replace("_", "-"): v
                 for k, v in headers.items()}}  # fmt: skip
        client.request(method, path, body, given)
        answer = client.getresponse()
        data = answer.read()
        client.close()
        text = data.decode()
        kind = (answer.headers["content-type"] or "").partition(";")[0]
        assert kind == ("application/json" if text.startswith("{") else kind)
        return SimpleNamespace(
            status=answer.status, headers=answer.headers, text=text,
            json=json.loads(text) if text.startswith("{") else None,
        )  # fmt: skip

    def raw(self, data: bytes) -> socket.socket:
        client = socket.create_connection(("127.0.0.1", self.port), timeout=PATIENCE_S)
        client.sendall(data)
        return client

    def head(self, *lines: str, token=TOKEN) -> bytes:
        first = ["POST /score?image_id=1 HTTP/1.1", "host: h", f"authorization: Bearer {token}"]
        return "\r\n".join([*first, *lines, "", ""]).encode()

    def metric(self, name: str) -> float:
        text = self.ask(None, "/metrics", method="GET").text
        return sum(float(line.split()[-1]) for line in text.splitlines() if line.startswith(name))


@contextlib.contextmanager
def service(answer=score_order, workers=1, **given):
    class Worker:
        def __init__(self, _scorer) -> None:
            self.call = answer

        def __class_getitem__(cls, _types):
            return cls

        abort = close = staticmethod(lambda: None)

    told: list[str] = []
    options = HttpOptions(token=TOKEN, port=0, **given)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(processes, "TaskProcess", Worker)
        with (
            listening(options.host, options.port) as listener,
            ScoreServer(None, workers) as server,
        ):
            app = ScoreApp(server, OPTIONS, options, told.append)
            made = Service(app, listener.getsockname()[1], told)
            made.server = http_server(app.asgi(), connections=2 * options.queue + 64)
            made.scratch = server.scratch
            thread = threading.Thread(target=made.server.run, args=([listener],))
            thread.start()
            try:
                yield made
            finally:
                made.server.should_exit = True
                thread.join(PATIENCE_S)
                assert not thread.is_alive()


@pytest.fixture(scope="module")
def running():
    with service(body_bytes=1 << 20) as made:
        yield made


def test_scores_are_rounded_and_tell_no_more(running):
    found = running.ask(path="/score?image_id=1&id=step-7").json
    assert found == {
        "id": "step-7", "image_id": 1, "status": "ok", "reason": None, "V": 1, "R": 0.12,
        "A": 0.5, "S": 0.31, "reward": 0.31, "step": 0.01,
    }  # fmt: skip
    assert running.ask(path="/score?image_id=2").json["reward"] == 0.7


def test_the_second_card_s_numbers_are_rounded_and_its_objects_stay(running):
    found = running.ask(path="/score?image_id=1&parts=RAX").json
    assert found["x"] == {
        "R_p": 0.12, "R_x": None, "A_x": 0.99, "F3D": 0.5, "found": 0.33, "R_empty": 0.25,
        "R_above_empty": -0.3,
    }  # fmt: skip


def test_exact_scores_and_objects_are_options():
    with service(step=0.0, per_object=True) as made:
        found = made.ask().json
        second = decode(ObjectsAnswer, made.ask(path="/score?image_id=1&parts=RAX").text)
    assert second.x == SECOND
    assert (found["R"], found["S"], found["warnings"]) == (*SCORES[1][::2], ["w"])


@pytest.mark.parametrize("step", [0.01, 0.05, 0.3, 1.0])
def test_a_rounded_score_is_a_multiple_of_the_step(step):
    with service(step=step) as made:
        found = made.ask().json["R"]
    assert abs(found - SCORES[1][0]) <= step / 2 + 1e-12
    assert found == pytest.approx(step * round(found / step), abs=1e-12)


def test_openrlhf_s_form(running):
    batch = {"query": ["a", "b"], "labels": [1, "2"], "prompts": ["", ""]}
    body = json.dumps(batch).encode()
    assert running.ask(body, "/rewards").json == {"rewards": [0.31, 0.7]}


@pytest.mark.parametrize(
    ("batch", "status"),
    [
        ({"query": ["a"], "labels": [1, 2]}, 422),
        ({"query": [], "labels": []}, 422),
        ({"query": ["a"], "labels": ["x"]}, 422),
        ({"query": ["a"]}, 422),
        ({"query": ["/etc"], "labels": [1]}, 422),
        ({"query": ["a", "a"], "labels": [1, 3]}, 503),
        ({"query": ["a"] * 257, "labels": [1] * 257}, 422),
    ],
)
def test_a_batch_has_a_number_for_each_query_or_none_at_all(running, batch, status):
    found = running.ask(json.dumps(batch).encode(), "/rewards")
    assert (found.status, found.json["status"]) == (status, "refused")
    assert running.metric("legoworld_queue_taken") == 0


def test_a_failed_evaluator_tells_the_server_alone(running):
    found = running.ask(path="/score?image_id=3")
    assert (found.status, found.headers["retry-after"]) == (503, "1")
    assert (found.json["R"], found.json["reward"]) == (None, None)
    assert "/private" not in found.text
    assert "/private/depth" in running.told[-1]


@pytest.mark.parametrize("token", ["", "0123456789abcdeF", TOKEN + "0", "\xe4" * 16])
@pytest.mark.parametrize("path", ["/score?image_id=1", "/rewards", "/metrics"])
def test_a_wrong_token_is_refused_unread(running, token, path):
    found = running.ask(b"x", path, token, "GET" if path == "/metrics" else "POST")
    assert (found.status, found.headers["www-authenticate"]) == (401, "Bearer")


def test_health_needs_no_token(running):
    assert running.ask(None, "/healthz", "", "GET").text == "ok\n"


@pytest.mark.parametrize(
    ("path", "status"),
    [("/score", 422), ("/score?image_id=x", 422), ("/score?image_id=9", 422), ("/other", 404)],
)
def test_what_is_asked_wrongly(running, path, status):
    assert running.ask(path=path).status == status


def test_what_cannot_be_unpacked_is_422(running):
    assert running.ask(b"bomb").status == 422
    assert [*running.scratch.glob("request-*")] == []


@pytest.mark.parametrize("token", [TOKEN, "wrong"])
@pytest.mark.parametrize("length", [4 << 30, 10**19])
def test_a_length_of_4_gib_is_refused_by_the_headers_alone(running, length, token):
    with running.raw(running.head(f"content-length: {length}", token=token)) as client:
        answer = b"".join(iter(lambda: client.recv(4096), b""))  # until the server closes
    assert answer.startswith(b"HTTP/1.1 413" if token == TOKEN else b"HTTP/1.1 401")


@pytest.mark.parametrize("length", ["-1", "1e3", "1" * 400, "5\r\ncontent-length: 6"])
def test_a_length_that_is_none(running, length):
    with running.raw(running.head(f"content-length: {length}")) as client:
        answer = b"".join(iter(lambda: client.recv(4096), b""))
    assert answer.startswith(b"HTTP/1.1 400")


def test_a_body_without_a_length_is_cut_off_at_the_limit(running):
    chunk = b"10000\r\n" + bytes(1 << 16) + b"\r\n"
    with running.raw(running.head("transfer-encoding: chunked")) as client:
        client.sendall(chunk * 17)
        answer = client.recv(4096)
    assert answer.startswith(b"HTTP/1.1 413")
    until(lambda: not [*running.scratch.glob("request-*")])


def test_half_a_body_leaves_nothing(running):
    before = running.metric('legoworld_refusals_total{code="499"}')
    with running.raw(running.head("content-length: 1000") + b"half"):
        until(lambda: [*running.scratch.glob("request-*")])
        assert running.metric("legoworld_spool_bytes") == 1000
    until(lambda: running.metric('legoworld_refusals_total{code="499"}') == before + 1)
    until(lambda: not [*running.scratch.glob("request-*")])
    assert running.metric("legoworld_queue_taken") == running.metric("legoworld_spool_bytes") == 0


def test_a_slow_body_is_given_up():
    with service(receive_s=0.3) as made, made.raw(made.head("content-length: 9")) as client:
        client.sendall(b"slow")
        answer = b"".join(iter(lambda: client.recv(4096), b""))
        assert answer.startswith(b"HTTP/1.1 408")
        assert made.metric("legoworld_queue_taken") == 0


@pytest.mark.parametrize(
    ("first", "begin"),
    [
        (b"", b""),
        (b"", b"POST /score HTTP/1.1\r\nx: "),
        (b"GET /healthz HTTP/1.1\r\nhost: h\r\n\r\n", b"POST /score HTTP/1.1\r\nx: "),
    ],
)
def test_headers_that_trickle_are_given_up(first, begin, monkeypatch):
    monkeypatch.setattr(serving, "_HEADERS_S", 0.3)
    with service() as made, made.raw(first) as client:
        if first:
            until(lambda: b"ok\n" in client.recv(4096))
        client.sendall(begin)
        assert client.recv(4096) == b""


def test_headers_without_an_end_are_refused(running):
    answer = b"HTTP/1.1 4"
    endless = running.head()[:-2] + b"x: " + b"y" * (1 << 20)
    # It may be closed while they are sent.
    with contextlib.suppress(ConnectionError), running.raw(endless) as client:
        answer = client.recv(4096)
    assert answer.startswith(b"HTTP/1.1 4")


class Held:
    """Scores once it is let go."""

    def __init__(self) -> None:
        self.begun, self.go = [], threading.Event()

    def __call__(self, order) -> ServeAnswer:
        self.begun.append(order)
        assert self.go.wait(PATIENCE_S)
        return score_order(order)


def test_a_full_queue_says_when_to_come_again():
    held = Held()
    with service(held, queue=2, receive_s=1.0) as made, ThreadPoolExecutor(2) as clients:
        asked = [clients.submit(made.ask, b"x") for _ in range(2)]
        until(lambda: made.metric("legoworld_queue_taken") == 2)
        full = made.ask(b"y" * (1 << 20))
        assert (full.status, full.json["reason"]) == (429, "the queue is full")
        assert int(full.headers["retry-after"]) >= 1
        batch = json.dumps({"query": ["a"], "labels": [1]}).encode()
        assert made.ask(batch, "/rewards").status == 429
        lines = ["content-type: application/json", "content-length: 9"]
        with made.raw(made.head(*lines)) as client:  # none of the body
            answer = b"".join(iter(lambda: client.recv(4096), b""))
        assert answer.startswith(b"HTTP/1.1 429")
        held.go.set()
        assert [one.result().status for one in asked] == [200, 200]
        assert made.ask().status == 200
        assert made.metric('legoworld_refusals_total{code="429"}') == 3


def test_a_full_disk_budget_is_a_full_queue():
    held = Held()
    with service(held, body_bytes=1 << 16) as made, ThreadPoolExecutor(16) as clients:
        asked = [clients.submit(made.ask, bytes(1 << 16)) for _ in range(16)]
        until(lambda: made.metric("legoworld_spool_bytes") == 1 << 20)
        assert made.ask(b"x").status == 429
        held.go.set()
        assert {one.result().status for one in asked} == {200}


def test_what_nobody_waits_for_is_not_begun():
    held = Held()
    with service(held) as made, ThreadPoolExecutor(1) as clients:
        first = clients.submit(made.ask)
        until(lambda: held.begun)
        with made.raw(made.head("content-length: 1") + b"x"):
            until(lambda: made.metric("legoworld_queue_taken") == 2)
        until(lambda: made.metric("legoworld_queue_taken") == 1)
        held.go.set()
        assert first.result().status == 200
        assert len(held.begun) == 1


def test_what_was_taken_is_answered_before_the_end():
    held = Held()
    with service(held) as made, ThreadPoolExecutor(2) as clients:
        asked = [clients.submit(made.ask) for _ in range(2)]
        until(lambda: made.metric("legoworld_queue_taken") == 2)
        made.server.should_exit = True
        until(lambda: _refuses(made.port))
        held.go.set()
        assert [one.result().status for one in asked] == [200, 200]


def _refuses(port: int) -> bool:
    try:
        socket.create_connection(("127.0.0.1", port)).close()
    except ConnectionRefusedError:
        return True
    return False


def test_a_taken_port():
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(PortTakenError), listening("127.0.0.1", port):
            pass


@pytest.mark.parametrize("host", ["::1", "nowhere.invalid"])
def test_a_host_that_cannot_be_listened_on(host):
    with pytest.raises(PortTakenError, match="another host"), listening(host, 0):
        pass


def test_the_token_s_places(tmp_path, monkeypatch):
    monkeypatch.delenv("LEGOWORLD_SERVE_TOKEN", raising=False)
    new, is_new = access_token(None)
    assert is_new
    assert len(new) >= 32
    monkeypatch.setenv("LEGOWORLD_SERVE_TOKEN", TOKEN)
    assert access_token(None) == (TOKEN, False)
    (tmp_path / "token").write_text(f"{TOKEN}{TOKEN}\n", encoding="utf-8")
    assert access_token(tmp_path / "token") == (TOKEN + TOKEN, False)
    for bad in ("", "short", "\xe4" * 20, "with a\nline break in it"):
        (tmp_path / "token").write_text(bad, encoding="utf-8")
        with pytest.raises(UsageError):
            access_token(tmp_path / "token")
    with pytest.raises(UsageError):
        access_token(tmp_path / "none")


def test_the_scratch_goes_with_the_service():
    with service() as made:
        assert made.ask().status == 200
        folder = made.scratch
    assert not folder.exists()
    assert tempfile.gettempdir() != str(folder)
