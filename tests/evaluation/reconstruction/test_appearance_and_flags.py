"""A's pictures, and the flags that a person should look at; a flag changes no score."""

from __future__ import annotations

import io
import json

import numpy as np
import pytest
from evaluation.reconstruction.datasets import (
    NOTHING,
    Submission,
    evaluate_bench,
    write_dataset,
    write_run,
)
from msgspec.structs import replace
from PIL import Image

from legoworld.evaluation.reconstruction import appearance, picture_cache
from legoworld.evaluation.reconstruction.protocol import bench_protocol
from legoworld.records.submission import CameraPlane, ImageTexture, TextBlock


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return write_dataset(tmp_path_factory.mktemp("bench"), views=2, tiers=("easy",))


def rows_of(dataset, run, output):
    summary = evaluate_bench(run, dataset.private, output, draws=20)
    lines = (output / "per_image.jsonl").read_text().splitlines()
    return summary, {row["image_id"]: row for row in map(json.loads, lines)}


def kinds(row):
    return [flag["kind"] for flag in row["flags"]]


def texture(name="photo.png", users=("material",), thumbnail=0):
    return ImageTexture(name=name, path=name, size_wh=(64, 36), packed=True, generated=False,
                        absolute_path=False, thumbnail=thumbnail, users=users)  # fmt: skip


def reference_thumbnail(dataset, image_id=1):
    path = dataset.root / "public" / "images" / str(dataset.cases[image_id].image.file_name)
    with Image.open(path) as opened:
        return np.asarray(opened.resize((64, 36), Image.Resampling.LANCZOS))


def test_the_resize_is_pillow_s_lanczos():
    random = np.random.default_rng(0)
    picture = random.integers(0, 256, (108, 192, 3), dtype=np.uint8)
    ours = appearance.resize_picture(picture, (51, 29))
    theirs = Image.fromarray(picture).resize((51, 29), Image.Resampling.LANCZOS)
    np.testing.assert_array_equal(ours, np.asarray(theirs))
    assert appearance.resize_picture(picture, (192, 108)) is picture


def test_the_curve_never_falls_and_holds_a():
    random = np.random.default_rng(1)
    a, b = random.integers(0, 256, (2, 40, 50, 3), dtype=np.uint8)
    found = appearance.agreement(a, b)
    slow = np.abs(a.astype(int) - b.astype(int)).max(axis=-1)
    np.testing.assert_array_equal(found.largest, slow)
    curve = appearance.curve(found, 30)
    assert list(curve.values()) == sorted(curve.values())
    assert curve["30"] == found.share(30) == float(np.mean(slow <= 30))


def test_a_damaged_or_foreign_cache_entry_changes_nothing(tmp_path, monkeypatch):
    monkeypatch.setenv("LEGOWORLD_CACHE", str(tmp_path))
    picture = np.random.default_rng(2).integers(0, 256, (36, 64, 3), dtype=np.uint8)
    stream = io.BytesIO()
    Image.fromarray(picture).save(stream, format="PNG")
    first = picture_cache.resized_reference(stream.getvalue(), "ab", (16, 9))
    (entry,) = tmp_path.rglob("*.npy")
    again = picture_cache.resized_reference(b"not read", "ab", (16, 9))
    np.testing.assert_array_equal(again, first)
    whole = entry.read_bytes()
    for damaged in (b"", whole[:-70], whole[:200] + b"x" + whole[201:]):
        entry.write_bytes(damaged)
        again = picture_cache.resized_reference(stream.getvalue(), "ab", (16, 9))
        np.testing.assert_array_equal(again, first)


@pytest.mark.parametrize(
    ("users", "kind"), [(("material",), "picture_in_scene"), (("world",), "picture_in_world")]
)
def test_the_reference_as_a_texture_is_flagged_mirrored_too(dataset, tmp_path, users, kind):
    thumbnail = reference_thumbnail(dataset)[None]
    facts = replace(NOTHING, images=(texture(users=users),))
    for place, shown in enumerate((thumbnail, thumbnail[:, :, ::-1])):
        submission = Submission(integrity=facts, extra={"textures": shown})
        run = write_run(tmp_path / f"run{place}", dataset, {1: submission})
        summary, rows = rows_of(dataset, run, tmp_path / f"eval{place}")
        assert kinds(rows[1]) == [kind]
        assert rows[1]["flags"][0]["measured"] > 0.9
        assert rows[1]["S"] == 1.0  # reported, never punished
        assert [flag.image_id for flag in summary.flags] == [1]
        assert kinds(rows[2]) == []


def test_an_ordinary_texture_is_not_flagged(dataset, tmp_path):
    noise = np.random.default_rng(0).integers(0, 256, (2, 36, 64, 3), dtype=np.uint8)
    noise[1] = 90
    facts = replace(NOTHING, images=(texture(), texture("flat.png", thumbnail=1)))
    submission = Submission(integrity=facts, extra={"textures": noise})
    _, rows = rows_of(dataset, write_run(tmp_path / "run", dataset, {1: submission}),
                      tmp_path / "eval")  # fmt: skip
    assert kinds(rows[1]) == []


def test_a_plane_that_owns_a_s_hits_is_flagged_with_its_share(dataset, tmp_path):
    case = dataset.cases[1]
    plane = np.full(case.depth_z_m.shape, -1, np.int16)
    plane[:, : plane.shape[1] // 2] = 0
    facts = replace(
        NOTHING, planes=(CameraPlane(object="Billboard", tilt_deg=1.0, share=0.5, images=()),)
    )
    submission = Submission(integrity=facts, extra={"plane": plane})
    _, rows = rows_of(dataset, write_run(tmp_path / "run", dataset, {1: submission}),
                      tmp_path / "eval")  # fmt: skip
    (flag,) = rows[1]["flags"]
    assert (flag["kind"], flag["measured"]) == ("camera_facing_planes", 0.5)
    assert "Billboard" in flag["what"]
    plane[plane == 0] = 1  # which the run says nothing of
    submission = Submission(integrity=facts, extra={"plane": plane})
    _, rows = rows_of(dataset, write_run(tmp_path / "other", dataset, {1: submission}),
                      tmp_path / "eval2")  # fmt: skip
    assert [flag["what"] for flag in rows[1]["flags"]] == ["a plane first of 1"]


def test_texts_drivers_and_compositor_nodes_are_counted(dataset, tmp_path):
    facts = replace(
        NOTHING, texts=(TextBlock(name="run.py", characters=9, registers=True),), drivers=3,
        compositor_nodes=("CompositorNodeImage",),
    )  # fmt: skip
    run = write_run(tmp_path / "run", dataset, {1: Submission(integrity=facts)})
    _, rows = rows_of(dataset, run, tmp_path / "eval")
    assert kinds(rows[1]) == ["compositor_nodes", "text_blocks", "drivers"]


def test_a_picture_without_its_geometry_is_flagged(dataset, tmp_path):
    far = np.full_like(dataset.cases[1].depth_z_m, 80.0)
    run = write_run(tmp_path / "run", dataset, {1: Submission(depth_z_m=far)})
    _, rows = rows_of(dataset, run, tmp_path / "eval")
    assert kinds(rows[1]) == ["appearance_without_geometry"]
    assert rows[1]["A"] == 1.0


def test_a_second_view_that_falls_is_flagged(dataset, tmp_path):
    second = dataset.cases[2]
    assert second.image.view == 1
    run = write_run(tmp_path / "run", dataset, {2: Submission(render=255 - second.render)})
    summary, _ = rows_of(dataset, run, tmp_path / "eval")
    (flag,) = summary.flags
    assert (flag.kind, flag.image_id) == ("view_drop", 2)
    assert flag.measured >= bench_protocol().flags.view_drop


@pytest.mark.parametrize("data", [b"", b"\x89PNG\r\n\x1a\n", b"GIF89a", b"x" * 99])
def test_what_is_no_picture_is_refused(data):
    with pytest.raises(appearance.PictureError):
        appearance.decode_picture(data)
