"""N lines in, N answers out, whatever they hold; without a dataset's arrays or Blender."""

from __future__ import annotations

import io
import json
import tempfile
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from waiting import until

from legoworld.bench import score_worker
from legoworld.bench import server as serving
from legoworld.bench.score_worker import Order, ScoreWorker, no_score, scene_below
from legoworld.bench.server import ScoreServer
from legoworld.records.base import canonical, decode
from legoworld.records.bench_results import ServeAnswer
from legoworld.workers.task_process import ProcessLostError

#: image id -> what its scoring raises.
RAISED = {1: ValueError("not foreseen"), 2: MemoryError(), 3: OSError(5, "Input/output error")}


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    options = SimpleNamespace(
        dataset=SimpleNamespace(cases=dict.fromkeys(RAISED)),
        root=tmp_path_factory.mktemp("root"),
        limits=None,
        rules={"R": None},
        cache=None,
    )
    with pytest.MonkeyPatch.context() as patch:
        nothing = SimpleNamespace(close=lambda: None)
        patch.setattr(score_worker, "BlenderProcess", lambda _limits: nothing)
        patch.setattr(serving, "TaskProcess", InThisProcess)
        patch.setattr(tempfile, "tempdir", tempfile.gettempdir())  # a worker's own is another

        def scored(_self, request, _scene):
            raise RAISED[request.image_id]

        patch.setattr(ScoreWorker, "_score_scene", scored)
        with ScoreServer(options, 2) as made:
            yield made


class InThisProcess:
    """A worker's process that is none, so that what it does can be replaced."""

    def __init__(self, function) -> None:
        self.call = function

    def __class_getitem__(cls, _types):
        return cls

    abort = close = staticmethod(lambda: None)


def answers(server: ScoreServer, lines: list[bytes]) -> list[ServeAnswer]:
    found: list[ServeAnswer] = []
    server.serve(io.BytesIO(b"".join(line + b"\n" for line in lines)), found.append)
    return found


REQUEST = st.fixed_dictionaries(
    {"scene": st.text(), "image_id": st.integers(-1, 5) | st.floats() | st.none()},
    optional={
        "id": st.text() | st.integers() | st.lists(st.integers()),
        "parts": st.sampled_from(["R", "RA", "X"]),
    },
).map(lambda value: json.dumps(value).encode())
LINE = REQUEST | st.binary() | st.text().map(lambda t: json.dumps(t).encode())


@given(lines=st.lists(LINE.filter(lambda line: b"\n" not in line), max_size=6))
def test_every_line_has_one_answer_without_a_number(server, lines):
    found = answers(server, lines)
    assert len(found) == sum(bool(line.strip()) for line in lines)
    for answer in found:
        assert answer.status in ("refused", "evaluator_error")
        assert answer.reason
        assert (answer.V, answer.R, answer.A, answer.S) == (None, None, None, None)
        assert decode(ServeAnswer, canonical(answer)) == answer


@pytest.mark.parametrize("image_id", RAISED)
def test_what_a_scoring_raises_is_its_answer_after_one_retry(server, image_id):
    line = json.dumps({"scene": "s", "image_id": image_id, "id": "x"}).encode()
    (answer,) = answers(server, [line])
    assert (answer.id, answer.status) == ("x", "evaluator_error")
    assert answer.reason.startswith(type(RAISED[image_id]).__name__)


def test_a_line_that_is_not_utf_8_and_one_of_2_mib_are_refused(server):
    long = b'{"scene": "' + b"x" * (2 << 20) + b'", "image_id": 1}'
    found = answers(server, [b"\xff\xfe", long, b"{}"])
    assert [a.status for a in found] == ["refused"] * 3


@pytest.mark.parametrize(("losses", "status"), [(1, "ok"), (2, "ok"), (3, "evaluator_error")])
def test_an_order_whose_process_is_lost_is_given_to_another(losses, status, monkeypatch):
    class Worker(InThisProcess):
        def call(self, order):
            calls.append(order)
            if len(calls) <= losses:
                raise ProcessLostError("killed")
            return no_score(None, "", status="ok")

        def __init__(self, _scorer) -> None:
            pass

    calls: list[Order] = []
    monkeypatch.setattr(serving, "TaskProcess", Worker)
    with ScoreServer(None, 1) as server:
        line = json.dumps({"scene": "s", "image_id": 4, "id": "x"}).encode()
        answer = server.submit(Order(line=line)).result()
        assert (answer.status, server.n_lost) == (status, losses)
    assert answer.id == ("x" if losses == 3 else None)


def test_lines_that_wait_are_not_scored_after_an_interruption(monkeypatch):
    scored, over = [], threading.Event()

    class Worker(InThisProcess):
        def call(self, order):
            scored.append(order.line)
            over.wait()

        def __init__(self, _scorer) -> None:
            pass

        abort = staticmethod(over.set)

    class Interrupted(io.BytesIO):
        def readline(self, *given):
            if line := super().readline(*given):
                return line
            until(lambda: scored)
            raise KeyboardInterrupt

    monkeypatch.setattr(serving, "TaskProcess", Worker)
    with ScoreServer(None, 1) as server, pytest.raises(KeyboardInterrupt):
        server.serve(Interrupted(b"1\n2\n"), lambda _: None)
    assert scored == [b"1\n"]


@pytest.mark.parametrize(
    "scene", ["..", "/etc", "a/../..", "link", "link/passwd", "a\0b", "\ud800", "x" * 5000, "loop"]
)
def test_no_scene_outside_of_the_root_is_looked_at(tmp_path, scene):
    root = tmp_path / "root"
    root.mkdir()
    (root / "link").symlink_to("/etc")
    (root / "loop").symlink_to("loop")
    assert scene_below(root, scene) is None or len(scene) > 1000


def test_a_scene_below_the_root_by_either_path(tmp_path):
    expected = tmp_path.resolve() / "one"
    assert scene_below(tmp_path, "one") == expected
    assert scene_below(tmp_path, str(tmp_path / "one")) == expected
    assert scene_below(Path("/"), str(tmp_path / "one")) == expected
