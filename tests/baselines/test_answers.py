"""Whatever a baseline writes down, each image gets one row that every file of a run can hold."""

from __future__ import annotations

import dataclasses
import io
import json
import queue
from collections import deque
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from baselines.tracks import FAKE, NAMES_OF_TWO, make_photos, make_track
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from legoworld.baselines import baseline_run, child, conversation
from legoworld.baselines.answers import MOST_LEVELS, Unreadable, read_line
from legoworld.baselines.baseline_run import summarise
from legoworld.baselines.cards import chosen_options, load_baseline
from legoworld.baselines.child import BaselineFailedError
from legoworld.baselines.confinement import confine_baseline
from legoworld.baselines.conversation import BaselineRefusedError, Conversation
from legoworld.baselines.request import BaselineRequest, build_configuration
from legoworld.files import canonical_json, readable_json
from legoworld.readouts.family import protocol
from legoworld.records.base import as_json, canonical, readable
from legoworld.records.baseline_messages import Message
from legoworld.tracks.track import load_track

HELLO = '{"provenance": {}, "environment": {}}\n'
DONE = '{"done": true}\n'


def line(**message: Any) -> str:
    return json.dumps(message) + "\n"


def nested_lists(levels: int) -> str:
    return "[" * levels + "]" * levels


@pytest.fixture(scope="module")
def request_of(tmp_path_factory: pytest.TempPathFactory):
    """A request of a task about two photos."""
    folder = tmp_path_factory.mktemp("answers")
    photos = make_photos(folder / "photos", NAMES_OF_TWO)
    track = load_track(make_track(folder / "track.json", NAMES_OF_TWO))

    def made(task: str) -> BaselineRequest:
        card = load_baseline(str(FAKE))
        return BaselineRequest(
            card=card,
            protocol=protocol(task, track.vocabulary),
            track=track,
            photos=photos,
            weights="weights.bin",
            run=folder / "run",
            python=Path("python"),
            device="cpu",
            dtype="float32",
            batch_size=1,
            options=chosen_options(card, []),
            labels={},
            prompts=None,
            offline=True,
            overwrite=False,
            limit=None,
            image_ids=(),
            load_time_limit_s=None,
            time_limit_s=None,
            confinement=confine_baseline(card, "weights.bin", "limits", offline=True),
        )

    return made


class Scripted:
    """A process that says these lines and ends."""

    lines: tuple[str, ...] = ()

    def __init__(self, *_given: Any, **_named: Any) -> None:
        self.left = [m for m in map(read_line, self.lines) if m is not None]

    def __enter__(self) -> Scripted:
        return self

    def __exit__(self, *_how: object) -> None:
        pass

    def begin(self) -> None:
        pass

    def take(self, _name: str) -> bool:
        return False

    def next_message(self, _deadline: float | None) -> Any:
        return self.left.pop(0) if self.left else None

    def how_it_ended(self) -> str:
        return "exit code 0"


def records_of(
    request: BaselineRequest, *lines: str, notices: list[str] | None = None
) -> dict[int, dict[str, Any]]:
    """The row of each image after these lines, as the files of the run hold it."""
    images = list(request.track.images)
    photos = {i.id: request.photos / i.file_name for i in images}
    began: list[dict[str, Any]] = []
    notices = [] if notices is None else notices
    script = type("Script", (Scripted,), {"lines": lines})
    before = conversation.BaselineProcess
    conversation.BaselineProcess = script  # type: ignore[misc]
    try:
        talk = Conversation(
            request, photos, dict.fromkeys(photos, 0), began.append, str, notices.append
        )
        records = list(talk.records(images, images))
    finally:
        conversation.BaselineProcess = before  # type: ignore[misc]
    for record in records:
        canonical(record).encode("utf-8")
    for provenance in began:
        readable_json({"configuration": provenance}).encode("utf-8")
    rows = [*{record.row.image_id: record.row for record in records}.values()]
    summary = summarise(build_configuration(request, images), rows)
    readable(summary).encode("utf-8")
    assert sorted(row.image_id for row in rows) == [1, 2]
    return {row.image_id: as_json(row) for row in rows}


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        ('{"image_id": 1, "predictions": [{"score": NaN}]}\n', "NaN, infinity"),
        ('{"image_id": 1, "predictions": [], "counts": {"n": 1e999}}\n', "number out of range"),
        (line(image_id=1, failed="\ud800"), "half of a surrogate pair"),
        (line(image_id=1, predictions=[], counts={"\udfff": 1}), "half of a surrogate pair"),
        (f'{{"image_id": 1, "predictions": {nested_lists(200)}}}\n', "nested beyond 32 levels"),
        (f'{{"image_id": 1, "predictions": [{10**30}]}}\n', "more than 64 bits"),
        (f'{{"image_id": 1, "predictions": [{"9" * 5000}]}}\n', "more than 64 bits"),
        (f'{{"image_id": {"9" * 5000}, "predictions": []}}\n', "more than 64 bits"),
        (f'{{"image_id": 1, "predictions": [-{"9" * 5000}.5]}}\n', "number out of range"),
        (f'{{"image_id": 1, "predictions": {nested_lists(100_000)}}}\n', "nested too deeply"),
        (line(image_id=1, predictions=[], counts=["a"]), "got array at $.counts"),
        (
            line(image_id=1, predictions=[], counts={"a": "b"}),
            "got str at $.counts[...]",
        ),
        (line(image_id=1, predictions={"a": 1}), "got object at $.predictions"),
        (line(image_id=1, predictions=[3]), "expected object, got int at $.predictions[0]"),
        (line(image_id=1), "no predictions"),
    ],
)
def test_an_unusable_answer_is_one_row(request_of, bad, words):
    good = line(image_id=2, predictions=[])
    found = records_of(request_of("coco"), HELLO, line(working_on=[1]), bad, good, DONE)
    assert (found[1]["status"], found[1]["code"]) == ("failed", "baseline_answer")
    assert words in found[1]["reason"]
    assert len(found[1]["reason"].splitlines()) == 1
    assert found[2]["status"] == "ok"


def test_a_line_that_is_too_long_is_an_answer_where_it_begins_as_one(monkeypatch):
    monkeypatch.setattr(child, "_LONGEST_LINE", 1 << 10)
    process = child.BaselineProcess.__new__(child.BaselineProcess)
    log: list[str] = []
    said = io.BytesIO(b"x" * (1 << 10) + b"\n{" + b"1" * (1 << 10) + b"}\n")
    vars(process).update(
        _pipes=SimpleNamespace(stdout=said), _messages=queue.Queue(), _closing=False,
        _log=log.append,
    )  # fmt: skip
    process._read_messages()
    message, end = process._messages.get_nowait(), process._messages.get_nowait()
    assert isinstance(message, Unreadable)
    assert message.reason.startswith("a line of more than ")
    assert end is None
    assert log == ["x" * (1 << 10), "1}"]


def test_a_log_line_of_any_length_is_passed_on_in_pieces_of_64_ki():
    process = child.BaselineProcess.__new__(child.BaselineProcess)
    log: list[str] = []
    words = "é" * 200_000
    vars(process).update(
        _pipes=SimpleNamespace(stderr=io.BytesIO(f"{words}\n\nlast\n".encode())),
        _tail=deque(), _log=log.append,
    )  # fmt: skip
    process._read_log()
    assert "".join(log) == words + "last"
    assert [len(piece) for piece in log] == [65536, 65536, 65536, 3392, 4]
    assert process.last_words() == "last"


def test_two_answers_for_an_image_are_none(request_of):
    """Whatever the second is, nothing tells which is right: the row names the image."""
    good = [line(image_id=i, predictions=[]) for i in (1, 2)]
    for second in (good[0], line(image_id=1, failed="no"), line(image_id=1, predictions=3)):
        found = records_of(request_of("coco"), HELLO, *good, second, DONE)
        assert (found[1]["status"], found[1]["code"]) == ("failed", "baseline_answer")
        assert "two answers of image 1, 001.jpg" in found[1]["reason"]
        assert "neither answer is kept" in found[1]["reason"]
        assert found[2]["status"] == "ok"


def test_an_answer_that_was_not_asked_for_ends_the_run(request_of):
    for stranger in (line(image_id=3, predictions=[]), line(image_id=3, predictions=3)):
        with pytest.raises(BaselineFailedError) as error:
            records_of(request_of("coco"), HELLO, line(image_id=1, predictions=[]), stranger)
        assert "answered for image 3" in str(error.value)
        assert "one of 2 images, such as 1" in str(error.value)


@pytest.mark.parametrize(
    "strange",
    [line(working_on=3), line(working_on=[[1], None, True, "1"]), line(image_id=[1]), "{}\n"],
)
def test_a_strange_line_costs_no_image(request_of, strange):
    answers = [line(image_id=i, predictions=[]) for i in (1, 2)]
    found = records_of(request_of("coco"), HELLO, strange, *answers, DONE)
    assert [found[i]["status"] for i in (1, 2)] == ["ok", "ok"]


@pytest.mark.parametrize(
    ("first", "words"),
    [
        ('{"provenance": {"seed": NaN}}\n', "first line .* cannot be used.*NaN, infinity"),
        (f'{{"provenance": {nested_lists(100_000)}}}\n', "first line .* nested too deeply"),
        (line(provenance={"model": "\ud800"}), "first line .* half of a surrogate pair"),
        (
            line(provenance=[]),
            r"first line .* got array at \$\.provenance",
        ),
        (line(provenance={}, environment=[]), r"first line .* got array at \$\.environment"),
        (line(refused="no"), r"first line .* got str at \$\.refused"),
        (line(image_id=1), "does not report what it runs"),
    ],
)
def test_an_unusable_beginning_is_the_runs_error(request_of, first, words):
    with pytest.raises(BaselineFailedError, match=words):
        records_of(request_of("coco"), first)


def test_a_photo_that_goes_away_is_that_images_row(request_of, tmp_path):
    own = dataclasses.replace(request_of("coco"), photos=make_photos(tmp_path, NAMES_OF_TWO))
    (tmp_path / NAMES_OF_TWO[0]).unlink()
    answers = [line(image_id=i, predictions=[]) for i in (1, 2)]
    found = records_of(own, HELLO, *answers, DONE)
    assert (found[1]["status"], found[1]["code"]) == ("missing", "missing_photo")
    assert found[2]["status"] == "ok"


def test_a_gpu_that_is_there_and_unused_is_named(request_of):
    hello = line(provenance={}, environment={"gpu": "Some GPU"})
    answers = [line(image_id=i, predictions=[]) for i in (1, 2)]
    for device, expected in (("cpu", 1), ("cuda", 0)):
        notices: list[str] = []
        request = dataclasses.replace(request_of("coco"), device=device)
        records_of(request, hello, *answers, DONE, notices=notices)
        assert len([n for n in notices if "Some GPU" in n and "--device auto" in n]) == expected


NUMBERS = (
    st.integers()
    | st.floats()
    | st.sampled_from([1, 2, 17, 18, 0.5, 2**63 - 1, -(2**63), 1e308, -1e308, 10**400])
)
TEXTS = st.text(st.characters(), max_size=4) | st.sampled_from(["\ud800", "depth", "1", "\x1b]0;"])
KEYS = TEXTS | st.sampled_from(
    ["image_id", "category_id", "bbox", "score", "segmentation", "size", "counts", "predictions"]
)
VALUES = st.recursive(
    st.none() | st.booleans() | NUMBERS | TEXTS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(KEYS, inner, max_size=4),
    max_leaves=12,
)
MASKS = st.fixed_dictionaries(
    {
        "size": st.just([48, 64]) | VALUES,
        "counts": st.lists(NUMBERS, max_size=4) | st.text(max_size=6) | VALUES,
    }
)
ENTRIES = st.fixed_dictionaries(
    {
        "image_id": st.sampled_from([1, 2]) | VALUES,
        "category_id": st.sampled_from([17, 18]) | VALUES,
        "score": NUMBERS | VALUES,
        "bbox": st.lists(NUMBERS, min_size=4, max_size=4) | VALUES,
        "segmentation": MASKS | VALUES,
    }
)
ANSWERS = st.fixed_dictionaries(
    {"image_id": st.sampled_from([1, 2]) | VALUES},
    optional={
        "predictions": st.lists(ENTRIES, max_size=3) | VALUES,
        "counts": VALUES,
        "failed": VALUES,
        "depth": VALUES,
        "working_on": VALUES,
        "provenance": VALUES,
    },
)
FIRST = st.fixed_dictionaries({}, optional=dict.fromkeys(("provenance", "refused", "x"), VALUES))
LINES = st.lists((ANSWERS | VALUES).map(lambda v: json.dumps(v) + "\n"), max_size=6)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(task=st.sampled_from(["coco", "lvis", "eth3d"]), lines=LINES)
@example(task="coco", lines=[line(image_id=True, predictions=[])])
@example(task="lvis", lines=[line(working_on=[1, 2]), f'{{"a": {nested_lists(5000)}}}\n'])
def test_any_answers_end_in_rows(request_of, task, lines):
    """Or in an error about an image that was not asked for."""
    try:
        records_of(request_of(task), HELLO, *lines, DONE)
    except BaselineFailedError as error:
        assert "that it was not asked for" in str(error)  # noqa: PT017


@settings(max_examples=100, deadline=None)
@given(first=FIRST.map(lambda v: json.dumps(v) + "\n"))
def test_any_beginning_is_one_line_or_a_run(request_of, first):
    said = ""
    try:
        records_of(request_of("coco"), first, DONE)
    except (BaselineFailedError, BaselineRefusedError) as error:
        said = str(error)
    assert len(said.encode("utf-8").splitlines()) <= 1


@settings(max_examples=200, deadline=None)
@given(VALUES)
def test_a_message_is_what_every_file_can_hold(value):
    found = read_line(line(provenance={"a": value}))
    if isinstance(found, Message):
        again = canonical_json({"row": {"counts": [found.provenance]}}).encode("utf-8")
        assert json.loads(again)["row"]["counts"][0] == found.provenance
    else:
        assert isinstance(found, Unreadable)


def test_nesting_is_bounded_where_it_says():
    def levels(n: int) -> str:  # the object is the first level
        return '{"a": ' + nested_lists(n - 1) + "}\n"

    assert isinstance(read_line(levels(MOST_LEVELS)), Message)
    assert isinstance(read_line(levels(MOST_LEVELS + 1)), Unreadable)


def test_a_baseline_is_told_to_begin_in_the_words_of_its_protocol(monkeypatch):
    """Its second line; a program of others may look at what it says."""
    sent = []
    process = object.__new__(child.BaselineProcess)
    monkeypatch.setattr(child.BaselineProcess, "_send", lambda _self, message: sent.append(message))
    process.begin()
    assert sent == [{"begin": True}]


def test_each_new_row_is_told_once_and_kept_ones_are_not(tmp_path, monkeypatch):
    monkeypatch.setattr(baseline_run, "journal", lambda folder: nullcontext(folder))
    monkeypatch.setattr(baseline_run, "append", lambda stream, record: (stream, record))
    made = [SimpleNamespace(row=SimpleNamespace(image_id=n)) for n in (5, 2)]
    told: list[Any] = []
    request: Any = SimpleNamespace(run=tmp_path)
    found = baseline_run._write_journal(request, {1: "kept"}, iter(made), told.append)  # type: ignore[dict-item]
    assert found == {1: (tmp_path, "kept"), 5: (tmp_path, made[0]), 2: (tmp_path, made[1])}
    assert told == [made[0].row, made[1].row]


@pytest.mark.parametrize(
    ("code", "said"),
    [(0, "exit code 0"), (None, "exit code 0"), (3, "exit code 3"), (-9, "signal SIGKILL"),
     (-1, "signal SIGHUP")],
)  # fmt: skip
def test_how_a_baseline_ended_is_said(code, said, monkeypatch):
    process = object.__new__(child.BaselineProcess)
    process._sandbox = SimpleNamespace(poll_exit=lambda **_: code)
    monkeypatch.setattr(child.BaselineProcess, "close", lambda _self: None)
    monkeypatch.setattr(child.BaselineProcess, "last_words", lambda _self: "its last line")
    assert process.how_it_ended() == f"{said}; its last line"


@pytest.mark.parametrize("bubblewrap", [None, "0.9"])
@pytest.mark.parametrize("network", [False, True])
@pytest.mark.parametrize("offline", [False, True])
def test_a_baseline_without_a_network_is_told_so(bubblewrap, network, offline, monkeypatch):
    monkeypatch.setattr(child, "child_environment", lambda *_, **how: {"HOME": str(how["home"])})
    sandbox = SimpleNamespace(path_inside=lambda name: f"/in/{name}", temporary="/in/tmp")
    held = SimpleNamespace(bubblewrap=bubblewrap, network=network)
    card: Any = SimpleNamespace(shared_path="/shared")
    request: Any = SimpleNamespace(offline=offline)
    found = child._environment(card, sandbox, SimpleNamespace(protections=held), [], request)  # type: ignore[arg-type]
    without = offline or (bubblewrap is not None and not network)
    assert (found.get("HF_HUB_OFFLINE"), found.get("TRANSFORMERS_OFFLINE")) == (
        ("1", "1") if without else (None, None)
    )
    assert (found["PYTHONPATH"], found["PYTHONHASHSEED"], found["HOME"]) == (
        "/shared", "0", "/in/home",
    )  # fmt: skip
    own = {"TRITON_CACHE_DIR": "/in/home/triton", "CUDA_CACHE_PATH": "/in/home/cuda",
           "USER": "baseline"}  # fmt: skip
    assert {name: found.get(name) for name in own} == (own if bubblewrap else dict.fromkeys(own))


@pytest.mark.parametrize("terminal", [False, True])
def test_a_baseline_draws_its_progress_on_a_terminal_alone(terminal, monkeypatch):
    given = {"TOKENIZERS_PARALLELISM": "true"}
    monkeypatch.setattr(child, "child_environment", lambda *_, **__: {**given})
    monkeypatch.setattr("sys.stderr.isatty", lambda: terminal, raising=False)
    sandbox: Any = SimpleNamespace(path_inside=lambda name: f"/in/{name}", temporary="/in/tmp")
    held = SimpleNamespace(bubblewrap=None, network=True)
    card: Any = SimpleNamespace(shared_path="/shared")
    request: Any = SimpleNamespace(offline=False)
    found = child._environment(card, sandbox, SimpleNamespace(protections=held), [], request)  # type: ignore[arg-type]
    progress = {} if terminal else {"HF_HUB_DISABLE_PROGRESS_BARS": "1"}
    assert found == {
        "PYTHONPATH": "/shared", "PYTHONHASHSEED": "0", "PYTHONDONTWRITEBYTECODE": "1",
        "PYTHONUNBUFFERED": "1", "CUBLAS_WORKSPACE_CONFIG": ":4096:8", **given, **progress,
    }  # fmt: skip
