"""VGGT: its input, the camera with the resize undone, and the whole program on a stand-in."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest
from baseline_programs.child import (
    ask,
    ask_here,
    defaults,
    drawn_photo,
    importable,
    program,
    refusal,
    request,
    some_photo,
)
from PIL import Image

torch = pytest.importorskip("torch")
pytest.importorskip("safetensors")
importable("vggt")
STANDIN = Path(__file__).parent / "vggt_standin"
if str(STANDIN) not in sys.path:
    sys.path.insert(0, str(STANDIN))

import vggt_network  # noqa: E402
from safetensors.torch import save_file  # noqa: E402
from vggt_camera import NoCameraError, photo_camera  # noqa: E402
from vggt_depth import photo_depth  # noqa: E402
from vggt_input import TooSmallError, fit, network_photo  # noqa: E402

SIZES = {"embed_dim": 8, "img_size": 518, "patch_size": 14}


def camera_request(weights, output, photos, **options):
    return request("camera", weights, output, photos, options={**defaults("vggt"), **options})


# The input


@pytest.mark.parametrize(
    ("size_wh", "mode", "resized", "network", "origin"),
    [
        ((640, 480), "crop", (518, 392), (518, 392), (0, 0)),  # 388.5 is nearer to 392
        ((640, 480), "pad", (518, 392), (518, 518), (0, 63)),
        ((480, 640), "crop", (518, 686), (518, 518), (0, -84)),
        ((480, 640), "pad", (392, 518), (518, 518), (63, 0)),
        ((6048, 4032), "crop", (518, 350), (518, 350), (0, 0)),
        ((100, 100), "pad", (518, 518), (518, 518), (0, 0)),
        ((4000, 432), "crop", (518, 56), (518, 56), (0, 0)),
    ],
)
def test_the_sizes_are_the_official_ones(size_wh, mode, resized, network, origin):
    placed = fit(size_wh, mode)
    assert (placed.resized_wh, placed.network_wh, placed.origin_xy) == (resized, network, origin)
    photo = np.zeros((*size_wh[::-1], 3), np.uint8)
    assert network_photo(photo, placed).shape == (3, *network[::-1])


@pytest.mark.parametrize("size_wh", [(55, 500), (640, 55), (4000, 370), (1, 1)])
def test_a_photo_that_is_too_small_is_refused(size_wh):
    with pytest.raises(TooSmallError, match=f"{size_wh[0]}x{size_wh[1]} px"):
        fit(size_wh, "crop")


def test_cropped_rows_are_the_middle_and_padding_is_white():
    photo = np.random.default_rng(0).integers(0, 256, (640, 480, 3), np.uint8)
    tall = np.asarray(Image.fromarray(photo).resize((518, 686), Image.Resampling.BICUBIC))
    seen = network_photo(photo, fit((480, 640), "crop"))
    assert np.array_equal((seen * 255).round(), tall[84:602].transpose(2, 0, 1))
    whole = network_photo(photo, fit((480, 640), "pad"))
    narrow = np.asarray(Image.fromarray(photo).resize((392, 518), Image.Resampling.BICUBIC))
    assert np.array_equal((whole[:, :, 63:455] * 255).round(), narrow.transpose(2, 0, 1))
    assert (whole[:, :, :63] == 1).all()
    assert (whole[:, :, 455:] == 1).all()


# The camera


def seen_by_network(camera, size_wh, mode):
    """What a network that knows a photo's camera answers: the fields of view of what it sees.

    By the angles of rays through the photo's pixels at the edges of the crop, or of the border; no
    intrinsics are scaled.
    """
    placed = fit(size_wh, mode)
    fields = []
    for axis, name in enumerate("xy"):
        focal, centre = camera[f"f{name}"], camera[f"c{name}"]
        shown = placed.resized_wh[axis] / size_wh[axis]
        first = (0 - placed.origin_xy[axis]) / shown
        last = (placed.network_wh[axis] - placed.origin_xy[axis]) / shown
        fields.append(math.atan((last - centre) / focal) - math.atan((first - centre) / focal))
    return placed, fields[0], fields[1]


@pytest.mark.parametrize("mode", ["crop", "pad"])
@pytest.mark.parametrize("size_wh", [(640, 480), (480, 640), (1000, 333), (333, 1000), (518, 518)])
def test_the_photo_s_camera_comes_back_from_the_fields_of_view(size_wh, mode):
    width, height = size_wh
    camera = {"fx": 0.9 * width, "fy": 0.93 * width, "cx": width / 2, "cy": height / 2}
    placed, wide, high = seen_by_network(camera, size_wh, mode)
    pose = torch.tensor([[[0, 0, 0, 0, 0, 0, 1, high, wide]]], dtype=torch.float64)
    from vggt.utils.pose_enc import pose_encoding_to_extri_intri

    _, intrinsics = pose_encoding_to_extri_intri(pose, placed.network_wh[::-1])
    found = photo_camera(intrinsics[0, 0].double().numpy(), placed)
    assert (found.pop("width"), found.pop("height")) == size_wh
    assert found == pytest.approx(camera, rel=1e-6)


@pytest.mark.filterwarnings("ignore:register_new_resolver:UserWarning")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_the_stand_in_decodes_poses_as_depth_anything_3_does():
    """DA3's package has the same encoding."""
    theirs = pytest.importorskip("depth_anything_3.model.utils.transform")
    from vggt.utils.pose_enc import pose_encoding_to_extri_intri

    poses = torch.rand(2, 3, 9, generator=torch.Generator().manual_seed(0)) + 0.2
    for own, other in zip(
        pose_encoding_to_extri_intri(poses, (392, 518)),
        theirs.pose_encoding_to_extri_intri(poses, (392, 518)),
        strict=True,
    ):
        torch.testing.assert_close(own, other)


def test_points_project_to_the_same_photo_pixels():
    """The network's pixels of points, mapped back, are where the photo's camera has them."""
    placed = fit((480, 640), "crop")
    matrix = np.array([[700.0, 0, 250], [0, 710, 270], [0, 0, 1]])
    found = photo_camera(matrix, placed)
    points = np.random.default_rng(1).uniform((-1, -1, 2), (1, 1, 5), (50, 3))
    in_network = (points @ matrix.T)[:, :2] / points[:, 2:]
    in_photo = (in_network - placed.origin_xy) / np.array(placed.resized_wh) * (480, 640)
    directly = points[:, :2] / points[:, 2:] * (found["fx"], found["fy"])
    directly += found["cx"], found["cy"]
    assert np.abs(in_photo - directly).max() < 1e-9


@pytest.mark.parametrize("bad", [0.0, -3.0, math.nan, math.inf])
def test_an_answer_that_is_no_camera_is_one_line(bad):
    matrix = np.array([[bad, 0, 259], [0, 500.0, 259], [0, 0, 1]])
    with pytest.raises(NoCameraError, match="no camera: fx"):
        photo_camera(matrix, fit((640, 480), "crop"))


# The depth


def test_depth_is_unknown_where_the_network_saw_nothing_or_is_unsure():
    placed = fit((1480, 1960), "crop")
    assert placed.resized_wh == (518, 686)
    depth = np.random.default_rng(2).uniform(1, 9, (518, 518)).astype(np.float32)
    confidence = np.ones((518, 518), np.float32)
    confidence[:, 100:] = 2.0
    values = photo_depth(depth, confidence, placed, 1.5)
    assert values.shape == (686, 518)
    assert np.array_equal(values[84:602, 100:], depth[:, 100:])
    rest = values.copy()
    rest[84:602, 100:] = np.inf
    assert np.isposinf(rest).all()
    padded = photo_depth(depth, confidence, fit((1480, 1960), "pad"), 1.0)
    assert np.array_equal(padded, depth[:, 63:455])


def test_an_array_larger_than_the_photo_is_read_at_its_pixels():
    placed = fit((64, 60), "crop")
    depth, confidence = (np.full(placed.network_wh[::-1], v, np.float32) for v in (3.0, 1.0))
    values = photo_depth(depth, confidence, placed, 1.0)
    assert values.shape == (60, 64)
    assert np.allclose(values, 3.0)


# The whole program


@pytest.fixture(scope="module")
def network():
    """All heads, as a checkpoint has them; 60 degrees wide and 47 high whatever it sees."""
    from vggt.models.vggt import VGGT

    torch.manual_seed(0)
    made = VGGT(**SIZES)
    branch = made.camera_head.pose_branch
    torch.nn.init.zeros_(branch.weight)
    branch.bias.data = torch.tensor([0, 0, 0, 0, 0, 0, 1, math.radians(47), math.radians(60)])
    return made


@pytest.fixture(scope="module")
def checkpoint(network, tmp_path_factory):
    folder = tmp_path_factory.mktemp("vggt")
    save_file(network.state_dict(), folder / "model.safetensors")
    (folder / "config.json").write_text(json.dumps(SIZES))
    return folder


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    folder = tmp_path_factory.mktemp("photos")
    return [drawn_photo(folder / "tall.png", (600, 800)), some_photo()]


def test_the_program_answers_camera_and_depth(checkpoint, photos, tmp_path):
    said = ask("vggt", camera_request(checkpoint, tmp_path, photos, mode="pad"), STANDIN)
    tall = said.results[1]
    fx = 259 / math.tan(math.radians(30)) * 600 / 392
    fy = 259 / math.tan(math.radians(23.5)) * 800 / 518
    camera = {"width": 600, "height": 800, "fx": fx, "fy": fy, "cx": 300, "cy": 400}
    assert tall["camera"] == pytest.approx(camera, rel=1e-5)
    assert tall["depth"]["size_wh"] == [392, 518]
    assert (tall["depth"]["space"], tall["depth"]["unit"]) == ("depth", None)
    with np.load(tmp_path / tall["depth"]["file"]) as stored:
        assert np.isfinite(stored["values"]).all()
        assert (stored["values"] > 0).all()
    provenance = said.provenance
    assert [f["name"] for f in provenance["weight_files"]] == ["model.safetensors"]
    assert len(provenance["package"]["sha256"]) == 64
    assert provenance["package"]["commit"] is None
    assert provenance["preprocessing"]["mode"] == "pad"
    assert provenance["camera"]["rotation"] is None
    assert str(checkpoint) not in json.dumps(provenance)


def test_a_pt_file_and_a_camera_alone(network, photos, tmp_path, monkeypatch):
    """A file has no config.json beside it: the sizes are VGGT-1B's."""
    monkeypatch.setattr(vggt_network, "SIZES", SIZES)
    torch.save(network.state_dict(), tmp_path / "model.pt")
    asked = camera_request(tmp_path / "model.pt", tmp_path, photos[:1], depth=False)
    said = ask_here("vggt", asked)
    assert set(said.results[1]) == {"image_id", "camera", "counts"}
    assert said.provenance["model"] == "model.pt"


def test_as_a_baseline_of_depth(checkpoint, photos, tmp_path):
    asked = camera_request(checkpoint, tmp_path, photos[:1], least_confidence=1e9)
    said = ask_here("vggt", {**asked, "task": "eth3d"})
    assert said.results[1]["counts"]["unsure_px"] == 518 * 518
    with np.load(tmp_path / "depth" / "tall.npz") as stored:
        assert stored["values"].shape == (686, 518)
        assert not np.isfinite(stored["values"]).any()


def change_checkpoint(checkpoint, folder, change):
    from safetensors.torch import load_file

    weights = change(load_file(checkpoint / "model.safetensors"))
    save_file(weights, folder / "model.safetensors")
    (folder / "config.json").write_text(json.dumps(SIZES))
    return folder


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (lambda w: {k: v for k, v in w.items() if "camera_token" not in k}, "camera_token"),
        (lambda w: {**w, "b": torch.zeros(1)}, "1 unknown (b)"),
        (lambda w: {f"module.{k}": v for k, v in w.items()}, "keys are missing"),
        (lambda w: {**w, "camera_head.pose_branch.bias": torch.zeros(8)}, "shape (8,)"),
    ],
)
def test_wrong_weights_are_refused(checkpoint, tmp_path, change, found):
    words = refusal(
        "vggt", camera_request(change_checkpoint(checkpoint, tmp_path, change), tmp_path, [])
    )
    assert "no checkpoint of VGGT" in words["message"]
    assert found in words["found"]


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("model.pt", b"not a checkpoint", "cannot be read"),
        ("model.safetensors", b"\0" * 40, "cannot be read"),
        ("model.onnx", b"", "a file of another kind"),
    ],
)
def test_a_file_that_is_no_weights_is_refused(tmp_path, name, data, message):
    (tmp_path / name).write_bytes(data)
    words = refusal("vggt", camera_request(tmp_path / name, tmp_path, []))
    assert message in words["message"]


def test_code_in_a_pt_file_is_not_run(tmp_path):
    torch.save({"w": Path}, tmp_path / "model.pt")
    words = refusal("vggt", camera_request(tmp_path / "model.pt", tmp_path, []))
    assert "cannot be read" in words["message"]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"weights": "/nowhere/model.pt"}, "no folder and no model id"),
        ({"weights": "facebook/VGGT-1B"}, "no model that can be had offline"),
        ({"dtype": "bfloat16"}, "half precision"),
        ({"task": "eth3d", "options": {"mode": "crop", "depth": False}}, "this run is of depth"),
    ],
)
def test_what_cannot_be_run_is_refused(tmp_path, monkeypatch, changes, message):
    monkeypatch.setenv("HF_HUB_CACHE", str(tmp_path))
    words = refusal("vggt", {**camera_request(tmp_path, tmp_path, []), **changes})
    assert message in words["message"]


def test_weights_of_another_input_are_refused(checkpoint, tmp_path):
    change_checkpoint(checkpoint, tmp_path, lambda weights: weights)
    (tmp_path / "config.json").write_text(json.dumps({**SIZES, "patch_size": 16}))
    words = refusal("vggt", camera_request(tmp_path, tmp_path, []))
    assert "patch_size 16" in words["found"]


@pytest.fixture
def no_package(monkeypatch):
    """As where there is no stand-in."""
    monkeypatch.setattr(sys, "path", [path for path in sys.path if path != str(STANDIN)])
    for name in [name for name in sys.modules if name.partition(".")[0] == "vggt"]:
        monkeypatch.delitem(sys.modules, name)


@pytest.mark.usefixtures("no_package")
def test_without_the_package_it_says_how_to_get_it(checkpoint, tmp_path):
    words = refusal("vggt", camera_request(checkpoint, tmp_path, []))
    assert words["message"] == "the package vggt is not installed"
    assert "git+https://github.com/facebookresearch/vggt.git" in words["next_step"]


@pytest.mark.usefixtures("no_package")
@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("class VGGT:\n    def __init__(self, cfg): ...\n", "not facebookresearch's"),
        ("import vggt.nothing\n", "not facebookresearch's"),
        ("x = 1\n", "not facebookresearch's"),
        (
            "import nothing_of_this_name\n",
            "nothing_of_this_name is not installed, which vggt needs",
        ),
    ],
)
def test_another_package_of_the_name_is_refused(checkpoint, tmp_path, monkeypatch, source, message):
    for folder in ("", "models", "utils"):
        (tmp_path / "vggt" / folder).mkdir()
        (tmp_path / "vggt" / folder / "__init__.py").write_text("")
    (tmp_path / "vggt" / "models" / "vggt.py").write_text(source)
    (tmp_path / "vggt" / "utils" / "pose_enc.py").write_text(
        "def pose_encoding_to_extri_intri(): ...\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    words = refusal("vggt", camera_request(checkpoint, tmp_path, []))
    assert message in words["message"]
    for name in [name for name in sys.modules if name.partition(".")[0] == "vggt"]:
        del sys.modules[name]


@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        RuntimeError("DefaultCPUAllocator: can't allocate memory: you tried to allocate 9 bytes"),
        torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2.00 GiB"),
    ],
)
def test_out_of_memory_is_one_line(checkpoint, photos, tmp_path, monkeypatch, error):
    def fails(*_arguments, **_more):
        raise error

    asked = camera_request(checkpoint, tmp_path, photos[:1])
    run = program("vggt")
    model, _ = run.load(asked)
    with monkeypatch.context() as patch:
        patch.setattr(vggt_network, "predict", fails)
        failed = run.predict(model, asked["images"][0])["failed"]
    assert failed.startswith("out of memory on cpu")
    monkeypatch.setattr(vggt_network, "load_weights", fails)
    assert "does not fit into the memory" in refusal("vggt", asked)["message"]


def test_another_error_is_not_called_so(checkpoint, photos, tmp_path, monkeypatch):
    def fails(*_arguments):
        raise RuntimeError("shapes cannot be multiplied")

    asked = camera_request(checkpoint, tmp_path, photos[:1])
    run = program("vggt")
    model, _ = run.load(asked)
    monkeypatch.setattr(vggt_network, "predict", fails)
    with pytest.raises(RuntimeError, match="multiplied"):
        run.predict(model, asked["images"][0])
