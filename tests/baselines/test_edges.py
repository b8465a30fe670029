"""Rules of imports, environments and providers at their edges; no process is started."""

from __future__ import annotations

import hashlib
import json
import subprocess
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from msgspec.structs import replace

from legoworld.baselines import (
    box_formats,
    category_ids,
    confinement,
    depth,
    environments,
    photo_provider,
)
from legoworld.baselines.answers import Unreadable
from legoworld.baselines.child import TooSlowError
from legoworld.baselines.detection import BASELINE as DETECTIONS
from legoworld.baselines.foreign_results import next_step_for
from legoworld.baselines.labels import LabelsUnmatchedError, Matcher, label_map
from legoworld.baselines.normals import normals_source
from legoworld.baselines.photo_names import PhotosUnmatchedError, file_name, place
from legoworld.baselines.results_file import read_results
from legoworld.errors import UsageError
from legoworld.evaluation.detection.inputs.box_formats import MAX_SHARE_OUTSIDE, BoxFormatError
from legoworld.evaluation.detection.inputs.prediction_checks import PredictionsInvalidError
from legoworld.records.baseline_messages import CameraSaid, DepthSaid, Message
from legoworld.records.run_file import RunCoverage, RunSummary
from legoworld.tracks.track import TrackImage
from legoworld.tracks.vocabulary import Category, Vocabulary


def image(number: int, name: str, size_wh: Any = (64, 48)) -> TrackImage:
    return TrackImage(id=number, file_name=name, size_wh=size_wh, scene="")


IMAGES = [image(139, "val/a.jpg"), image(285, "val/b.jpg"), image(632, "test/b.jpg")]


def match(*entries: dict[str, Any], infos: Any = (), subset: bool = False, images: Any = IMAGES):
    found = place(entries, {info["id"]: info for info in infos}, images, subset=subset)
    return [entry.get("image_id") for entry in found.entries], found.by, found.left_out


@pytest.mark.parametrize(
    ("name", "number"),
    [
        ("val/a.jpg", 139), ("a.jpg", 139), ("a", 139), ("far/val/a.jpg", 139), ("val\\a.jpg", 139),
        ("val/b.jpg", 285), ("test/b", 632), ("139", 139), ("b.jpg", None), ("other/a.jpg", None),
        ("0" * 16 + "139", 139), ("0" * 17 + "139", None), ("٣", None), ("-139", None),
    ],
)  # fmt: skip
def test_a_photo_is_known_by_its_path_its_name_or_its_id(name, number):
    if number is not None:
        assert match({"image_id": name}) == ([number], "file_names", 0)
        return
    with pytest.raises(PhotosUnmatchedError, match="1 of 1 prediction is of images outside"):
        match({"image_id": name})


@pytest.mark.parametrize(
    ("info", "name"),
    [
        ({"file_name": "a", "coco_url": "b"}, "a"), ({"file_name": "", "coco_url": "b"}, "b"),
        ({"file_name": 3, "coco_url": "b"}, "b"), ({"coco_url": ""}, None), ({}, None),
    ],
)  # fmt: skip
def test_an_image_s_entry_names_its_file_before_its_address(info, name):
    assert file_name(info) == name


@pytest.mark.parametrize(
    ("ids", "refused"),
    [
        (range(10), True), (range(1, 11), True), (range(9), False), (range(2, 12), False),
        ([*range(9), 10], False), ([*range(10), 139, 285, 632], False),
    ],
)  # fmt: skip
def test_ten_ids_without_a_gap_from_0_or_1_are_positions(ids, refused):
    entries = [{"image_id": n} for n in ids]
    strict = "look like positions" if refused else "of images outside the track"
    with pytest.raises(PhotosUnmatchedError, match=strict) as caught:
        match(*entries)
    if refused:
        first = min(ids)
        assert caught.value.found == f"ids {first} to {first + 9} without a gap"
        assert caught.value.expected == "ids such as 139, 285, 632"


def test_results_of_other_photos_are_left_out_where_that_was_asked_for():
    ours, other = {"image_id": 139}, {"image_id": 7}
    assert match(ours, other, subset=True) == ([139], "ids", 1)
    with pytest.raises(PhotosUnmatchedError, match="pass --subset to leave them out"):
        match(ours, other)
    with pytest.raises(PhotosUnmatchedError, match="with its image ids or file names"):
        match(other, subset=True)
    with pytest.raises(PhotosUnmatchedError, match="under the track's file names"):
        match({"file_name": "z.jpg"}, subset=True)
    with pytest.raises(PhotosUnmatchedError, match="if not, pass --subset"):
        match(ours, {"file_name": "train/a.jpg"})
    assert match({"image_id": 1.5}, {"image_id": True}) == ([1.5, True], "ids", 0)


def test_the_file_s_own_images_are_of_the_track_s_sizes_and_each_once():
    def info(number: int, name: str, **size: Any) -> dict[str, Any]:
        return {"id": number, "file_name": name, **size}

    one = {"image_id": 1}
    assert match(one, infos=[info(1, "a.jpg", width=64, height=48)])[0] == [139]
    assert match(one, infos=[info(1, "a.jpg", width=64)])[0] == [139]
    assert match(one, infos=[info(1, "a.jpg", width=3, height=4)],
                  images=[image(139, "a.jpg", None)])[0] == [139]  # fmt: skip
    with pytest.raises(PhotosUnmatchedError, match="expected: 64x48, as in the track"):
        match(one, infos=[info(1, "a.jpg", width=48, height=64)])
    with pytest.raises(PhotosUnmatchedError, match=r"'a\.jpg' and 'val/a\.jpg' for image 139"):
        match(one, infos=[info(1, "a.jpg"), info(2, "val/a.jpg")])
    with pytest.raises(PhotosUnmatchedError, match="outside the track"):
        match({"image_id": 139}, infos=[info(1, "b.jpg")])  # named, so 139 is the file's own id


WIDE = {1: (100, 50)}


def boxes(*rows: list[float]) -> list[dict[str, Any]]:
    return [{"image_id": 1, "bbox": list(row)} for row in rows]


@pytest.mark.parametrize(
    ("box_format", "box"),
    [("xywh", [10, 20, 30, 40]), ("xyxy", [10, 20, 20, 20]), ("cxcywh", [-5, 0, 30, 40])],
)
def test_a_box_becomes_its_corner_and_size(box_format, box):
    (entry,) = boxes([10, 20, 30, 40])
    assert box_formats.with_xywh(entry, box_format)["bbox"] == box
    for bad in ({}, {"bbox": [1, 2, 3]}, {"bbox": [1, 2, 3, float("nan")]}, {"bbox": "1234"}):
        assert box_formats.with_xywh(bad, box_format) is bad


def test_a_declared_format_is_refused_where_another_explains_the_boxes():
    corners = boxes([60, 10, 90, 40], [80, 30, 99, 49])
    box_formats.check_declared(corners, WIDE, "xyxy")
    assert box_formats.other_formats(corners, WIDE, "xywh") == ["xyxy"]
    with pytest.raises(BoxFormatError, match=r"100\.0% of 2 boxes.*pass --box-format xyxy"):
        box_formats.check_declared(corners, WIDE, "xywh")
    outside = boxes([200, 200, 300, 300])
    assert box_formats.other_formats(outside, WIDE, "xywh") == []
    box_formats.check_declared(outside, WIDE, "xywh")
    for undecided in (boxes(), boxes([0.1, 0.2, 1.0, 1.0]), [{"image_id": 1}]):
        assert box_formats.other_formats(undecided, WIDE, "xywh") == []
        box_formats.check_declared(undecided, WIDE, "xywh")
    whole = boxes([0, 0, 1.0, 1.01])
    assert box_formats.other_formats(whole, WIDE, "xywh") != []


def test_a_format_s_error_is_told_in_the_declared_one_s_words():
    error = BoxFormatError("what", found="3 of 4", expected="inside", next_step="do")
    told = box_formats.rephrase_error(error, "xywh", [])
    assert (told.what, told.found, told.next_step) == (
        "the boxes are not xywh in pixels", "3 of 4", "do",
    )  # fmt: skip
    told = box_formats.rephrase_error(error, "xyxy", ["xywh", "cxcywh"])
    assert told.found == "as x, y, width, height: 3 of 4"
    assert told.next_step.startswith("pass --box-format xywh or cxcywh, in which")


NAMES = Vocabulary(categories=tuple(Category(id=10 * n, name=f"c{n}") for n in range(1, 11)))


def test_the_most_frequent_categories_are_named():
    ids = Counter({20: 1000, 10: 5, 30: 5, **{10 * n: 1 for n in range(4, 11)}})
    assert category_ids.most_frequent(ids.elements(), NAMES) == (
        "10 categories: c2 1,000, c1 5, c3 5, c4 1, c5 1, c6 1, c7 1, c8 1, ..."
    )
    assert category_ids.most_frequent([10], NAMES) == "1 category: c1 1"
    assert category_ids.readings(Counter({30: 2}), NAMES, "coco") == {"dataset": "c3 2"}
    four = Counter({10: 4, 20: 3, 30: 2, 40: 1})
    assert category_ids.readings(four, NAMES, "coco") == {"dataset": "c1 4, c2 3, c3 2, ..."}
    assert category_ids.as_options({"dataset": "x", "lvis-0": "y"}) == (
        "--category-ids dataset (x) or --category-ids lvis-0 (y)"
    )
    with pytest.raises(UsageError, match="found: 10 categories of --task coco; expected: dataset"):
        category_ids.map_category_ids("lvis-0", NAMES, "coco")


def test_ids_outside_the_declared_numbering_are_counted():
    known = {1: 1, 5: 2}
    category_ids.check_numbering(Counter({1: 3}), known, "mine")
    with pytest.raises(PredictionsInvalidError) as caught:
        category_ids.check_numbering(Counter({1: 3, 9: 1, 7: 1}), known, "mine")
    assert caught.value.what == "2 of 5 predictions have no category id of mine"
    assert (caught.value.found, caught.value.expected) == ("category ids [7, 9]", "1 to 5")
    rows = [{"category_id": i} for i in (1, 1, True, "2", 3.0, None)]
    assert category_ids.plain_ids(rows) == {1: 2}


def test_labels_that_match_nothing_are_counted_by_their_own_words(tmp_path):
    path = tmp_path / "map.json"
    path.write_text(json.dumps({"Mug": "c1", "junk": None}))
    names = label_map(path, NAMES, "lvis")
    assert names == {"Mug": "c1", "junk": None}
    matcher = Matcher(NAMES, names)
    assert [matcher.match(text) and matcher.match(text).id for text in ("mug", "C2", "junk")] == [
        10, 20, None,
    ]  # fmt: skip
    assert (matcher.match("who"), matcher.match("who")) == (None, None)
    assert (matcher.unmatched, matcher.left_out) == ({"who": 2}, {"junk": 1})
    assert (matcher.knows("MUG"), matcher.knows("c1")) == (True, False)
    with pytest.raises(LabelsUnmatchedError, match="1 label names no category; found: 'who'"):
        matcher.refuse_unmatched()
    path.write_text(json.dumps({str(n): f"no {n}" for n in range(7)}))
    with pytest.raises(LabelsUnmatchedError, match=r"maps to 7 unknown names.*'no 5'.*, \.\.\."):
        label_map(path, NAMES, "lvis")
    assert label_map(None, NAMES, "coco") == {}
    couch = Vocabulary(categories=(Category(id=1, name="couch"),))
    assert label_map(None, couch, "coco") == {"sofa": "couch"}
    assert label_map(None, couch, "lvis") == {}
    path.write_text(json.dumps({"Sofa": None}))
    assert label_map(path, couch, "coco") == {"Sofa": None}


def test_the_options_of_a_folder_of_arrays_arrive(tmp_path):
    given = {"suffix": "_d", "space": "depth", "unit": "mm", "array": "z"}
    found = depth.depth_source(tmp_path, given)
    assert (found.folder, found.suffix, found.naming.noun) == (tmp_path, "_d", "depth")
    said = found.imported
    assert (said.folder, said.space, said.unit, said.array, said.suffix, said.cameras_sha256) == (
        tmp_path.name, "depth", "mm", "z", "_d", None,
    )  # fmt: skip
    fitted = normals_source(tmp_path, given)
    assert (fitted.suffix, fitted.naming.noun, fitted.imported.unit) == ("_d", "depth", "mm")
    own = normals_source(tmp_path, {"suffix": "_n", "sign": "out", "array": "n"})
    assert (own.suffix, own.naming.noun) == ("_n", "normals")
    assert (own.imported.sign, own.imported.array) == ("out", "n")
    assert (own.imported.folder, own.imported.suffix) == (tmp_path.name, "_n")
    for other in ("unit", "intrinsics"):
        with pytest.raises(UsageError, match=f"--{other} is for depth"):
            normals_source(tmp_path, {other: "x"})
    with pytest.raises(UsageError, match="--sign and --space"):
        normals_source(tmp_path, {"sign": "out", "space": "depth"})


def project(folder: Path, name: str = "net") -> Any:
    return SimpleNamespace(name=name, shelf="shelf", folder=folder)


def test_what_an_environment_needs_and_lacks(tmp_path, monkeypatch):
    assert environments.requirements(project(tmp_path)).dependencies == ()
    (tmp_path / "pyproject.toml").write_text(
        '[project]\ndependencies = ["a==1.0+cpu", "b[x]>=2", "c == 3", "d"]\n'
        '[tool.legoworld]\nno-deps = ["e==5"]\n'
    )
    needed = environments.requirements(project(tmp_path))
    assert (len(needed.dependencies), needed.no_deps) == (4, ("e==5",))
    assert len({needed.sha256, environments.Requirements(dependencies=needed.no_deps,
                no_deps=needed.dependencies).sha256}) == 2  # fmt: skip
    found = {"a": "1.0+cu126", "b": None, "c": "3.1", "d": "9", "e": "5"}
    monkeypatch.setattr(environments, "_ask", lambda _python, names: {n: found[n] for n in names})
    monkeypatch.setattr(environments, "environment_folder", lambda _card: tmp_path / "env")
    other = Path("/other/python")
    assert environments.problems(project(tmp_path), other) == [
        "b is not installed", "c is 3.1, not 3",
    ]  # fmt: skip
    assert environments.installed_python(project(tmp_path)) is None
    (tmp_path / "env").mkdir()
    stamp = tmp_path / "env" / environments._STAMP
    stamp.write_text("old\n")
    own = environments.installed_python(project(tmp_path))
    assert own == tmp_path / "env" / "bin" / "python"
    assert environments.problems(project(tmp_path), own)[-1] == "installed for other requirements"
    stamp.write_text(needed.sha256 + "\n")
    assert len(environments.problems(project(tmp_path), own)) == 2
    assert environments.chosen_python(project(tmp_path), None) == own
    assert environments.chosen_python(project(tmp_path), other) == other


def test_a_command_that_fails_is_told_with_the_end_of_what_it_said(monkeypatch):
    done = SimpleNamespace(returncode=1, stderr="x" * 500 + "the end", stdout="out")
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: done)
    with pytest.raises(environments.EnvironmentFailedError) as caught:
        environments._run(["/usr/bin/uv", "pip", "install", "torch", "numpy"])
    assert caught.value.what == "`/usr/bin/uv pip install torch ...` failed"
    assert len(caught.value.found or "") <= 400
    assert (caught.value.found or "").endswith("xthe end")
    done.returncode = 0
    assert environments._run(["x"]) == "out"

    def absent(*_: Any, **__: Any) -> None:
        raise FileNotFoundError(2, "No such file")

    monkeypatch.setattr(subprocess, "run", absent)
    with pytest.raises(environments.EnvironmentFailedError, match="python cannot be started"):
        environments._run(["/a/python"])


CAMERA = CameraSaid(width=64, height=48, fx=1.0, fy=2.0, cx=3.0, cy=4.0)


def request(options: Any = None, limit_s: float | None = None) -> Any:
    card = SimpleNamespace(
        name="net", about=SimpleNamespace(version="2"), sha256="s", code_sha256=lambda: "code"
    )
    return SimpleNamespace(
        card=card, weights="hub/weights", device="cuda:1", dtype="float16", source="net 2",
        options=options or {}, time_limit_s=limit_s,
    )  # fmt: skip


class Talking:
    """A process that says these messages, or raises them."""

    def __init__(self, *said: Any) -> None:
        self.said = [*said]
        self.how_it_ended = lambda: "exit code 3; killed"
        self.last_words = lambda: "loading"

    def next_message(self, _deadline: float | None) -> Any:
        if isinstance(one := self.said.pop(0), Exception):
            raise one
        return one


def test_a_provider_s_answer_is_the_line_about_the_photo():
    answer = Message(image_id=1, camera=CAMERA)
    other = replace(answer, image_id=2)
    assert photo_provider._answer(Talking(Message(), other, answer), request()) is answer  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("said", "limit_s", "found"),
    [
        (None, None, "exit code 3; killed"),
        (Unreadable(image_id=None, reason="half a line"), None, "half a line"),
        (Message(image_id=1, failed="too dark"), None, "too dark"),
        (Message(done=True), None, "the end without an answer"),
        (TooSlowError(), 2.5, "no answer after 2.5 s; loading"),
        (Message(image_id=2), 0.0, "no answer after 0 s; loading"),
    ],
)
def test_a_provider_without_an_answer_says_why(said, limit_s, found):
    with pytest.raises(photo_provider.ProviderFailedError) as caught:
        photo_provider._answer(Talking(said), request(limit_s=limit_s))  # type: ignore[arg-type]
    assert caught.value.found == found
    assert caught.value.what == "net has no camera for the photo"
    hint = "SIGKILL" if said is None else "pass --fov, or --camera"
    assert hint in (caught.value.next_step or "")


def test_a_provider_s_depth_is_the_file_that_it_spoke_of(tmp_path):
    photo = Path("a/room.jpg")
    path = tmp_path / photo_provider._depth_name(photo)
    said = DepthSaid(sha256=hashlib.sha256(b"depth").hexdigest(), size_wh=(8, 6),
                     space="disparity", unit=None)  # fmt: skip
    for content, found in ((None, "absent"), (b"other", "absent or not")):
        if content:
            path.parent.mkdir(parents=True)
            path.write_bytes(content)
        with pytest.raises(photo_provider.ProviderFailedError, match=found):
            photo_provider._depth(request(), said, photo, tmp_path)
    path.write_bytes(b"depth")
    given = photo_provider._depth(request(), said, photo, tmp_path)
    assert (given.path, given.space, given.source, given.of_photo) == (
        path, "disparity", "net 2", True,
    )  # fmt: skip
    with pytest.raises(photo_provider.ProviderFailedError, match="depth of space ray; expected: d"):
        photo_provider._depth(request(), replace(said, space="ray"), photo, tmp_path)


def test_what_a_provider_was_is_on_record():
    hello = Message(provenance={"weights": []}, environment={"torch": "2"})
    record = photo_provider._record(request({"how": "well"}), hello, {"frames": 3})
    assert (record.name, record.version, record.card_sha256, record.code_sha256) == (
        "net", "2", "s", "code",
    )  # fmt: skip
    assert (record.device, record.dtype, record.options) == ("cuda", "float16", {"how": "well"})
    assert (record.provenance, record.environment, record.counts) == (
        {"weights": []}, {"torch": "2"}, {"frames": 3},
    )  # fmt: skip
    assert photo_provider._record(request(), Message(), {}).provenance == {}


def test_a_share_of_boxes_may_leave_their_images():
    """As many as the most that is allowed, and one more."""
    n = round(1 / MAX_SHARE_OUTSIDE)
    inside, outside = [60.0, 10.0, 90.0, 40.0], [60.0, 10.0, 190.0, 40.0]
    for count, fits in ((1, True), (2, False)):
        given = boxes(*[outside] * count, *[inside] * (n - count))
        assert ("xyxy" in box_formats.other_formats(given, WIDE, "xywh")) is fits
    box_formats.check_declared(boxes(outside, *[inside] * (n - 1)), WIDE, "xyxy")


@pytest.mark.parametrize(
    ("suffixes", "said"),
    [((".pt", ".pth", ".pkl", ".pickle", ".PTH"), "json.dump("),
     ((".npz", ".npy"), "tolist()"), ((".txt",), "from_yolo"), ((".xml",), "from_pascal_voc"),
     ((".csv",), "one object a row"), ((".json", ""), None)],
)  # fmt: skip
def test_every_kind_of_foreign_file_has_its_own_way_to_json(tmp_path, suffixes, said):
    told = {next_step_for(tmp_path / f"results{suffix}") for suffix in suffixes}
    assert len(told) == 1
    assert (said in told.pop()) if said else told == {""}
    for suffix in suffixes:
        folder = tmp_path / f"of{suffix}"
        folder.mkdir()
        (folder / "a.md").touch()
        (folder / f"results{suffix}").touch()
        assert next_step_for(folder) == next_step_for(tmp_path / f"results{suffix}")


@pytest.mark.parametrize(
    "where",
    [{"bbox": [1, 2, 3, 4]}, {"segmentation": [[1, 2, 3, 2, 3, 4]]},
     {"bbox": [1, 2, 3, 4], "segmentation": [[1, 2, 3, 2, 3, 4]]}],
)  # fmt: skip
def test_a_file_of_one_result_is_a_list_of_it(tmp_path, where):
    result = {"image_id": 1, "category_id": 2, "score": 0.5, **where}
    found = []
    for k, text in enumerate((json.dumps(result), json.dumps([result]))):
        path = tmp_path / f"{k}.jsonl"
        path.write_text(text + "\n")
        found.append(read_results(path).entries)
    assert found[0] == found[1]
    assert len(found[0]) == 1


def test_an_image_without_a_prediction_is_counted_as_empty():
    """`ok_empty` is of images that have none at all; predictions and empty masks are summed."""
    made = [(0, 2), (1, None), (3, 1), (None, None)]
    rows: Any = [SimpleNamespace(n_predictions=n, empty_masks_dropped=m) for n, m in made]
    summary = RunSummary(
        schema_version=1, task="coco", partial=False, warnings=0,
        coverage=RunCoverage(attempted=4, ok=4, ok_empty=9, by_status={"ok": 4}),
    )  # fmt: skip
    found = DETECTIONS.sum_up(summary, rows)
    assert (found.coverage.ok_empty, found.predictions, found.empty_masks_dropped) == (2, 4, 3)


def test_the_caches_of_a_process_with_the_network_are_made_where_they_are_missing(tmp_path):
    hub, torch = tmp_path / "far" / "hub", tmp_path / "torch"
    torch.mkdir()
    named = {"HF_HUB_CACHE": str(hub), "TORCH_HOME": str(torch), "CUDA_HOME": str(tmp_path / "x")}
    assert confinement.writable(named) == (hub, torch)
    assert hub.is_dir()
    assert confinement.writable({}) == ()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["far", "torch"]
