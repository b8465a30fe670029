"""The plugin over a Blender that is stood in for: its socket, its copies, its ledger, its words."""

from __future__ import annotations

import json
import math
import socket
import threading
from contextlib import contextmanager, nullcontext
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from msgspec.structs import replace
from plugin.talking import called

from legoworld.errors import LegoWorldError, UsageError
from legoworld.plugin import live as live_module
from legoworld.plugin import serve as serve_module
from legoworld.plugin import small_render
from legoworld.plugin.artefacts import Artefacts, find_kind
from legoworld.plugin.case import Case
from legoworld.plugin.connection import (
    Address,
    BlenderConnection,
    BlenderRefusedError,
    BlenderUnreachableError,
)
from legoworld.plugin.evidence import EvidenceInvalidError
from legoworld.plugin.evidence_camera import camera_evidence, camera_problem, read_camera
from legoworld.plugin.final_steps import _review_size
from legoworld.plugin.interruption import Interruption
from legoworld.plugin.ledger import LedgerBrokenError
from legoworld.plugin.live import LiveBlender, NotRestoredError
from legoworld.plugin.live_copy import COPY
from legoworld.plugin.open_ledger import OpenLedger, TransactionError
from legoworld.plugin.server import plugin_server
from legoworld.plugin.state import compute_signature
from legoworld.plugin.tool_answers import answer_state
from legoworld.plugin.tool_schemas import decode_arguments
from legoworld.records.base import canonical
from legoworld.records.plugin_calls import InitializeArguments
from legoworld.records.plugin_evidence import ProviderCamera
from legoworld.records.plugin_state import SceneState

EMPTY = SceneState(
    objects=(), camera=None, camera_sha256="c" * 64, render_sha256="d" * 64,
    world_sha256="e" * 64, collections_sha256="f" * 64, geometry_signature="a" * 64,
    scene_signature="b" * 64,
)  # fmt: skip
STATE = replace(EMPTY, scene_signature=compute_signature(EMPTY))


@contextmanager
def answering(*answers: bytes):
    """A port that answers each client with the next bytes; what the clients said."""
    heard: list[dict] = []
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve():
            for data in answers:
                client, _ = listener.accept()
                with client:
                    heard.append(json.loads(client.recv(1 << 16)))
                    for at in range(0, len(data), 5):
                        client.sendall(data[at : at + 5])

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        address = Address(port=listener.getsockname()[1])
        yield BlenderConnection(address, time_s=60.0), heard
        thread.join(60.0)


def success(result) -> bytes:
    return json.dumps({"status": "success", "result": result}).encode()


def test_what_is_said_to_blender_and_what_comes_back():
    failed = json.dumps({"status": "error", "message": "no such name"}).encode()
    answers = [
        success({"result": "printed"}), success({"result": 5}), success(None), success([1]),
        success({"workspace": "/work"}), success({}), failed, failed, b"", b"words",
    ]  # fmt: skip
    with answering(*answers) as (blender, heard):
        assert [blender.run("print()") for _ in range(3)] == ["printed", "", ""]
        assert blender.command("look", {"a": 1}) == [1]
        assert str(blender.workspace()) == "/work"
        assert blender.workspace() is None
        assert blender.workspace() is None
        with pytest.raises(BlenderRefusedError, match=r"refused look.*no such name.*in part"):
            blender.command("look", {})
        with pytest.raises(BlenderUnreachableError, match="ended without an answer"):
            blender.command("look", {})
        with pytest.raises(BlenderUnreachableError, match="a message is a JSON object"):
            blender.command("look", {})
    assert heard[0] == {"type": "execute_code", "params": {"code": "print()"}}
    assert heard[3] == {"type": "look", "params": {"a": 1}}
    assert heard[4] == {"type": "get_workspace", "params": {}}
    with pytest.raises(BlenderUnreachableError, match=f"no Blender answers at {blender.address}"):
        blender.run("print()")
    assert str(Address()) == "127.0.0.1:9876"


class Blender:
    """It saves `scene` where it is asked to, and says so; `restored`: what it was told to open."""

    def __init__(self, folder):
        self.folder, self.scene, self.version, self.told = folder, b"BLENDER 1", [4, 2], []
        self.recovered, self.words = None, None

    def workspace(self):
        return self.folder

    def run(self, code):
        self.told.append(code)
        if "open_mainfile" in code:
            self.scene = (self.folder / COPY).read_bytes()
            return "restored\n"
        if self.words is not None:
            return self.words
        (self.folder / COPY).write_bytes(self.scene)
        said = {"copy": str(self.folder / COPY), "filepath": "/mine.blend",
                "version": self.version, "recovered": self.recovered}  # fmt: skip
        return f"noise\n{json.dumps(said)}\n"


@pytest.fixture
def live(tmp_path, monkeypatch):
    for name in ("work", "store"):
        (tmp_path / name).mkdir()
    blender, reads = Blender(tmp_path / "work"), []

    def read_live(path, reader):
        reads.append((path, reader))
        name = path.read_bytes().decode()
        state = replace(STATE, scene_signature=name)
        return LiveScene(state=state, reading="shown")

    monkeypatch.setattr(live_module, "read_live", read_live)
    monkeypatch.setattr(live_module, "bpy_version", lambda: "4.2.3")
    monkeypatch.setattr(live_module.dataclasses, "replace", lambda scene, **how: (scene, how))
    monkeypatch.setattr(live_module, "render_small", lambda *words: words)
    made = LiveBlender(blender, "the reader", tmp_path / "store")
    return SimpleNamespace(made=made, blender=blender, reads=reads, store=tmp_path / "store")


class LiveScene(SimpleNamespace):
    """What a reader tells."""


def test_a_scene_is_read_from_a_copy_that_goes_and_may_be_kept(live):
    scene, kept = live.made.read()
    assert (scene.state.scene_signature, kept) == ("BLENDER 1", None)
    copy = live.blender.folder / COPY
    assert live.reads == [(copy, "the reader")]
    assert list(live.blender.folder.iterdir()) == list(live.store.iterdir()) == []
    _, kept = live.made.read(keep=True)
    assert (live.store / f"{kept}.blend").read_bytes() == b"BLENDER 1"
    (scene, how), _ = live.made.read(render_wh=(6, 4))
    assert scene.reading == "shown"
    assert how == {"render": (copy, "the reader", (6, 4))}
    assert live.made.recovered is None
    live.blender.recovered = "/mine.blend"
    live.made.read()
    live.blender.recovered = None
    live.made.read()
    assert live.made.recovered == "/mine.blend"


def test_what_cannot_be_shown_is_not_rendered(live, monkeypatch):
    broken = LiveScene(state=STATE, reading=LegoWorldError("no", found="x"))
    monkeypatch.setattr(live_module, "read_live", lambda *_: broken)
    assert live.made.read(render_wh=(6, 4)) == (broken, None)


def test_a_copy_that_changes_while_it_is_read_is_refused(live, monkeypatch):
    def exchange(path, _reader):
        path.write_bytes(b"BLENDER other")
        return LiveScene(state=STATE, reading="shown")

    monkeypatch.setattr(live_module, "read_live", exchange)
    for keep in (False, True):
        with pytest.raises(BlenderRefusedError, match="changed while it was read"):
            live.made.read(keep=keep)


def test_a_scene_is_restored_and_that_is_proven(live):
    _, kept = live.made.read(keep=True)
    live.blender.scene = b"BLENDER 2"
    live.made.restore(kept, replace(STATE, scene_signature="BLENDER 1"))
    assert live.blender.scene == b"BLENDER 1"
    code = next(text for text in live.blender.told if "open_mainfile" in text)
    assert "kept = '/mine.blend'" in code
    assert f"filepath={str(live.blender.folder / COPY)!r}" in code
    assert list(live.blender.folder.iterdir()) == []
    with pytest.raises(NotRestoredError, match=rf"BLENDER 1.*BLENDER 9.*open {kept}\.blend"):
        live.made.restore(kept, replace(STATE, scene_signature="BLENDER 9"))
    live.made.install("print(5)")
    assert live.blender.told[-1] == "print(5)"


@pytest.mark.parametrize(("version", "read"), [([4, 2], True), ([3, 9], True), ([4, 3], False),
                                               ([5, 0], False)])  # fmt: skip
def test_a_newer_blender_than_the_reader_is_refused(live, version, read):
    live.blender.version = version
    if read:
        assert live.made.read()
        return
    said = rf"Blender {version[0]}\.{version[1]}.*Blender 4\.2 or older"
    with pytest.raises(BlenderRefusedError, match=said):
        live.made.read()


@pytest.mark.parametrize("words", ["", "no JSON", "[]", "{}", '{"copy": 5}'])
def test_a_blender_that_does_not_say_where_the_copy_is_is_refused(live, words):
    live.blender.words = words
    with pytest.raises(BlenderRefusedError, match="did not report the path of the saved copy"):
        live.made.read()


def test_a_case_is_where_its_last_entry_left_it(tmp_path):
    made = OpenLedger(tmp_path, tmp_path / "states")
    assert (made.phase, made.transaction, made.last_settled()) == ("idle", 0, None)
    with pytest.raises(TransactionError, match=r"no transaction is open.*0 so far.*call begin"):
        made.begun_entry()
    made.note(SimpleNamespace(state=STATE))
    made.keep_base(STATE, "9" * 64)
    made.record("begin", {"a": 1}, lambda: {"x": 1}, opens=True)
    assert (made.phase, made.transaction) == ("open", 1)
    (entry,) = made.ledger.entries
    assert (entry.tool, entry.request, entry.answer, entry.error) == (
        "begin", {"a": 1}, {"x": 1}, None,
    )  # fmt: skip
    assert (entry.geometry_signature, entry.scene_signature) == ("a" * 64, STATE.scene_signature)
    assert entry.base_sha256 == "9" * 64
    assert made.begun_entry() == made.begun_entry(1) == made.last_settled() == entry
    with pytest.raises(TransactionError, match=r"transaction 2 is not open.*transaction 1 is"):
        made.begun_entry(2)
    for error, said in [
        (LegoWorldError("not so", found="this"), "not so; found: this"),
        (ValueError("seven"), "ValueError: seven"),
    ]:

        def fail(error=error):
            raise error

        with pytest.raises(type(error)):
            made.record("commit", {}, fail, closes=lambda _: True)
        last = made.ledger.entries[-1]
        assert (last.answer, last.phase, last.transaction) == (None, "open", 1)
        assert last.error.startswith(said)
    assert made.count("commit") == 0
    made.record("commit", {}, lambda: {"ok": False}, closes=lambda found: found["ok"])
    assert (made.phase, made.last_settled()) == ("open", entry)
    assert (made.count("commit"), made.count("commit", since=4)) == (1, 0)
    made.record("commit", {}, lambda: {"ok": True}, closes=lambda found: found["ok"])
    assert (made.phase, made.transaction) == ("idle", 1)
    assert made.last_settled() == made.ledger.entries[-1]
    assert made.ledger.entries[-1].transaction == 1
    made.record("diff", {}, lambda: None)
    assert made.ledger.entries[-1].transaction is None
    with pytest.raises(TransactionError, match="1 so far, all of them ended"):
        made.begun_entry()
    assert made.base() == STATE
    again = OpenLedger(tmp_path, tmp_path / "states")
    assert (again.phase, again.transaction, again.last_settled()) == (
        "idle",
        1,
        made.last_settled(),
    )
    again.record("measure", {}, lambda: None)
    last = again.ledger.entries[-1]
    assert (last.scene_signature, last.base_sha256) == (STATE.scene_signature, "9" * 64)
    path = tmp_path / "states" / f"{STATE.scene_signature}.json"
    path.write_text(path.read_text().replace("c" * 64, "0" * 64))
    with pytest.raises(LedgerBrokenError, match=r"state of another signature.*another --ledger"):
        again.base()
    path.unlink()
    with pytest.raises(LedgerBrokenError, match=f"stored state {STATE.scene_signature[:12]}"):
        again.base()


def test_what_a_case_made_is_kept_once_and_read_by_its_hash(tmp_path):
    made = Artefacts(tmp_path)
    sha256 = made.keep(b"data", "md")
    assert made.keep(b"data", "md") == sha256
    assert [path.name for path in tmp_path.iterdir()] == [f"{sha256}.md"]
    assert made.read(sha256, "md") == b"data"
    (tmp_path / "short.md").write_text("")
    (tmp_path / f"{'-' * 64}.md").write_text("")
    for wrong in ("short", "-" * 64, "0" * 64, sha256.upper()):
        with pytest.raises(UsageError, match="no such artefact"):
            made.read(wrong, "md")
    with pytest.raises(UsageError, match="no such artefact"):
        made.read(sha256, "png")
    assert [find_kind(name) for name in ("a.json", "b.md", "c.png")] == ["json", "md", "png"]


def test_an_answer_has_the_last_state_and_line():
    def case(entries, recovered=None):
        ledger = SimpleNamespace(entries=entries)
        return SimpleNamespace(ledger=ledger, live=SimpleNamespace(recovered=recovered))

    assert answer_state(case([])) == {"scene_signature": None, "ledger_seq": 0}
    entries = [SimpleNamespace(seq=4, scene_signature="s"), SimpleNamespace(seq=5,
               scene_signature="t")]  # fmt: skip
    assert answer_state(case(entries)) == {"scene_signature": "t", "ledger_seq": 5}
    assert "/mine.blend is your file again" in answer_state(case([], "/mine.blend"))["notice"]


@pytest.mark.parametrize(
    ("tools", "phase", "resumed"),
    [
        (["begin", "diff"], "open", False),
        (["begin", "resume"], "open", True),
        (["begin", "resume", "rollback"], "idle", False),
        (["begin", "resume", "commit", "begin"], "open", False),
        (["begin", "resume", "begin fails"], "open", True),
        ([], "idle", False),
    ],
)
def test_a_client_is_told_that_its_transaction_was_resumed(tools, phase, resumed):
    entries = [
        SimpleNamespace(
            tool=tool.split()[0], error="no" if " " in tool else None, seq=n, scene_signature="s"
        )
        for n, tool in enumerate(tools, 1)
    ]
    case = SimpleNamespace(
        ledger=SimpleNamespace(entries=entries), interruption=Interruption(), live=None,
        phase=phase, transaction=7,
    )  # fmt: skip
    ((failed, said),) = called(plugin_server(case, None), ("status", {}))
    assert not failed, said
    found = json.loads(said)
    assert (found["phase"], found["transaction"], found["resumed"]) == (phase, 7, resumed)


@pytest.mark.parametrize(
    ("photo_wh", "asked"), [((640, 480), (192, 144)), ((96, 192), (96, 192)), ((4000, 2), (192, 1))]
)
def test_a_small_render_is_of_the_photo_s_shape_and_its_light_is_rec_709(
    monkeypatch, photo_wh, asked
):
    rgb = np.array([[[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255]]], np.uint8)
    png = cv2.imencode(".png", rgb[:, :, ::-1])[1].tobytes()
    told = []

    def render_copy(*words, samples):
        told.append((*words, samples))
        return png

    monkeypatch.setattr(small_render, "render_copy", render_copy)
    found = small_render.render_small("the copy", "Blender", photo_wh)
    assert told == [("the copy", "Blender", asked, 16)]
    assert (found == rgb).all()
    luma = small_render.rec709_luma(found)
    assert luma == pytest.approx(np.array([[0.2126, 0.7152, 0.0722, 1.0]]))


def test_a_small_picture_is_spread_by_its_nearest_pixels():
    small = np.arange(6.0).reshape(2, 3)
    assert (small_render.upscale_nearest(small, (6, 4)) == small.repeat(2, 0).repeat(2, 1)).all()
    assert (small_render.upscale_nearest(small, (4, 3))[0] == [0, 0, 1, 2]).all()
    assert (small_render.upscale_nearest(small, (4, 3))[:, 0] == [0, 0, 3]).all()


@pytest.mark.parametrize(
    ("given", "place"),
    [
        ({"camera_height_m": math.nan}, r"nan at \$.camera_height_m"),
        ({"structures": {"a": [1, {"b": math.inf}]}}, r"inf at \$.structures.a\[1\].b"),
        ({"structures": {"a": "flor"}}, "one of ceiling, .*nearest: floor"),
        ({"camera_height_m": 0}, "number from 0.01 to 1000 .metres"),
        ({"camera_hight_m": 1}, "no argument 'camera_hight_m'.*nearest: camera_height_m"),
    ],
)
def test_arguments_are_numbers_and_of_their_kind(given, place):
    with pytest.raises(UsageError, match=f"arguments cannot be used.*{place}"):
        decode_arguments(InitializeArguments, given)
    none = {"structures": None, "camera_height_m": 2}
    assert decode_arguments(InitializeArguments, none).camera_height_m == 2


PHOTO = SimpleNamespace(sha256="a" * 64, width=640, height=480)
CAMERA = ProviderCamera(
    schema_version=1, source="vggt 1b", photo_sha256="a" * 64, width=320, height=240, fx=200.0,
    fy=200.0, cx=160.0, cy=120.0,
)  # fmt: skip
TURNED = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({}, None),
        ({"world_from_cam_rotation": TURNED}, None),
        ({"photo_sha256": "b" * 64}, "photo_sha256 bbbbbbbbbbbb..."),
        ({"width": 321, "cx": 160.5}, None),
        ({"height": 242, "cy": 121.0}, "320x242"),
        ({"height": 238, "cy": 119.0}, "320x238"),
        ({"fx": 203.9}, None),
        ({"fx": 204.1}, "fx / fy 1.020, principal point 0.000 off the middle"),
        ({"fx": 195.9}, "fx / fy 0.980, principal point 0.000 off the middle"),
        ({"cx": 166.3}, None),
        ({"cx": 166.5}, "fx / fy 1.000, principal point 0.020 off the middle"),
        ({"cy": 115.0}, "fx / fy 1.000, principal point 0.021 off the middle"),
        ({"world_from_cam_rotation": ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))},
         "world_from_cam_rotation"),
        ({"world_from_cam_rotation": ((1.002, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))},
         "world_from_cam_rotation"),
    ],
)  # fmt: skip
def test_a_provider_s_camera_is_of_the_photo_and_square(tmp_path, change, said):
    camera = replace(CAMERA, **change)
    problem = camera_problem(camera, PHOTO)
    assert (problem and problem.found) == said
    (tmp_path / "camera.json").write_text(canonical(camera))
    if said is None:
        assert read_camera(tmp_path / "camera.json", PHOTO) == camera
        return
    with pytest.raises(EvidenceInvalidError, match=r"camera of camera\.json cannot be used"):
        read_camera(tmp_path / "camera.json", PHOTO)


def test_what_a_camera_does_not_say_is_told():
    photo = np.zeros((48, 64, 3), np.uint8)
    whole = camera_evidence(photo, None, replace(CAMERA, world_from_cam_rotation=TURNED))
    assert whole.hfov_deg == pytest.approx(math.degrees(2 * math.atan(160 / 200)))
    assert (whole.hfov_source, whole.rotation_source, whole.unknown) == (
        "vggt 1b", "vggt 1b", None,
    )  # fmt: skip
    assert whole.world_from_cam_rotation == TURNED
    part = camera_evidence(photo, 20.0, CAMERA)
    assert part.hfov_deg == whole.hfov_deg
    assert (part.hfov_source, part.rotation_source) == ("vggt 1b", None)
    assert part.unknown
    given = camera_evidence(photo, 50.0, None)
    assert (given.hfov_deg, given.hfov_source, given.rotation_source) == (50.0, "given", None)
    none = camera_evidence(photo, None, None)
    assert (none.hfov_deg, none.hfov_source) == (None, None)
    assert none.unknown == "the field of view is not known"


@pytest.mark.parametrize(
    ("size", "shown"),
    [((640, 480), (640, 480)), ((1600, 800), (800, 400)), ((500, 3000), (133, 800)),
     ((20000, 1), (800, 1)), ((1, 20000), (1, 800))],
)  # fmt: skip
def test_a_review_is_at_most_800_pixels_long_and_at_least_one_wide(size, shown):
    case = SimpleNamespace(evidence=SimpleNamespace(size_wh=size))
    assert _review_size(case, None) == shown


@pytest.mark.parametrize(
    ("evidence", "photo", "without", "known"),
    [
        ("e", "p", (), "evidence e of p"), ("e", None, (), "evidence e of None"),
        (None, "p", (), "photo p"), (None, None, (), None), ("e", "p", ("evidence",), None),
        (None, "p", ("evidence",), None),
    ],
)  # fmt: skip
def test_what_a_server_knows_of_its_photo(evidence, photo, without, known, tmp_path, monkeypatch):
    served = []
    stubs = {
        "require_server": lambda: None, "read_evidence": lambda e, p: f"evidence {e} of {p}",
        "photo_alone": lambda p: f"photo {p}", "BlenderProcess": lambda _: nullcontext("reader"),
        "BlenderConnection": lambda address: f"to {address}", "parsed_address": lambda text: text,
        "LiveBlender": lambda *words: words,
    }  # fmt: skip
    for name, stub in stubs.items():
        monkeypatch.setattr(serve_module, name, stub)
    monkeypatch.setattr(Case, "serve", lambda case: served.append(case))
    monkeypatch.setattr(
        "legoworld.plugin.server.plugin_server",
        lambda *known: served.extend(known) or "the server",
    )
    monkeypatch.setattr("legoworld.plugin.server.run_on_stdio", served.append)
    serve_module.serve_plugin(
        address="h:9", photo=photo, evidence=evidence, ledger=tmp_path / "case", without=without,
        require_transaction=True,
    )  # fmt: skip
    case, again, given, modules, how = served
    assert case is again
    assert (given, how) == (known, "the server")
    assert case.live == ("to h:9", "reader", tmp_path / "case" / "states")
    assert ("evidence" in modules) is not bool(without)
