"""Tracks of depth: ETH3D whole or in part, its layout with other data, files named like photos."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from evaluation.depth.folders import plane, rows_of, write_eth3d

from legoworld import cli
from legoworld.depth_files.errors import DepthFileError
from legoworld.errors import CatalogError, UsageError
from legoworld.records.base import canonical
from legoworld.shipped import catalog
from legoworld.track_making.make_track import make_track
from legoworld.track_making.pixel_folders import _pictures
from legoworld.tracks.track import load_track

Track = dict[str, Any]
Make = Callable[..., Track]
SHIPPED = json.loads((catalog.folder("datasets") / "eth3d" / "images.json").read_text())
SCENES = {e["file_name"].split("/")[0] for e in SHIPPED}


def eth3d_folder(root: Path, scenes: tuple[str, ...] = ("kicker", "office")) -> Path:
    """ETH3D's calibration files, with the photos' real names and made-up sizes."""
    for k, scene in enumerate(scenes):
        folder = root / scene / "dslr_calibration_jpg"
        folder.mkdir(parents=True)
        (folder / "cameras.txt").write_text(
            f"# cameras\n3 THIN_PRISM_FISHEYE {600 + k} 400 1 1 1 1 0 0 0 0 0 0 0 0\n"
        )
        photos = [e["file_name"] for e in SHIPPED if e["file_name"].startswith(f"{scene}/")]
        lines = "".join(
            f"{n} 1 0 0 0 0 0 0 3 dslr_images/{p.rsplit('/', 1)[1]}\n\n"
            for n, p in enumerate(photos)
        )
        (folder / "images.txt").write_text("# images\n# two lines each\n" + lines)
    return root


@pytest.fixture
def make(tmp_path: Path) -> Make:
    def go(truth: Path, *, sample: int | None = None, **choice: Any) -> Track:
        said: list[str] = []
        made = make_track(
            "eth3d",
            truth,
            tmp_path / "track.json",
            sample=sample,
            seed=1,
            options=choice,
            notice=said.append,
        )
        assert len(load_track(tmp_path / "track.json").images) == len(made.images)
        return {**json.loads(canonical(made)), "said": said}

    return go


def test_eth3d_s_scenes_that_are_there(make: Make, tmp_path: Path) -> None:
    root = eth3d_folder(tmp_path / "eth3d")
    made = make(root)
    ids = {e["file_name"]: e["id"] for e in SHIPPED}
    assert len(made["images"]) == 31 + 26
    assert all(ids[i["file_name"]] == i["id"] for i in made["images"])
    assert {(i["width"], i["height"]) for i in made["images"]} == {(600, 400), (601, 400)}
    info = made["info"]
    assert (info["dataset"], info["dataset_version"], info["dataset_images"]) == (
        "eth3d",
        "training-dslr",
        454,
    )
    assert info["scenes"] == {"kicker": 31, "office": 26}
    assert set(info["scenes_left_out"]) == SCENES - {"kicker", "office"}
    assert sum(info["scenes_left_out"].values()) + 57 == 454
    assert made["said"][0].startswith("2 of ETH3D's 13 scenes; not covered: courtyard, ")
    assert len(make(root, sample=7)["images"]) == 7
    one = make(root, scenes=["office"])
    assert one["images"] == [i for i in made["images"] if i["file_name"].startswith("office/")]
    assert one["info"]["scenes"] == {"office": 26}
    assert one["info"]["scenes_left_out"]["kicker"] == 31


def test_the_whole_of_eth3d_leaves_nothing_out(make: Make, tmp_path: Path) -> None:
    made = make(eth3d_folder(tmp_path / "eth3d", tuple(sorted(SCENES))))
    assert len(made["images"]) == 454
    assert made["info"]["scenes_left_out"] == {}
    assert made["said"] == []


def test_lost_blank_lines_lose_no_photo(make: Make, tmp_path: Path) -> None:
    root = eth3d_folder(tmp_path / "eth3d", ("kicker",))
    whole = make(root)["images"]
    path = root / "kicker/dslr_calibration_jpg/images.txt"
    path.write_text(path.read_text().replace("\n\n", "\n"))
    assert make(root)["images"] == whole
    assert len(whole) == 31


def test_marigold_s_tree(make: Make, tmp_path: Path) -> None:
    root = eth3d_folder(tmp_path / "eth3d")
    (root / "rgb").mkdir()
    for scene in ("kicker", "office"):
        (root / scene).rename(root / "rgb" / scene)
    assert len(make(root)["images"]) == 57


def test_photos_that_the_calibration_does_not_list_are_named(make: Make, tmp_path: Path) -> None:
    root = eth3d_folder(tmp_path / "eth3d", ("kicker",))
    path = root / "kicker/dslr_calibration_jpg/images.txt"
    lines = path.read_text().split("\n")
    path.write_text("\n".join(line for line in lines if "DSC_6487" not in line))
    made = make(root)
    assert len(made["images"]) == 30
    assert made["info"]["photos_left_out"] == ["kicker/images/dslr_images/DSC_6487.JPG"]
    assert any("1 photo is in no images.txt" in text for text in made["said"])
    path.write_text("")
    with pytest.raises(CatalogError, match=r"kicker lists none of ETH3D's photos.*--dataset"):
        make(root)


def test_scenes_that_are_not_there_or_not_readable(make: Make, tmp_path: Path) -> None:
    root = eth3d_folder(tmp_path / "eth3d")
    for scenes, words in ((["courtyard"], "no scene 'courtyard'; found: kicker, office"),
                          ([], "no scene is named")):  # fmt: skip
        with pytest.raises(UsageError, match=words):
            make(root, scenes=scenes)
    (root / "kicker/dslr_calibration_jpg/images.txt").write_text("1 2 3 4\n")
    with pytest.raises(CatalogError, match=r"calibration of kicker cannot be read.*--scenes"):
        make(root)
    assert len(make(root, scenes=["office"])["images"]) == 26
    with pytest.raises(CatalogError, match=r"no scene in ETH3D's layout.*--photos"):
        make(tmp_path / "eth3d/office")


def own_dataset(root: Path) -> Path:
    """Two scenes of our own in ETH3D's layout: three photos with depth and one without."""
    names = ["hall/images/dslr_images/B.JPG", "hall/images/dslr_images/A.JPG",
             "attic/images/dslr_images/A.JPG", "attic/images/dslr_images/dark.JPG"]  # fmt: skip
    write_eth3d(root, {name: plane((32, 20), i) for i, name in enumerate(names)})
    (root / "attic/ground_truth_depth/dslr_images/dark.JPG").unlink()
    return root


def test_another_dataset_in_eth3d_s_layout(make: Make, tmp_path: Path) -> None:
    root = own_dataset(tmp_path / "ours")
    made = make(root)
    assert [(i["id"], i["file_name"]) for i in made["images"]] == [
        (1, "attic/images/dslr_images/A.JPG"),
        (2, "hall/images/dslr_images/A.JPG"),
        (3, "hall/images/dslr_images/B.JPG"),
    ]
    info = made["info"]
    assert (info["dataset"], info["dataset_version"], info["dataset_images"]) == (
        "ours",
        "custom",
        3,
    )
    assert info["photos_left_out"] == ["attic/images/dslr_images/dark.JPG"]
    assert "1 photo without a measured depth left out" in made["said"][0]
    # Numbers are the whole dataset's, whichever scenes are taken.
    hall = make(root, scenes=["hall"], dataset="our halls")
    assert [i["id"] for i in hall["images"]] == [2, 3]
    assert hall["info"]["dataset"] == "our halls"
    assert hall["info"]["scenes_left_out"] == {"attic": 1}


def test_a_scene_of_eth3d_s_name_among_others(make: Make, tmp_path: Path) -> None:
    root = own_dataset(tmp_path / "ours")
    (root / "hall").rename(root / "office")
    # Named like one of ETH3D's, and holding none of its photos.
    with pytest.raises(CatalogError, match=r"office lists none of ETH3D's photos.*--dataset"):
        make(root)
    assert len(make(root, dataset="ours")["images"]) == 3
    shutil.rmtree(root / "office")
    eth3d_folder(root, ("office",))
    made = make(root)
    assert len(made["images"]) == 26
    assert "1 scene is not ETH3D's and left out: attic" in made["said"][1]
    with pytest.raises(UsageError, match="a track covers one dataset"):
        make(root, scenes=["attic", "office"])


def test_our_own_layout_from_track_to_score(tmp_path: Path) -> None:
    root, track = own_dataset(tmp_path / "ours"), tmp_path / "t.json"
    depths = tmp_path / "depths"
    for path in root.glob("*/ground_truth_depth/dslr_images/*.JPG"):
        scene = path.parents[2].name
        target = depths / scene / "images/dslr_images" / f"{path.stem}.npy"
        target.parent.mkdir(parents=True, exist_ok=True)
        np.save(target, np.fromfile(path, "<f4").reshape(20, 32))
    run = ["baseline", "import", depths, "--space", "depth", "--unit", "m", "--track", track]
    for command in (
        ["track", "make", "--task", "eth3d", "--truth", root, "-o", track],
        [*run, "--task", "eth3d", "-o", tmp_path / "run"],
        ["evaluate", tmp_path / "run", "--truth", root, "-o", tmp_path / "e", "--draws", "9"],
    ):
        assert cli.run([str(word) for word in command]) == 0
    rows = rows_of(tmp_path / "e")
    assert [row["group"] for row in rows] == ["attic", "hall", "hall"]
    assert max(row["metrics"]["abs_rel"]["error_1"] for row in rows) < 1e-6


@pytest.fixture
def desk(tmp_path: Path) -> Path:
    """Photos, and 16-bit depth in millimetres of all but one."""
    for i, name in enumerate(("a/1.jpg", "a/2.JPG", "b.png", "b/plain.jpg")):
        photo = tmp_path / "photos" / name
        photo.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(photo), np.zeros((20, 32, 3), np.uint8))
        if "plain" not in name:
            depth = (tmp_path / "depths" / name).with_suffix(".png")
            depth.parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(depth), (plane((32, 20), i) * 1000).astype(np.uint16))
    return tmp_path


def test_depth_files_named_like_photos(desk: Path, capsys: pytest.CaptureFixture[str]) -> None:
    track = desk / "t.json"
    make = ["track", "make", "--task", "eth3d", "--truth", str(desk / "depths"), "-o", str(track)]
    make += ["--photos", str(desk / "photos"), "--dataset", "desk"]
    assert cli.run(make) != 0
    assert "integers without a declared unit" in capsys.readouterr().err
    assert not track.exists()
    assert cli.run([*make, "--space", "depth", "--unit", "mm"]) == 0
    said = capsys.readouterr()
    assert "3 of 3 images of desk" in said.out
    assert 'depth.toml now says: space = "depth" unit = "mm"' in said.err
    assert "1 photo has no depth file and is left out, such as b/plain.jpg" in said.err
    images = load_track(track).images
    assert [(i.id, i.file_name, i.size_wh) for i in images] == [
        (1, "a/1.jpg", (32, 20)),
        (2, "a/2.JPG", (32, 20)),
        (3, "b.png", (32, 20)),
    ]
    info = json.loads(track.read_text())["info"]
    assert (info["dataset"], info["dataset_version"]) == ("desk", "custom")
    assert info["photos_left_out"] == ["b/plain.jpg"]
    assert cli.run(["track", "check", str(track), "--photos", str(desk / "photos")]) == 0
    assert cli.run([*make, "--overwrite", "--unit", "m/5000"]) == 2, "declared otherwise"
    assert "depth.toml declares" in capsys.readouterr().err


@pytest.mark.parametrize("unit", ["mm", "m/1000"])
def test_a_folder_of_depth_scored_against_itself(desk: Path, unit: str) -> None:
    depths, track = desk / "depths", desk / "t.json"
    declared = ["--space", "depth", "--unit", unit]
    for command in (
        ["track", "make", "--task", "eth3d", "--truth", depths, "--photos", desk / "photos",
         *declared, "-o", track],
        ["baseline", "import", depths, "--task", "eth3d", "--track", track, *declared,
         "-o", desk / "run"],
        ["evaluate", desk / "run", "--truth", depths, "-o", desk / "e", "--draws", "9"],
    ):  # fmt: skip
        assert cli.run([str(word) for word in command]) == 0
    rows = rows_of(desk / "e")
    assert len(rows) == 3
    assert max(row["metrics"]["abs_rel"]["error_1"] for row in rows) < 1e-12


def test_a_folder_of_depth_that_does_not_fit(desk: Path, make: Make) -> None:
    (desk / "depths/depth.toml").write_text('space = "depth"\nunit = "mm"\n')
    photos = desk / "photos"
    assert len(make(desk / "depths", photos=photos)["images"]) == 3
    cv2.imwrite(str(desk / "depths/a/2.png"), np.ones((20, 31), np.uint16))
    with pytest.raises(
        CatalogError, match=r"2\.png and its photo have different sizes.*31x20.*32x20"
    ):
        make(desk / "depths", photos=photos)
    (desk / "depths/a/2.png").write_bytes(b"no picture")
    with pytest.raises(DepthFileError, match=r"2\.png cannot be read"):
        make(desk / "depths", photos=photos)
    np.save(desk / "depths/a/1.npy", np.ones((20, 32), np.float32))
    with pytest.raises(CatalogError, match="more than one depth file"):
        make(desk / "depths", photos=photos)
    with pytest.raises(CatalogError, match="no photo below a has a depth file below depths"):
        make(desk / "depths", photos=photos / "a")
    with pytest.raises(UsageError, match="cannot be combined"):
        make(desk / "depths", photos=photos, scenes=["a"])


def test_photos_and_depth_in_one_folder(desk: Path, make: Make) -> None:
    shutil.copytree(desk / "photos", desk / "both")
    for i, name in enumerate(("a/1", "a/2", "b")):
        path = desk / "both" / f"{name}.npz"
        np.savez(path, depth=plane((32, 20), i).astype(np.float32))
    (desk / "both/depth.toml").write_text('space = "depth"\nunit = "m"\n')
    assert len(make(desk / "both", photos=desk / "both")["images"]) == 3


@pytest.mark.parametrize("more", [["--scenes", "a"], ["--dataset", "a"], ["--unit", "mm"]])
def test_options_of_depth_are_for_depth(tmp_path: Path, more: list[str]) -> None:
    (tmp_path / "t.json").write_text("{}")
    make = ["track", "make", "--truth", str(tmp_path / "t.json"), "-o", str(tmp_path / "o.json")]
    assert cli.run([*make, "--task", "coco", *more]) == 2
    assert not (tmp_path / "o.json").exists()


@pytest.mark.parametrize("unit", ["cm", "m/0", "m/x", "m/inf", "m/-5"])
def test_a_unit_that_is_none(desk: Path, unit: str) -> None:
    make = ["track", "make", "--task", "eth3d", "--truth", str(desk / "depths")]
    make += ["--photos", str(desk / "photos"), "-o", str(desk / "t.json"), "--unit", unit]
    assert cli.run(make) == 2
    assert not (desk / "depths/depth.toml").exists()


def test_hidden_pictures_are_no_photos(tmp_path: Path) -> None:
    for name in ("b.png", "a/c.JPG", ".hidden.png", ".cache/d.png", "e.txt", "f.png.bak", "g..png"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert sorted(_pictures(tmp_path)) == ["a/c.JPG", "b.png", "g..png"]


@pytest.mark.parametrize(
    "ending", [".jpg", ".jpeg", ".png", ".webp", ".bmp", ".tif", ".tiff", ".ppm", ".JPEG"]
)
def test_photos_of_every_format_are_found_and_nothing_else(tmp_path: Path, ending: str) -> None:
    (tmp_path / "a").mkdir()
    for name in (f"a/1{ending}", f"2{ending}", "notes.txt", "a/depth.npy", "jpg"):
        (tmp_path / name).touch()
    assert sorted(_pictures(tmp_path)) == [f"2{ending}", f"a/1{ending}"]
