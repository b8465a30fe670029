"""N commands in, N answers out, whatever they hold; the port stays open, whatever clients do."""

from __future__ import annotations

import errno
import json
import socket
import threading
from contextlib import closing
from dataclasses import replace
from types import SimpleNamespace
from typing import ClassVar

import pytest
from endpoint.clients import LIMITS, Client
from hypothesis import example, given
from hypothesis import strategies as st
from waiting import until

from legoworld.endpoint import session as session_module
from legoworld.endpoint.blender import BlenderEndedError
from legoworld.endpoint.listener import HOST, Listener, PortTakenError
from legoworld.endpoint.serve import EndpointOptions, open_endpoint, record_path
from legoworld.endpoint.server import MOST_CLIENTS, EndpointServer
from legoworld.endpoint.session import Session, Trial
from legoworld.records.endpoint import BlenderReply, Command, Failure, Success
from legoworld.workers.protections import protections

PNG = b"\x89PNG\r\n\x1a\n" + (13).to_bytes(4, "big") + b"IHDR" + b"\0\0\0\1" * 2 + bytes(32)


class StandIn:
    """A Blender that answers at once: every word of the endpoint's own is spoken as usual."""

    def __init__(self, workspace, *_given, blend=None, **_more) -> None:
        self.files = workspace.parent / "files"
        (self.files / "output").mkdir(parents=True, exist_ok=True)
        if blend is not None and blend.read_bytes() == b"BLENDER broken":
            raise BlenderEndedError("Blender crashed or was ended: signal SIGSEGV")
        self.opened = blend and blend.read_bytes()

    def path_inside(self, name):
        return f"/sandbox/output/{name}"

    output_name = staticmethod(lambda name: f"output/{name}")

    def ask(self, kind, *_given):
        if kind == "get_viewport_screenshot":
            (self.files / "output" / "screenshot.png").write_bytes(PNG)
            return BlenderReply(result={"success": True}, seconds=0.0)
        if kind == "save_copy":
            return BlenderReply(error="nothing to save", seconds=0.0)
        return BlenderReply(result={"result": str(self.opened)}, seconds=0.0)

    def close(self):
        pass


class Saving(StandIn):
    """Its scene is another after each piece of code, and is saved. running: those not closed."""

    running: ClassVar[list[Saving]] = []

    def __init__(self, *given, **more) -> None:
        super().__init__(*given, **more)
        self.calls = 0
        self.running.append(self)

    def ask(self, kind, *given):
        self.calls += kind == "execute_code"
        if kind != "save_copy":
            return super().ask(kind, *given)
        (self.files / "output" / "checkpoint.blend").write_bytes(b"BLENDER %d" % self.calls)
        return BlenderReply(result={}, seconds=0.0)

    def close(self):
        self.running.remove(self)


def trial_in(folder) -> Trial:
    return Trial(
        workspace=folder / "workspace",
        record=folder / "record",
        limits=LIMITS,
        protections=protections("limits"),
    )


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    folder = tmp_path_factory.mktemp("served")
    (folder / "workspace").mkdir()
    patch = pytest.MonkeyPatch()
    patch.setattr(session_module, "LiveBlender", StandIn)
    trial = trial_in(folder)
    with closing(Session(trial)) as session, EndpointServer(session, 0) as server:
        yield server
    patch.undo()


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inside: st.lists(inside, max_size=3) | st.dictionaries(st.text(), inside, max_size=3),
    max_leaves=6,
)
KINDS = st.sampled_from(
    ["execute_code", "get_viewport_screenshot", "export_scene", "get_scene_info", "ping",
     "get_object_info", "get_polyhaven_status", "list_scene_items"]
)  # fmt: skip
PATHS = st.text() | st.sampled_from(
    ["a\0b", "\0", "", "/", ".", "..", "\ud800", "x" * 5000, "/tmp", "/proc/self/mem", "a/" * 3000]
)
PARAMS = st.none() | JSON | st.fixed_dictionaries({"filepath": PATHS | JSON, "code": JSON})
COMMANDS = st.fixed_dictionaries({"type": KINDS | st.text() | JSON}, optional={"params": PARAMS})


@given(st.lists(COMMANDS, min_size=1, max_size=5))
@example([{"type": "get_viewport_screenshot", "params": {"filepath": "a\0b"}}])
@example([{"type": "export_scene", "params": {"filepath": "a\0b.glb"}}])
def test_as_many_answers_as_commands(served, commands):
    with socket.create_connection((HOST, served.port), timeout=300) as line:
        line.sendall(b"".join(json.dumps(command).encode() + b"\n" for command in commands))
        with line.makefile("rb") as answers:
            for command in commands:
                answer = json.loads(answers.readline())
                assert answer["status"] in ("success", "error"), command
                assert "internal error" not in answer.get("message", ""), command


@pytest.mark.parametrize(
    "message",
    [
        b'{"type": "execute_code", "params": {"code": ' + b"9" * 5000 + b"}}",
        b'{"type": "execute_code", "params": ' + b'{"a": ' * 100_000 + b"1" + b"}" * 100_001,
        b'{"type": "\xff\xfe"}',
        b"[" * 100_000 + b"]" * 100_000,
    ],
    ids=["digits", "depth", "no UTF-8", "brackets"],
)
def test_what_no_decoder_likes_is_answered_and_so_is_the_next_command(served, message):
    with socket.create_connection((HOST, served.port), timeout=300) as line:
        line.sendall(message + b'\n{"type": "ping"}\n')
        with line.makefile("rb") as answers:
            assert "internal error" not in json.loads(answers.readline()).get("message", "")
            assert json.loads(answers.readline())["status"] == "success"


def test_a_mistake_of_the_endpoint_is_an_answer(served, monkeypatch, capfd):
    def broken(*_):
        raise LookupError("nobody thought of this")

    monkeypatch.setattr(served._session, "answer", broken)
    client = Client(served.port)
    with closing(client.line):
        for _ in range(2):
            assert "internal error" in client.ask("ping")["message"]
    assert "nobody thought of this" in capfd.readouterr().err


def test_clients_beyond_the_most_are_told_so_and_the_next_one_is_served(served):
    lines = [socket.create_connection((HOST, served.port)) for _ in range(MOST_CLIENTS)]
    try:
        until(lambda: len(served._clients) == MOST_CLIENTS)
        refused = Client(served.port)
        with closing(refused.line):
            assert "clients are connected" in refused.ask("ping")["message"]
    finally:
        for line in lines:
            line.close()
    until(lambda: not served._clients)
    client = Client(served.port)
    with closing(client.line):
        assert client.ask("ping")["status"] == "success"


def test_a_machine_without_threads_or_descriptors_ends_no_listening(monkeypatch, capfd):
    """About a thousand connections at once ended the accepting thread for good."""
    met = threading.Event()

    def accepted(client: socket.socket) -> None:
        if not met.is_set():
            met.set()
            raise RuntimeError("can't start new thread")
        client.sendall(b"served")
        client.close()

    real, failures = socket.socket.accept, [errno.EMFILE, errno.ECONNABORTED]

    def accept(self):
        if failures:
            raise OSError(failures.pop(), "refused by the machine")
        return real(self)

    monkeypatch.setattr(socket.socket, "accept", accept)
    listener = Listener(0, accepted)
    for said in (b"", b"served"):
        with socket.create_connection((HOST, listener.port), timeout=300) as line:
            assert line.recv(100) == said
    listener.stop()
    listener.join()
    assert failures == []
    assert "can't start new thread" in capfd.readouterr().err


def test_a_scene_that_does_not_open_any_more_is_passed_over(tmp_path, monkeypatch):
    """One checkpoint that broke every start of Blender was the end of a session for ever."""
    monkeypatch.setattr(session_module, "LiveBlender", StandIn)
    (tmp_path / "workspace").mkdir()
    trial = trial_in(tmp_path)
    with closing(Session(trial)) as session:
        for call, data in enumerate([b"BLENDER good", b"BLENDER broken"], start=1):
            (tmp_path / "workspace" / "made").write_bytes(data)
            found = session.record.copy_incoming(tmp_path / "workspace", "made")
            assert found is not None
            session.record.take(*found, kind="live", call=call, at_s=0.0)
    with closing(Session(trial)) as session, EndpointServer(session, 0) as server:
        session.start()
        client = Client(server.port)
        with closing(client.line):
            said = client.refused("print()")
            assert "SIGSEGV" in said
            assert "as call 1 left it" in said
            assert client.run("print()") == "b'BLENDER good'"


def test_each_scene_is_kept_with_its_call_and_blender_ends_with_the_session(tmp_path, monkeypatch):
    monkeypatch.setattr(session_module, "LiveBlender", Saving)
    (tmp_path / "workspace").mkdir()
    code = Command(type="execute_code", params={"code": "1"})
    with closing(Session(trial_in(tmp_path))) as session:
        for command in (code, Command(type="get_scene_info"), code):
            session.answer(command)
        record = session.record
        assert len(Saving.running) == 1
    assert Saving.running == []
    assert [(c.call, c.kind) for c in record.checkpoints] == [(1, "live"), (3, "live")]
    assert [(c.status, c.checkpoint) for c in record.calls] == [
        ("success", 1),
        ("success", None),
        ("success", 2),
    ]


def test_what_is_served_and_what_is_kept_from_it_is_said(tmp_path, monkeypatch):
    monkeypatch.setattr(session_module, "LiveBlender", Saving)
    held = protections("limits")
    serving = EndpointOptions(
        scene=None, port=0, workspace=tmp_path / "work", inputs=(), protections=held, limits=LIMITS,
        call_time_s=300.0,
    )  # fmt: skip
    said: list[list[str]] = []
    for held_now in (held, replace(held, why_not=None)):
        said.append([])
        with open_endpoint(replace(serving, protections=held_now), notice=said[-1].append) as port:
            client = Client(port)
            with closing(client.line):
                client.run("1")
    first, again = said
    (warning,) = [line for line in first if line.startswith("warning")]
    assert warning.startswith("warning: not kept from it: network, ")
    assert warning.endswith(" (not asked for)")
    assert not any("continuing" in line or "None" in line for line in first)
    assert again[0] == f"continuing {record_path(tmp_path / 'work')} after 1 calls"
    assert not any("(" in line for line in again)


def test_asset_libraries_are_off_and_telemetry_is_too(served):
    client = Client(served.port)
    with closing(client.line):
        for name in ("polyhaven", "sketchfab", "hyper3d"):
            assert client.ask(f"get_{name}_status")["result"]["enabled"] is False
        assert client.ask("get_telemetry_consent")["result"] == {"consent": False}
        assert "Unknown command" in client.ask("polyhaven_status")["message"]


def test_a_port_that_is_taken_is_refused(served):
    with pytest.raises(PortTakenError) as refused:
        Listener(served.port, lambda client: client.close())
    assert refused.value.code == "port_taken"
    assert f"port {served.port} cannot be used" in str(refused.value)


def test_a_client_that_is_being_handed_over_is_waited_for():
    entered, go, done = threading.Event(), threading.Event(), []

    def accepted(client: socket.socket) -> None:
        entered.set()
        go.wait()
        done.append(sum(range(5_000_000)))
        client.close()

    listener = Listener(0, accepted)
    with socket.create_connection((HOST, listener.port)):
        entered.wait()
        listener.stop()
        go.set()
        listener.join()
        assert len(done) == 1


@pytest.mark.parametrize(("used_s", "answered"), [(0.0, True), (1e9, False)])
def test_after_its_time_a_trial_answers_no_further_call(tmp_path, used_s, answered, monkeypatch):
    """Whatever Blender could do: it is not even asked."""
    (tmp_path / "workspace").mkdir()
    monkeypatch.setattr(Session, "_answer_command", lambda *_: Success(result={}))
    with closing(Session(trial_in(tmp_path))) as session:
        session.restart_clock(used_s)
        found = session.answer(Command(type="execute_code", params={"code": "1"}))
    assert isinstance(found, Success) is answered
    if not answered:
        assert "s are over; no further call is possible" in found.message


def test_a_trial_s_time_is_over_when_all_of_it_is_used(tmp_path, monkeypatch):
    (tmp_path / "workspace").mkdir()
    monkeypatch.setattr(Session, "_answer_command", lambda *_: Success(result={}))
    monkeypatch.setattr("legoworld.endpoint.session.time", SimpleNamespace(monotonic=lambda: 64.0))
    trial = trial_in(tmp_path)
    with closing(Session(trial)) as session:
        for left_s, kind in ((2.0**-20, Success), (0.0, Failure)):
            session.restart_clock(trial.limits.time_s - left_s)
            found = session.answer(Command(type="execute_code", params={"code": "1"}))
            assert isinstance(found, kind)
