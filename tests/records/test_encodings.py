"""JSON of strangers, wherever it is read: encodings, byte order marks, halves of surrogates."""

from __future__ import annotations

import codecs
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from legoworld import cli
from legoworld.baselines.results_file import read_results
from legoworld.errors import CatalogError, LegoWorldError
from legoworld.evaluation.depth.arrays import read_declaration
from legoworld.files import EncodingError, utf8_text
from legoworld.records.base import (
    Record,
    RecordError,
    decode,
    decode_foreign,
    decode_lines,
    read_json,
)
from legoworld.records.track import TrackFile
from legoworld.scene.labels import read_labels_file
from legoworld.track_making.annotations import annotation_source
from legoworld.tracks import vocabulary
from legoworld.tracks.track import load_track

IMAGES = [{"id": 1, "file_name": "a.png", "width": 8, "height": 6}]
CATEGORIES = [{"id": 1, "name": "cat"}]
TRACK: dict[str, Any] = {"info": {}, "images": IMAGES, "categories": CATEGORIES}
LABELS: dict[str, Any] = {"version": 1, "labels": [{"object": "A", "category": "cat"}]}
RESULTS = [{"image_id": 1, "category_id": 1, "bbox": [0, 0, 2, 2], "score": 1.0}]


def truth(path: Path) -> object:
    return annotation_source("coco", path)


READERS: dict[str, tuple[Callable[[Path], object], Any]] = {
    "track.json": (load_track, TRACK),
    "labels.json": (read_labels_file, LABELS),
    "truth.json": (truth, TRACK),
    "results.json": (read_results, RESULTS),
    "vocabulary.json": (vocabulary.load, CATEGORIES),
}


@pytest.mark.parametrize("name", READERS)
def test_a_utf8_byte_order_mark_is_left_out_and_another_encoding_is_named(
    name: str, tmp_path: Path
) -> None:
    read, value = READERS[name]
    path, text = tmp_path / name, json.dumps(value)
    path.write_bytes(codecs.BOM_UTF8 + text.encode())
    read(path)
    for encoding, said in (
        ("utf-16", "UTF-16 text"), ("utf-32", "UTF-32 text"), ("utf-16-be", "UTF-16 text or no"),
    ):  # fmt: skip
        path.write_bytes(text.encode(encoding))
        with pytest.raises(LegoWorldError, match=f"it is {said}.*save it again as UTF-8"):
            read(path)
    path.write_bytes(text.encode().replace(b'"cat"', b'"c\xe4t"').replace(b"bbox", b"b\xe4x"))
    with pytest.raises(LegoWorldError, match=r"it is not UTF-8: .* byte 0xe4 at position \d+"):
        read(path)


@pytest.mark.parametrize("name", READERS)
@pytest.mark.parametrize("half", [r"\ud800", r"\udc00", r"\ud800\ud83d\ude00", r"\ud800x"])
def test_half_of_a_surrogate_pair_is_refused_with_its_place(
    name: str, half: str, tmp_path: Path
) -> None:
    read, value = READERS[name]
    path, text = tmp_path / name, json.dumps(value, indent=1)
    sound = "bbox" if name == "results.json" else "cat"
    path.write_text(text.replace(sound, rf"\\ud800\ud83d\ude00{half}"))
    with pytest.raises(LegoWorldError, match=r"half of a surrogate pair, .u\w+: line \d+ column"):
        read(path)


def test_a_whole_pair_and_an_escaped_backslash_are_text() -> None:
    assert read_json(rb'["\ud83d\ude00", "\\ud800", 1]') == ["\U0001f600", r"\ud800", 1]
    with pytest.raises(RecordError, match="NaN, infinity"):
        decode(object, b"NaN")


def test_lines_begin_with_a_mark_too(tmp_path: Path) -> None:
    assert decode_lines(dict[str, int], codecs.BOM_UTF8 + b'{"a": 1}\n{"a": 2}\n')[0] == {"a": 1}
    assert decode(TrackFile, codecs.BOM_UTF8 + json.dumps(TRACK).encode()).images[0].id == 1
    rows = "\n".join(json.dumps(row) for row in RESULTS * 2)
    (tmp_path / "rows.json").write_bytes(codecs.BOM_UTF8 + rows.encode())
    assert len(read_results(tmp_path / "rows.json").entries) == 2
    (tmp_path / "depth.toml").write_bytes(codecs.BOM_UTF8 + b'space = "depth"\nunit = "m"\n')
    assert read_declaration(tmp_path).unit == "m"


def test_a_text_of_one_byte_is_a_text() -> None:
    assert utf8_text(b"") == ""
    assert utf8_text(b"1") == "1"
    with pytest.raises(EncodingError):
        utf8_text(b"\xff")


@pytest.mark.parametrize("name", ["a\nb.png", "a\tb.png", "a\x1b[2Jb", "a\0b.png", "\u202eb.png"])
def test_a_name_that_could_forge_a_line_is_refused(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "track.json"
    document = {**TRACK, "images": [{**IMAGES[0], "file_name": name}]}
    path.write_text(json.dumps(document))
    with pytest.raises(CatalogError, match="without control characters"):
        load_track(path)
    words = ["track", "make", "--task", "coco", "--truth", str(path), "-o", str(tmp_path / "t")]
    assert cli.run(words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "file name without control characters" in line


@pytest.mark.parametrize("kind", [list, dict])
def test_nesting_is_refused_from_one_level_beyond_its_limit(kind):
    def nested(levels):
        value = 1
        for _ in range(levels):
            value = [value] if kind is list else {"a": value}
        return json.dumps({"schema_version": 1, "more": value}).encode()

    class Known(Record, frozen=True, kw_only=True):
        schema_version: int

    assert decode_foreign(Known, nested(4), levels=5) == Known(schema_version=1)
    with pytest.raises(RecordError, match="nested beyond 5 levels"):
        decode_foreign(Known, nested(5), levels=5)
