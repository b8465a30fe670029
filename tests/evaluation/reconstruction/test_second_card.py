"""LEGO-Bench-X: what each number says of a made-up submission, and that the headline stays."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from evaluation.reconstruction.datasets import (
    NOTHING,
    VALID,
    Submission,
    evaluate_bench,
    sha256,
    write_dataset,
    write_run,
    write_second_card,
)
from msgspec.structs import replace

from legoworld import cli
from legoworld.cards import load_card
from legoworld.evaluation.evidence import verify
from legoworld.evaluation.reconstruction.dataset import BenchTruthError
from legoworld.evaluation.reconstruction.integrity import scale_flags
from legoworld.evaluation.reconstruction.points import picture_raster
from legoworld.evaluation.reconstruction.protocol import bench_protocol
from legoworld.evaluation.reconstruction.reference import Reference
from legoworld.evaluation.reconstruction.second_card import above_empty, shown_first, within
from legoworld.records.second_card import OWN
from legoworld.records.submission import Check, ImageTexture, Integrity, TextBlock
from legoworld.records.track import SecondView
from legoworld.workers.tasks import WorkerPool

CARD = load_card("bench-x")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    made = write_dataset(tmp_path_factory.mktemp("bench"), views=2)
    write_second_card(made)
    return made


def run_of(folder: Path, dataset, submissions=None):
    track = sha256(dataset.private / "x.json")
    return write_run(folder, dataset, submissions, task="bench-x", track_sha256=track)


def scored(dataset, folder: Path, submission: Submission):
    """The row of the first case, submitted so; the others are the reference."""
    run = run_of(folder / "run", dataset, {1: submission})
    evaluate_bench(run, dataset.private, folder / "eval", draws=10)
    return json.loads((folder / "eval" / "per_image.jsonl").read_text().splitlines()[0])


def kinds(row) -> set[str]:
    return {flag["kind"] for flag in row["flags"]}


def test_the_reference_submitted_as_itself_is_one_everywhere_and_raises_no_flag(dataset, tmp_path):
    run = run_of(tmp_path / "run", dataset)
    summary = evaluate_bench(run, dataset.private, tmp_path / "eval", draws=10)
    for name in ("R", "R_p", "R_x", "A_x", "F3D", "found", "R_above_empty"):
        assert summary.metrics[name].value == 1.0, name
        assert summary.metrics[name].n == 8
    assert summary.metrics["R_empty"].value == 0.25
    assert summary.task == "bench-x"
    assert not summary.flags
    assert {check.status for check in verify(tmp_path / "eval", None)} == {"ok"}


def test_the_headline_is_the_bench_s_to_the_byte(dataset, tmp_path):
    rows = {}
    for task, run in (
        ("bench", write_run(tmp_path / "a", dataset)),
        ("bench-x", run_of(tmp_path / "b", dataset)),
    ):
        evaluate_bench(run, dataset.private, tmp_path / task, draws=10)
        lines = (tmp_path / task / "per_image.jsonl").read_text().splitlines()
        rows[task] = [json.loads(line) for line in lines]
    assert all("x" not in row for row in rows["bench"])
    for row in rows["bench-x"]:
        del row["x"]
    assert rows["bench"] == rows["bench-x"]


def test_dust_at_the_public_centres_has_no_moved_sample(dataset, tmp_path):
    nothing = np.full_like(dataset.cases[1].second["offset_depth_z_m"], np.inf)
    row = scored(
        dataset,
        tmp_path,
        Submission(probed={"offset_depth_z_m": nothing}, surface_differs=0.9),
    )
    assert (row["R"], row["x"]["R_p"], row["x"]["R_x"]) == (1.0, 0.0, 1.0)
    assert kinds(row) == {"sub_pixel_surface", "surface_not_in_picture"}


def test_a_surface_of_one_view_alone_fails_in_the_other(dataset, tmp_path):
    wall = np.full_like(dataset.cases[1].second["view_depth_z_m"], 30.0)
    black = np.zeros_like(dataset.cases[1].render)
    row = scored(
        dataset, tmp_path, Submission(probed={"view_depth_z_m": wall}, second_render=black)
    )
    assert (row["R"], row["x"]["R_x"]) == (1.0, 0.0)
    assert row["A"] == 1.0
    assert row["x"]["A_x"] < 0.7
    assert row["x"]["A_x_seen"] < 0.7
    assert kinds(row) == {"one_view_geometry", "one_view_appearance"}


RASTER = picture_raster((160, 90), 90.0, (16, 9))
STAY = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def shown(first, second, moved_x=0.0):
    """Of two depths, the second from a place `moved_x` metres to the right, which looks alike."""
    reference = Reference(
        raster=RASTER, depth_z_m=first, label=np.zeros((9, 16), np.int32), sampled=True
    )
    pose = ((1.0, 0.0, 0.0, moved_x), *STAY[1:])
    view = SecondView(cam_from_view=pose, hfov_deg=90.0)
    return shown_first(second, RASTER, view, reference, 0.02)


def test_what_the_first_picture_does_not_show_may_be_left_out():
    wall = np.full((9, 16), 4.0, np.float32)  # 8 m across: a pixel is half a metre
    assert shown(wall, wall).all()
    assert shown(wall, wall * np.float32(1.015)).all()
    assert not shown(wall, wall * np.float32(1.03)).any()
    aside = shown(wall, wall, 2.0)
    assert aside[:, :12].all()
    assert not aside[:, 12:].any()  # out of the first picture
    before = wall.copy()
    before[:, :6] = 2.0
    hidden = shown(before, wall)
    assert not hidden[:, :5].any()
    assert hidden[:, 5:].all()  # a silhouette may fall on the next sample
    sky = wall.copy()
    sky[0] = np.inf
    assert not shown(wall, sky)[0].any()
    behind = wall.copy()
    behind[4] = 0.5
    assert not shown(wall, behind)[4].any()


def test_f3d_counts_the_whole_object_and_what_lies_around_it_is_no_mistake(dataset, tmp_path):
    points = dataset.cases[1].second["points_m"]
    owner = dataset.cases[1].second["point_object"]
    front = points[:, 2] < 3.5  # half of the object, and all that it stands on
    half = {"points_m": points[front], "point_object": owner[front]}
    row = scored(dataset, tmp_path, Submission(probed=half))
    own = dataset.cases[1].second["point_kind"] == OWN
    near = points[own, 2] <= points[front, 2].max() + 0.1
    for found in row["x"]["objects"]:
        assert found["eligible"]
        assert found["precision"] == 1.0
        assert found["recall"] == pytest.approx(near.mean())
        assert found["f1"] == pytest.approx(2 * near.mean() / (1 + near.mean()))
    floor = {"points_m": points[~own], "point_object": owner[~own]}
    row = scored(dataset, tmp_path / "floor", Submission(probed=floor))
    assert (row["x"]["F3D"], row["x"]["found"]) == (0.0, 0.0)
    far = points + np.float32(0.3)  # three times tau aside on each axis
    row = scored(dataset, tmp_path / "far", Submission(probed={"points_m": far}))
    assert all(o["precision"] < 0.7 for o in row["x"]["objects"])
    none = {"points_m": points[:0], "point_object": owner[:0]}
    row = scored(dataset, tmp_path / "none", Submission(probed=none))
    assert (row["x"]["F3D"], row["x"]["found"]) == (0.0, 0.0)


def test_what_is_not_valid_is_zero_and_without_a_render_a_x_is_undefined(dataset, tmp_path):
    broken = replace(VALID, scene_glb=Check(ok=False, found="nothing"))
    row = scored(dataset, tmp_path, Submission(validity=broken))
    x = row["x"]
    assert (x["R_p"], x["R_x"], x["A_x"], x["F3D"], x["found"]) == (0, 0, 0, 0, 0)
    assert x["R_above_empty"] == pytest.approx(-0.25 / 0.75)
    row = scored(dataset, tmp_path / "blind", Submission(no_render=True))
    assert row["x"]["A_x"] is None
    assert row["x"]["R_x"] == 1.0


def test_text_blocks_alone_are_no_flag(dataset, tmp_path):
    text = TextBlock(name="run.py", characters=8, registers=False)
    told = replace(NOTHING, texts=(text,))
    assert scored(dataset, tmp_path / "alone", Submission(integrity=told))["flags"] == []
    with_dust = Submission(integrity=told, surface_differs=0.5)
    row = scored(dataset, tmp_path / "dust", with_dust)
    assert kinds(row) == {"text_blocks", "surface_not_in_picture"}


def test_r_above_empty():
    assert above_empty(1.0, 0.3) == 1.0
    assert above_empty(0.3, 0.3) == 0.0
    assert above_empty(0.0, 0.5) == -1.0
    assert above_empty(1.0, 1.0) is None


def test_any_number_of_workers_gives_the_same_bytes(dataset, tmp_path):
    run = run_of(tmp_path / "run", dataset)
    for workers in (1, 2):
        pool = WorkerPool(engine="local", workers=workers)
        evaluate_bench(run, dataset.private, tmp_path / str(workers), draws=10, pool=pool)
    for name in ("per_image.jsonl", "summary.json"):
        assert (tmp_path / "1" / name).read_bytes() == (tmp_path / "2" / name).read_bytes()


def test_halves_and_runs_that_do_not_belong_together_are_refused(dataset, tmp_path):
    public = write_run(tmp_path / "run", dataset, task="bench-x")
    with pytest.raises(BenchTruthError, match="of another dataset"):
        evaluate_bench(public, dataset.private, tmp_path / "a", draws=10)
    other = write_dataset(tmp_path / "other", seed=3)
    with pytest.raises(BenchTruthError, match=r"x\.json cannot be read"):
        evaluate_bench(run_of(tmp_path / "run2", dataset), other.private, tmp_path / "b", draws=10)
    (other.private / "x.json").write_bytes((dataset.private / "x.json").read_bytes())
    with pytest.raises(BenchTruthError, match="another dataset"):
        evaluate_bench(run_of(tmp_path / "run3", dataset), other.private, tmp_path / "c", draws=10)


def test_a_probe_that_was_touched_is_a_row_of_zeros(dataset, tmp_path):
    run = run_of(tmp_path / "run", dataset)
    file = next((run / "probe").glob("*.npz"))
    file.write_bytes(file.read_bytes() + b"0")
    summary = evaluate_bench(run, dataset.private, tmp_path / "eval", draws=10)
    assert summary.coverage.by_status == {"changed": 1, "ok": 7}
    assert summary.metrics["R_p"].value == 7 / 8


def test_both_cards_are_compared_tabled_and_shown(dataset, tmp_path, capsys):
    for name, submissions in (("a", {}), ("b", {1: Submission(probed={})})):
        run = run_of(tmp_path / f"run-{name}", dataset, submissions)
        evaluate_bench(run, dataset.private, tmp_path / name, draws=10)
    sides = [str(tmp_path / name) for name in "ab"]
    assert cli.run(["compare", *sides, "-o", str(tmp_path / "comparison"), "--draws", "10"]) == 0
    assert cli.run(["bench", "table", *sides, "-o", str(tmp_path / "table")]) == 0
    assert "R above empty" in (tmp_path / "table" / "leaderboard.md").read_text("utf-8")
    assert cli.run(["report", sides[0], "-o", str(tmp_path / "report.html")]) == 0
    assert "Both cards" in (tmp_path / "report.html").read_text("utf-8")
    compared = json.loads((tmp_path / "comparison" / "comparison.json").read_text("utf-8"))
    assert "R_x" in json.dumps(compared)


def test_a_picture_is_known_as_a_negative_and_in_little_detail():
    random = np.random.default_rng(0)
    photo = np.repeat(np.repeat(random.integers(0, 256, (9, 16, 3), np.uint8), 20, 0), 20, 1)
    small = photo[::5, ::5]
    noisy = np.clip(small + random.normal(0, 70, small.shape), 0, 255).astype(np.uint8)
    other = random.integers(0, 256, small.shape, np.uint8)
    textures = np.stack([small, np.invert(small), noisy, other])
    facts = Integrity(
        images=tuple(
            ImageTexture(name=name, path="", size_wh=(64, 36), packed=True, generated=False,
                         absolute_path=False, thumbnail=k, users=("world",))
            for k, name in enumerate(("same", "negative", "noisy", "other"))
        ),
        world_nodes=(), compositor_nodes=(), texts=(), drivers=0, planes=(), joints=(),
    )  # fmt: skip
    rules = bench_protocol(CARD).x
    assert rules is not None
    flags = {f.what.split(",")[0]: f for f in scale_flags(facts, textures, photo, rules.scales)}
    assert set(flags) == {"same", "negative", "noisy"}
    assert flags["negative"].measured == pytest.approx(flags["same"].measured)
    assert "64x36" not in flags["noisy"].what


def test_within_is_what_every_pair_says():
    random = np.random.default_rng(0)
    for _ in range(300):
        n, m = random.integers(1, 120, 2)
        size = 10 ** random.uniform(-3, 3, 3)
        points, targets = ((random.normal(size=(k, 3)) * size).astype(np.float32) for k in (n, m))
        tau = float(10 ** random.uniform(-3, 3))
        apart = (points[:, None].astype(np.float64) - targets[None].astype(np.float64)) ** 2
        nearest = (apart[..., 0] + apart[..., 1] + apart[..., 2]).min(axis=1)
        assert np.array_equal(within(points, targets, tau), nearest <= tau * tau)
    one = np.zeros((1, 3), np.float32)
    line = np.zeros((5, 3), np.float32)
    line[:, 0] = (-2, -1, 0, 1, 2)
    assert within(line, one, 1.0).tolist() == [False, True, True, True, False]
    assert within(line, one[:0], 1.0).tolist() == [False] * 5
    assert within(one[:0], line, 1.0).shape == (0,)
