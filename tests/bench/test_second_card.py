"""LEGO-Bench-X from a reference scene to its scores: made, read out, scored, and kept private."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path

import numpy as np
import pytest
from bench.quick_renders import few_samples
from bench.stage import PROGRAM, picture

import legoworld
from legoworld import cli
from legoworld.agents.workspaces import load_trial_setup
from legoworld.errors import UsageError
from legoworld.evaluation.reconstruction.dataset import BenchTruthError
from legoworld.files import sha256_of_file
from legoworld.records.base import canonical, decode
from legoworld.records.second_card import BenchXFile

MAKE = ["--size", "96x54", "--samples", "2", "--noise-seeds", "0", "-q"]
#: Easy's objects alone, in a family of one view; a copy whose alpha Cycles alone can read.
SCENES = (
    PROGRAM
    + """
scene = stage(); box("Blue", 1.0, 0.0, 0.0, 0.4, category="box"); deliver("one")
m = bpy.data.materials.new("Ghost")
tree = m.node_tree
noise, none = tree.nodes.new("ShaderNodeTexNoise"), tree.nodes.new("ShaderNodeMath")
none.operation, none.inputs[1].default_value = "MULTIPLY", 0.0
tree.links.new(noise.outputs[0], none.inputs[0])
tree.links.new(none.outputs[0], tree.nodes["Principled BSDF"].inputs["Alpha"])
for thing in scene.objects:
    if thing.type == "MESH":
        thing.data.materials.clear()
        thing.data.materials.append(m)
deliver("ghost")
"""
)


@pytest.fixture(scope="module")
def made(references, build_scenes, tmp_path_factory):
    """A family of two views, and one of one; each submitted as itself."""
    top = tmp_path_factory.mktemp("second")
    build_scenes(SCENES, top / "built")
    (top / "scenes").mkdir()
    (top / "scenes" / "den").symlink_to(references / "den")
    (top / "scenes" / "one").symlink_to(top / "built" / "one")
    command = ["bench", "make", str(top / "scenes"), "-o", str(top / "bench"), *MAKE]
    assert cli.run([*command, "--keep-scenes", str(top / "itself")]) == 0
    ghost = top / "ghosts" / "one__view_00"
    ghost.parent.mkdir()
    ghost.symlink_to(top / "built" / "ghost")
    picture(top / "built" / "ghost" / "final.png")
    return top


def second(made: Path) -> BenchXFile:
    return decode(BenchXFile, (made / "bench" / "private" / "x.json").read_bytes())


def rows_of(made: Path, submissions: Path, place: Path, *more: str) -> dict[str, dict]:
    track = made / "bench" / "private" / "x.json"
    arguments = ["readout", str(submissions), "--task", "bench-x", "--track", str(track), *more]
    cli.run([*arguments, "-o", str(place / "run"), "--workers", "1", "-q"])
    truth = ["--truth", str(made / "bench" / "private"), "--draws", "10", "-q"]
    assert cli.run(["evaluate", str(place / "run"), *truth, "-o", str(place / "eval")]) == 0
    lines = (place / "eval" / "per_image.jsonl").read_text("utf-8").splitlines()
    return {row["file_name"].removesuffix(".png"): row for row in map(json.loads, lines)}


def test_the_next_view_is_the_second_one_and_a_single_view_gets_a_private_one(made):
    images = {str(image.file_name): image for image in second(made).images}
    assert len(images) == 7
    for tier in ("easy", "medium", "hard"):
        for view, other in ((0, 1), (1, 0)):
            x = images[f"den__{tier}__view_{view:02}.png"].x
            assert x.picture == f"public/images/den__{tier}__view_{other:02}.png"
    alone = images["one__view_00.png"]
    assert alone.x.picture == "private/x/one__view_00.png"
    assert alone.probe.view is not None
    arrays = np.load(made / "bench" / "private" / "x" / "one__view_00.npz")
    first = np.load(made / "bench" / "private" / "raster" / "one__view_00.npz")["instance"]
    scored = [i for i in np.unique(first) if i >= 0]
    for number in scored:  # it sees the same objects, from elsewhere
        assert (arrays["view_instance"] == number).sum() >= 0.25 * (first == number).sum()
    assert (arrays["view_instance"] != first).mean() > 0.05
    for image in images.values():
        assert sha256_of_file(made / "bench" / str(image.x.picture)) == image.x.picture_sha256
        assert 0 < image.x.R_empty < 1
        dx, dy = map(abs, image.probe.offset_px)
        assert 0.15 <= min(dx, dy) <= max(dx, dy) <= 0.45
    assert len({image.probe.offset_px for image in images.values()}) == 7


def test_nothing_of_the_second_card_is_public(made):
    public = [p for p in (made / "bench" / "public").rglob("*") if p.is_file()]
    assert {p.suffix for p in public} == {".json", ".png"}
    private = made / "bench" / "private" / "x" / "one__view_00.png"
    assert sha256_of_file(private) not in {sha256_of_file(p) for p in public}
    text = (made / "bench" / "public" / "track.json").read_text("utf-8")
    for image in second(made).images:
        numbers = [*image.probe.offset_px, image.x.R_empty]
        assert not [n for n in numbers if repr(n) in text]
    assert not re.search("probe|offset|bench-x", text)


def test_its_track_is_not_handed_to_agents(made):
    with pytest.raises(UsageError, match="private"):
        load_trial_setup(made / "bench" / "private" / "x.json", made, task="bench", plugin=())


def test_the_public_track_is_no_track_of_bench_x(made, tmp_path, capsys):
    track = made / "bench" / "public" / "track.json"
    command = ["readout", str(made / "itself"), "--task", "bench-x", "--track", str(track)]
    assert cli.run([*command, "-o", str(tmp_path / "run")]) == 2
    assert "private/x.json" in capsys.readouterr().err


def test_references_submitted_as_themselves_are_one_and_a_ghost_is_seen_through(
    made, tmp_path, monkeypatch
):
    few_samples(monkeypatch)
    for name in ("den__hard__view_01", "one__view_00"):
        (tmp_path / "two" / name).parent.mkdir(exist_ok=True)
        (tmp_path / "two" / name).symlink_to(made / "itself" / name)
    rows = rows_of(made, tmp_path / "two", tmp_path / "itself")
    assert len(rows) == 7
    for name in ("den__hard__view_01", "one__view_00"):
        row, x = rows[name], rows[name]["x"]
        numbers = (row["R"], x["R_p"], x["R_x"], x["F3D"], x["found"], x["R_above_empty"])
        assert numbers == (1.0,) * 6, name
        assert x["A_x"] > 0.9
        assert x["surface_differs"] < 0.01
        assert x["unreadable_alpha"] == 0
        assert row["flags"] == []
    ghost = rows_of(made, made / "ghosts", tmp_path / "ghost")["one__view_00"]
    assert ghost["R"] == 1.0
    assert ghost["x"]["surface_differs"] > 0.95
    assert ghost["x"]["unreadable_alpha"] == 1
    assert "surface_not_in_picture" in {flag["kind"] for flag in ghost["flags"]}


#: Of an answer and of a row of `evaluate`.
KEYS = ("R", "A", "S", "objects", "status", "validity", "warnings", "x")


def test_served_without_a_render_it_is_that_of_evaluate(made, submissions, tmp_path):
    """In every bit, of submissions that are right, wrong, not valid and not readable."""
    placed = {
        "den__hard__view_00": made / "itself" / "den__easy__view_00",
        "den__easy__view_00": submissions / "flat_picture",
        "den__hard__view_01": submissions / "nan",
        "one__view_00": made / "itself" / "one__view_00",
    }
    (tmp_path / "sent").mkdir()
    for name, place in placed.items():
        (tmp_path / "sent" / name).symlink_to(place)
    rows = rows_of(made, tmp_path / "sent", tmp_path, "--no-render")
    asked = [(tmp_path / "sent" / name, rows[name]["image_id"]) for name in placed]
    answers = legoworld.bench_score(
        made / "bench", asked, render=False, second_card=True, diagnostics=True, workers=1
    )
    for name, answer in zip(placed, answers, strict=True):
        found = json.loads(canonical(answer))
        for key in KEYS:
            assert found[key] == rows[name][key], (name, key)
    assert [a.x.R_p == 1.0 for a in answers] == [False, False, False, True]
    assert answers[0].x.A_x is None
    assert answers[1].x.R_above_empty < 0


def test_served_with_a_render_it_is_that_of_evaluate_and_unasked_it_is_left_out(made, tmp_path):
    (tmp_path / "sent").mkdir()
    place = tmp_path / "sent" / "one__view_00"
    place.symlink_to(made / "ghosts" / "one__view_00")
    row = rows_of(made, tmp_path / "sent", tmp_path)["one__view_00"]
    lines = [
        json.dumps({"scene": str(place), "image_id": row["image_id"], "id": parts, **more})
        for parts, more in (("RAX", {"parts": "RAX"}), ("", {}))
    ]
    answers: dict[str, dict] = {}
    legoworld.bench_serve(
        made / "bench",
        io.BytesIO("\n".join(lines).encode()),
        lambda answer: answers.update({str(answer.id): json.loads(canonical(answer))}),
        root="/",
        second_card=True,
        diagnostics=True,
        workers=1,
    )
    for key in (*KEYS, "flags"):
        assert answers["RAX"][key] == row[key], key
    assert answers["RAX"]["x"]["surface_differs"] > 0.95
    assert "x" not in answers[""]
    assert answers[""]["S"] == row["S"]


def test_a_server_without_it_refuses_it_and_a_dataset_without_it_is_refused(made, tmp_path):
    answers: list = []
    line = json.dumps({"scene": "one", "image_id": 1, "parts": "RX"}).encode()
    legoworld.bench_serve(made / "bench", io.BytesIO(line), answers.append, render=False)
    assert (answers[0].status, answers[0].R) == ("refused", None)
    assert answers[0].reason == "this server gives R alone"
    for half in ("public", "private"):
        (tmp_path / half).mkdir()
        for path in (made / "bench" / half).iterdir():
            if path.name != "x.json":
                (tmp_path / half / path.name).symlink_to(path)
    with pytest.raises(BenchTruthError, match=r"x\.json cannot be read"):
        legoworld.bench_serve(tmp_path, io.BytesIO(line), answers.append, second_card=True)
