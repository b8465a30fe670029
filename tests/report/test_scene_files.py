"""Renders and scenes of a page: only those that were read out, and words where there is none."""

from __future__ import annotations

import base64
import hashlib
import json
import shutil
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from evaluation.depth.folders import evaluate_depth, write_arrays
from report.chromium import Browser, browser
from report.pages import embedded_json

from legoworld import cli
from legoworld.records.base import to_record
from legoworld.records.run_file import ImageSource
from legoworld.records.run_rows import RunRow
from legoworld.report import page_file
from legoworld.report.scene_files import SceneFiles, why_not_shown

EXAMPLES = Path(__file__).parents[2] / "examples"
TRUTH = Path(__file__).parents[2] / "datasets" / "skimage_examples" / "truth_coco.json"


def glb(document: dict[str, Any]) -> bytes:
    """A binary glTF file of one JSON chunk."""
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    return struct.pack("<4sII", b"glTF", 2, 20 + len(text)) + struct.pack(
        "<I4s", len(text), b"JSON"
    ) + text  # fmt: skip


ROW = RunRow(image_id=1, file_name="one.png", size_wh=(8, 6), status="ok", rendered_wh=(8, 6))


def scene_record(folder: Path, name: str | None = None) -> ImageSource:
    """What a run records of a scene folder; name: another than its own."""
    files = {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.iterdir()}
    pose = [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0.25]]
    camera = {
        "name": "Camera", "type": "PERSP", "world_from_camera": pose, "lens_mm": 45.0,
        "sensor_width_mm": 36.0, "sensor_height_mm": 24.0, "sensor_fit": "AUTO", "shift_x": 0.0,
        "shift_y": 0.0, "ortho_scale": 6.0, "clip_start": 0.1, "clip_end": 100.0,
    }  # fmt: skip
    projection = {
        "fx": 10.0, "fy": 10.0, "cx": 4.0, "cy": 3.0, "orthographic": False, "z_near": 0.1,
        "z_far": 100.0,
    }  # fmt: skip
    record = {"scene": name or folder.name, "files": files}
    return to_record(ImageSource, {**record, "camera": camera, "projection": projection})


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    folder = tmp_path / "scenes" / "one"
    folder.mkdir(parents=True)
    assert cv2.imwrite(str(folder / "final.png"), np.zeros((6, 8, 3), np.uint8))
    (folder / "scene.glb").write_bytes(glb({"asset": {"version": "2.0"}}))
    return folder


def test_the_files_that_were_read_out_are_shown(scene: Path) -> None:
    files = SceneFiles(folders=(scene.parent,))
    shown = files.page_scene(scene_record(scene), ROW)
    assert shown is not None
    assert (shown.render, shown.glb, shown.render_said, shown.glb_said) == (0, 0, "", "")
    assert shown.camera is not None
    assert shown.camera.size_wh == (8, 6)
    again = files.page_scene(scene_record(scene), ROW)
    assert again == shown
    assert len(files.renders) == len(files.glbs) == 1, "each file once"


def test_another_file_than_the_one_that_was_read_out_is_not_shown(scene: Path) -> None:
    record = scene_record(scene)
    (scene / "scene.glb").write_bytes(glb({"asset": {"version": "2.0"}, "extras": 1}))
    (scene / "final.png").unlink()
    shown = SceneFiles(folders=(scene.parent,)).page_scene(record, ROW)
    assert shown is not None
    assert (shown.render, shown.glb) == (None, None)
    assert "its sha256 differs" in shown.glb_said
    assert "was not found" in shown.render_said


def test_a_name_that_leads_out_of_the_scenes_is_not_followed(scene: Path) -> None:
    record = scene_record(scene, "../scenes/one")
    shown = SceneFiles(folders=(scene.parent,)).page_scene(record, ROW)
    assert shown is not None
    assert shown.glb is None
    assert "leads out" in shown.glb_said
    assert SceneFiles(folders=()).page_scene(record, ROW) is None


#: 3e8 vertices that no byte of the file holds.
VERTICES: dict[str, Any] = {"componentType": 5126, "type": "VEC3", "count": 300_000_000}
VIEW: dict[str, Any] = {
    "buffers": [{"byteLength": 3, "uri": "data:;base64,AAAA"}],
    "bufferViews": [{"buffer": 0, "byteLength": 3}],
}


def picture(width: int, height: int) -> str:
    """A data URI with the header of a PNG."""
    head = b"\x89PNG\r\n\x1a\n" + struct.pack(
        ">I4sIIBBBBBI", 13, b"IHDR", width, height, 8, 2, 0, 0, 0, 0
    )
    return "data:image/png;base64," + base64.b64encode(head).decode()


@pytest.mark.parametrize(
    ("document", "words"),
    [
        ({"extensionsRequired": ["KHR_draco_mesh_compression"]}, "Draco-compressed"),
        ({"extensionsRequired": ["EXT_meshopt_compression"]}, "meshopt-compressed"),
        ({"extensionsRequired": ["KHR_texture_basisu"]}, "Basis-compressed"),
        ({"buffers": [{"uri": "scene.bin", "byteLength": 1}]}, "files outside itself: scene.bin"),
        ({"images": [{"uri": "https://example.org/a.png"}]}, "files outside itself"),
        ({"buffers": 5}, "could not be read"),
        ({"extensionsRequired": ["KHR_materials_unlit"]}, ""),
        ({"extensionsRequired": ["ACME_rays"]}, "could not be read: ACME_rays"),
        ({"accessors": [VERTICES]}, "claims 3,600 MB of vertices"),
        ({"accessors": [{**VERTICES, "count": 2_000_000}] * 4}, "claims 96 MB of vertices"),
        ({"accessors": [{**VERTICES, "count": 1000}]}, ""),
        ({"accessors": [{**VERTICES, "bufferView": 0}], **VIEW}, "needs 3600000000 bytes"),
        ({"nodes": [{"children": [1]}, {"children": [0]}]}, "their own ancestors"),
        ({"images": [{"uri": picture(8192, 4096)}] * 4}, ""),
        ({"images": [{"uri": picture(8192, 4096)}] * 5}, "textures of 167,772,160 pixels"),
    ],
)
def test_what_the_page_cannot_show_says_why(document: dict[str, Any], words: str) -> None:
    said = why_not_shown(glb({"asset": {"version": "2.0"}, **document}))
    assert words in said
    assert bool(said) == bool(words)


def test_what_is_no_glb_says_so() -> None:
    assert "could not be read: it begins with b'glTX'" in why_not_shown(b"glTX" + bytes(40))
    assert "could not be read" in why_not_shown(b"glTF")


@pytest.fixture(scope="module")
def evaluation(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The shipped examples, read out and scored."""
    folder = tmp_path_factory.mktemp("examples")
    run = ["readout", str(EXAMPLES), "--task", "coco", "-o", str(folder / "run"), "-q"]
    track = TRUTH.parent / "track_coco.json"
    assert cli.run([*run, "--track", str(track)]) == 0
    evaluate = ["evaluate", str(folder / "run"), "--truth", str(TRUTH), "--draws", "20", "-q"]
    assert cli.run([*evaluate, "-o", str(folder / "eval")]) == 0
    return folder / "eval"


@pytest.fixture(scope="module")
def chrome() -> Iterator[Browser]:
    with browser(viewport={"width": 1280, "height": 900}) as opened:
        yield opened


@pytest.mark.blender
@pytest.mark.parametrize("inside", [True, False])
def test_the_scene_in_3d_covers_what_was_read_out(
    chrome: Browser, evaluation: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, inside: bool
) -> None:
    """Seen from the photo's camera, the body of the cat fills the box that was read out."""
    if not inside:
        monkeypatch.setattr(page_file, "EMBEDDED_SCENE_BYTES", 1000)
    page = tmp_path / "report.html"
    words = ["report", str(evaluation), "--scenes", str(EXAMPLES), "-o", str(page), "-q"]
    assert cli.run(words) == 0
    views = {v["file_name"]: v for v in embedded_json(page, "view-")}
    view = views["chelsea.png"]
    chrome.said.clear()
    chrome.open(page, f"#/coco/{view['id']}?panes=scene0")
    chrome.until("document.querySelector('.scene3d[data-ready]')")
    x, y, w, h = chrome.js(
        """(async () => {
          await new Promise(r => requestAnimationFrame(() => requestAnimationFrame(r)));
          const c = document.querySelector('.scene3d canvas'), g = c.getContext('webgl2');
          const p = new Uint8Array(4 * c.width * c.height);
          g.readPixels(0, 0, c.width, c.height, g.RGBA, g.UNSIGNED_BYTE, p);
          let [l, t, r, b] = [1e9, 1e9, -1, -1];
          for (let i = 0; i < c.width * c.height; i += 1) {
            const [red, green, blue, alpha] = p.subarray(4 * i, 4 * i + 4);
            if (alpha > 200 && blue > red + 40) {
              const [u, v] = [i % c.width, c.height - 1 - Math.floor(i / c.width)];
              l = Math.min(l, u); r = Math.max(r, u + 1);
              t = Math.min(t, v); b = Math.max(b, v + 1);
            }
          }
          return [l / c.width, t / c.height, (r - l) / c.width, (b - t) / c.height];
        })()"""
    )
    width, height = view["size_wh"]
    (cat,) = view["sides"][0]["predictions"]
    read = [cat["box"][0] / width, cat["box"][1] / height,
            cat["box"][2] / width, cat["box"][3] / height]  # fmt: skip
    assert [x, y, w, h] == pytest.approx(read, abs=0.01)
    assert cat["o"] == "tp"
    drawn = "document.querySelector('.scene3d canvas').toDataURL()"
    before = chrome.js(drawn)
    chrome.page.locator(".scene3d canvas").focus()
    chrome.key("ArrowRight")
    assert chrome.js(drawn) != before
    chrome.page.get_by_text("photo's camera").click()
    assert chrome.js(drawn) == before
    wanted = [] if inside else ["scene-"]
    others = [u for u in chrome.asked if not u.startswith("data:") and u != page.as_uri()
              and "#" not in u]  # fmt: skip
    assert all(any(w in u for w in wanted) for u in others)
    assert chrome.said == []


@pytest.mark.blender
def test_the_object_that_is_too_near_is_named(chrome: Browser, tmp_path: Path) -> None:
    """The cat of the ground truth stands a third further away than the scene's; no else errs."""
    one = tmp_path / "scenes" / "chelsea"
    shutil.copytree(EXAMPLES / "chelsea", one)
    run = tmp_path / "run"
    assert cli.run(["readout", str(one.parent), "--task", "eth3d", "-o", str(run), "-q"]) == 0
    (row,) = [json.loads(line) for line in (run / "per_image.jsonl").read_text().splitlines()]
    z_m = np.load(run / row["depth"]["file"])["depth_z_m"]
    truth = write_arrays(tmp_path / "truth", {"chelsea": np.where(z_m < 0.4, z_m * 4 / 3, z_m)})
    evaluate_depth(run, truth, tmp_path / "eval", draws=5)
    page = tmp_path / "report.html"
    words = ["report", str(tmp_path / "eval"), "--scenes", str(one.parent), "-o", str(page), "-q"]
    assert cli.run(words) == 0
    chrome.said.clear()
    chrome.open(page)
    chrome.until("document.querySelector('.worst .object-errors b')")
    assert chrome.js("document.querySelector('.object-errors b').textContent") == "Cat"
    titles = "Array.from(document.querySelectorAll('.worst figcaption'), f => f.textContent)"
    assert chrome.js(titles) == [
        "ground truth", "scene, aligned", "scene minus ground truth", "scene in 3D"
    ]  # fmt: skip
    assert not chrome.js("document.getElementById('pages').innerText.includes('true positive')")
    assert chrome.said == []


def test_a_glb_nested_too_deeply_is_said_for_its_photo_alone(scene: Path) -> None:
    text = b'{"asset": {"version": "2.0"}, "extras": ' + b"[" * 100_000 + b"]" * 100_000 + b"}"
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text), len(text), b"JSON")
    (scene / "scene.glb").write_bytes(head + text)
    shown = SceneFiles(folders=(scene.parent,)).page_scene(scene_record(scene), ROW)
    assert shown is not None
    assert shown.glb is None
    assert "JSON does not parse: maximum recursion depth" in shown.glb_said
    assert shown.render == 0
