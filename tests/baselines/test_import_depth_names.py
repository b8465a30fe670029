"""Depth imports of other people's files: their names, shapes, types and channels."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from baselines.tracks import call, make_track, rows, run_document
from hypothesis import given, settings
from hypothesis import strategies as st

from legoworld.baselines.depth import NAMING
from legoworld.baselines.pixel_matching import match_files
from legoworld.depth_files.errors import DepthFileError
from legoworld.tracks.track import TrackImage, scene_name

NAMES = ["hall/images/dslr_images/A.JPG", "hall/images/dslr_images/B.JPG"]
DEPTH = np.linspace(1, 9, 48 * 64, dtype=np.float32).reshape(48, 64)


def image(number: int, name: str) -> TrackImage:
    return TrackImage(id=number, file_name=name, size_wh=(64, 48), scene=scene_name(name))


IMAGES = [image(i, name) for i, name in enumerate(NAMES, start=1)]


def folder_of(root: Path, names: list[str]) -> Path:
    for name in names:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).touch()
    return root


def matched(
    root: Path, names: list[str], images: list[TrackImage] = IMAGES, suffix: str | None = None
) -> dict[int, tuple[str, str] | str]:
    """By image id: its file and the rule, or the reason for none."""
    matches = match_files(folder_of(root, names), images, suffix, NAMING)
    found: dict[int, tuple[str, str] | str]
    found = {i: (m.path.relative_to(root).as_posix(), m.how) for i, m in matches.by_image.items()}
    return {**found, **{i: str(error) for i, error in matches.errors.items()}}


BASE = "hall/images/dslr_images/A"
ONE_FILE = {
    f"{BASE}.npy": "same_path",
    f"{BASE}.NPY": "same_path",
    f"{BASE}.TIFF": "same_path",
    f"{BASE}.JPG.npy": "extension_kept",
    f"{BASE}_pred.npz": "suffix_added",
    f"{BASE}.JPG_depth.png": "suffix_added",
    "hall_images_dslr_images_A.npy": "path_joined",
    "hall__images__dslr_images__A_depth.npy": "path_joined",
    "hall-A.pfm": "path_joined",
    "A.npy": "photo_name_alone",
    "A.JPG.npy": "photo_name_alone",
    "A_disp.exr": "photo_name_alone",
    "a.npy": "photo_name_alone_in_another_case",
    "Hall/Images/dslr_images/A.npy": "same_path_in_another_case",
}


@pytest.mark.parametrize("name", ONE_FILE)
def test_a_name_and_the_rule_that_understands_it(tmp_path: Path, name: str) -> None:
    assert matched(tmp_path, [name]) == {1: (name, ONE_FILE[name])}


@pytest.mark.parametrize(
    "name",
    [
        "attic/A.npy",  # another scene's photo of the same name
        "attic/images/dslr_images/A.npy",
        "deeper/A.npy",
        f"{BASE}_other.npy",
        f"{BASE}A.npy",
        f"{BASE}.txt",
        "A.npy/inside.npy",
    ],
)
def test_names_that_are_no_photo_s(tmp_path: Path, name: str) -> None:
    assert matched(tmp_path, [name]) == {}
    strangers = match_files(tmp_path, IMAGES, None, NAMING).strangers
    assert strangers == (() if name.endswith(".txt") else (name,))


def test_the_strictest_rule_wins_and_leaves_the_rest_as_strangers(tmp_path: Path) -> None:
    names = [f"{BASE}.npy", f"{BASE}_pred.npy", "A.npy", "hall/images/dslr_images/B.JPG.npy"]
    assert matched(tmp_path, names) == {
        1: (f"{BASE}.npy", "same_path"),
        2: ("hall/images/dslr_images/B.JPG.npy", "extension_kept"),
    }
    assert match_files(tmp_path, IMAGES, None, NAMING).strangers == ("A.npy", f"{BASE}_pred.npy")


def test_two_files_by_one_rule_are_refused_with_both_names(tmp_path: Path) -> None:
    names = [f"{BASE}_pred.npy", f"{BASE}_depth.npy"]
    found = matched(tmp_path, names)[1]
    assert "more than one depth file" in found
    assert f"{BASE}_depth.npy, {BASE}_pred.npy" in found
    assert "--suffix _depth.npy" in found
    assert matched(tmp_path, names, suffix="_pred") == {1: (f"{BASE}_pred.npy", "same_path")}
    assert matched(tmp_path, [*names, f"{BASE}_pred.png"], suffix="_pred.npy") == {
        1: (f"{BASE}_pred.npy", "same_path")
    }
    preview = matched(tmp_path / "2", ["A.npy", "A.png"])[1]
    assert "--suffix .npy" in preview
    assert matched(tmp_path / "2", ["A.npy"], suffix=".npy")[1][0] == "A.npy"


def test_a_suffix_of_one_s_own(tmp_path: Path) -> None:
    names = ["A-dpt_large_384.pfm", "B.pfm"]
    assert matched(tmp_path, names, suffix="-dpt_large_384") == {1: (names[0], "photo_name_alone")}


def test_a_flat_name_of_two_photos_is_refused_with_both(tmp_path: Path) -> None:
    images = [*IMAGES, image(3, "attic/images/dslr_images/A.JPG")]
    found = matched(tmp_path, ["A.npy", "B.npy"], images)
    assert found[2] == ("B.npy", "photo_name_alone")
    for number in (1, 3):
        assert "could be the depth of several photos" in found[number]
        assert NAMES[0] in found[number]
        assert images[2].file_name in found[number]
    # Also when one of them has a file of its own: the flat one may still be that one's.
    found = matched(tmp_path, [f"{BASE}.npy", "A.npy"], images)
    assert found[1] == (f"{BASE}.npy", "same_path")
    assert "could be the depth of several photos" in found[3]
    joined = matched(tmp_path / "2", ["hall_A.npy", "attic_A.npy"], images)
    assert joined == {1: ("hall_A.npy", "path_joined"), 3: ("attic_A.npy", "path_joined")}


def test_paths_that_join_to_one_name(tmp_path: Path) -> None:
    images = [image(1, "a/b_X.jpg"), image(2, "a_b/X.jpg")]
    found = matched(tmp_path, ["a_b_X.npy"], images)
    assert set(found) == {1, 2}
    assert all("a/b_X.jpg, a_b/X.jpg" in found[i] for i in (1, 2))


parts = st.sampled_from(["a", "b", "A", "x_y", "1", "_depth"])
photo = st.lists(parts, min_size=1, max_size=3).map(lambda p: "/".join(p) + ".jpg")
file = st.builds(
    lambda p, s, f: "/".join(p) + s + f,
    st.lists(parts, min_size=1, max_size=3),
    st.sampled_from(["", ".jpg", *NAMING.endings[:3]]),
    st.sampled_from([".npy", ".png"]),
)


@settings(max_examples=150)
@given(
    photos=st.lists(photo, min_size=1, max_size=5, unique=True),
    files=st.lists(file, max_size=8, unique=True),
)
def test_no_file_is_two_photos_and_order_says_nothing(
    tmp_path_factory: pytest.TempPathFactory, photos: list[str], files: list[str]
) -> None:
    root = tmp_path_factory.getbasetemp() / "matching"
    shutil.rmtree(root, ignore_errors=True)
    images = [image(i, name) for i, name in enumerate(photos, start=1)]
    matches = match_files(folder_of(root, files), images, None, NAMING)
    paths = [match.path for match in matches.by_image.values()]
    assert len(set(paths)) == len(paths)
    assert not set(matches.by_image) & set(matches.errors)
    backwards = match_files(root, images[::-1], None, NAMING)
    assert backwards.by_image == matches.by_image
    assert set(backwards.errors) == set(matches.errors)
    assert backwards.strangers == matches.strangers
    for number, photo_image in enumerate(images, start=1):
        exact = [f for f in files if Path(f).with_suffix("").as_posix() == photo_image.scene]
        if len(exact) == 1:
            assert matches.by_image[number].path == root / exact[0]
        if number in matches.errors:
            with pytest.raises(DepthFileError):
                matches.of(photo_image)


@pytest.fixture
def bring(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> Any:
    track = make_track(tmp_path / "track.json", NAMES)
    (tmp_path / "depths").mkdir()

    def go(*options: str, name: str = "run") -> tuple[int, Path, str]:
        run = tmp_path / name
        start = ["baseline", "import", tmp_path / "depths", "--task", "eth3d", "--track", track]
        code = call([*start, "-o", run, *options])
        return code, run, capfd.readouterr().err

    return go


def values_of(run: Path, letter: str = "A") -> np.ndarray:
    with np.load(run / f"depth/hall/images/dslr_images/{letter}.npz") as arrays:
        return arrays["values"]


IN_METRES = ("--space", "depth", "--unit", "m")


def test_a_flat_folder_with_its_rule_on_record(bring: Any, tmp_path: Path) -> None:
    np.save(tmp_path / "depths/A_pred.npy", DEPTH[None])
    np.save(tmp_path / "depths/B_pred.npy", DEPTH[..., None])
    code, run, said = bring(*IN_METRES)
    assert code == 0
    assert "2 files are matched by: photo name alone" in said
    for letter in "AB":
        assert np.array_equal(values_of(run, letter), DEPTH)
    scenes = run_document(run)["scenes"]
    assert scenes["1"]["source"]["file"] == "A_pred.npy"
    assert scenes["1"]["source"]["matched_by"] == "photo_name_alone"
    assert scenes["1"]["read"] == {"array": None, "dtype": "float32", "shape": [1, 48, 64]}
    assert scenes["2"]["read"]["shape"] == [48, 64, 1]
    before = (run / "run.json").read_bytes()
    times = {p: p.stat().st_mtime_ns for p in run.rglob("*.npz")}
    bring(*IN_METRES)
    assert {p: p.stat().st_mtime_ns for p in run.rglob("*.npz")} == times
    assert run_document(run)["scenes"] == scenes, before


def test_float16_is_taken_with_a_warning(bring: Any, tmp_path: Path) -> None:
    for letter in "AB":
        np.save(tmp_path / f"depths/{letter}.npy", DEPTH.astype(np.float16))
    code, run, _ = bring(*IN_METRES)
    assert code == 0
    assert values_of(run).dtype == np.float32
    assert np.array_equal(values_of(run), DEPTH.astype(np.float16).astype(np.float32))
    assert "float16" in rows(run)[1]["warnings"][0]
    assert run_document(run)["scenes"]["1"]["read"]["dtype"] == "float16"


def test_an_array_of_several_is_named(bring: Any, tmp_path: Path) -> None:
    for letter in "AB":
        np.savez(tmp_path / f"depths/{letter}.npz", depth=DEPTH, confidence=DEPTH * 0 + 1)
    code, _, said = bring(*IN_METRES)
    assert code != 0
    assert "found: depth, confidence" in said
    assert "--array" in said
    code, run, _ = bring(*IN_METRES, "--array", "depth")
    assert code == 0
    assert np.array_equal(values_of(run), DEPTH)
    assert run_document(run)["scenes"]["1"]["read"]["array"] == "depth"
    assert run_document(run)["configuration"]["imported"]["array"] == "depth"


def test_the_only_array_needs_no_name(bring: Any, tmp_path: Path) -> None:
    for letter in "AB":
        np.savez(tmp_path / f"depths/{letter}.npz", prediction=DEPTH, fps=np.array(3.0))
    code, run, _ = bring(*IN_METRES)
    assert code == 0
    assert run_document(run)["scenes"]["1"]["read"]["array"] == "prediction"


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_tiff(bring: Any, tmp_path: Path, dtype: Any) -> None:
    for name in ("A.tif", "B.TIFF"):
        cv2.imwrite(str(tmp_path / "depths" / name.replace("TIFF", "tiff")), DEPTH.astype(dtype))
    (tmp_path / "depths/B.tiff").rename(tmp_path / "depths/B.TIFF")
    code, run, _ = bring(*IN_METRES)
    assert code == 0
    for letter in "AB":
        assert np.array_equal(values_of(run, letter), DEPTH)


def test_tiff_of_integers_and_of_colours(bring: Any, tmp_path: Path) -> None:
    millimetres = (DEPTH * 1000).astype(np.uint16)
    cv2.imwrite(str(tmp_path / "depths/A.tif"), millimetres)
    cv2.imwrite(str(tmp_path / "depths/B.tif"), np.dstack([millimetres] * 3))
    code, run, _ = bring("--space", "depth", "--unit", "mm")
    assert code == 1
    assert np.array_equal(values_of(run), millimetres / 1000)
    assert "not one depth image" in rows(run)[2]["reason"]


def test_a_tiff_of_several_pictures(bring: Any, tmp_path: Path) -> None:
    cv2.imwritemulti(str(tmp_path / "depths/A.tif"), [DEPTH, DEPTH])
    np.save(tmp_path / "depths/B.npy", DEPTH)
    code, run, _ = bring(*IN_METRES)
    assert code == 1
    assert "several images in one TIFF" in rows(run)[1]["reason"]


EXR = {
    "Z": ({"Z": DEPTH}, "Z"),
    "layer Z": ({"View.Z": DEPTH, "R": DEPTH * 2}, "View.Z"),
    "Y": ({"Y": DEPTH}, "Y"),
    "V": ({"Depth.V": DEPTH, "A": DEPTH * 0}, "Depth.V"),
    "only R": ({"R": DEPTH}, "R"),
    "grey": ({"R": DEPTH, "G": DEPTH, "B": DEPTH}, "R"),
    "half": ({"Y": DEPTH.astype(np.float16)}, "Y"),
}


@pytest.mark.parametrize("case", EXR)
def test_exr_channels(bring: Any, tmp_path: Path, case: str) -> None:
    openexr = pytest.importorskip("OpenEXR", reason="EXR needs the package OpenEXR")
    channels, name = EXR[case]
    for letter in "AB":
        path = tmp_path / f"depths/{letter}.exr"
        openexr.File({"type": openexr.scanlineimage}, dict(channels)).write(str(path))
    code, run, _ = bring(*IN_METRES)
    assert code == 0
    assert np.array_equal(values_of(run), channels[name].astype(np.float32))
    assert run_document(run)["scenes"]["1"]["read"]["array"] == name


@pytest.mark.parametrize(
    "channels",
    [
        {"R": DEPTH, "G": DEPTH, "B": DEPTH + 1},  # a colour picture
        {"a.Z": DEPTH, "b.Z": DEPTH},
        {"Y": DEPTH, "V": DEPTH},
        {"id": DEPTH, "mist": DEPTH},
        {"Z": DEPTH.astype(np.uint32)},
    ],
)
def test_exr_that_does_not_say_which_channel(
    bring: Any, tmp_path: Path, channels: dict[str, np.ndarray]
) -> None:
    openexr = pytest.importorskip("OpenEXR", reason="EXR needs the package OpenEXR")
    for letter in "AB":
        path = tmp_path / f"depths/{letter}.exr"
        openexr.File({"type": openexr.scanlineimage}, dict(channels)).write(str(path))
    code, _, said = bring(*IN_METRES)
    assert code != 0
    assert "no single depth channel" in said
    assert all(name in said for name in channels)
    name = sorted(channels)[0]
    code, _, _ = bring(*IN_METRES, "--array", name)
    assert code == (0 if channels[name].dtype == np.float32 else 2)


@pytest.mark.parametrize("option", ["--array", "--suffix"])
def test_these_options_are_of_depth(tmp_path: Path, option: str) -> None:
    track = make_track(tmp_path / "track.json", NAMES)
    (tmp_path / "r.json").write_text("[]")
    command = ["baseline", "import", tmp_path / "r.json", "--task", "coco", "--track", track]
    assert call([*command, "-o", tmp_path / "run", option, "x"]) == 2
