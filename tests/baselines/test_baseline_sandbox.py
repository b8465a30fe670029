"""What a baseline's program can read, write, reach and leave behind."""

from __future__ import annotations

import json
import os
import sys
import textwrap
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from baselines.tracks import (
    FAKE,
    call,
    make_photos,
    make_track,
    results,
    rows,
    run_arguments,
    run_document,
)
from running import paused
from waiting import until
from workers.confinements import bubblewrap_or_skip

from legoworld.baselines.cards import load_baseline
from legoworld.baselines.confinement import readable

CARD = """
name = "spy"
version = "1"
title = "Looks around"
licence = "none"
tasks = ["coco", "eth3d"]
[options.path]
type = "str"
help = "what to look at"
"""
SPY = """
import glob, os, socket, subprocess, sys
from pathlib import Path
from legoworld_baseline import hash_files, serve, write_depth
import numpy as np

def load(request):
    return request, {"weights": hash_files([request["weights"]])}

def tried(action):
    try:
        return int(bool(action()))
    except OSError:
        return 0

def predict(request, image):
    given = request["options"]["path"] or ""
    {body}

serve(load, predict)
"""
NAMES = ["001.jpg", "002.jpg"]
SECRET = "hidden-token"


def spy(folder: Path, body: str) -> Path:
    folder.mkdir()
    (folder / "card.toml").write_text(CARD)
    indented = textwrap.indent(textwrap.dedent(body), "    ").strip()
    (folder / "run.py").write_text(SPY.replace("{body}", indented))
    return folder


def write_track(folder: Path, names: list[str] = NAMES) -> tuple[Path, Path, Path]:
    """A track, its photos in a folder of their own, and weights."""
    photos = make_photos(folder / "photos", names)
    weights = folder / "weights.bin"
    weights.write_bytes(b"weights")
    return make_track(folder / "track.json", names), photos, weights


LOOK = """
words = b"hidden-" + b"token"  # not in this program's own text
seen = {
    "own": SECRET_NAME in os.environ,
    "environ": sum(
        tried(lambda: words in Path(p).read_bytes()) for p in glob.glob("/proc/[0-9]*/environ")
    ),
    "beside": tried(Path(given).read_bytes),
    "listed": len(glob.glob(os.path.dirname(image["path"]) + "/*")),
    "photo": tried(Path(image["path"]).read_bytes),
    "weights": tried(lambda: Path(request["weights"]).open("ab")),
    "network": tried(lambda: socket.create_connection(("127.0.0.1", int(PORT)), 5)),
    "processors": tried(lambda: os.listdir("/sys/devices/system/cpu")),
}
return {"predictions": [], "counts": {name: int(n) for name, n in seen.items()}}
"""


def test_a_program_sees_what_it_needs_and_nothing_else(tmp_path, monkeypatch):
    import socket

    bubblewrap_or_skip()
    monkeypatch.setenv("SOME_TOKEN", SECRET)
    track, photos, weights = write_track(tmp_path)
    secret = photos / "gt.json"
    secret.write_text("{}")
    with socket.create_server(("127.0.0.1", 0)) as server:
        body = LOOK.replace("PORT", str(server.getsockname()[1]))
        body = body.replace("SECRET_NAME", repr("SOME_TOKEN"))
        arguments = run_arguments(
            track, photos, weights, tmp_path / "run", "--option", f"path={secret}",
            baseline=spy(tmp_path / "spy", body),
        )  # fmt: skip
        assert call([*arguments, "--sandbox", "bubblewrap"]) == 0
        shown = {"own": 0, "environ": 0, "beside": 0, "listed": 2, "photo": 1}
        kept = {"weights": 0, "network": 0, "processors": 1}
        for row in rows(tmp_path / "run").values():
            assert row["counts"] == shown | kept
        about = run_document(tmp_path / "run")["baseline"]["sandbox"]
        names = {"network", "files", "other processes", "environment", "child processes ended"}
        assert set(about["holds"]) == names
        assert about["does_not_hold"] == []
        # An --input is shown; without bubblewrap nothing is claimed of files.
        given = ["--input", str(secret), "--overwrite"]
        assert call([*arguments, *given]) == 0
        assert rows(tmp_path / "run")[1]["counts"]["beside"] == 1
        assert call([*arguments, "--sandbox", "limits", "--overwrite"]) == 0
        assert rows(tmp_path / "run")[1]["counts"]["beside"] == 1
        about = run_document(tmp_path / "run")["baseline"]["sandbox"]
        assert set(about["does_not_hold"]) == names


def test_the_network_is_there_for_a_card_that_downloads_its_weights(tmp_path, monkeypatch):
    import socket

    bubblewrap_or_skip()
    monkeypatch.setenv("HF_HUB_CACHE", str(tmp_path / "hub"))
    track, photos, weights = write_track(tmp_path)
    body = """
    (Path(os.environ["HF_HUB_CACHE"]) / "blob").write_text("x")
    return {"predictions": [], "counts": {"network": tried(
        lambda: socket.create_connection(("127.0.0.1", int(given)), 5))}}
    """
    program = spy(tmp_path / "spy", body)
    text = (program / "run.py").read_text()
    (program / "run.py").write_text(text.replace('hash_files([request["weights"]])', "[]"))
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = str(server.getsockname()[1])
        found = []
        for card in (CARD, CARD.replace("tasks", "network = true\ntasks")):
            (program / "card.toml").write_text(card)
            for hub_id, given in (("org/name", []), ("org/name", ["--offline"]), (weights, [])):
                arguments = run_arguments(
                    track, photos, Path(hub_id), tmp_path / "run", "--option", f"path={port}",
                    "--sandbox", "bubblewrap", "--overwrite", *given, baseline=program,
                )  # fmt: skip
                call(arguments)
                row = rows(tmp_path / "run")[1]
                found.append((row["status"], (row.get("counts") or {}).get("network")))
    # Without the network the cache cannot be written to either.
    assert found == [("failed", None)] * 3 + [("ok", 1)] + [("failed", None)] * 2
    assert (tmp_path / "hub" / "blob").is_file()


def test_a_program_that_writes_into_its_run_is_named(tmp_path, capfd):
    """Without bubblewrap it can: the run says what has happened to its journal."""
    track, photos, weights = write_track(tmp_path)
    body = """
    if image["image_id"] == 2:
        while not tried(lambda: b"\\n" in Path(given).read_bytes()):
            pass  # the first record is not kept yet
        Path(given).write_text("of the program" * 1000)
    return {"predictions": []}
    """
    arguments = run_arguments(
        track, photos, weights, tmp_path / "run", "--sandbox", "limits",
        "--option", f"path={tmp_path / 'run' / 'journal.jsonl'}",
        baseline=spy(tmp_path / "spy", body),
    )  # fmt: skip
    assert call(arguments) != 0
    said = capfd.readouterr().err
    assert "journal.jsonl was changed while the run was writing it" in said
    assert "next: let nothing else write into the run folder" in said
    assert "None" not in said


DEPTH = "return write_depth(request, image, np.ones((48, 64), np.float32), 'disparity', None)"


def test_depth_is_taken_from_the_programs_own_folder(tmp_path, confinement):
    track, photos, weights = write_track(tmp_path, ["a/images/dslr_images/001.JPG"])
    arguments = run_arguments(
        track, photos, weights, tmp_path / "run", "--sandbox", confinement, task="eth3d",
        baseline=spy(tmp_path / "spy", DEPTH),
    )  # fmt: skip
    assert call(arguments) == 0
    row = rows(tmp_path / "run")[1]
    assert (row["depth"]["space"], row["depth"]["unit"]) == ("disparity", None)
    with np.load(tmp_path / "run" / row["depth"]["file"]) as stored:
        assert np.array_equal(stored["values"], np.ones((48, 64), np.float32))
    assert not [p for p in (tmp_path / "run").iterdir() if "baseline-" in p.name]


def test_a_link_in_the_place_of_depth_is_refused(tmp_path, confinement):
    track, photos, weights = write_track(tmp_path, ["a/images/dslr_images/001.JPG"])
    body = """
    answer = write_depth(request, image, np.ones((48, 64), np.float32), "disparity", None)
    written = Path(request["output"]) / answer["depth"]["file"]
    written.rename(Path(request["output"]) / "aside.npz")
    written.symlink_to(Path(request["output"]) / "aside.npz")
    return answer
    """
    arguments = run_arguments(
        track, photos, weights, tmp_path / "run", "--sandbox", confinement, task="eth3d",
        baseline=spy(tmp_path / "spy", body),
    )  # fmt: skip
    assert call(arguments) == 1
    row = rows(tmp_path / "run")[1]
    assert (row["status"], row["code"]) == ("failed", "file_refused")
    assert not (tmp_path / "run" / "depth/a/images/dslr_images/001.npz").exists()


def test_an_array_written_at_once_outlives_the_deletion_of_earlier_ones(tmp_path):
    """--overwrite deletes when the model has loaded: the program writes nothing before."""
    track, photos, weights = write_track(tmp_path, ["a/images/dslr_images/001.JPG"])
    program = spy(tmp_path / "spy", DEPTH)
    arguments = run_arguments(
        track, photos, weights, tmp_path / "run", task="eth3d", baseline=program
    )
    assert call(arguments) == 0
    before = results(tmp_path / "run")
    assert call([*arguments, "--overwrite"]) == 0
    assert results(tmp_path / "run") == before


def of_this_run(folder: Path) -> list[str]:
    """Running processes that have the folder in their command line."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            if str(folder).encode() in path.read_bytes() and path.parent.name != str(os.getpid()):
                found.append(path.parent.name)
        except OSError:
            continue
    return found


def test_nothing_outlives_a_killed_legoworld(tmp_path, confinement):
    """Nor what left its group and its session."""
    track, photos, weights = write_track(tmp_path)
    program = spy(
        tmp_path / "spy",
        """
        if image["image_id"] == 2:
            code = "import os, time; os.setsid(); time.sleep(6000)"
            subprocess.Popen([sys.executable, "-c", code, request["weights"]])
            Path(request["output"], "begun").touch()
            import time
            time.sleep(6000)
        return {"predictions": []}
        """,
    )
    arguments = run_arguments(
        track, photos, weights, tmp_path / "run", "--sandbox", confinement, baseline=program
    )
    process = paused.start_paused([*arguments, "-q"], "row", 1)
    run = tmp_path / "run"
    until(lambda: [*run.glob(".legoworld-baseline-*/output/begun")], "the second photo")
    assert len(of_this_run(weights)) >= 2
    process.kill()
    process.communicate()
    until(lambda: not of_this_run(weights), "the end of all that it started")
    until(lambda: not [*run.glob(".legoworld-baseline-*")], "the end of its folder")
    assert json.loads((run / "configuration.json").read_text())["kind"] == "baseline"


def test_what_the_environment_names_is_shown(tmp_path):
    names = [
        "LD_LIBRARY_PATH", "CUDA_HOME", "CUDA_PATH", "SSL_CERT_FILE", "SSL_CERT_DIR",
        "REQUESTS_CA_BUNDLE", "CURL_CA_BUNDLE", "HF_HUB_CACHE", "TORCH_HOME",
    ]  # fmt: skip
    for name in [*names, "second", "OTHER"]:
        (tmp_path / name).mkdir()
    environment = {name: str(tmp_path / name) for name in [*names, "OTHER"]}
    environment["LD_LIBRARY_PATH"] += f":{tmp_path / 'second'}:"
    photo = make_photos(tmp_path / "photos", ["a.jpg", "b.jpg"]) / "a.jpg"
    asked: Any = SimpleNamespace(images=[SimpleNamespace(path=photo)], weights="hub")
    shown = readable(load_baseline(str(FAKE)), Path(sys.executable), asked, environment, [])
    below = {path.relative_to(tmp_path) for path in shown if path.is_relative_to(tmp_path)}
    assert below == {*map(Path, [*names, "second", "photos/a.jpg"])}
