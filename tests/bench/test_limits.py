"""Limits of the scoring service at their very edge, and the figures that it tells."""

from __future__ import annotations

import asyncio
import errno
import io
import itertools
import json
import tarfile
import tomllib
import zipfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from starlette.requests import Request

from legoworld.bench import archive, http_app, http_server, score_worker
from legoworld.bench.admission import Counts, HttpOptions
from legoworld.bench.archive import ArchiveError, UnpackLimits, unpack
from legoworld.bench.harbor import HarborOptions, instruction
from legoworld.bench.harbor import _task_toml as task_toml
from legoworld.bench.hidden import hidden_things
from legoworld.bench.procedural import PACKS, DrawRequest, draw_scenes
from legoworld.bench.reward import bench_reward
from legoworld.errors import NotAssessedError, UsageError
from legoworld.records.base import UNSET
from legoworld.records.bench_dataset import BenchImage
from legoworld.records.bench_results import ServeRequest


def pack_files(kind: str, files: dict[str, bytes]) -> bytes:
    stream = io.BytesIO()
    if kind == "zip":
        with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as made:
            for name, data in files.items():
                made.writestr(name, data)
    else:
        with tarfile.open(fileobj=stream, mode="w") as made:
            for name, data in files.items():
                info = tarfile.TarInfo(name)
                info.type = tarfile.DIRTYPE if name.endswith("/") else tarfile.REGTYPE
                info.size = len(data)
                made.addfile(info, io.BytesIO(data))
    return stream.getvalue()


def unpack_upload(folder: Path, data: bytes, **limits: Any) -> Path:
    (folder / "upload").write_bytes(data)
    return unpack(folder / "upload", "den", UnpackLimits(**{"unpacked_bytes": 100} | limits))[0]


@pytest.mark.parametrize("kind", ["zip", "tar"])
@pytest.mark.parametrize(
    ("limits", "files", "over", "said"),
    [
        ({}, {"a": bytes(60), "b": bytes(40)}, {"a": bytes(60), "b": bytes(41)}, "at most 100"),
        ({"files": 2}, {"d/": b"", "d/a": b"x"}, {"d/": b"", "e/": b"", "d/a": b"x"}, "at most 2"),
        ({}, {"y" * 200: b"x"}, {"y" * 201: b"x"}, "at most 8 parts of 200 bytes"),
        ({}, {"x/" * 7 + "y": b"x"}, {"x/" * 8 + "y": b"x"}, "at most 8 parts of 200 bytes"),
        ({}, {"ä" * 100: b"x"}, {"ä" * 101: b"x"}, "at most 8 parts of 200 bytes"),
    ],
)
def test_an_archive_at_its_limits_is_unpacked_and_one_beyond_is_not(
    kind, limits, files, over, said, tmp_path
):
    place = unpack_upload(tmp_path, pack_files(kind, files), **limits)
    assert sum(p.stat().st_size for p in place.rglob("*") if p.is_file()) == sum(
        map(len, files.values())
    )
    with pytest.raises(ArchiveError) as refused:
        unpack_upload(tmp_path, pack_files(kind, over), **limits)
    assert refused.value.expected == said


@pytest.mark.parametrize("kind", ["zip", "tar"])
def test_a_file_that_claims_too_much_is_refused_before_it_is_written(kind, tmp_path):
    with pytest.raises(ArchiveError, match="more bytes unpacked"):
        unpack_upload(tmp_path, pack_files(kind, {"small": bytes(50), "large": bytes(51)}))
    assert [p.name for p in tmp_path.glob("unpacked-*/**/*") if p.is_file()] == ["small"]


def test_two_folders_are_the_scene_s_own(tmp_path):
    place = unpack_upload(tmp_path, pack_files("tar", {"a/one": b"1", "b/two": b"2"}))
    assert sorted(p.name for p in place.iterdir()) == ["a", "b"]
    lone = unpack_upload(tmp_path, pack_files("tar", {"one": b"1"}))
    assert [p.name for p in lone.iterdir()] == ["one"], "a file is no folder around the files"


@pytest.mark.parametrize(("late", "refused"), [(0.0, False), (1e-6, True)])
def test_unpacking_has_its_whole_time(late, refused, tmp_path, monkeypatch):
    clock = itertools.chain([50.0], itertools.repeat(50.0 + 7.5 + late))
    monkeypatch.setattr(archive.time, "monotonic", lambda: next(clock))
    data = pack_files("zip", {"a": b"x"})
    if not refused:
        assert unpack_upload(tmp_path, data, time_s=7.5).is_dir()
        return
    with pytest.raises(ArchiveError, match=r"at most 7\.5 s to unpack"):
        unpack_upload(tmp_path, data, time_s=7.5)


@pytest.mark.parametrize(
    ("number", "raised"), [(errno.ENOSPC, OSError), (errno.EINVAL, ArchiveError)]
)
def test_a_full_disk_is_not_the_archive_s_fault(number, raised, tmp_path, monkeypatch):
    def full(_stream: Any) -> Any:
        raise OSError(number, "said by the system")

    monkeypatch.setattr(archive, "_zip_members", full)
    with pytest.raises(raised, match="said by the system"):
        unpack_upload(tmp_path, pack_files("zip", {"a": b"x"}))


@pytest.mark.parametrize("size", [0, 1])
def test_a_header_may_be_as_long_as_a_read(size, tmp_path):
    most = archive._LONGEST_READ
    (tmp_path / "file").write_bytes(bytes(most + size))
    with archive._ShortReads(tmp_path / "file") as stream:
        assert len(stream.read(most)) == most
        stream.seek(0)
        if size == 0:
            assert len(stream.read()) == len(stream.read(-1)) + most == most
            return
        for asked in (None, -1, most + 1):
            with pytest.raises(ArchiveError, match=f"a header of {most + 1} bytes"):
                stream.read(asked)
        stream.seek(1)
        assert len(stream.read(most + 1)) == most, "no more than is left is asked for"


def test_what_was_answered_is_counted_for_prometheus():
    counts = Counts()
    assert counts.mean_s == 1.0
    for status, seconds in [("ok", 0.05), ("ok", 0.25), ("refused", 90.0)]:
        counts.answer(status, seconds)
    counts.refusals[429] += 2
    assert counts.mean_s == pytest.approx(30.1)
    text = counts.text([("queue_taken", 3), ("workers_lost_total", 1)])
    buckets = [line.split() for line in text.splitlines() if "bucket" in line]
    assert [(name.split('"')[1], int(n)) for name, n in buckets] == [
        ("0.05", 1), ("0.1", 1), ("0.25", 2), ("0.5", 2), ("1.0", 2), ("2.5", 2), ("5.0", 2),
        ("10.0", 2), ("30.0", 2), ("60.0", 2), ("+Inf", 3),
    ]  # fmt: skip
    assert [line for line in text.splitlines() if "bucket" not in line] == [
        "# TYPE legoworld_answers_total counter",
        'legoworld_answers_total{status="ok"} 2',
        'legoworld_answers_total{status="refused"} 1',
        "# TYPE legoworld_refusals_total counter",
        'legoworld_refusals_total{code="429"} 2',
        "# TYPE legoworld_answer_seconds histogram",
        f"legoworld_answer_seconds_sum {counts.seconds}",
        "legoworld_answer_seconds_count 3",
        "# TYPE legoworld_queue_taken gauge",
        "legoworld_queue_taken 3",
        "# TYPE legoworld_workers_lost_total counter",
        "legoworld_workers_lost_total 1",
    ]
    assert text.endswith("\n")


def app(tmp_path: Path, *, workers: int = 2, **options: Any) -> http_app.ScoreApp:
    server: Any = SimpleNamespace(scratch=tmp_path, workers=workers, n_lost=4)
    http = HttpOptions(token="0123456789abcdef", **options)
    return http_app.ScoreApp(server, SimpleNamespace(), http, print)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("mean_s", "places", "wait_s"),
    [(0.2, 0, 1), (7.3, 0, 8), (8.0, 0, 8), (300.0, 0, 60), (0.2, 100, 3), (0.2, 80, 2)],
)
def test_a_refused_client_waits_for_an_answer_or_a_share_of_the_queue(
    mean_s, places, wait_s, tmp_path
):
    made = app(tmp_path, queue=200)
    made._counts.answer("ok", mean_s)
    made._admission.take(places)
    assert (made._full().status, made._full().retry_s) == (429, wait_s)


def request(headers: dict[str, str], *messages: dict[str, Any]) -> Request:
    left = iter(messages)

    async def receive() -> dict[str, Any]:
        return next(left)

    pairs = [(name.encode(), value.encode()) for name, value in headers.items()]
    return Request({"type": "http", "headers": pairs, "method": "POST"}, receive)


def part(more: bool) -> dict[str, Any]:
    return {"type": "http.request", "body": b"x", "more_body": more}


GONE = {"type": "http.disconnect"}


@pytest.mark.parametrize(
    ("headers", "messages", "whole"),
    [
        ({}, [], True),
        ({"transfer-encoding": "chunked"}, [], False),
        ({"content-length": "9"}, [part(True), part(False)], True),
        ({"content-length": "10"}, [part(False)], True),
        ({"content-length": "11"}, [], False),
        ({"content-length": "9"}, [part(True), GONE], False),
        ({"content-length": "9"}, [{"type": "http.request"}], True),
    ],
)
def test_a_refused_request_is_read_to_its_end_where_that_is_near(headers, messages, whole):
    assert asyncio.run(http_app._read_on(request(headers, *messages), 10, 60.0)) is whole


def test_a_request_that_was_received_has_nothing_left_to_read():
    taken = request({"content-length": "9"})
    taken.state.received = True
    assert asyncio.run(http_app._read_on(taken, 10, 60.0)) is True


@pytest.mark.parametrize(
    ("refused", "close", "headers"),
    [
        (http_app.RefusedRequestError(429, "full", retry_s=0), False, {"retry-after": "0"}),
        (http_app.RefusedRequestError(401, "who"), False, {"www-authenticate": "Bearer"}),
        (http_app.RefusedRequestError(413, "long"), True, {"connection": "close"}),
    ],
)
def test_a_refusal_says_what_to_do_in_its_headers(refused, close, headers):
    response = http_app._refusal(refused, close=close)
    assert response.status_code == refused.status
    assert json.loads(bytes(response.body)) == {"status": "refused", "reason": refused.reason}
    named = ("retry-after", "www-authenticate", "connection")
    assert {name: response.headers[name] for name in named if name in response.headers} == headers


def test_the_gauges_are_those_of_the_server(tmp_path):
    made = app(tmp_path, queue=9, body_bytes=100)
    made._admission.take(spool_bytes=70)
    made._admission.take()
    text = bytes(asyncio.run(made._metrics(request({}))).body).decode()
    assert {line for line in text.splitlines() if line.startswith(("legoworld_q", "legoworld_s",
            "legoworld_w"))} == {"legoworld_queue_places 9", "legoworld_queue_taken 2",
            "legoworld_spool_bytes 70", "legoworld_workers 2",
            "legoworld_workers_lost_total 4"}  # fmt: skip


def test_a_body_as_long_as_the_limit_is_taken(tmp_path):
    made = app(tmp_path)
    assert made._length(request({}), 7) == made._length(request({"content-length": "7"}), 7) == 7
    with pytest.raises(http_app.RefusedRequestError, match="a body of 8 bytes; the most is 7"):
        made._length(request({"content-length": "8"}), 7)
    for most in (2, 1):
        chunks: list[bytes] = []
        sent = request({}, part(True), part(False))
        if most == 2:
            asyncio.run(made._receive(sent, most, chunks.append))
            assert (b"".join(chunks), sent.state.received) == (b"xx", True)
            continue
        with pytest.raises(http_app.RefusedRequestError, match="more than 1 bytes") as caught:
            asyncio.run(made._receive(sent, most, chunks.append))
        assert caught.value.status == 413


def case(file_name: str, view: int, *scored: str) -> Any:
    truth = SimpleNamespace(scored=[SimpleNamespace(name=name) for name in scored])
    return SimpleNamespace(file_name=file_name, view=view, truth=truth)


def test_a_tier_hides_what_any_earlier_one_of_its_view_scores():
    cases = [
        case("easy0", 0, "b", "a", "c"), case("easy1", 1, "d"), case("medium0", 0, "a"),
        case("medium1", 1, "d", "e"), case("hard0", 0, "a", "f"), case("hard1", 1, "e"),
    ]  # fmt: skip
    assert hidden_things(cases) == {
        "medium0": ("b", "c"), "hard0": ("b", "c"), "hard1": ("d",),
    }  # fmt: skip


IMAGE = BenchImage(
    id=3, file_name="den__easy__view_00.png", width=640, height=360, hfov_deg=49.125,
    family="den", environment="indoor", theme=None, split="test", tier="easy", view=0,
)  # fmt: skip


def test_a_task_for_harbor_has_the_machine_that_was_asked_for():

    options = HarborOptions(
        agent_timeout_s=12.5, verifier_timeout_s=7, cpus=3, memory_mb=500, prebuilt=None
    )
    found = tomllib.loads(task_toml(IMAGE, options))
    machine = {"cpus": 3, "memory_mb": 500}
    (server,) = found["environment"].pop("mcp_servers")
    assert server == {
        "name": "blender", "transport": "stdio", "command": "legoworld",
        "args": ["blender", "mcp", "--workspace", "/workspace"],
    }  # fmt: skip
    assert found["environment"] == found["verifier"].pop("environment") == machine
    assert found["agent"] == {"timeout_sec": 12.5}
    assert found["verifier"] == {"timeout_sec": 7.0, "environment_mode": "separate"}
    assert found["task"]["name"] == "legoworld/den__easy__view_00"
    assert found["task"]["keywords"] == ["den", "easy", "indoor", "test"]
    assert found["metadata"]["benchmark"] == "lego-bench"
    whole = HarborOptions()
    assert (whole.agent_timeout_s, whole.verifier_timeout_s) == (3600, 900)
    assert (whole.cpus, whole.memory_mb) == (2, 8192)


def test_an_agent_is_told_the_picture_s_size_field_and_categories():
    text = instruction(IMAGE, ["cup", "sofa"])
    assert "`image.png` in /workspace is a picture of 640 x 360 pixels" in text
    assert "is 49.125000 degrees" in text
    assert "Things that may be in the picture: cup, sofa.\n" in text


def test_scenes_that_are_there_are_not_drawn_again(tmp_path, monkeypatch):
    for pack in PACKS:
        (tmp_path / "assets" / pack).mkdir(parents=True)
    drawn: list[int] = []
    monkeypatch.setattr(
        "legoworld.bench.procedural._draw", lambda _request, _assets, number: drawn.append(number)
    )
    scenes, told = tmp_path / "scenes", list[str]()
    wanted = DrawRequest(scenes=scenes, seed=7, count=3, assets=tmp_path / "assets", workers=1)
    for name in ("den-7-0001", "half-7-0002"):
        (scenes / name).mkdir(parents=True)
    (scenes / "den-7-0001" / "scene.blend").touch()
    draw_scenes(wanted, told.append)
    assert (drawn, told) == ([0, 2], ["drawing 2 of 3 scenes of seed 7"])
    for name in ("a-7-0000", "half-7-0002"):
        (scenes / name).mkdir(exist_ok=True)
        (scenes / name / "scene.blend").touch()
    draw_scenes(wanted, told.append)
    assert (drawn, len(told)) == ([0, 2], 1), "nothing is drawn and nothing told"
    (scenes / "den-7-0003").mkdir()
    (scenes / "den-7-0003" / "scene.blend").touch()
    with pytest.raises(UsageError, match="found: den-7-0003"):
        draw_scenes(wanted, told.append)


@pytest.mark.parametrize(
    ("count", "raised"), [(2, http_app.ClientDisconnect), (3, http_app.RefusedRequestError)]
)
def test_a_batch_as_long_as_the_queue_is_taken(count, raised, tmp_path):
    made, taken = app(tmp_path, queue=2), list[Any]()

    async def scored(_request: Any, order: Any, place: Any, _begin: float) -> Any:
        taken.append((json.loads(order.line), place.places))
        raise http_app.ClientDisconnect

    made._score_order = scored  # type: ignore[method-assign]
    body = json.dumps({"query": ["a"] * count, "labels": [1] * count}).encode()
    with pytest.raises(raised):
        asyncio.run(made._rewards(request({}, {"type": "http.request", "body": body})))
    assert taken == [({"scene": "a", "image_id": 1}, 1)] * (count if count == 2 else 0)


def test_tokens_are_compared_whole_and_the_scheme_in_any_case(tmp_path):
    made = app(tmp_path)
    token = "0123456789abcdef"
    for given, known in [
        (f"Bearer {token}", True), (f"bEARER   {token} ", True), (f"Basic {token}", False),
        (token, False), (f"Bearer {token[:-1]}", False), ("", False),
    ]:  # fmt: skip
        assert made._knows(request({"authorization": given})) is known


def scored_row(**changes: Any) -> Any:
    known = {
        "status": "ok", "reason": None, "valid": True, "R": 0.5, "A": 0.25, "S": 0.375,
        "objects": (), "validity": None, "flags": (), "warnings": ("w",), "x": UNSET,
    }  # fmt: skip
    return SimpleNamespace(**known | changes)


@pytest.mark.parametrize(
    ("lone", "valid", "v"),
    [(False, True, 1), (False, False, 0), (True, True, None), (True, False, 0)],
)
def test_an_answer_has_the_row_s_scores_and_no_v_of_a_lone_blend(lone, valid, v):
    asked = ServeRequest(id="a", scene="s", image_id=3)
    scene: Any = SimpleNamespace(lone=lone)
    found = score_worker._answer(asked, scene, scored_row(valid=valid))
    assert (v, 0.5, 0.25, 0.375) == (found.V, found.R, found.A, found.S)
    assert (found.id, found.scene, found.image_id, found.warnings) == ("a", "s", 3, ("w",))
    assert score_worker._answer(asked, scene, scored_row(R=None)).R == 0.0


def test_the_parts_that_are_not_asked_for_are_the_last_that_are_offered():
    worker: Any = SimpleNamespace(_options=SimpleNamespace(rules={"R": 1, "RA": 2}))
    for asked, given in ((UNSET, "RA"), ("R", "R")):
        request_: Any = SimpleNamespace(parts=asked)
        assert score_worker.ScoreWorker._parts(worker, request_) == given


def test_a_reward_that_is_there_is_kept_unless_it_is_to_be_replaced(tmp_path):
    kept = tmp_path / "reward.json"
    kept.write_text("mine")
    with pytest.raises(UsageError):
        bench_reward(tmp_path / "none", kept)
    assert kept.read_text() == "mine"
    with pytest.raises(NotAssessedError):
        bench_reward(tmp_path / "none", kept, overwrite=True)
    assert not kept.exists()


def test_headers_are_as_long_as_is_said_and_idle_clients_go(tmp_path):
    config = http_server.http_server(app(tmp_path).asgi(), connections=74).config
    assert config.h11_max_incomplete_event_size == 16 * 1024
    assert (config.timeout_keep_alive, config.limit_concurrency) == (75, 74)
    assert (config.lifespan, config.access_log, config.server_header) == ("off", False, False)
