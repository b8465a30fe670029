"""Pictures pixel by pixel: colours of depth and of instances, outlines, boxes and names."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from legoworld.errors import LegoWorldError
from legoworld.readouts.pictures import (
    _color,
    _edges,
    _tint,
    depth_picture,
    instance_picture,
    overlay,
    read_photo,
    write_png,
)
from legoworld.records.scene_folder import InstanceRow

#: Of ids 0, 1 and 2: hues .08, .698 and .316 (the fraction of .08 + n * .618034).
COLORS = [(255, 156, 64), (100, 64, 255), (84, 255, 64)]


def row(number: int, category: str | None, box: tuple[int, int, int, int], area: int = 1):
    return InstanceRow(
        id=number,
        name=f"thing {number}",
        objects=("Thing",),
        category=category,
        category_id=None,
        labelled=category is not None,
        area_px=area,
        bbox_xywh_px=box,
        nested_in=None,
        reason=None,
    )


def test_a_written_picture_is_read_as_it_was(tmp_path):
    picture = np.random.default_rng(0).integers(0, 256, (5, 7, 3), np.uint8)
    write_png(tmp_path / "a.png", picture)
    assert np.array_equal(read_photo(tmp_path / "a.png"), picture)
    stored = cv2.imread(str(tmp_path / "a.png"))
    assert np.array_equal(stored[:, :, ::-1], picture)  # red first here, blue first there


def test_a_file_that_is_no_picture_is_named(tmp_path):
    (tmp_path / "photo.jpg").write_text("no picture")
    with pytest.raises(LegoWorldError, match=r"photo\.jpg is not an image"):
        read_photo(tmp_path / "photo.jpg")


def test_a_picture_that_cannot_be_encoded_is_an_error(tmp_path):
    with pytest.raises((LegoWorldError, cv2.error)):
        write_png(tmp_path / "a.png", np.zeros((0, 4, 3), np.uint8))
    assert not (tmp_path / "a.png").exists()


def test_depth_is_red_near_and_blue_far_and_grey_where_there_is_none():
    depth = np.array([[1.0, 1.0, 2.0, 4.0, 4.0, np.inf, 0.0, -1.0, np.nan]], np.float32)
    picture = depth_picture(depth)
    assert picture.dtype == np.uint8
    assert picture[0, 0].tolist() == picture[0, 1].tolist() == [158, 1, 66]
    assert picture[0, 3].tolist() == picture[0, 4].tolist() == [94, 79, 162]
    assert picture[0, 5:].tolist() == [[40, 40, 40]] * 4
    # Inverse depth: 1/2 is 2/3 of the way from 1 to 1/4, between the sixth and the seventh
    # colours after the first.
    share = 2 / 3 * 10 - 6
    between = (np.array([230, 245, 152]) * (1 - share) + np.array([171, 221, 164]) * share).round()
    assert picture[0, 2].tolist() == between.tolist()


def test_the_map_is_colorbrewer_s_spectral():
    colors = [
        (158, 1, 66), (213, 62, 79), (244, 109, 67), (253, 174, 97), (254, 224, 139),
        (255, 255, 191), (230, 245, 152), (171, 221, 164), (102, 194, 165), (50, 136, 189),
        (94, 79, 162),
    ]  # fmt: skip
    # Many pixels at both ends, so that the percentiles are the ends.
    inverse = np.concatenate([np.full(100, 1.0), np.linspace(1, 0.5, 11), np.full(100, 0.5)])
    picture = depth_picture((1 / inverse).astype(np.float32)[None])
    assert np.abs(picture[0, 100:111] - np.array(colors)).max() <= 1  # depth is rounded to float32


def test_percentiles_cut_what_is_far_off():
    depth = np.geomspace(1, 2, 1000, dtype=np.float32)[None]
    depth[0, :5], depth[0, -5:] = 1e-3, 1e6
    picture = depth_picture(depth)
    assert picture[0, 0].tolist() == [158, 1, 66]
    assert picture[0, -1].tolist() == [94, 79, 162]
    assert len(np.unique(picture[0, 20:-20], axis=0)) > 200  # the middle keeps the whole map


def test_depth_of_one_value_and_of_none():
    assert (depth_picture(np.full((2, 2), 3.0, np.float32)) == (158, 1, 66)).all()
    assert (depth_picture(np.full((2, 2), np.inf, np.float32)) == 40).all()


def test_instances_have_a_colour_each_on_black():
    picture = instance_picture(np.array([[-1, 0, 1, 2]], np.int32))
    assert picture[0].tolist() == [[0, 0, 0], *([c // 2 for c in color] for color in COLORS)]
    assert instance_picture(np.full((1, 2), -1, np.int32)).tolist() == [[[0, 0, 0]] * 2]


#: Two instances side by side in a picture of 60 x 40: 0 in the left part, 1 right of it.
IDS = np.full((40, 60), -1, np.int32)
IDS[10:30, 5:25] = 0
IDS[10:30, 25:45] = 1


def test_a_labelled_instance_is_tinted_and_outlined():
    ground = np.full((40, 60, 3), 100, np.uint8)
    drawn = overlay(ground, IDS, [row(0, "cup", (5, 10, 20, 20))])
    color = np.array(COLORS[0])
    tint = (100 * 0.72 + color * 0.28).astype(np.uint8)
    assert drawn[27, 15].tolist() == tint.tolist()
    for edge in ((15, 24), (29, 10), (29, 24), (28, 5)):
        assert drawn[edge].tolist() == color.tolist()
    assert drawn[35, 50].tolist() == [100, 100, 100]
    assert drawn[27, 40].tolist() == [100, 100, 100]  # the other one is no row
    assert (ground == 100).all()


def test_an_unlabelled_instance_has_a_faint_outline_alone():
    ground = np.full((40, 60, 3), 100, np.uint8)
    drawn = overlay(ground, IDS, [row(1, None, (25, 10, 20, 20))])
    outline = np.zeros((40, 60), bool)
    outline[10:30, 25:45] = True
    outline[11:29, 26:44] = False
    assert (drawn[outline] == 100 // 2 + 64).all()
    assert (drawn[~outline] == 100).all()


def test_an_instance_without_pixels_is_not_drawn():
    ground = np.full((40, 60, 3), 100, np.uint8)
    unseen = [row(0, "cup", (0, 0, 0, 0), area=0), row(1, None, (0, 0, 0, 0), area=0)]
    assert np.array_equal(overlay(ground, IDS, unseen), ground)


def test_the_box_is_its_pixels_and_its_name_stays_inside():
    ground = np.zeros((200, 200, 3), np.uint8)
    ids = np.full((200, 200), -1, np.int32)
    drawn = overlay(ground, ids, [row(0, "cup", (100, 120, 50, 60))])
    color = list(COLORS[0])
    for y, x in ((179, 100), (179, 149), (150, 100), (150, 149)):
        assert drawn[y, x].tolist() == color
    assert (drawn[180:] == 0).all()
    assert (drawn[:, 150:] == 0).all()
    assert (drawn[140:179, 101:149] == 0).all()  # its inside, below the name
    name = (drawn[121:130, 101:140] != color).any(axis=2)
    assert name.any()  # dark letters on the bright colour
    (width, height), base = cv2.getTextSize("0 cup", cv2.FONT_HERSHEY_SIMPLEX, 0.4, 1)
    low = overlay(ground, ids, [row(0, "cup", (190, 195, 5, 3))])
    drawn_rows, drawn_columns = np.nonzero(low.any(axis=2))
    assert drawn_rows.min() == 200 - height - base - 2
    assert drawn_columns.min() == 200 - width - 2


def test_the_smaller_one_is_drawn_over_the_larger():
    ground = np.zeros((200, 200, 3), np.uint8)
    ids = np.full((200, 200), -1, np.int32)
    large, small = row(0, "a", (50, 50, 20, 90), 900), row(1, "b", (50, 60, 90, 20), 400)
    for rows in ([large, small], [small, large]):
        # Where the two boxes' edges cross.
        assert overlay(ground, ids, rows)[79, 69].tolist() == list(COLORS[1])


def test_letters_are_dark_on_every_colour():
    ground = np.full((60, 90, 3), 255, np.uint8)
    ids = np.full((60, 90), -1, np.int32)
    for number in range(40):
        drawn = overlay(ground, ids, [row(number, "mm", (10, 10, 60, 40))])
        assert drawn.sum(axis=2).min() < 200, number  # the colours add up to 383 and more


def test_colouring_in_one_pass_is_colouring_each_instance():
    rng = np.random.default_rng(3)
    ids = rng.integers(-1, 40, (300, 20)).astype(np.int32).repeat(2, axis=1)
    ground = rng.integers(0, 256, (300, 40, 3)).astype(np.uint8)
    names = ["cup", None, "chair"]
    entries = [row(i, names[i % 3], (0, 0, 1, 1), area=i % 7) for i in range(0, 60, 2)]
    expected, edges = ground.copy(), _edges(ids)
    for entry in entries:
        mask = (ids == entry.id) if entry.area_px else np.zeros(ids.shape, bool)
        if entry.category is None:
            expected[edges & mask] = expected[edges & mask] // 2 + 64
        else:
            color = np.array(_color(entry.id))
            expected[mask] = (expected[mask] * 0.72 + color * 0.28).astype(np.uint8)
            expected[edges & mask] = color
    drawn = ground.copy()
    _tint(drawn, ids, [e for e in entries if e.area_px])
    assert np.array_equal(drawn, expected)
