"""A package of its own adds a task of a new family, and every command serves it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from legoworld.shipped import catalog

HERE = Path(__file__).parent
DATA = catalog.folder("datasets") / "skimage_examples"
TRUTH = DATA / "truth_coco.json"
SCENES = catalog.folder("examples")
PROGRAM = "from legoworld.cli import entry; entry()"


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """A folder in which the package is installed, as pip's --target leaves it."""
    folder = tmp_path_factory.mktemp("site")
    (folder / "legoworld_counts").symlink_to(HERE / "legoworld_counts")
    about = folder / "legoworld_counts-1.0.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: legoworld-counts\nVersion: 1.0.0\n"
    )
    (about / "entry_points.txt").write_text("[legoworld.tasks]\ncounts = legoworld_counts:TASK\n")
    return folder


@pytest.fixture(scope="module")
def command(site, tmp_path_factory):
    """Runs a command where the package is installed; its exit code, output and errors."""
    cache = tmp_path_factory.mktemp("cache")

    def run(*words: object, code: int = 0, package: bool = True) -> str:
        paths = [str(site)] if package else []
        paths += [p for p in os.environ.get("PYTHONPATH", "").split(os.pathsep) if p]
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM, *map(str, words)],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(paths), "LEGOWORLD_CACHE": str(cache)},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == code, f"{done.stdout}\n{done.stderr}"
        return done.stdout + done.stderr

    return run


@pytest.fixture(scope="module")
def done(command, tmp_path_factory) -> Path:
    """Track, run, an imported run, both evaluations and their comparison."""
    folder = tmp_path_factory.mktemp("counts")
    command("track", "make", "--task", "counts", "--truth", TRUTH, "-o", folder / "track.json")
    readout = ("readout", SCENES, "--task", "counts", "--track", folder / "track.json")
    command(*readout, "-o", folder / "run", "--workers", 2)
    names = [e["file_name"] for e in json.loads((folder / "track.json").read_text())["images"]]
    (folder / "theirs.json").write_text(json.dumps({name: {"1": 3} for name in names[1:]}))
    imports = ("baseline", "import", folder / "theirs.json", "--task", "counts")
    command(*imports, "--track", folder / "track.json", "-o", folder / "theirs", code=1)
    for name in ("run", "theirs"):
        command("evaluate", folder / name, "--truth", TRUTH, "-o", folder / f"eval-{name}")
    sides = (folder / "eval-run", folder / "eval-theirs")
    command("compare", *sides, "-o", folder / "comparison", "--draws", 50)
    return folder


def test_its_numbers_are_those_of_an_independent_count(done):
    truth = json.loads(TRUTH.read_text())
    rows = [
        json.loads(line) for line in (done / "eval-run/per_image.jsonl").read_text().splitlines()
    ]
    run = [json.loads(line) for line in (done / "run/per_image.jsonl").read_text().splitlines()]
    files = {row["image_id"]: row["answer"]["file"] for row in run if row["status"] == "ok"}
    errors = []
    for row in rows:
        real = [a["category_id"] for a in truth["annotations"]
                if a["image_id"] == row["image_id"] and not a["iscrowd"]]  # fmt: skip
        stored = json.loads((done / "run" / files[row["image_id"]]).read_text())
        kinds = {*real, *map(int, stored)}
        by_kind = [abs(real.count(k) - stored.get(str(k), 0)) for k in kinds]
        errors.append(sum(by_kind) / max(1, len(kinds)))
        assert row["error"] == pytest.approx(errors[-1], abs=1e-15)
    summary = json.loads((done / "eval-run/summary.json").read_text())
    assert summary["mae"]["value"] == pytest.approx(sum(errors) / len(errors), abs=1e-15)
    assert summary["coverage"]["scored"] == len(rows) == len(files)


def test_the_comparison_pairs_what_both_scored(done):
    document = json.loads((done / "comparison/comparison.json").read_text())
    (pair,) = document["pairs"]
    assert pair["coverage"]["baseline_scored"] == pair["coverage"]["attempted"] - 1
    assert {row["metric"] for row in pair["rows"]} == {"mae"}


def test_one_worker_resumed_gives_the_same_bytes(done, command, tmp_path):
    readout = ("readout", SCENES, "--task", "counts", "--track", done / "track.json")
    command(*readout, "-o", tmp_path / "run", "--workers", 1, "--limit", 1)
    command(*readout, "-o", tmp_path / "run", "--workers", 1, "--overwrite")
    assert "valid result already" in command(*readout, "-o", tmp_path / "run", "--workers", 1)
    for name in ("per_image.jsonl", "summary.json"):
        assert (tmp_path / "run" / name).read_bytes() == (done / "run" / name).read_bytes()


def test_shards_of_it_merge_to_the_same_bytes(done, command, tmp_path):
    readout = ("readout", SCENES, "--task", "counts", "--track", done / "track.json")
    for i in (1, 2):
        command(*readout, "-o", tmp_path / f"{i}", "--shard", f"{i}/2")
    command("merge", tmp_path / "1", tmp_path / "2", "-o", tmp_path / "whole")
    for name in ("per_image.jsonl", "summary.json"):
        assert (tmp_path / "whole" / name).read_bytes() == (done / "run" / name).read_bytes()


def test_its_evidence_is_verified_and_an_altered_answer_is_seen(done, command):
    assert "mae" in command("evidence", "verify", done / "eval-run", "-v")
    assert "checks hold" in command("evidence", "verify", done / "comparison")
    answer = next((done / "run/answer").rglob("*.json"))
    kept = answer.read_bytes()
    answer.write_bytes(b"{}\n")
    try:
        command("evidence", "verify", done / "eval-run", code=1)
    finally:
        answer.write_bytes(kept)


def test_the_page_shows_its_tables(done, command, tmp_path):
    command("report", done / "eval-run", done / "eval-theirs", "-o", tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert "Counts" in page
    assert "mean absolute error" in page
    command("report", done / "comparison", "-o", tmp_path / "compared.html")


def test_other_commands_know_it(done, command, tmp_path):
    scene = next(p.parent for p in sorted(SCENES.glob("*/scene.blend")))
    assert "counts" in command("list", "tasks")
    assert "category" in command("list", "schema", "--task", "counts")
    assert "counts" in command("readout", "--help")
    command("inspect", scene, "--task", "counts", "-o", tmp_path / "look")
    command("track", "check", done / "track.json", "--photos", tmp_path, code=1)


def test_what_is_not_for_it_is_refused_in_one_sentence(done, command, tmp_path):
    refused = command("export", done / "run", "-o", tmp_path / "x.json", code=2)
    assert "coco-masks" in refused
    words = ("evaluate", done / "run", "--truth", TRUTH, "-o", tmp_path / "e")
    assert "--camera-model is for depth alone" in command(*words, "--camera-model", "none", code=2)


def test_without_the_package_its_run_says_which_task_is_missing(done, command, tmp_path):
    words = ("evaluate", done / "run", "--truth", TRUTH, "-o", tmp_path / "e")
    assert "unknown task 'counts'" in command(*words, code=2, package=False)


def test_the_api_serves_it(done, site, tmp_path):
    program = f"""
import legoworld
run = legoworld.readout({str(SCENES)!r}, {str(tmp_path / "run")!r}, task="counts",
                        track={str(done / "track.json")!r})
found = legoworld.evaluate(run.folder, {str(tmp_path / "eval")!r}, truth={str(TRUTH)!r})
print(found.metrics["mae"], found.table[0]["metric"], len(found.per_image()))
assert "mean absolute error" in found._repr_html_()
"""
    env = {**os.environ, "PYTHONPATH": str(site)}
    printed = subprocess.check_output([sys.executable, "-c", program], text=True, env=env)
    summary = json.loads((done / "eval-run/summary.json").read_text())
    images = summary["coverage"]["attempted"]
    assert printed.split() == [str(summary["mae"]["value"]), "mae", str(images)]


def test_no_file_of_the_package_knows_it():
    import legoworld

    for path in Path(legoworld.__file__).parent.rglob("*.py"):
        assert "legoworld_counts" not in path.read_text(encoding="utf-8")
