"""Predictions in one file or in many are the same predictions, for everything that reads them."""

from __future__ import annotations

import json
import shutil
import tracemalloc
from collections.abc import Sequence
from functools import partial
from itertools import chain
from pathlib import Path

import pytest
from baselines.tracks import make_track
from evaluation.detection_runs import random_predictions, random_truth, write_truth
from running.run_folders import readout as readout_of
from running.run_folders import results

from legoworld import cli
from legoworld.records.base import canonical
from legoworld.records.folders import prediction_files as storage
from legoworld.records.folders.prediction_files import (
    PredictionsUnreadableError,
    delete_predictions,
    prediction_files,
    read_image_predictions,
    stored_batches,
    write_predictions,
)
from legoworld.records.predictions import Prediction, Rle


def mask(image_id: int, counts: str | tuple[int, ...]) -> Prediction:
    rle = Rle(size=(4, 5), counts=counts)
    return Prediction(image_id=image_id, category_id=2, score=1, segmentation=rle)


#: Per image, by ascending id: none at either end, between, and a text that a line could break at.
IMAGES: list[tuple[Prediction, ...]] = [
    (),
    (
        Prediction(image_id=3, category_id=1, score=0.5, bbox=(0, 1.5, 2, 3)),
        mask(3, "a\u2028b},\r"),
    ),
    (),
    (mask(7, "]"),),
    (mask(9, (1, 2)),),
    (),
]
IDS = [1, 3, 4, 7, 9, 12]
ENTRIES = [entry for predictions in IMAGES for entry in predictions]
DOCUMENTS = [json.loads(canonical(entry)) for entry in ENTRIES]


def in_lines(images: Sequence[Sequence[Prediction]]) -> list[list[str]]:
    return [[canonical(prediction) for prediction in image] for image in images]


def read_stored(files: list[Path]) -> list[Prediction]:
    return [*chain.from_iterable(stored_batches(files, Prediction))]


def write_files(folder: Path, images_per_file: int | None) -> list[Path]:
    write_predictions(folder, images_per_file, in_lines(IMAGES), len(IMAGES))
    return prediction_files(folder, images_per_file, len(IMAGES))


def in_a_list(lines: str) -> str:
    return "[\n" + lines.rstrip("\n").replace("\n", ",\n") + "\n]\n"


@pytest.fixture(params=[1, 7, 40, 1 << 22], ids=lambda n: f"{n} bytes at once")
def any_batch(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(storage, "_BATCH_BYTES", request.param)


@pytest.mark.usefixtures("any_batch")
@pytest.mark.parametrize("images_per_file", [None, 1, 2, 3, 5, 6, 100])
def test_what_is_written_is_read(images_per_file, tmp_path):
    files = write_files(tmp_path, images_per_file)
    assert read_stored(files) == ENTRIES
    assert list(read_image_predictions(IDS, files)) == IMAGES
    if images_per_file is not None:
        assert len(files) == -(-len(IMAGES) // images_per_file)
        lines = "".join(path.read_text() for path in files)
        write_files(tmp_path / "whole", None)
        assert in_a_list(lines) == (tmp_path / "whole" / "predictions.json").read_text()
        for k, path in enumerate(files):
            mine = IMAGES[k * images_per_file : (k + 1) * images_per_file]
            assert path.name == f"{k:05}.jsonl"
            assert path.read_text() == "".join(canonical(p) + "\n" for ps in mine for p in ps)


@pytest.mark.parametrize("images_per_file", [None, 2])
def test_no_prediction_at_all(images_per_file, tmp_path):
    write_predictions(tmp_path, images_per_file, [[], [], []], 3)
    files = prediction_files(tmp_path, images_per_file, 3)
    assert [f.read_text() for f in files] == (["[]\n"] if images_per_file is None else ["", ""])
    assert not read_stored(files)


@pytest.mark.parametrize(("before", "after"), [(1, 4), (4, 1), (2, None), (None, 2)])
def test_files_of_another_division_go(before, after, tmp_path):
    write_files(tmp_path, before)
    files = write_files(tmp_path, after)
    assert sorted(p for p in tmp_path.rglob("*") if p.is_file()) == files
    assert (tmp_path / "predictions").exists() == (after is not None)
    delete_predictions(tmp_path)
    assert not list(tmp_path.iterdir())


def test_fewer_images_leave_no_file_of_the_others(tmp_path):
    write_files(tmp_path, 2)
    write_predictions(tmp_path, 2, in_lines(IMAGES[:3]), 3)
    assert sorted(p.name for p in (tmp_path / "predictions").iterdir()) == [
        "00000.jsonl", "00001.jsonl",
    ]  # fmt: skip


@pytest.mark.usefixtures("any_batch")
@pytest.mark.parametrize("layout", [{}, {"indent": 1}, {"indent": 0}, {"separators": (",\n", ":")}])
def test_a_list_that_others_wrote(layout, tmp_path):
    path = tmp_path / "predictions.json"
    path.write_text(json.dumps(DOCUMENTS * 5, **layout))
    assert read_stored([path]) == ENTRIES * 5


@pytest.mark.usefixtures("any_batch")
def test_a_cut_inside_of_an_entry_is_none(tmp_path):
    path = tmp_path / "predictions.json"
    inside = '"x": [\n{"a": 1},\n{"a": 2},\n{"a": 3}\n]'
    entries = [f'{{"image_id": {i}, "category_id": 1, "score": 1, {inside}}}' for i in range(3)]
    path.write_text("[\n" + ",\n".join(entries) + "\n]\n")
    assert [p.image_id for p in read_stored([path])] == [0, 1, 2]


@pytest.mark.usefixtures("any_batch")
def test_a_list_cut_off_anywhere_is_refused_as_json_refuses_it(tmp_path):
    (whole,) = write_files(tmp_path, None)
    text = whole.read_bytes()
    for length in range(len(text.rstrip())):
        whole.write_bytes(text[:length])
        with pytest.raises(PredictionsUnreadableError) as refused:
            read_stored([whole])
        with pytest.raises(ValueError, match=r".") as expected:
            json.loads(text[:length].decode())
        reason = str(expected.value)
        if isinstance(expected.value, UnicodeDecodeError):
            reason = f"it is not UTF-8: {expected.value.reason}, byte 0xe2 at position 132"
        assert refused.value.found == f"not JSON: {reason}"


@pytest.mark.usefixtures("any_batch")
@pytest.mark.parametrize(
    "text",
    [
        '{"a": 1}', "1", "", '[\n{"a": 1},\n]\n', '[\n{"a": 1}\n{"a": 2}\n]\n',
        '[\n{"a": 1},\n{"a": 2}\n]\n[]', '[\n{"a": 1},\n,\n{"a": 2}\n]\n',
        '[\n{"a": 1},\n{"a": 2}\n',
        '{"a": [\n{"b": 1},\n{"b": 2}\n]}', '"[\n{},\n{}\n]"',
    ],
)  # fmt: skip
def test_what_is_no_list_is_refused(text, tmp_path):
    path = tmp_path / "predictions.json"
    path.write_text(text)
    with pytest.raises(PredictionsUnreadableError, match=r"predictions\.json cannot be read"):
        read_stored([path])


@pytest.mark.usefixtures("any_batch")
@pytest.mark.parametrize(
    "text", ['{"a": 1}{"a": 2}\n', '{"a": 1},{"a": 2}\n', "\n", '{"a":\n', "]\n["]
)
def test_what_is_no_prediction_a_line_is_refused(text, tmp_path):
    path = tmp_path / "predictions" / "00000.jsonl"
    path.parent.mkdir()
    path.write_text('{"a": 0}\n' + text + '{"a": 9}\n')
    with pytest.raises(
        PredictionsUnreadableError, match=r"predictions/00000\.jsonl cannot be read"
    ):
        read_stored([path])


def test_images_out_of_order_lose_predictions_and_never_get_others(tmp_path):
    """A killed run can leave files of two runs: what their rows say then tells them apart."""
    path = tmp_path / "00000.jsonl"
    path.write_text("".join(canonical(mask(i, "")) + "\n" for i in (2, 5, 3, 3, 8)))
    found = list(read_image_predictions([1, 2, 3, 4, 5, 8], [path]))
    assert found == [(), (mask(2, ""),), (), (), (mask(5, ""),), (mask(8, ""),)]


@pytest.mark.parametrize("images_per_file", [None, 400])
def test_reading_holds_no_file_as_a_whole(images_per_file, tmp_path):
    images = [[mask(i, "x" * 5000)] for i in range(4000)]
    write_predictions(tmp_path, images_per_file, in_lines(images), len(images))
    files = prediction_files(tmp_path, images_per_file, len(images))
    size = sum(f.stat().st_size for f in files)
    tracemalloc.start()
    count = sum(map(len, stored_batches(files, Prediction)))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert count == 4000
    assert size > 20e6
    # A batch of 1 MiB is there as lines, text, list and the batch before; never the 20 MB.
    assert peak < size / 2


SCENES = """
for i in range(5):
    fresh(); camera()
    quad("Dog", x=i - 2, category="dog")
    quad("Cat", x=i - 1, z=-1, category="cat")
    save(f"scene{i}")
fresh(); quad("Dog", category="dog"); save("no_camera")
"""


@pytest.fixture(scope="module")
def whole(scenes: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with its predictions in one file."""
    folder = tmp_path_factory.mktemp("whole") / "run"
    assert readout(scenes, folder) == 1  # one scene has no camera
    return folder


readout = partial(readout_of, task="lvis")


def merge(output: Path, *runs: Path, n: int | None = None) -> int:
    more = [] if n is None else ["--images-per-file", str(n)]
    return cli.run(["merge", *map(str, runs), "-o", str(output), *more])


@pytest.mark.blender
@pytest.mark.parametrize("n", [1, 2, 4, 100])
def test_a_divided_run_is_the_undivided_one(n, scenes, whole, tmp_path):
    assert readout(scenes, tmp_path / "run", "--images-per-file", n) == 1
    files = sorted((tmp_path / "run" / "predictions").iterdir())
    assert [f.name for f in files] == [f"{k:05}.jsonl" for k in range(-(-6 // n))]
    text = in_a_list("".join(f.read_text() for f in files))
    assert text == (whole / "predictions.json").read_text()
    assert text.count("image_id") == 10
    own, others = results(tmp_path / "run"), results(whole)
    for name in ("per_image.jsonl", "summary.json"):
        assert own[name] == others[name]
    document = json.loads(own["run.json"])
    assert document["configuration"].pop("images_per_file") == n
    undivided = json.loads(others["run.json"])
    hashes = document.pop("results_sha256"), undivided.pop("results_sha256")
    assert hashes[0]["per_image.jsonl"] == hashes[1]["per_image.jsonl"]
    assert hashes[0].keys() - hashes[1].keys() == {f"predictions/{f.name}" for f in files}
    assert document == undivided


@pytest.mark.blender
def test_merge_divides_and_puts_together(scenes, whole, tmp_path):
    divided = tmp_path / "divided"
    assert readout(scenes, divided, "--images-per-file", 4) == 1
    assert merge(tmp_path / "one", divided) == 1
    assert results(tmp_path / "one") == results(whole)
    assert merge(tmp_path / "four", tmp_path / "one", n=4) == 1
    assert results(tmp_path / "four", with_time=True) == results(divided, with_time=True)
    shards = [tmp_path / f"shard{i}" for i in (1, 2, 3)]
    for i, shard in enumerate(shards, 1):
        more = [] if i == 2 else ["--images-per-file", i]
        readout(scenes, shard, "--shard", f"{i}/3", *more)
    assert merge(tmp_path / "again", *shards, n=4) == 1
    assert results(tmp_path / "again") == results(divided)
    assert merge(tmp_path / "undivided", *shards) == 1
    assert results(tmp_path / "undivided") == results(whole)


@pytest.mark.blender
def test_a_lost_file_is_read_again_and_nothing_else(scenes, tmp_path, capsys):
    run = tmp_path / "run"
    assert readout(scenes, run, "--images-per-file", 2) == 1
    before = results(run)
    (run / "predictions" / "00001.jsonl").unlink()
    assert merge(tmp_path / "merged", run) == 2
    assert "lacks some of its predictions" in capsys.readouterr().err
    arguments = [str(scenes), "--task", "lvis", "-o", str(run), "--images-per-file", "2"]
    assert cli.run(["readout", *arguments]) == 1
    # Images 1 and 2: no camera, scene0. Image 1 is never valid; 3 and 4 are of the lost file.
    assert "3 of 6 images have a valid result already" in capsys.readouterr().err
    assert results(run) == before


@pytest.mark.blender
def test_the_time_is_that_of_what_is_there(scenes, tmp_path):
    """Doing it again for nothing keeps every byte; bringing back what was lost is news."""
    run = tmp_path / "run"
    readout(scenes, run, "--images-per-file", 2)
    document = json.loads((run / "run.json").read_text())
    document["finished_at"] = "2020-01-01T00:00:00Z"
    old = json.dumps(document, sort_keys=True, ensure_ascii=False, indent=1) + "\n"
    (run / "run.json").write_text(old)
    readout(scenes, run, "--images-per-file", 2)
    assert (run / "run.json").read_text() == old
    (run / "predictions" / "00001.jsonl").unlink()
    readout(scenes, run, "--images-per-file", 2)
    assert json.loads((run / "run.json").read_text())["finished_at"] != "2020-01-01T00:00:00Z"


@pytest.mark.blender
def test_another_division_is_another_configuration(scenes, whole, tmp_path, capsys):
    run = tmp_path / "run"
    shutil.copytree(whole, run)
    for n in (2, 3):
        assert readout(scenes, run, "--images-per-file", n) == 2
        before = "null" if n == 2 else "2"
        assert f"images_per_file: {before} -> {n}" in capsys.readouterr().err
        assert readout(scenes, run, "--images-per-file", n, "--overwrite") == 1
    assert len(list((run / "predictions").iterdir())) == 2
    assert not (run / "predictions.json").exists()
    assert readout(scenes, run, "--overwrite") == 1
    assert results(run) == results(whole)
    assert not (run / "predictions").exists()


@pytest.mark.blender
def test_a_damaged_file_is_read_again(scenes, tmp_path, capsys):
    run = tmp_path / "run"
    readout(scenes, run, "--images-per-file", 2)
    before = results(run)
    (run / "predictions" / "00001.jsonl").write_text('{"image_id": 3')
    assert merge(tmp_path / "merged", run) == 2
    error = capsys.readouterr().err
    assert "run lacks some of its predictions" in error
    assert error.count("\n") == 1
    assert readout(scenes, run, "--images-per-file", 2) == 1
    assert results(run) == before


@pytest.mark.blender
def test_a_damaged_file_of_a_run_without_hashes_is_one_line(scenes, tmp_path, capsys):
    run = tmp_path / "run"
    readout(scenes, run, "--images-per-file", 2)
    document = json.loads((run / "run.json").read_text())
    del document["results_sha256"]
    (run / "run.json").write_text(json.dumps(document))
    (run / "predictions" / "00001.jsonl").write_text('{"image_id": 3')
    for command in (
        ["merge", str(run), "-o", str(tmp_path / "merged")],
        ["readout", "-q", str(scenes), "--task", "lvis", "-o", str(run), "--images-per-file", "2"],
    ):
        capsys.readouterr()
        assert cli.run(command) == 2
        error = capsys.readouterr().err
        assert "predictions/00001.jsonl cannot be read" in error
        assert error.count("\n") == 1


@pytest.mark.blender
def test_refusals(scenes, whole, tmp_path, capsys):
    assert readout(scenes, tmp_path / "a", "--images-per-file", 2, task="eth3d") == 2
    assert "--images-per-file is for boxes and masks" in capsys.readouterr().err
    assert readout(scenes, tmp_path / "depth", task="eth3d") == 1
    assert merge(tmp_path / "b", tmp_path / "depth", n=2) == 2
    assert "only boxes and masks can be divided" in capsys.readouterr().err
    assert merge(whole, whole, n=2) == 2
    assert cli.run(["merge", str(whole), "-o", str(whole), "--overwrite"]) == 2
    assert "one of the input runs" in capsys.readouterr().err
    assert readout(scenes, tmp_path / "c", "--images-per-file", 0) == 2
    assert not any((tmp_path / name).exists() for name in "abc")
    assert (whole / "predictions.json").is_file()


def test_an_imported_baseline_is_divided_and_put_together(tmp_path):
    track = make_track(tmp_path / "track.json", [f"photo{i}.jpg" for i in range(5)])
    found = [
        {"image_id": i, "category_id": c, "bbox": [1, 2, 3, 4], "score": 0.5}
        for i in (2, 5)
        for c in (17, 18)
    ]
    (tmp_path / "results.json").write_text(json.dumps(found))
    run = tmp_path / "run"
    bring = ["baseline", "import", "-q", str(tmp_path / "results.json"), "--task", "coco"]
    assert cli.run([*bring, "--track", str(track), "-o", str(run)]) == 0
    assert merge(tmp_path / "two", run, n=2) == 0
    sizes = [f.read_text().count("\n") for f in sorted((tmp_path / "two/predictions").iterdir())]
    assert sizes == [2, 0, 2]
    assert json.loads((tmp_path / "two" / "run.json").read_text())["baseline"]["imported"]
    assert merge(tmp_path / "one", tmp_path / "two") == 0
    assert results(tmp_path / "one", with_time=True) == results(run, with_time=True)


@pytest.fixture(scope="module")
def scored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs `whole` and `divided` of the same boxes, and the truth."""
    folder = tmp_path_factory.mktemp("scored")
    truth = random_truth("coco", seed=1)
    path = write_truth(folder / "truth.json", truth)
    (folder / "boxes.json").write_text(json.dumps(random_predictions("coco", truth, seed=2)))
    track = folder / "track.json"
    assert cli.run(["track", "make", "--task", "coco", "--truth", str(path), "-o", str(track)]) == 0
    bring = ["baseline", "import", "-q", str(folder / "boxes.json"), "--task", "coco"]
    assert cli.run([*bring, "--track", str(track), "-o", str(folder / "whole")]) == 0
    assert merge(folder / "divided", folder / "whole", n=5) == 0
    return folder


def evaluate(scored: Path, run: str, output: Path) -> int:
    return cli.run(
        ["evaluate", "-q", str(scored / run), "--truth", str(scored / "truth.json"),
         "-o", str(output), "--draws", "20"]
    )  # fmt: skip


def test_an_evaluation_has_the_same_bytes_but_for_its_inputs(scored, tmp_path, capsys):
    files = len(list((scored / "divided" / "predictions").iterdir()))
    assert files > 1
    for name in ("whole", "divided"):
        assert evaluate(scored, name, tmp_path / name) == 0
    whole, divided = ({str(p.relative_to(d)): p.read_bytes() for p in d.rglob("*") if p.is_file()}
                      for d in (tmp_path / "whole", tmp_path / "divided"))  # fmt: skip
    evidence = [json.loads(found.pop("evidence.json")) for found in (whole, divided)]
    assert divided == whole
    inputs = [found.pop("inputs") for found in evidence]
    assert evidence[0] == evidence[1]
    assert [entry["role"] for entry in inputs[1]] == [
        "truth", "run", "per_image", *["predictions"] * files,
    ]  # fmt: skip
    assert inputs[0][0]["sha256"] == inputs[1][0]["sha256"]
    capsys.readouterr()
    assert cli.run(["evidence", "verify", str(tmp_path / "divided")]) == 0
    with (scored / "divided" / "predictions" / "00001.jsonl").open("a") as stream:
        stream.write(" ")
    assert cli.run(["evidence", "verify", str(tmp_path / "divided")]) == 1
    assert "divided/predictions/00001.jsonl" in capsys.readouterr().out


def test_an_evaluation_misses_no_file(scored, tmp_path, capsys):
    run = tmp_path / "divided"
    shutil.copytree(scored / "divided", run)
    (run / "predictions" / "00001.jsonl").unlink()
    shutil.copy(scored / "truth.json", tmp_path / "truth.json")
    assert evaluate(tmp_path, "divided", tmp_path / "eval") == 2
    error = capsys.readouterr().err
    assert "predictions/00001.jsonl" in error
    assert error.count("\n") == 1
    assert not (tmp_path / "eval" / "evidence.json").exists()
