"""Label maps from buffers made by hand: segments, classes, sky, files, and what is said."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from PIL import Image
from readouts.made_views import view_of
from strategies import id_pictures

from legoworld.errors import UsageError
from legoworld.evaluation.label_maps.png import read_ids, read_values
from legoworld.readouts import panoptic, semantic
from legoworld.readouts.family import AnsweredImage, protocol
from legoworld.readouts.label_maps import (
    NO_CLASS,
    VOID,
    category_color,
    category_map,
    category_picture,
    picture_categories,
    segment_map,
    segment_picture,
)
from legoworld.records.run_rows import RunRow
from legoworld.scene.instances import Instance

READING = protocol("coco-panoptic", None)
NAMES = ("person", "wall", None, "person", "wall", "floor", "sky", "car", "bench")
ROW = RunRow(image_id=4, file_name="a.jpg", scene="a", status="ok", size_wh=(6, 4))


def instances(*names):
    found = [READING.vocabulary.match(name) if name else None for name in names]
    return [
        Instance(id=i, name=f"{name} {i}", objects=(f"{i}b", f"{i}a"), category=c, label_text=name)
        for i, (name, c) in enumerate(zip(names, found, strict=True))
    ]


def answer_image(ids, names, tmp_path, **more):
    shown = np.array(ids, np.int32)
    return AnsweredImage(
        image_id=4,
        name="a",
        run=tmp_path,
        instances=instances(*names),
        view=view_of(shown, len(names)),
        vocabulary=READING.vocabulary,
        **more,
    )


@given(id_pictures())
def test_every_labelled_pixel_is_in_one_segment_of_its_category(shown):
    every = instances(*NAMES)
    made = segment_map(view_of(shown, len(NAMES)), every, None)
    of_segment = {s.id: s for s in made.segments}
    assert [s.id for s in made.segments] == [*range(1, len(made.segments) + 1)]
    for row, col in np.ndindex(shown.shape):
        number = int(shown[row, col])
        category = every[number].category if number >= 0 else None
        segment = of_segment.get(int(made.ids[row, col]))
        assert (segment is None) == (category is None)
        assert category is None or segment.category_id == category.id
    for segment, members in zip(made.segments, made.members, strict=True):
        rows, cols = np.nonzero(made.ids == segment.id)
        x, y, w, h = segment.bbox
        assert segment.area == len(rows)
        assert (x, y, x + w, y + h) == (
            cols.min(), rows.min(), cols.max() + 1, rows.max() + 1,
        )  # fmt: skip
        assert len(members) == 1 or not every[members[0]].category.isthing
    stuff = [s.category_id for s in made.segments if s.category_id > 90]
    assert len(stuff) == len(set(stuff))


@given(id_pictures())
def test_the_order_of_the_instances_changes_nothing(shown):
    n = len(NAMES)
    turned = np.where(shown < 0, -1, n - 1 - shown).astype(np.int32)
    one = segment_map(view_of(shown, n), instances(*NAMES), None)
    other = segment_map(
        view_of(turned, n), [replace(i, id=k) for k, i in enumerate(instances(*NAMES)[::-1])], None
    )
    assert (one.ids == other.ids).all()
    assert one.segments == other.segments


def test_unlabelled_and_empty_pixels_are_void_and_sky_is_asked_for():
    view = view_of(np.array([[-1, -1, 2], [0, 1, 1]], np.int32), 3)
    plain = segment_map(view, instances("person", "wall", None), None)
    assert plain.ids.tolist() == [[VOID, VOID, VOID], [1, 2, 2]]
    sky = READING.category("sky", "--sky")
    made = segment_map(view, instances("person", "wall", None), sky)
    assert made.ids.tolist() == [[2, 2, VOID], [1, 3, 3]]
    assert [(s.category_id, s.area, s.bbox) for s in made.segments] == [
        (1, 1, (0, 1, 1, 1)), (187, 2, (0, 0, 2, 1)), (199, 2, (1, 1, 2, 1)),
    ]  # fmt: skip
    labelled = segment_map(view, instances("person", "wall", "sky"), sky)
    assert labelled.ids.tolist() == [[2, 2, 2], [1, 3, 3]]
    classes = category_map(view, instances("person", "wall", None), READING.vocabulary, sky)
    assert classes.tolist() == [[187, 187, NO_CLASS], [1, 199, 199]]
    with pytest.raises(UsageError, match="--sky names no category of coco-panoptic; found: 'nil'"):
        READING.category("nil", "--sky")


def test_background_is_what_shows_no_class_where_there_is_one():
    voc = protocol("voc-semantic", None).vocabulary
    every = [
        replace(one, category=voc.match(name))
        for one, name in zip(instances(None, None, None), ("couch", "TV", "bench"), strict=True)
    ]
    shown = np.array([[0, 1, 2, -1]], np.int32)
    assert category_map(view_of(shown, 3), every, voc, None).tolist() == [[18, 20, 0, 0]]


def test_the_files_of_an_image_and_of_one_that_failed(tmp_path):
    ids = [[0, 0, 1, 1, 2, -1]] * 2 + [[3, 3, 1, 4, 4, -1]] * 2
    image = answer_image(ids, NAMES[:5], tmp_path)
    row = panoptic.READOUT.write(ROW, image)
    assert row.files == [row.answer]
    assert row.answer.bytes <= panoptic.READOUT.file_bytes((6, 4))
    stored = read_ids(tmp_path / row.answer.file, ValueError)
    assert stored.tolist() == [[1, 1, 3, 3, 0, 0]] * 2 + [[2, 2, 3, 3, 3, 0]] * 2
    assert [(e.name, e.category, e.objects) for e in row.exported] == [
        ("person 0", "person", ("0b", "0a")[::-1]),
        ("person 3", "person", ("3a", "3b")),
        ("wall-other-merged", "wall-other-merged", ("1a", "1b", "4a", "4b")),
    ]
    failed = RunRow(image_id=2, file_name="b/c.jpg", scene="b/c", status="invalid", size_wh=(3, 2))
    unsized = RunRow(image_id=9, file_name="d.jpg", scene="d", status="missing")
    panoptic.write_segments_file(tmp_path, [row, failed, unsized])
    entries = json.loads((tmp_path / "answer.json").read_text())["annotations"]
    assert [(e["image_id"], e["file_name"]) for e in entries] == [(2, "b/c.png"), (4, "a.png")]
    assert entries[0]["segments_info"] == []
    assert entries[1]["segments_info"][2] == {
        "id": 3, "category_id": 199, "area": 10, "bbox": [2, 0, 3, 4], "iscrowd": 0,
    }  # fmt: skip
    assert read_ids(tmp_path / "answer/b/c.png", ValueError).tolist() == [[0, 0, 0]] * 2
    classes = semantic.READOUT.write(ROW, image)
    values = read_values(tmp_path / classes.answer.file, ValueError)
    assert values.tolist() == [[1, 1, 199, 199, 255, 255]] * 2 + [[1, 1, 199, 199, 199, 255]] * 2


def test_ten_thousand_things_are_ten_thousand_segments(tmp_path):
    shown = np.arange(10_000, dtype=np.int32).reshape(100, 100)
    row = panoptic.READOUT.write(ROW, answer_image(shown, ["car"] * 10_000, tmp_path))
    assert (read_ids(tmp_path / row.answer.file, ValueError) == shown + 1).all()
    assert row.segments[-1].id == 10_000


def test_a_scene_without_stuff_is_told_so(tmp_path):
    def said(names, **more):
        image = answer_image([[*range(len(names)), -1]], names, tmp_path, **more)
        return panoptic.READOUT.write(ROW, image).warnings

    (only,) = said(("person", None))
    assert only.startswith("things only: no visible stuff has a label")
    assert said(("person", "grass")) == said((None,)) == ()
    assert said(("person",), sky=READING.category("sky", "--sky")) == ()


def test_a_picture_tells_things_of_a_category_apart_and_shows_their_borders(tmp_path):
    made = segment_map(view_of(np.array([[0, 0, 1, 1, -1]] * 3, np.int32), 2),
                       instances("car", "car"), None)  # fmt: skip
    picture = segment_picture(made.ids, [s.category_id for s in made.segments])
    assert picture[0, 0].tolist() == [*category_color(3)]
    assert picture[0, 1].tolist() == [255, 255, 255]
    assert picture[0, 2].tolist() not in ([*category_color(3)], [255, 255, 255])
    assert picture[0, 4].tolist() == [0, 0, 0]
    assert panoptic.READOUT.picture(answer_image([[0, -1]], ["car"], tmp_path)).shape == (1, 2, 3)
    assert semantic.READOUT.picture(answer_image([[0, -1]], ["car"], tmp_path)).shape == (1, 2, 3)


def test_a_picture_tells_its_categories():
    place, ids = np.array([[1, 1, 2, 2, 3, 3, 0, 0]]), [7, 7, 200]
    found = picture_categories(segment_picture(place, ids), [7, 9, 200])
    assert found.tolist() == [[7, -2, 7, -2, 200, -2, -1, -1]]
    every = np.arange(255).reshape(15, 17)
    assert (picture_categories(category_picture(every), range(255)) == every).all()


def test_pngs_of_other_kinds_are_refused(tmp_path):
    Image.fromarray(np.zeros((2, 2), np.uint8)).save(tmp_path / "grey.png")
    Image.fromarray(np.zeros((2, 2, 3), np.uint8)).save(tmp_path / "rgb.png")
    (tmp_path / "cut.png").write_bytes((tmp_path / "rgb.png").read_bytes()[:50])
    (tmp_path / "text.png").write_text("no picture")
    palette = Image.fromarray(np.array([[0, 15]], np.uint8), mode="P")
    palette.putpalette([0, 0, 0] * 15 + [192, 128, 128])
    palette.save(tmp_path / "palette.png")
    assert read_values(tmp_path / "palette.png", ValueError).tolist() == [[0, 15]]
    for read, name in ((read_ids, "grey"), (read_values, "rgb"), (read_ids, "cut"),
                       (read_ids, "text"), (read_ids, "absent")):  # fmt: skip
        with pytest.raises(UsageError, match=f"{name}.png cannot be read"):
            read(tmp_path / f"{name}.png", UsageError)
