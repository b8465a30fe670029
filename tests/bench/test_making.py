"""`legoworld bench make`: cases of a reference scene, in two halves that cannot be mixed up."""

from __future__ import annotations

import json
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import legoworld
from legoworld import cli
from legoworld.bench import family as family_making
from legoworld.bench.family import MakeOptions, lost_family
from legoworld.cards import load_card
from legoworld.files import sha256_of_file
from legoworld.records.base import decode, to_record
from legoworld.records.bench_dataset import BenchTrackFile, BenchTruthFile, PictureCard
from legoworld.records.render_card import RenderCard
from legoworld.records.submission import BenchRow
from legoworld.scene.blender_process import BlenderProcess, Limits

QUICK = ["--size", "96x54", "--samples", "2", "--noise-seeds", "0", "-q"]


def make(scenes: Path, dataset: Path, *more: str) -> int:
    return cli.run(["bench", "make", str(scenes), "-o", str(dataset), *QUICK, *more])


def halves(dataset: Path) -> tuple[BenchTrackFile, BenchTruthFile]:
    track = decode(BenchTrackFile, (dataset / "public" / "track.json").read_bytes())
    truth = decode(BenchTruthFile, (dataset / "private" / "truth.json").read_bytes())
    return track, truth


@pytest.fixture(scope="module")
def made(references, tmp_path_factory):
    folder = tmp_path_factory.mktemp("made")
    assert make(references, folder / "bench", "--keep-scenes", str(folder / "itself")) == 0
    return folder


def test_tiers_and_views_are_cases(made):
    track, truth = halves(made / "bench")
    names = [image.file_name for image in track.images]
    assert names == sorted(
        f"den__{tier}__view_{view:02d}.png"
        for tier in ("easy", "medium", "hard")
        for view in (0, 1)
    )
    assert {(i.environment, i.theme, i.split) for i in track.images} == {("indoor", "shapes", None)}
    assert [c.name for c in track.categories] == ["box", "cube"]
    assert [i.id for i in track.images] == [1, 2, 3, 4, 5, 6]
    scored = {
        image.tier: {o.name for o in truth.images[str(image.id)].scored} for image in track.images
    }
    assert scored == {
        "easy": {"Red"}, "medium": {"Red", "Green"}, "hard": {"Red", "Green", "Blue"}
    }  # fmt: skip


def test_what_is_no_tier_stays_as_it_is(made):
    """Camera and everything that is not of a later tier are the same in every tier of a view."""
    track, truth = halves(made / "bench")
    by_view: dict[int, set[str]] = {}
    for image in track.images:
        one = truth.images[str(image.id)]
        by_view.setdefault(image.view, set()).add(str(one.camera))
    assert [len(cameras) for cameras in by_view.values()] == [1, 1]
    private = made / "bench" / "private"
    depth = {
        tier: np.load(private / "depth" / f"den__{tier}__view_00.npz")["depth_z_m"]
        for tier in ("easy", "medium", "hard")
    }
    assert (depth["medium"] <= depth["easy"]).all()
    assert (depth["hard"] <= depth["medium"]).all()
    assert (depth["medium"] < depth["easy"]).any()
    assert (depth["hard"] < depth["medium"]).any()


def test_nothing_private_is_readable_from_the_public_half(made):
    track, truth = halves(made / "bench")
    public, private = made / "bench" / "public", made / "bench" / "private"
    files = [p for p in public.rglob("*") if p.is_file()]
    assert {p.suffix for p in files} == {".json", ".png"}
    text = (public / "track.json").read_text("utf-8")
    secrets = {sha256_of_file(p) for p in private.rglob("*") if p.is_file()}
    for one in truth.images.values():
        secrets |= {getattr(one.sha256, name) for name in one.sha256.__struct_fields__}
        secrets |= {one.snapshot_sha256} | {o.name for o in one.scored}
    assert not [secret for secret in secrets if secret in text]
    # No hash at all: none of anything private can be hidden in it.
    assert not re.search(r"[0-9a-f]{32}", text)
    for path in files:
        if path.suffix == ".png":
            data = path.read_bytes()
            assert not [c for c in (b"tEXt", b"zTXt", b"iTXt", b"eXIf", b"tIME") if c in data]
    assert truth.track_sha256 == sha256_of_file(public / "track.json")
    assert set(truth.images) == {str(i.id) for i in track.images}


def test_hashes_of_the_private_half_are_of_its_files(made):
    track, truth = halves(made / "bench")
    for image in track.images:
        stem = image.file_name.removesuffix(".png")
        hashes = truth.images[str(image.id)].sha256
        private = made / "bench" / "private"
        assert hashes.reference == sha256_of_file(
            made / "bench" / "public" / "images" / image.file_name
        )
        assert hashes.depth == sha256_of_file(private / "depth" / f"{stem}.npz")
        assert hashes.instances == sha256_of_file(private / "instances" / f"{stem}.npz")
        assert hashes.raster == sha256_of_file(private / "raster" / f"{stem}.npz")


def test_the_reference_submitted_as_itself_has_its_own_surface(made):
    """Bit for bit: R is exactly 1 then, whatever the tolerance."""
    track = made / "bench" / "public" / "track.json"
    run = made / "run"
    arguments = ["readout", str(made / "itself"), "--task", "bench", "--track", str(track)]
    assert cli.run([*arguments, "-o", str(run), "--no-render", "-q"]) == 0
    for line in (run / "per_image.jsonl").read_bytes().splitlines():
        row = decode(BenchRow, line)
        assert row.valid is True, row
        raster = np.load(made / "bench" / "private" / "raster" / f"{row.scene}.npz")
        surface = np.load(run / row.surface.file)
        assert (surface["depth_z_m"] == raster["depth_z_m"]).all()
        assert (np.isfinite(raster["depth_z_m"]) == (raster["instance"] >= 0)).all()
        assert "own_depth_z_m" not in surface


def test_the_cameras_of_a_family_are_views_of_its_one_file(made, references):
    """The bytes of a file for each camera: the hard tier has every object."""
    family = legoworld.open_scene(references / "den")
    seen = family.views(["Camera", "Left"], size_wh=(96, 54))
    for number, view in enumerate(seen):
        stem = f"den__hard__view_{number:02d}"
        alone = legoworld.open_scene(made / "itself" / stem).view(size_wh=(96, 54))
        assert view.instance.tobytes() == alone.instance.tobytes()
        assert view.depth_z_m.tobytes() == alone.depth_z_m.tobytes()


def test_bytes_are_the_same_from_one_worker_and_two(references, made, build_scenes, tmp_path):
    """Two families, so that two workers have something to do; denoised pictures, too."""
    build_scenes("fresh(); quad('Q', category='leaf'); camera(); save('leaf')", tmp_path / "two")
    (tmp_path / "two" / "den").symlink_to(references / "den")
    for workers in ("1", "2"):
        place = tmp_path / workers
        assert make(tmp_path / "two", place, "--workers", workers, "--no-cache") == 0
    files = sorted(p.relative_to(tmp_path / "1") for p in (tmp_path / "1").rglob("*.*"))
    assert len(files) == 3 + 7 * 5 + 1  # both halves' lists and x.json; leaf's private picture
    for file in files:
        assert (tmp_path / "1" / file).read_bytes() == (tmp_path / "2" / file).read_bytes(), file
    again = made / "bench" / "private" / "raster" / "den__hard__view_01.npz"
    assert (tmp_path / "1" / again.relative_to(made / "bench")).read_bytes() == again.read_bytes()


def test_a_scene_that_cannot_become_cases_says_why_and_the_others_are_made(
    refused, tmp_path, capsys
):
    assert make(refused, tmp_path / "bench", "--json") == 1
    found = json.loads(capsys.readouterr().out)["families"]
    reasons = {f["family"]: f["reason"] for f in found}
    told = {
        "nothing_to_score": "no eligible object",
        "looks_away": "sees nothing",
        "no_hard": "hard has the objects of medium",
        "part_before_whole": "'Red' is of tier medium",
        "unknown_tier": "easy, medium or hard",
        "orthographic": "orthographic",
        "shifted": "shifted",
        "no_camera": "no view",
        "good": None,
    }
    assert set(reasons) == set(told)
    for family, words in told.items():
        assert (reasons[family] is None) if words is None else (words in reasons[family]), family
    track, _ = halves(tmp_path / "bench")
    assert [i.file_name for i in track.images] == ["good__view_00.png"]
    assert track.images[0].tier is None
    left = {p.stem for p in (tmp_path / "bench").rglob("*.npz")}
    assert left == {"good__view_00"}


def test_where_no_scene_becomes_a_case_nothing_is_written(tmp_path, monkeypatch, capsys):
    for name in ("b", "a"):
        (tmp_path / "scenes" / name).mkdir(parents=True)
        (tmp_path / "scenes" / name / "scene.blend").touch()

    def lose_each(_job, folders, _workers):
        yield from (lost_family(folder, "killed") for folder in reversed(folders))

    monkeypatch.setattr("legoworld.bench.dataset.ENGINES", {"local": lose_each})
    assert make(tmp_path / "scenes", tmp_path / "bench", "--json") == 1
    found = json.loads(capsys.readouterr().out)
    assert [f["family"] for f in found["families"]] == ["a", "b"]
    assert all("killed" in f["reason"] for f in found["families"])
    assert not [p for p in (tmp_path / "bench").rglob("*") if p.is_file()]


def test_a_dataset_is_never_written_over_by_chance(made, references, tmp_path, capsys):
    before = sha256_of_file(made / "bench" / "private" / "truth.json")
    assert make(references, made / "bench") == 2
    assert "--overwrite" in capsys.readouterr().err
    assert sha256_of_file(made / "bench" / "private" / "truth.json") == before
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "mine.txt").write_text("keep me", encoding="utf-8")
    assert make(references, tmp_path / "notes", "--overwrite") == 2
    assert (tmp_path / "notes" / "mine.txt").read_text("utf-8") == "keep me"
    (tmp_path / "empty").mkdir()
    assert make(tmp_path / "empty", tmp_path / "d") == 2
    assert "no scene" in capsys.readouterr().err


def tree(folder: Path) -> dict[str, str]:
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    return {p.relative_to(folder).as_posix(): sha256_of_file(p) for p in files}


def test_the_same_command_resumes_what_ended_early_from_its_renders(
    made, references, tmp_path, monkeypatch, capsys
):
    """Ended before the fourth of six pictures: three are kept, and the bytes are the same."""
    place, cache = tmp_path / "bench", ["--cache", str(tmp_path / "cache"), "--workers", "1"]
    asked: list[str] = []
    request = BlenderProcess.request

    def counted(self: BlenderProcess, message: dict) -> dict:
        if message["kind"] == "card_render":
            if len(asked) == 3 and "resumed" not in asked:
                raise KeyboardInterrupt
            asked.append("render")
        return request(self, message)

    monkeypatch.setattr(BlenderProcess, "request", counted)
    assert make(references, place, *cache) == 130
    assert not (place / "public" / "track.json").exists()
    asked.append("resumed")
    assert make(references, place, *cache) == 0
    assert len(asked) == 3 + 1 + 3
    assert tree(place) == tree(made / "bench")
    capsys.readouterr()
    quiet = [word for word in QUICK if word != "-q"]
    assert cli.run(["bench", "make", str(references), "-o", str(tmp_path / "again"), *quiet]) == 0
    said = capsys.readouterr().err
    assert said.count("picture, 2 samples") == 6


def test_a_render_has_time_for_its_samples(made, monkeypatch):
    """The default of docs/bench.md, 1920x1080 with 128 samples, on a slow core."""
    options = MakeOptions(
        output=made,
        size_wh=(1920, 1080),
        picture=PictureCard(engine="CYCLES", device="CPU", samples=128, seed=0, denoised=True),
        card=to_record(RenderCard, load_card("bench").value("render")),
        delta=30,
        noise_seeds=3,
        scenes=None,
        cache=None,
        require_frozen=False,
        threads=1,
    )
    assert options.render_s == 1920 * 1080 * 128 / 50_000
    started, closed = [], []
    monkeypatch.setattr(
        family_making,
        "BlenderProcess",
        lambda limits: started.append(limits) or SimpleNamespace(close=lambda: closed.append(1)),
    )
    maker = family_making.FamilyMaker(options, Limits(time_s=100.0))
    maker.close()
    assert [limits.time_s for limits in started] == [100.0 + options.render_s]
    assert closed == [1], "it ends with its maker"
