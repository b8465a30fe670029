"""`legoworld bench serve`: lines in, scores out, and nothing is left behind."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
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


def test_appearance_is_scored_with_a_render(dataset, tmp_path):
    hard = str(dataset / "itself" / "den__hard__view_00")
    (answer,) = serve(
        dataset, [json.dumps({"scene": hard, "image_id": 3})], "--workers", "1", scratch=tmp_path
    )
    assert answer["R"] == 1.0
    assert answer["A"] > 0.9
    assert answer["S"] == pytest.approx((1 + answer["A"]) / 2)


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
        until(lambda: list(tmp_path.glob("legoworld-blender-*")), "the start of Blender")
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
