"""The package a baseline's process uses: photos, labels, hashes, depth files, and its protocol."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from legoworld.baselines.labels import OLD_NAMES, label_map
from legoworld.evaluation.depth.arrays import Declaration
from legoworld.evaluation.depth.labelled import read_labelled
from legoworld.readouts.family import protocol
from legoworld.shipped import catalog
from legoworld.tracks.vocabulary import from_json

SHARED = catalog.folder("baselines") / "shared"


@pytest.fixture
def package(monkeypatch):
    monkeypatch.syspath_prepend(str(SHARED))
    import legoworld_baseline

    return legoworld_baseline


def request(names: list[str], labels: dict | None = None) -> dict:
    categories = [{"id": 10 * n, "name": name} for n, name in enumerate(names, start=1)]
    return {"categories": categories, "label_map": labels or {}}


def test_labels_match_by_name(package):
    found = package.match_labels(
        request(["dog", "potted plant"], {"Pottedplant": "potted plant"}),
        ["N/A", "Dog", "pottedplant", "unicorn"],
    )
    assert found == {"Dog": 10, "pottedplant": 20}


def test_a_label_can_be_left_out(package):
    asked = request(["dog"], {"dog": None, "hound": "dog"})
    assert package.match_labels(asked, ["dog", "hound"]) == {"hound": 10}


@pytest.mark.parametrize(
    ("labels", "words", "found"),
    [
        (["LABEL_0", "LABEL_1"], "2 of 2 categories have no label", "LABEL_0"),
        (["dog", "caat"], "1 of 2 categories have no label", "near: caat"),
        (["dog", "DOG", "cat"], "two labels of the model name one category", "'dog' and 'DOG'"),
    ],
)
def test_labels_that_are_refused(package, labels, words, found):
    with pytest.raises(package.Refused, match=words) as refusal:
        package.match_labels(request(["dog", "cat"]), labels)
    assert found in refusal.value.reason["found"]


def test_the_six_old_names_of_coco_reach_the_model(package):
    """A head with the old names covers COCO's whole vocabulary through legoworld's own map."""
    vocabulary = protocol("coco", None).vocabulary
    assert vocabulary is not None
    old = {new: old for old, new in OLD_NAMES.items()}
    head = [old.get(c.name, c.name) for c in vocabulary.categories]
    asked = {
        "categories": [{"id": c.id, "name": c.name} for c in vocabulary.categories],
        "label_map": label_map(None, vocabulary, "coco"),
    }
    found = package.match_labels(asked, head)
    assert list(found.values()) == [c.id for c in vocabulary.categories]
    assert found["tvmonitor"] == 72
    with pytest.raises(package.Refused, match="6 of 80"):
        package.match_labels({**asked, "label_map": {}}, head)


def test_an_old_name_that_is_itself_a_category_stays(package):
    vocabulary = from_json([{"id": 1, "name": "sofa"}, {"id": 2, "name": "couch"}], "here")
    assert "sofa" not in label_map(None, vocabulary, "coco")


def test_photos_keep_their_stored_orientation(package, tmp_path):
    pixels = np.arange(6 * 8 * 3, dtype=np.uint8).reshape(6, 8, 3)
    exif = Image.Exif()
    exif[0x0112] = 6  # shown rotated by 90 degrees
    Image.fromarray(pixels).save(tmp_path / "p.png", exif=exif)
    found = package.read_photo(tmp_path / "p.png", 8, 6)
    np.testing.assert_array_equal(found, pixels)
    assert found.flags.writeable
    with pytest.raises(package.PhotoError, match="is 8x6, the track says 6x8"):
        package.read_photo(tmp_path / "p.png", 6, 8)


@pytest.mark.parametrize("mode", ["L", "LA", "RGBA", "P", "CMYK", "1"])
def test_every_kind_of_picture_is_rgb(package, tmp_path, mode):
    suffix = "tif" if mode == "CMYK" else "png"
    Image.new("RGB", (5, 4), (200, 10, 10)).convert(mode).save(tmp_path / f"p.{suffix}")
    found = package.read_photo(tmp_path / f"p.{suffix}", 5, 4)
    assert found.shape == (4, 5, 3)
    assert found.dtype == np.uint8


def test_photos_that_cannot_be_read(package, tmp_path):
    (tmp_path / "text.jpg").write_text("no photo")
    Image.new("RGB", (64, 64), (1, 2, 3)).save(tmp_path / "cut.jpg")
    (tmp_path / "cut.jpg").write_bytes((tmp_path / "cut.jpg").read_bytes()[:400])
    for name in ("text.jpg", "cut.jpg", "absent.jpg"):
        with pytest.raises(package.PhotoError, match=f"{name} cannot be read"):
            package.read_photo(tmp_path / name, 64, 64)


def test_hashes_do_not_say_where_files_lie(package, tmp_path):
    (tmp_path / "model").mkdir()
    (tmp_path / "model" / "b.bin").write_bytes(b"bb")
    (tmp_path / "a.bin").write_bytes(b"")
    found = package.hash_files([tmp_path / "model" / "b.bin", tmp_path / "a.bin"], root=tmp_path)
    assert found == [
        {"name": "a.bin", "bytes": 0, "sha256": hashlib.sha256(b"").hexdigest()},
        {"name": "model/b.bin", "bytes": 2, "sha256": hashlib.sha256(b"bb").hexdigest()},
    ]


def test_versions(package):
    found = package.library_versions(["numpy", "no-such-thing"])
    assert found["numpy"] == np.__version__
    assert found["no-such-thing"] == "not installed"
    assert "python" in found


def test_depth_is_written_as_the_scorer_reads_it(package, tmp_path):
    values = np.array([[1.0, np.inf], [np.nan, 2.0]], np.float32)
    asked, image = {"output": str(tmp_path)}, {"file_name": "hall/images/A.JPG"}
    said = package.write_depth(asked, image, values, "disparity", None)["depth"]
    path = tmp_path / said["file"]
    assert said["file"] == "depth/hall/images/A.npz"
    assert said["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
    found = read_labelled(path, Declaration())
    assert (found.space, found.unit, found.size_wh) == ("disparity", None, (2, 2))
    np.testing.assert_array_equal(found.values, values)
    assert package.write_depth(asked, image, values, "disparity", None)["depth"] == said
    assert [p.name for p in path.parent.iterdir()] == ["A.npz"]


@pytest.mark.parametrize(
    ("values", "space"),
    [
        (np.zeros((2, 2)), "depth"),
        (np.zeros((2, 2, 1), np.float32), "depth"),
        (np.zeros((0, 2), np.float32), "depth"),
        (np.zeros((2, 2), np.float32), "inverse"),
    ],
)
def test_depth_that_is_no_depth(package, tmp_path, values, space):
    with pytest.raises(ValueError, match="depth"):
        package.write_depth({"output": str(tmp_path)}, {"file_name": "a.jpg"}, values, space, None)
    assert not list(tmp_path.rglob("*.npz"))


CHATTY = """
import os
print("imported")
from legoworld_baseline import serve
def load(request):
    os.write(1, b"loading")
    return None, {"model": "chatty"}
def predict(model, image):
    print("predicting", flush=True)
    if image["image_id"] == 2:
        raise ValueError("two\\nlines")
    if image["image_id"] == 3:
        return {"predictions": object()}
    return {"predictions": []}
serve(load, predict)
"""


def speak(tmp_path: Path, program: str, document: dict) -> tuple[list[str], str, int]:
    """What a program says to a request, its log, and its exit code."""
    (tmp_path / "run.py").write_text(program)
    process = subprocess.Popen(
        [sys.executable, tmp_path / "run.py"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONPATH": str(SHARED)},
    )  # fmt: skip
    assert process.stdin is not None
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdin.write(json.dumps(document) + '\n{"begin": true}\n')
    process.stdin.flush()  # and not closed: the end of standard input would end the process
    with process, process.stdin, process.stdout as said, process.stderr as log:
        return said.read().splitlines(), log.read(), process.wait()


def test_only_messages_reach_the_channel(tmp_path):
    images = [{"image_id": n, "batch": n} for n in (1, 2, 3)]
    request = {"schema_version": 1, "images": images, "batch_size": 1}
    lines, log, code = speak(tmp_path, CHATTY, request)
    assert code == 0
    assert lines[:2] == ["imported", ""]
    messages = [json.loads(line) for line in lines[2:]]
    assert messages[0]["provenance"] == {"model": "chatty"}
    assert messages[1:] == [
        {"working_on": [1]},
        {"image_id": 1, "predictions": []},
        {"working_on": [2]},
        {"image_id": 2, "failed": "ValueError: two lines"},
        {"working_on": [3]},
        {"image_id": 3, "failed": "TypeError: Object of type object is not JSON serializable"},
        {"done": True},
    ]
    assert log.startswith("loading")
    assert log.count("predicting") == 3
    assert "Traceback" in log


def test_no_image_is_answered_before_its_run_begins(tmp_path):
    """Until then --overwrite may delete the results of an earlier run."""
    (tmp_path / "run.py").write_text(CHATTY)
    request = {"schema_version": 1, "images": [{"image_id": 1, "batch": 0}], "batch_size": 1}
    with subprocess.Popen(
        [sys.executable, tmp_path / "run.py"], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL, text=True, env={**os.environ, "PYTHONPATH": str(SHARED)},
    ) as process:  # fmt: skip
        process.stdin.write(json.dumps(request) + "\n")
        process.stdin.flush()
        first = next(line for line in process.stdout if line.startswith("{"))
        process.stdin.close()  # only now: the end of its input ends it, whatever it is doing
        rest = process.stdout.read()
    assert [*json.loads(first)] == ["provenance", "environment"]
    assert rest == ""
    assert process.returncode == 1  # the end of its input is legoworld's


def test_a_request_of_another_version_is_not_served(tmp_path):
    lines, log, code = speak(tmp_path, CHATTY, {"schema_version": 2, "images": []})
    assert code == 1
    assert "schema_version 2" in log
    assert lines == ["imported", ""]
