"""`legoworld bench serve`: lines in, scores out, and nothing is left behind."""

from __future__ import annotations

import io
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tarfile
import urllib.parse
import urllib.request
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from checkout import CHECKOUT
from waiting import PATIENCE_S, until

import legoworld
from legoworld import cli


@pytest.fixture(scope="module")
def dataset(references, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("served")
    options = ["--size", "96x54", "--samples", "2", "--noise-seeds", "0", "-q"]
    place = ["-o", str(folder / "bench"), "--keep-scenes", str(folder / "itself")]
    assert cli.run(["bench", "make", str(references), *place, *options]) == 0
    return folder


def serve(dataset: Path, lines: list[str], *more: str, scratch: Path) -> list[dict]:
    done = subprocess.run(
        [sys.executable, "-m", "legoworld", "bench", "serve", str(dataset / "bench"), "--root", "/",
         *more],
        input="\n".join(lines) + "\n", capture_output=True, text=True, check=True,
        env={**os.environ, "TMPDIR": str(scratch)},
    )  # fmt: skip
    return [json.loads(line, parse_constant=_no_number) for line in done.stdout.splitlines()]


def _no_number(name: str) -> None:
    """JSON has no NaN and no infinity; Python's writer has."""
    raise AssertionError(name)


def test_every_line_has_an_answer(dataset, submissions, tmp_path):
    hard = dataset / "itself" / "den__hard__view_00"
    requests = [
        {"scene": str(hard), "image_id": 3, "id": "itself"},
        {"scene": str(dataset / "itself" / "den__easy__view_00"), "image_id": 3, "id": "less"},
        {"scene": str(submissions / "nan"), "image_id": 1, "id": "nan"},
        {"scene": str(submissions / "damaged"), "image_id": 1, "id": "damaged"},
        {"scene": str(submissions / "flat_picture"), "image_id": 1, "id": "not valid"},
        {"scene": str(tmp_path / "nowhere"), "image_id": 1, "id": "missing"},
        {"scene": str(hard), "image_id": 77, "id": "unknown"},
    ]
    lines = [*map(json.dumps, requests), "no json", "[1]", '{"scene": 3}', ""]
    answers = serve(dataset, lines, "--no-render", "--workers", "2", scratch=tmp_path)
    found = {a["id"]: a for a in answers if a["id"]}
    assert len(answers) == len(requests) + 3
    track = json.loads((dataset / "bench" / "public" / "track.json").read_text("utf-8"))
    assert track["images"][2]["file_name"] == "den__hard__view_00.png"
    assert (found["itself"]["V"], found["itself"]["R"], found["itself"]["A"]) == (1, 1.0, None)
    assert {o["name"] for o in found["itself"]["objects"]} == {"Red", "Green", "Blue"}
    assert 0 < found["less"]["R"] < 1
    for name in ("nan", "damaged", "missing", "not valid"):
        assert (found[name]["V"], found[name]["R"]) == (0, 0.0), name
    for answer in answers:
        if answer["status"] == "refused":
            assert [answer[k] for k in "VRAS"] == [None] * 4
    assert found["not valid"]["validity"]["final_png"]["ok"] is False
    assert all(found[n]["reason"] for n in ("nan", "damaged", "missing", "unknown"))
    assert sum(a["status"] == "refused" for a in answers) == 4
    assert list(tmp_path.iterdir()) == []


def test_a_list_of_submissions_is_scored_in_its_order(dataset, tmp_path):
    itself = dataset / "itself"
    submissions = [(itself / "den__easy__view_00", 3), (tmp_path / "nowhere", 1),
                   (itself / "den__hard__view_00", 3)]  # fmt: skip
    less, missing, whole = legoworld.bench_score(
        dataset / "bench", submissions, render=False, workers=2
    )
    assert 0 < less.R < whole.R == 1.0
    assert (missing.V, missing.R, missing.status) == (0, 0.0, "missing")


def test_ctrl_c_leaves_no_scratch(dataset, tmp_path):
    command = [
        sys.executable,
        "-m",
        "legoworld",
        "bench",
        "serve",
        str(dataset / "bench"),
        "--root",
        "/",
    ]
    request = json.dumps({"scene": str(dataset / "itself" / "den__hard__view_00"), "image_id": 3})
    with subprocess.Popen(
        [*command, "--no-cache", "--workers", "1"], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True, env={**os.environ, "TMPDIR": str(tmp_path)},
    ) as process:  # fmt: skip
        process.stdin.write(f"{request}\n" * 3)
        process.stdin.flush()
        until(lambda: list(tmp_path.glob("*/legoworld-blender-*")), "the start of Blender")
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=PATIENCE_S) == 130
    assert list(tmp_path.iterdir()) == []


def test_the_scratch_of_a_killed_server_goes_with_the_next_one(dataset, tmp_path):
    command = [sys.executable, "-m", "legoworld", "bench", "serve", str(dataset / "bench"),
               "--root", "/", "--workers", "1"]  # fmt: skip
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        env={**os.environ, "TMPDIR": str(tmp_path)},
    ) as process:  # fmt: skip
        process.stdin.write("no request\n")
        process.stdin.flush()
        assert json.loads(process.stdout.readline())["status"] == "refused"
        process.kill()
    assert list(tmp_path.glob("legoworld-serve-*"))
    serve(dataset, ["no request"], scratch=tmp_path)
    assert list(tmp_path.iterdir()) == []


TOKEN = "0123456789abcdef"


@pytest.fixture(scope="module")
def service(dataset, tmp_path_factory):
    """A running service of R and A, with its address, its process and its scratch."""
    scratch = tmp_path_factory.mktemp("service")
    command = [sys.executable, "-m", "legoworld", "bench", "serve", str(dataset / "bench"),
               "--http", "--port", "0", "--host", "127.0.0.1", "--workers", "2", "--step", "0",
               "--no-cache", "--second-card",
               "--per-object", "--queue", "64", "--body-limit", "16", "--unpacked-limit", "32",
               "--root", str(dataset)]  # fmt: skip
    with subprocess.Popen(
        command, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "TMPDIR": str(scratch), "LEGOWORLD_SERVE_TOKEN": TOKEN},
    ) as process:  # fmt: skip
        line = process.stderr.readline()
        assert line.startswith("listening on http://127.0.0.1:")
        yield SimpleNamespace(url=line.split()[-1], process=process, scratch=scratch)
        of_workers = scratch.glob("legoworld-serve-*/legoworld-serve-*/**/*")
        left = [p for p in of_workers if p.is_file() and not p.name.startswith(".owner")]
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=PATIENCE_S) == 0
    assert left == [], "of a submission that was scored nothing stays while the service runs"
    assert list(scratch.iterdir()) == []


def tar_folder(folder: Path) -> bytes:
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w") as archive:
        archive.add(folder, ".")
    return stream.getvalue()


def send(service, data: bytes, **query) -> dict[str, Any]:
    url = f"{service.url}/score?{urllib.parse.urlencode(query)}"
    asked = urllib.request.Request(url, data, {"Authorization": f"Bearer {TOKEN}"})
    with urllib.request.urlopen(asked, timeout=PATIENCE_S) as answer:
        return json.load(answer)


def evaluate_scenes(dataset: Path, scenes: Path, folder: Path, *more: str) -> dict[str, Any]:
    """The rows of `evaluate`, by the cases' names."""
    track, run = dataset / "bench" / "public" / "track.json", str(folder / "run")
    asked = ["--task", "bench", "--track", str(track), "-o", run, "--workers", "1", "-q", *more]
    assert cli.run(["readout", str(scenes), *asked]) in (0, 1)
    assert cli.run(["evaluate", run, "--truth", str(dataset / "bench" / "private"), "-q",
                    "-o", str(folder / "evaluation"), "--no-diagnostics"]) == 0  # fmt: skip
    lines = (folder / "evaluation" / "per_image.jsonl").read_text("utf-8").splitlines()
    return {Path(row["file_name"]).stem: row for row in map(json.loads, lines)}


def test_answers_over_http_are_those_of_evaluate(dataset, submissions, service, tmp_path):
    """In every bit: valid or not, as an archive and by its path below the root."""
    places = {
        "den__easy__view_00": dataset / "itself" / "den__easy__view_00",
        "den__hard__view_00": submissions / "cheat",
        "den__hard__view_01": submissions / "flat_picture",
        "den__medium__view_00": submissions / "nan",
    }
    for name, place in places.items():
        shutil.copytree(place, dataset / "sent" / name)
    rows = evaluate_scenes(dataset, dataset / "sent", tmp_path, "--no-render")
    for name in places:
        row, image_id = rows[name], rows[name]["image_id"]
        sent = send(service, tar_folder(dataset / "sent" / name), image_id=image_id, parts="R")
        path = {"scene": f"sent/{name}", "image_id": image_id, "parts": "R"}
        asked = urllib.request.Request(
            f"{service.url}/score", json.dumps(path).encode(),
            {"Authorization": f"Bearer {TOKEN}", "Content-Type": "application/json"},
        )  # fmt: skip
        with urllib.request.urlopen(asked, timeout=PATIENCE_S) as answer:
            named = json.load(answer)
        for found in (sent, named):
            for key in ("R", "objects", "status", "reason", "validity", "warnings"):
                assert found[key] == row[key], (name, key)
            assert (found["V"], found["reward"]) == (row["valid"], row["R"])
    assert {row["valid"] for row in rows.values()} == {True, False}


def test_a_and_s_by_the_page_s_client_are_those_of_evaluate(dataset, service, tmp_path):
    page = (CHECKOUT / "docs" / "scoring-service.md").read_text(encoding="utf-8")
    client: dict[str, Any] = {}
    exec(re.search(r"```python client\n(.*?)```", page, re.S)[1], client)
    hard = dataset / "itself" / "den__hard__view_00"
    shutil.copytree(hard, tmp_path / "one" / hard.name)
    row = evaluate_scenes(dataset, tmp_path / "one", tmp_path, "--image-id", "3")[hard.name]
    answer = client["score"](service.url, TOKEN, 3, tar_folder(hard))
    for key in ("R", "A", "S", "objects", "validity", "warnings", "flags"):
        assert answer[key] == row[key], key
    assert answer["A"] > 0.9
    assert answer["reward"] == row["S"]


def test_a_blend_alone_has_r_and_no_v(dataset, submissions, service):
    hard = dataset / "itself" / "den__hard__view_00"
    answer = send(service, (hard / "scene.blend").read_bytes(), image_id=3, parts="R")
    assert (answer["V"], answer["R"], answer["status"]) == (None, 1.0, "ok")
    assert not [w for w in answer["warnings"] if w.startswith("not valid")]
    assert "x" not in answer
    second = send(service, (hard / "scene.blend").read_bytes(), image_id=3, parts="RX")["x"]
    assert [second[k] for k in ("R_p", "R_x", "F3D", "R_above_empty", "A_x")] == [1.0] * 4 + [None]
    blend = (submissions / "nan" / "scene.blend").read_bytes()
    answer = send(service, blend, image_id=3, parts="R")
    assert (answer["V"], answer["R"]) == (0, 0.0)


def test_killed_workers_and_blenders_lose_no_answer(dataset, service):
    data = (dataset / "itself" / "den__hard__view_00" / "scene.blend").read_bytes()

    def ask(number: int) -> float:
        return send(service, data, image_id=3, parts="R", id=number)["R"]

    with ThreadPoolExecutor(4) as clients:
        asked = [clients.submit(ask, n) for n in range(16)]
        for done, name in ((2, "task_process"), (6, "blender.worker"), (10, "task_process")):
            until(lambda done=done: sum(one.done() for one in asked) >= done)
            until(lambda name=name: _descendants(service.process.pid, name))
            with suppress(IndexError, ProcessLookupError):  # it ended by itself meanwhile
                os.kill(_descendants(service.process.pid, name)[0], signal.SIGKILL)
        assert [one.result() for one in asked] == [1.0] * 16


def _descendants(pid: int, name: str) -> list[int]:
    """Processes below one that have a word on their command line."""
    listed = subprocess.run(
        ["ps", "-ww", "-eo", "pid=,ppid=,args="], capture_output=True, text=True, check=True
    )
    table = [line.split(None, 2) for line in listed.stdout.splitlines()]
    below = {str(pid)}
    for _ in range(3):
        below |= {child for child, parent, _ in table if parent in below}
    return [int(child) for child, _, words in table if child in below and name in words]
