"""LEGO-Bench's two halves as types, and the raster they share."""

from __future__ import annotations

import math
import re

import pytest

from legoworld.cards import load_card
from legoworld.records.base import RecordError, as_json, canonical, decode
from legoworld.records.bench_dataset import BenchTrackFile, BenchTruthFile
from legoworld.records.render_card import RenderCard
from legoworld.records.submission import Check, Validity
from legoworld.tracks.track import load_track
from legoworld.visibility.scoring_raster import (
    POINT_CAP,
    on_raster,
    picture_projection,
    raster_size,
)

IMAGE = (
    '{"id": 1, "file_name": "den__easy__view_00.png", "width": 64, "height": 36, '
    '"hfov_deg": 50.0, "family": "den", "environment": "indoor", "theme": null, "split": null, '
    '"tier": "easy", "view": 0%s}'
)
TRACK = (
    '{"info": {"description": "d", "task": "bench", "card_version": "1.0.0", "picture": '
    '{"engine": "CYCLES", "device": "CPU", "samples": 8, "seed": 0, "denoised": true}}, '
    '"images": [%s], "categories": [{"id": 1, "name": "chair"}]}'
)


def test_a_bench_track_is_a_track(tmp_path):
    path = tmp_path / "track.json"
    path.write_text(TRACK % (IMAGE % ""), encoding="utf-8")
    track = decode(BenchTrackFile, path.read_bytes())
    assert track.images[0].tier == "easy"
    assert decode(BenchTrackFile, canonical(track)) == track
    read = load_track(path)
    assert read.images[0].scene == "den__easy__view_00"
    assert read.made_for == "bench"


@pytest.mark.parametrize(
    ("wrong", "told"),
    [(', "tier": "huge"', "tier"), (', "view": -1', "view"), (', "hfov_deg": 180', "hfov_deg")],
)
def test_a_track_edited_by_hand_says_where_it_is_wrong(wrong, told):
    with pytest.raises(RecordError, match=re.escape(f"$.images[0].{told}")):
        decode(BenchTrackFile, TRACK % (IMAGE % wrong))


def test_nothing_of_the_private_half_is_a_field_of_the_public_one():
    private = {*BenchTruthFile.__struct_fields__, "scored", "camera", "sha256", "depth"}
    public = {*BenchTrackFile.__struct_fields__, *as_json_keys(TRACK % (IMAGE % ""))}
    assert private & public <= {"images", "task", "card_version"}


def as_json_keys(text: str) -> set[str]:
    return set(re.findall(r'"(\w+)":', canonical(decode(BenchTrackFile, text))))


def test_every_check_decides_over_v():
    good = {name: Check(ok=True) for name in Validity.__struct_fields__}
    assert Validity(**good).valid
    for name in good:
        assert not Validity(**{**good, name: Check(ok=False)}).valid


def test_the_card_holds_a_render_card():
    card = decode(RenderCard, canonical(load_card("bench").value("render")))
    assert as_json(card) == load_card("bench").value("render")


def test_the_card_states_the_raster_the_code_makes():
    assert load_card("bench").value("raster.point_cap") == POINT_CAP
    assert raster_size((1920, 1080)) == raster_size((3840, 2160)) == (421, 237)
    assert raster_size((30_000, 1)) == (54_772, 1)  # 1.8 rows: two would pass the cap
    for width in (1, 3, 7, 100, 640, 1000, 4096):
        for height in (1, 5, 99, 480, 1000, 3000):
            columns, rows = raster_size((width, height))
            assert 1 <= columns * rows <= max(POINT_CAP, columns)


def test_picture_and_raster_share_the_rays_of_their_edges():
    size, raster = (1920, 1080), (421, 237)
    picture = picture_projection(size, 50.0, z_near=0.1, z_far=100.0)
    assert math.isclose(math.degrees(2 * math.atan(picture.cx / picture.fx)), 50.0)
    small = on_raster(picture, size, raster)
    for x in (0, size[0]):
        there = x * raster[0] / size[0]
        assert math.isclose((x - picture.cx) / picture.fx, (there - small.cx) / small.fx)
    for y in (0, size[1]):
        there = y * raster[1] / size[1]
        assert math.isclose((y - picture.cy) / picture.fy, (there - small.cy) / small.fy)
