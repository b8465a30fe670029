"""What a session records of each command, and what it starts Blender with; a stand-in answers."""

from __future__ import annotations

import json
import socket
from contextlib import closing
from dataclasses import replace
from types import SimpleNamespace

import pytest
from endpoint.clients import LIMITS

from legoworld.endpoint import blender, finalisation, workspace_finalisation
from legoworld.endpoint import session as session_module
from legoworld.endpoint.blender import BlenderEndedError, LiveBlender
from legoworld.endpoint.finalisation import export_submission, finalise
from legoworld.endpoint.listener import HOST
from legoworld.endpoint.screenshots import NotShownError, deliver_picture
from legoworld.endpoint.serve import (
    EndpointOptions,
    open_endpoint,
    record_path,
    serve_endpoint,
    workspace_path,
)
from legoworld.endpoint.server import EndpointServer
from legoworld.endpoint.session import CALL_TIME_S, Session, Trial
from legoworld.endpoint.trial_record import TrialRecord, read_rows, write_rows
from legoworld.endpoint.workspace_finalisation import blender_finalise
from legoworld.errors import LegoWorldError, SceneInvalidError, UsageError
from legoworld.records.endpoint import BlenderReply, Call, Checkpoint, Command, Failure, Success
from legoworld.workers.protections import protections
from legoworld.workers.sandbox import SandboxLimits

PNG = b"\x89PNG\r\n\x1a\n" + (13).to_bytes(4, "big") + b"IHDR" + b"\0\0\0\1" * 2 + bytes(32)
HELD = protections("limits")
CODE = Command(type="execute_code", params={"code": "1"})


class Blender:
    """Each reply is the next of `replies`, an error is raised; `scene` is what it saves."""

    def __init__(self, folder):
        self.files, self.replies, self.scene = folder / "files", [], b"BLENDER 0"
        (self.files / "output").mkdir(parents=True)
        self.started, self.asked, self.closed = [], [], 0

    def __call__(self, workspace, limits, protections, **how):
        self.started.append(
            SimpleNamespace(workspace=workspace, limits=limits, protections=protections, **how)
        )
        return self

    def __enter__(self):
        return self

    def __exit__(self, *_error):
        self.close()

    def path_inside(self, name):
        return f"/sandbox/output/{name}"

    output_name = staticmethod(lambda name: f"output/{name}")

    def ask(self, kind, params, limit):
        self.asked.append((kind, params, limit))
        if kind == "save_copy":
            if self.scene is None:
                return BlenderReply(error="no", seconds=0.0)
            (self.files / "output" / "checkpoint.blend").write_bytes(self.scene)
            return BlenderReply(result={}, seconds=0.0)
        reply = self.replies.pop(0)
        if isinstance(reply, Exception):
            raise reply
        return reply

    def close(self):
        self.closed += 1


def reply_of(result=None, error=None, seconds=0.0, stopped=False):
    return BlenderReply(result=result, error=error, seconds=seconds, stopped=stopped)


@pytest.fixture
def live(tmp_path, monkeypatch):
    (tmp_path / "workspace").mkdir()
    made = Blender(tmp_path)
    monkeypatch.setattr(session_module, "LiveBlender", made)
    return made


def trial_in(folder, **how) -> Trial:
    known = {"workspace": folder / "workspace", "record": folder / "record", "limits": LIMITS}
    return Trial(**{**known, "protections": HELD, **how})


def test_a_session_starts_blender_with_what_the_trial_says(tmp_path, live):
    inputs, scene = (tmp_path / "in",), tmp_path / "scene.blend"
    trial = trial_in(tmp_path, inputs=inputs, blend=scene, lease=5)
    assert trial.call_time_s == CALL_TIME_S == 165.0
    with closing(Session(trial)) as session:
        session.start()
        session.start()
        (begun,) = live.started
        assert (begun.workspace, begun.protections, begun.blend) == (trial.workspace, HELD, scene)
        assert (begun.inputs, begun.lease) == (inputs, 5)
        assert 590 < begun.limits.time_s <= 600
        assert replace(begun.limits, time_s=600.0) == LIMITS
        ((kind, params, within_s),) = live.asked
        assert (kind, params) == ("save_copy", {"output": "/sandbox/output/checkpoint.blend"})
        assert within_s == 120.0
        assert list((tmp_path / "record" / "checkpoints").iterdir()) == []
    assert live.closed == 1


def test_each_call_is_a_row_of_what_was_sent_and_what_came_of_it(tmp_path, live):
    long = "é " * 300
    live.replies = [
        reply_of({"result": long}, seconds=1.23456789),
        reply_of(error="no\nsuch name", seconds=0.5),
        reply_of(error="stopped", stopped=True),
        reply_of(["no words"]),
        BlenderEndedError("it is over", limit="time"),
        BlenderEndedError("it crashed", limit="memory"),
        LegoWorldError("not this", found="that"),
        OSError("disk"),
    ]
    sent = [
        CODE, Command(type="get_scene_info"), Command(type="execute_code", params={"code": 5}),
        *[Command(type="list_scene_items", params={})] * 5,
    ]  # fmt: skip
    with closing(Session(trial_in(tmp_path))) as session:
        session.restart_clock(100.0)
        answers = [session.answer(c, "agent" if n else "plugin") for n, c in enumerate(sent)]
        calls = session.record.calls
    assert [type(a) for a in answers] == [Success, Failure, Failure, Success] + [Failure] * 4
    assert answers[0].result == {"result": long}
    assert answers[1].message == "no\nsuch name"
    again = "; the next call finds Blender started anew, with the scene as it began"
    assert answers[4].message == f"it is over{again}"
    assert answers[5].message == f"it crashed{again}"
    assert answers[6].message.startswith("not this")
    assert answers[7].message == "disk"
    assert [c.number for c in calls] == [*range(1, 9)]
    assert [c.command for c in calls] == [c.type for c in sent]
    assert [c.code for c in calls] == ["1"] + [None] * 7
    assert [c.by for c in calls] == ["plugin"] + ["agent"] * 7
    assert [c.status for c in calls] == [
        "success", "error", "timeout", "success", "timeout", "crashed", "error", "error",
    ]  # fmt: skip
    assert (calls[0].seconds, calls[1].seconds, calls[6].seconds) == (1.234568, 0.5, 0)
    assert len(calls[0].said) <= 400
    assert calls[0].said.startswith("é é")
    assert [c.said for c in calls[1:4]] == ["no such name", "stopped", ""]
    assert all(100 <= c.at_s < 200 for c in calls)
    assert len(live.started) == 3, "anew after each end"
    rows = (tmp_path / "record" / "calls.jsonl").read_bytes().splitlines()
    assert [json.loads(row)["number"] for row in rows] == [*range(1, 9)]


def test_a_call_has_no_more_time_than_is_left(tmp_path, live):
    with closing(Session(trial_in(tmp_path, call_time_s=7.0))) as session:
        live.replies = [reply_of({}), reply_of({})]
        session.answer(CODE)
        assert live.asked[-2][0:2] == ("execute_code", {"code": "1"})
        assert live.asked[-2][2] == 7.0
        session.restart_clock(LIMITS.time_s - 5.0)
        session.answer(CODE)
        assert 0 < live.asked[-2][2] <= 5.0
        session.restart_clock(LIMITS.time_s + 1.0)
        over = session.answer(CODE)
        assert over.message == "the trial's 600 s are over; no further call is possible"
        assert len(session.record.calls) == 2


def test_only_code_makes_a_checkpoint_and_only_of_another_scene(tmp_path, live):
    live.replies = [
        reply_of({}),
        reply_of({}),
        reply_of({}),
        reply_of({}),
        reply_of({"success": True}),
        reply_of({}),
    ]
    (live.files / "output" / "screenshot.png").write_bytes(PNG)
    look = Command(
        type="get_viewport_screenshot",
        params={"filepath": str(tmp_path / "workspace" / "look.png"), "max_size": 5},
    )
    sent = [
        (b"BLENDER 0", CODE), (b"BLENDER 1", CODE), (b"BLENDER 2", Command(type="get_scene_info")),
        (None, CODE), (b"BLENDER 3", look), (b"BLENDER 3", CODE),
    ]  # fmt: skip
    with closing(Session(trial_in(tmp_path))) as session:
        session.start()
        for scene, command in sent:
            live.scene = scene
            answer = session.answer(command)
            if command is look:
                assert answer.result == {"success": True, "filepath": look.params["filepath"]}
        assert [c.checkpoint for c in session.record.calls] == [None, 1, None, None, None, None]
        assert [(c.call, c.kind, c.ordinal) for c in session.record.checkpoints] == [(2, "live", 1)]
    assert (tmp_path / "workspace" / "look.png").read_bytes() == PNG
    inside = {"filepath": "/sandbox/output/screenshot.png", "max_size": 5}
    assert [params for kind, params, _ in live.asked if "screenshot" in kind] == [inside]


def test_a_screenshot_that_failed_delivers_nothing(tmp_path, live):
    target = tmp_path / "workspace" / "look.png"
    live.replies = [reply_of({"success": False}), reply_of("words"), reply_of({"success": True})]
    look = Command(type="get_viewport_screenshot", params={"filepath": str(target)})
    with closing(Session(trial_in(tmp_path))) as session:
        assert session.answer(look).result == {"success": False}
        assert session.answer(look).result == "words"
        assert "no picture that is shown" in session.answer(look).message
        assert "no PNG" in session.record.calls[-1].said
    assert not target.exists()


def test_an_export_stays_in_the_workspace(tmp_path, live):
    live.replies = [reply_of({"done": 1})]
    inside = {"filepath": str(tmp_path / "workspace" / "a.glb")}
    with closing(Session(trial_in(tmp_path))) as session:
        answer = session.answer(Command(type="export_scene", params=inside))
        assert answer.result == {"done": 1}
        for wrong in ({"filepath": 5}, {}, {"filepath": str(tmp_path / "a.glb")}, None):
            refused = session.answer(Command(type="export_scene", params=wrong))
            assert "writes only to the workspace" in refused.message
            assert f"a path below {(tmp_path / 'workspace').resolve()}" in refused.message
        assert "found: None" in session.record.calls[-1].said
    assert [params for kind, params, _ in live.asked if kind == "export_scene"] == [inside]


def test_a_saved_scene_is_kept_when_it_is_another(tmp_path, live):
    workspace = tmp_path / "workspace"
    (workspace / "scene.blend").write_bytes(b"BLENDER before")
    live.scene, live.replies = None, [reply_of({})] * 4
    with closing(Session(trial_in(tmp_path))) as session:
        session.answer(CODE)
        assert session.record.checkpoints == [], "it was there before"
        (workspace / "scene.blend").write_bytes(b"BLENDER saved it")
        session.answer(CODE)
        session.answer(CODE)
        (kept,) = session.record.checkpoints
        assert (kept.kind, kept.call, kept.bytes) == ("saved", 2, 16)
        assert [c.checkpoint for c in session.record.calls] == [None, 1, None]
        (workspace / "scene.blend").write_bytes(b"BLENDER by other means")
        session.keep_last_save()
        assert [(c.call, c.ordinal) for c in session.record.checkpoints] == [(2, 1), (3, 2)]
    (workspace / "scene.blend").write_bytes(b"BLENDER while nobody looked")
    with closing(Session(trial_in(tmp_path))) as session:
        session.keep_last_save()
        assert [c.ordinal for c in session.record.checkpoints] == [1, 2, 3]


def test_a_continued_session_goes_on_after_its_last_call(tmp_path, live):
    record = TrialRecord(tmp_path / "record")
    row = Call(
        number=1, command="execute_code", code=None, at_s=400.0, seconds=50.0, status="success",
        said="", checkpoint=None,
    )  # fmt: skip
    record.note(row)
    live.replies = [reply_of({})]
    with closing(Session(trial_in(tmp_path))) as session:
        session.answer(CODE)
        second = session.record.calls[1]
    assert second.number == 2
    assert 450 <= second.at_s < 500
    assert 100 < live.started[0].limits.time_s <= 150


@pytest.mark.parametrize(
    ("kind", "result"),
    [
        ("ping", {"pong": True}),
        ("get_telemetry_consent", {"consent": False}),
        ("set_telemetry_consent",
         {"error": "this endpoint collects nothing, and that stays so"}),
        *[(f"get_{name}_status", False) for name in
          ("polyhaven", "hyper3d", "sketchfab", "polypizza", "hunyuan3d", "tripo", "meshy")],
    ],
)  # fmt: skip
def test_some_answers_need_no_blender(tmp_path, live, kind, result):
    with closing(Session(trial_in(tmp_path))) as session:
        found = session.answer(Command(type=kind)).result
        assert session.record.calls == []
        told = session.answer(Command(type="get_workspace")).result
        assert told == {"workspace": str((tmp_path / "workspace").resolve())}
        assert session.answer(Command(type="fly")).message == "Unknown command type: fly"
    assert (found["enabled"] if result is False else found) == result
    assert live.started == []


def test_rows_are_read_and_written_one_a_line(tmp_path):
    record = TrialRecord(tmp_path / "r")
    (tmp_path / "a.blend").write_bytes(b"12345")
    row = record.take(tmp_path / "a.blend", "f" * 64, kind="live", call=3, at_s=1.23456)
    assert (row.ordinal, row.bytes, row.call, row.at_s) == (1, 5, 3, 1.2346)
    assert record.blend(row) == tmp_path / "r" / "checkpoints" / f"{'f' * 64}.blend"
    assert record.blend(row).read_bytes() == b"12345"
    assert record.last("live") == row
    assert record.last("saved") is None
    path = tmp_path / "r" / "checkpoints.jsonl"
    assert read_rows(path, Checkpoint) == [row] == TrialRecord(tmp_path / "r").checkpoints
    path.write_bytes(path.read_bytes() + b'{"ordinal": 2')
    assert read_rows(path, Checkpoint) == [row]
    write_rows(path, [row, row])
    assert read_rows(path, Checkpoint) == [row, row]
    assert read_rows(tmp_path / "none", Checkpoint) == []


def test_a_file_that_is_no_blend_is_told_as_spoilt_until_the_next(tmp_path):
    record = TrialRecord(tmp_path / "r")
    (tmp_path / "scene.blend").write_bytes(b"glTF is another format")
    assert record.keep_saved(tmp_path, call=4, at_s=0.0) is None
    assert record.spoilt == "saved by call 4: it begins with b'glTF is '"
    (tmp_path / "scene.blend").unlink()
    assert record.keep_saved(tmp_path, call=5, at_s=0.0) is None
    assert record.spoilt == ""


@pytest.fixture
def exporting(tmp_path, monkeypatch):
    """A Blender that leaves what `files` names of a scene that it opened."""
    (tmp_path / "workspace").mkdir()
    (tmp_path / "made").mkdir()
    (tmp_path / "stored.blend").write_bytes(b"BLENDER stored")
    live = Blender(tmp_path)
    live.leaves, live.opened = {"scene.blend": b"b", "scene.glb": b"g"}, []

    def ask(kind, params, within_s):
        live.asked.append((kind, params, within_s))
        live.opened.append(live.started[-1].blend.read_bytes())
        for name, data in live.leaves.items():
            (live.files / "output" / name).write_bytes(data)
        return live.replies.pop(0)

    live.ask = ask
    monkeypatch.setattr(finalisation, "LiveBlender", live)
    monkeypatch.setattr(finalisation, "check_glb", lambda _: None)
    monkeypatch.setattr(finalisation, "final_picture", lambda *words: [f"picture {words[0]}"])
    return live


def export(tmp_path, **how):
    return export_submission(
        tmp_path / "stored.blend", tmp_path / "made", workspace=tmp_path / "workspace",
        limits=LIMITS, protections=HELD, blender="it", **how,
    )  # fmt: skip


def test_a_scene_is_exported_from_the_workspace_with_room_for_it(tmp_path, exporting):
    (tmp_path / "workspace" / "full").write_bytes(bytes(1 << 20))
    exporting.replies = [reply_of({"warnings": ["a\nb", 5]}), reply_of({})]
    assert export(tmp_path) == ["a b", "5", "picture it"]
    (begun,) = exporting.started
    assert (begun.workspace, begun.protections) == (tmp_path / "workspace", HELD)
    assert begun.blend == tmp_path / "workspace" / ".finalised.blend"
    assert exporting.opened == [b"BLENDER stored"]
    assert (begun.limits.time_s, begun.limits.memory_bytes) == (300.0, LIMITS.memory_bytes)
    assert begun.limits.disk_bytes >= LIMITS.disk_bytes + (1 << 20)
    assert exporting.asked == [("finalise", {"output": "/sandbox/output/"}, 150.0)]
    assert {p.name: p.read_bytes() for p in (tmp_path / "made").iterdir()} == exporting.leaves
    assert [path.name for path in (tmp_path / "workspace").iterdir()] == ["full"]
    (tmp_path / "workspace" / "deep").mkdir()
    assert export(tmp_path, place="deep") == ["picture it"]
    assert exporting.started[1].blend == tmp_path / "workspace" / "deep" / ".finalised.blend"
    assert list((tmp_path / "workspace" / "deep").iterdir()) == []


def test_a_scene_without_a_gltf_is_delivered_and_a_bad_one_is_not(tmp_path, exporting, monkeypatch):
    exporting.leaves, exporting.replies = {"scene.blend": b"b"}, [reply_of(), reply_of()]
    assert export(tmp_path) == ["picture it"]
    exporting.leaves["scene.glb"] = b"g"

    def check(path):
        assert path.read_bytes() == b"g"
        raise LegoWorldError("it is broken", found="this")

    monkeypatch.setattr(finalisation, "check_glb", check)
    first, _ = export(tmp_path)
    assert first.startswith("scene.glb is not delivered: it is broken")
    assert [path.name for path in (tmp_path / "made").iterdir()] == ["scene.blend"]


def test_what_cannot_be_saved_is_no_submission(tmp_path, exporting):
    exporting.replies = [reply_of(error="no memory"), reply_of()]
    with pytest.raises(SceneInvalidError, match=r"could not be exported.*no memory"):
        export(tmp_path)
    exporting.leaves = {}
    for name in ("scene.blend", "scene.glb"):
        (exporting.files / "output" / name).unlink()
    with pytest.raises(SceneInvalidError, match=r"Blender left no scene\.blend"):
        export(tmp_path)
    assert list((tmp_path / "made").iterdir()) == list((tmp_path / "workspace").iterdir()) == []


def test_the_last_save_that_opens_is_the_submission_else_the_open_scene(tmp_path, monkeypatch):
    record, tried = TrialRecord(tmp_path / "r"), []
    rows = [
        ("live", "a"), ("saved", "c"), ("saved", "b"), ("live", "d"), ("saved", "e"),
        ("saved", "e"), ("saved", "f"), ("live", "g"), ("live", "h"), ("live", "i"),
    ]  # fmt: skip
    for number, (kind, name) in enumerate(rows, start=1):
        (tmp_path / "file").write_text(name)
        record.take(tmp_path / "file", name, kind=kind, call=number, at_s=0.0)
    bad = {}

    def export(blend, made, **how):
        tried.append(blend.stem)
        assert made == "made"
        assert how == {"workspace": "w", "limits": "l", "protections": "h", "blender": 1}
        if blend.stem in bad:
            raise bad[blend.stem]
        return ["warned"]

    monkeypatch.setattr(finalisation, "export_submission", export)

    def finalised():
        return finalise(record, "made", workspace="w", limits="l", protections="h", blender=1)

    found = finalised()
    assert (found.source, found.checkpoint, found.sha256) == ("saved", 7, "f")
    assert (found.refused, found.warnings) == ((), ("warned",))
    record.spoilt = "saved by call 9: a link"
    bad |= {name: SceneInvalidError("broken", found=name) for name in "fei"}
    bad["b"] = BlenderEndedError("crashed")
    tried.clear()
    found = finalised()
    assert tried == ["f", "e", "b", "i", "h"], "three of each kind, the latest first"
    assert (found.source, found.checkpoint, found.sha256) == ("checkpoint", 9, "h")
    assert found.refused[0] == "saved by call 9: a link"
    assert [text.partition(":")[0] for text in found.refused[1:]] == [
        "saved 7", "saved 6", "saved 3", "live 10",
    ]  # fmt: skip
    bad |= {name: SceneInvalidError("broken", found="x" * 300) for name in "hgdac"}
    tried.clear()
    found = finalised()
    assert tried == ["f", "e", "b", "i", "h", "g"]
    assert (found.source, found.checkpoint, found.sha256) == ("none", None, None)
    assert len(found.refused) == 7
    assert max(map(len, found.refused)) <= 210


@pytest.mark.parametrize(("kills", "opened"), [(1, "b"), (2, "a")])
def test_a_blender_that_was_killed_opens_the_same_scene_once_more(
    tmp_path, monkeypatch, kills, opened
):
    """A kill from outside says nothing of the scene; the second may be the system's memory."""
    record = TrialRecord(tmp_path / "record")
    for number, name in enumerate("ab", start=1):
        (tmp_path / "file").write_text(name)
        record.take(tmp_path / "file", name, kind="live", call=number, at_s=0.0)
    left = [BlenderEndedError("SIGKILL", killed=True)] * kills

    def export(blend, **_how):
        if left:
            raise left.pop()
        return [blend.stem]

    monkeypatch.setattr(finalisation, "export_submission", export)
    found = finalise(record, "made", workspace="w", limits="l", protections="h", blender=1)
    assert (found.warnings, len(found.refused)) == ((opened,), kills - 1)
    (tmp_path / "workspace").mkdir()
    left = [BlenderEndedError("SIGKILL", killed=True)] * kills
    session = Session(trial_in(tmp_path))
    monkeypatch.setattr(
        session, "_open_checkpoint", lambda last: export(session.record.blend(last))
    )
    assert session._start_blender() == [opened]
    assert bool(session._passed_over) == (kills == 2)


def test_a_workspace_is_finalised_with_what_it_saved_after_its_last_call(tmp_path, monkeypatch):
    workspace, asked = tmp_path / "workspace", []
    workspace.mkdir()
    record = TrialRecord(record_path(workspace))
    row = Call(
        number=1, command="execute_code", code=None, at_s=40.0, seconds=5.0, status="success",
        said="", checkpoint=None,
    )  # fmt: skip
    record.note(row)
    (workspace / "scene.blend").write_bytes(b"BLENDER saved")

    class Process:
        def __init__(self, limits):
            asked.append(limits.memory_bytes)

        def __enter__(self):
            return "the blender"

        def __exit__(self, *_error):
            asked.append("closed")

    def finalise(record, output, **how):
        asked.append((record.checkpoints, output, how))
        return "made"

    monkeypatch.setattr(workspace_finalisation, "BlenderProcess", Process)
    monkeypatch.setattr(workspace_finalisation, "finalise", finalise)
    output = tmp_path / "deep" / "out"
    monkeypatch.setattr(workspace_finalisation, "protections", lambda _sandbox: HELD)
    assert blender_finalise(workspace, output, memory_limit_gib=3) == "made"
    memory, ((kept,), where, how), closed = asked
    assert (memory, closed, where) == (3 << 30, "closed", output)
    assert (kept.kind, kept.call, kept.at_s) == ("saved", 1, 45.0)
    assert how == {
        "workspace": workspace, "protections": HELD, "blender": "the blender",
        "limits": SandboxLimits(time_s=600.0, memory_bytes=3 << 30),
    }  # fmt: skip
    blender_finalise(workspace, output)
    (output / "there").write_text("")
    with pytest.raises(UsageError, match="output folder is not empty"):
        blender_finalise(workspace, output)


def serving(tmp_path, **how):
    known = {"scene": None, "port": 0, "workspace": tmp_path / "workspace", "inputs": (),
             "protections": HELD, "limits": LIMITS, "call_time_s": 30.0}  # fmt: skip
    return EndpointOptions(**{**known, **how})


def test_an_endpoint_opens_its_scene_and_says_where_it_is_kept(tmp_path, live):
    options = serving(tmp_path, inputs=(tmp_path,), scene=tmp_path / "scene.blend")
    notices, words = [], []
    with open_endpoint(options, notice=notices.append) as port:
        (begun,) = live.started
        assert (begun.blend, begun.inputs) == (options.scene, (tmp_path,))
        live.replies = [reply_of({})]
        with socket.create_connection((HOST, port), timeout=60) as line:
            line.sendall(b'{"type": "get_scene_info"}')
            assert json.loads(line.recv(4096))["status"] == "success"
        assert live.asked[-1][2] == 30.0
    record = tmp_path / "workspace.trajectory"
    assert notices[-1] == f"Blender writes to {options.workspace}; every scene is kept in {record}"
    assert notices[0] == f"runs any code it is sent; kept from it: {', '.join(HELD.holds)}"
    assert workspace_path(options) == tmp_path / "workspace"
    assert str(workspace_path(replace(options, workspace=None, port=9))) == "blender-9"
    over = SimpleNamespace(wait=words.append)
    serve_endpoint(options, over, say=words.append, notice=notices.append)
    assert words[0].startswith(f"listening on {HOST}:")
    assert words[1] == LIMITS.time_s


def test_a_workspace_s_own_scene_is_never_overwritten(tmp_path, live):
    saved = tmp_path / "workspace" / "scene.blend"
    saved.write_bytes(b"BLENDER")
    other = serving(tmp_path, scene=tmp_path / "other.blend")
    with (
        pytest.raises(UsageError, match=r"has a scene\.blend already.*another --workspace"),
        open_endpoint(other, notice=print),
    ):
        pass
    assert live.started == []
    for scene in (saved, None):
        with open_endpoint(serving(tmp_path, scene=scene), notice=lambda _: None):
            pass
    assert [begun.blend for begun in live.started] == [saved, None]


def test_what_is_no_message_is_answered_before_the_line_closes(tmp_path, live):
    with closing(Session(trial_in(tmp_path))) as session, EndpointServer(session, 0) as server:
        with socket.create_connection((HOST, server.port), timeout=60) as line:
            line.sendall(b'{"type": 5}')
            answer = json.loads(line.recv(4096))
            assert answer["status"] == "error"
            assert answer["message"].startswith('not a command such as {"type": "get_scene_info"}')
            line.sendall(b"\nhello")
            answer = json.loads(line.makefile("rb").read())
            assert answer["message"] == "a message is a JSON object and begins with {"
        by = EndpointServer(session, 0, by="plugin")
        live.replies = [reply_of({})]
        with by, socket.create_connection((HOST, by.port), timeout=60) as line:
            line.sendall(b'{"type": "get_scene_info"}')
            line.recv(4096)
        assert session.record.calls[-1].by == "plugin"


def test_a_picture_elsewhere_is_refused_with_where_it_may_be(tmp_path):
    with pytest.raises(NotShownError, match=r"found: no filepath.*TMPDIR set to the workspace"):
        deliver_picture(PNG, "", tmp_path)
    large = PNG[:16] + (1 << 14).to_bytes(4, "big") * 2 + bytes(40)
    with pytest.raises(NotShownError, match="16384x16384 pixels in 64 bytes"):
        deliver_picture(large, str(tmp_path / "a.png"), tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("limit", "words"),
    [
        ("time", "the trial's time is over, and Blender was ended"),
        ("memory", "Blender used more than 1.5 GiB and was ended"),
        ("disk", "more than 2.5 GiB were written, and Blender was ended"),
        ("output", "more than 3 MiB were printed, and Blender was ended"),
        ("processes", "more than 64 processes ran, and all were ended"),
    ],
)
def test_the_limit_that_ended_a_blender_is_named(limit, words):
    limits = replace(LIMITS, memory_bytes=3 << 29, disk_bytes=5 << 29, output_bytes=3 << 20)
    ended, closed = SimpleNamespace(over=limit, code=None), []
    stand_in = SimpleNamespace(
        _ending=ended, _watch=None, _limits=limits, close=lambda: closed.append(1)
    )
    error = LiveBlender._end_and_explain(stand_in, ConnectionError("closed"), 1.0)
    assert (str(error), error.limit, closed) == (words, limit, [1])
    stand_in._ending = None
    error = LiveBlender._end_and_explain(stand_in, TimeoutError(), 2.5)
    assert str(error) == "Blender was ended: still busy 10 s after its 2.5 s were over"
    assert (error.limit, closed) == ("time", [1, 1])
    error = LiveBlender._end_and_explain(stand_in, ConnectionError("its end"), 2.5)
    assert (error.limit, closed) == (None, [1, 1, 1])
    assert str(error).startswith("Blender closed its line")
    assert "its end" in str(error)


@pytest.mark.parametrize("where", ["workspace", "elsewhere", None])
def test_a_scene_from_elsewhere_becomes_the_workspace_s(tmp_path, where):
    begun = []

    class Ended(Exception):  # noqa: N818
        pass

    def start(command, shown):
        begun.append((command, shown))
        raise Ended

    (tmp_path / "box").mkdir()
    sandbox = SimpleNamespace(
        scratch=tmp_path / "box", path_inside=lambda name: f"/s/{name}", start=start
    )
    scene = None if where is None else tmp_path / where / "a.blend"
    workspace, given = tmp_path / "workspace", tmp_path / "given"
    with pytest.raises(Ended):
        LiveBlender._start(SimpleNamespace(_sandbox=sandbox), workspace, scene, [given])
    ((command, shown),) = begun
    assert command[1:5] == ["-u", "-m", "legoworld.scene.blender.endpoint", "/s/channel"]
    foreign = where == "elsewhere"
    assert json.loads(command[5]) == {
        "open": None if scene is None else str(scene),
        "become": str(workspace / "scene.blend") if foreign else None,
    }
    assert shown == ([given, scene] if foreign else [given])


def test_a_blender_that_does_not_start_is_closed(tmp_path, monkeypatch):
    closed, opened_with = [], []

    class Sandbox:
        def __init__(self, *words, **how):
            opened_with.append((words[1:], how["workspace"], how["lease"], how["owner"]))

        def stop(self):
            closed.append("stopped")

        def close(self):
            closed.append("closed")

    monkeypatch.setattr(blender, "Sandbox", Sandbox)
    with pytest.raises(AttributeError):
        LiveBlender(tmp_path, LIMITS, HELD, lease=4)
    assert closed == ["stopped", "closed"]
    ((words, workspace, lease, owner),) = opened_with
    assert (words, workspace, lease) == ((LIMITS, HELD), tmp_path, 4)
    assert not owner.exists()


def test_a_blender_that_does_not_answer_has_ended(monkeypatch):
    line, sent, why = SimpleNamespace(), [], []
    line.settimeout = sent.append
    line.sendall = sent.append

    def reply(_deadline):
        raise OSError("gone")

    def over(error, time_s):
        why.append((str(error), time_s))
        return BlenderEndedError("it ended")

    stand_in = SimpleNamespace(_line=line, _reply=reply, _end_and_explain=over)
    with pytest.raises(BlenderEndedError, match="it ended"):
        LiveBlender.ask(stand_in, "look", {"a": "\ud800"}, 3.0)
    assert why == [("gone", 3.0)]
    seconds, data = sent
    assert seconds == 13.0
    assert len(data) == 4 + int.from_bytes(data[:4], "big")
    stand_in._reply = lambda deadline: deadline
    monkeypatch.setattr(blender, "time", SimpleNamespace(monotonic=lambda: 100.0))
    assert LiveBlender.ask(stand_in, "look", {}, 3.0) == 113.0
