"""Depth estimators of transformers: what their numbers are, on which grid, and end to end."""

from __future__ import annotations

import json
import math
import shutil
from types import SimpleNamespace

import numpy as np
import pytest
from baseline_programs.child import ask, defaults, importable, program, refusal, request, some_photo
from PIL import Image

torch = pytest.importorskip("torch")
transformers = pytest.importorskip("transformers")
importable("hf-depth")

import depth_network  # noqa: E402
from baseline_programs.tiny_depth import TINY, dpt_config, save_depth_pro, save_tiny, square  # noqa: E402
from depth_declared import declared_numbers  # noqa: E402
from depth_grid import fits, written_array  # noqa: E402
from legoworld_baseline import Refused  # noqa: E402


@pytest.fixture(scope="module")
def photo():
    return some_photo()


def depth_request(weights, output, photo, **options):
    options = {**defaults("hf-depth"), **options}
    return request("eth3d", weights, output, [photo], options=options)


def run_here(weights, output, photo, **options):
    """Load and predict in this process: provenance, result, the array on disk."""
    run = program("hf-depth")
    asked = depth_request(weights, output, photo, **options)
    model, provenance = run.load(asked)
    result = run.predict(model, asked["images"][0])
    return provenance, result, load_depth(output, photo)


def load_depth(output, photo):
    with np.load(output / "depth" / f"{photo.stem}.npz") as file:
        return str(file["space"]), str(file["unit"]), file["values"]


# What the numbers are


@pytest.mark.parametrize(
    ("model_type", "kind", "expected"),
    [
        ("depth_anything", "relative", ("disparity", None)),
        ("depth_anything", "metric", ("depth", "m")),
        ("dpt", None, ("disparity", None)),
        ("glpn", None, ("depth", "m")),
        ("zoedepth", None, ("depth", "m")),
        ("depth_pro", None, ("depth", "m")),
    ],
)
def test_declared_by_the_type(model_type, kind, expected):
    config = SimpleNamespace(model_type=model_type, depth_estimation_type=kind)
    found = declared_numbers(config, "declared", "declared")
    assert (found.space, found.unit) == expected
    assert found.said_by == "model_type"


def test_an_undeclared_type_is_refused_until_told():
    config = SimpleNamespace(model_type="tipsv2_dpt")
    with pytest.raises(Refused) as refusal:
        declared_numbers(config, "declared", "declared")
    assert "space=disparity" in refusal.value.reason["next_step"]
    found = declared_numbers(config, "disparity", "declared")
    assert (found.space, found.unit, found.said_by) == ("disparity", None, "option")
    found = declared_numbers(config, "depth", "m")
    assert (found.space, found.unit) == ("depth", "m")
    with pytest.raises(Refused, match="unit without a space"):
        declared_numbers(config, "declared", "m")


# The grid


def test_an_array_the_scorer_takes_is_left_alone():
    values = np.ones((336, 504), np.float32)
    assert written_array(values, "depth", (6048, 4032)) is values
    assert not fits((384, 384), (640, 480))  # stretched
    assert not fits((480, 641), (640, 480))  # larger
    assert fits((480, 640), (640, 480))


@pytest.mark.parametrize("space", ["depth", "disparity"])
@pytest.mark.parametrize("padding_wh", [(0, 0), (3, 2)])
def test_another_array_is_read_at_the_pixel_centres(space, padding_wh):
    values = (np.random.default_rng(2).random((9, 9)) * 4 + 1).astype(np.float32)
    hole = np.inf if space == "depth" else np.nan
    values[:3, :3] = hole
    (left, top), (width, height) = padding_wh, (16, 6)
    found = written_array(values, space, (width, height), padding_wh)
    assert found.shape == (height, width)
    assert found.dtype == np.float32
    for y in range(height):
        for x in range(width):
            u = (x + left + 0.5) * 9 / (width + 2 * left) - 0.5
            v = (y + top + 0.5) * 9 / (height + 2 * top) - 0.5
            u, v = min(max(u, 0), 8), min(max(v, 0), 8)
            total = weight = 0.0
            for row, row_weight in ((int(v), 1 - v % 1), (int(v) + 1, v % 1)):
                for col, col_weight in ((int(u), 1 - u % 1), (int(u) + 1, u % 1)):
                    value = float(values[min(row, 8), min(col, 8)])
                    if np.isfinite(value):
                        value = 1 / value if space == "depth" else value
                        total += row_weight * col_weight * value
                        weight += row_weight * col_weight
            expected = hole
            if weight >= 0.5:
                expected = weight / total if space == "depth" else total / weight
            assert found[y, x] == pytest.approx(expected, rel=1e-5, nan_ok=True)


@pytest.mark.parametrize("size_wh", [(640, 480), (51, 200), (6048, 4032)])
def test_zoedepths_padding_is_what_its_processor_adds(size_wh, tmp_path):
    processor = transformers.ZoeDepthImageProcessorPil()
    processor.save_pretrained(tmp_path)
    width, height = size_wh
    padded = processor.pad_image(np.zeros((1, height, width), np.float32))
    mirrored = depth_network.load_preparation(tmp_path, "zoedepth", "pil")
    left, top = depth_network.padding_wh(mirrored, size_wh)
    assert padded.shape == (1, height + 2 * top, width + 2 * left)
    transformers.ZoeDepthImageProcessorPil(do_pad=False).save_pretrained(tmp_path)
    plain = depth_network.load_preparation(tmp_path, "zoedepth", "pil")
    assert depth_network.padding_wh(plain, size_wh) == (0, 0)


# The models


@pytest.mark.parametrize("name", list(TINY))
def test_each_kind_of_checkpoint(name, tmp_path, photo):
    folder = save_tiny(name, tmp_path / "model")
    provenance, result, (space, unit, values) = run_here(folder, tmp_path / "run", photo)
    assert (space, unit or None) == TINY[name][3]
    assert result["depth"]["space"] == space
    assert provenance["depth"]["said_by"] == "model_type"
    assert provenance["preprocessing"]["class"] == TINY[name][1]
    assert provenance["preprocessing"]["backend"] == "pil"
    # what transformers itself gives for the photo
    network = transformers.AutoModelForDepthEstimation.from_pretrained(folder).eval()
    processor = transformers.AutoImageProcessor.from_pretrained(folder, backend="pil")
    with Image.open(photo) as picture:
        size_wh = picture.size
        inputs = processor(images=picture.convert("RGB"), return_tensors="pt")
    with torch.inference_mode():
        expected = network(**inputs).predicted_depth[0].numpy()
    if name in ("depth_anything", "metric", "glpn"):
        assert np.array_equal(values, expected)
    else:  # a square, or padded: at the photo's size
        assert values.shape == size_wh[::-1]
        assert values.min() >= expected.min() * (1 - 1e-5)
        assert values.max() <= expected.max() * (1 + 1e-5)
    assert np.ptp(values) > 1e-5 * abs(values).max()  # not one number everywhere


def test_depth_pro_gives_metres_through_its_own_field_of_view(tmp_path, photo):
    folder = save_depth_pro(tmp_path / "model")
    _, _, (space, unit, values) = run_here(folder, tmp_path / "run", photo)
    assert (space, unit) == ("depth", "m")
    with Image.open(photo) as picture:
        size_wh = picture.size
        pixels = np.asarray(picture.convert("RGB"), np.float32)
    assert values.shape == size_wh[::-1]
    # the published chain: canonical inverse depth * width / focal length is 1 / m
    network = transformers.AutoModelForDepthEstimation.from_pretrained(folder).eval()
    photo_values = torch.from_numpy((pixels / 255 - 0.5) / 0.5).permute(2, 0, 1)[None]
    resized = torch.nn.functional.interpolate(photo_values, size=(224, 224), mode="bilinear")
    with torch.inference_mode():
        out = network(pixel_values=resized)
    fov = math.radians(out.field_of_view.item())
    assert 0.5 < fov < 1.6
    focal_px = 0.5 * size_wh[0] / math.tan(0.5 * fov)
    inverse = torch.nn.functional.interpolate(
        out.predicted_depth[None] * size_wh[0] / focal_px, size=size_wh[::-1], mode="bilinear"
    )[0, 0]
    expected = 1 / inverse.clamp(1e-4, 1e4).numpy()
    near = expected < 5  # m; beyond, it shows that they clamp at 10 km after resizing
    assert near.mean() > 0.3
    assert np.allclose(values[near], expected[near], rtol=1e-3)


def test_end_to_end(tmp_path, photo):
    folder = save_tiny("depth_anything", tmp_path / "model")
    said = ask("hf-depth", depth_request(folder, tmp_path / "run", photo))
    space, _, values = load_depth(tmp_path / "run", photo)
    assert space == "disparity"
    assert said.results[1]["depth"]["size_wh"] == [values.shape[1], values.shape[0]]
    _, result, _ = run_here(folder, tmp_path / "again", photo)
    assert result["depth"]["sha256"] == said.results[1]["depth"]["sha256"]
    assert said.provenance["architecture"] == "DepthAnythingForDepthEstimation"
    assert [f["name"] for f in said.provenance["weight_files"]] == ["model.safetensors"]


# Refusals


def test_a_semantic_head_of_the_same_type_is_refused(tmp_path, photo):
    config = dpt_config()
    transformers.DPTForSemanticSegmentation(config).save_pretrained(tmp_path / "model")
    transformers.DPTImageProcessorPil(**square(32)).save_pretrained(tmp_path / "model")
    words = refusal("hf-depth", depth_request(tmp_path / "model", tmp_path / "run", photo))
    assert "head" in words["found"]
    assert "does not fill" in words["message"]


@pytest.mark.parametrize(
    ("change", "found"),
    [({"do_pad": True, "size_divisor": 14}, "do_pad"), (None, "preprocessor_config.json")],
)
def test_an_input_that_is_not_the_whole_photo_is_refused(tmp_path, photo, change, found):
    folder = save_tiny("dpt", tmp_path / "model")
    path = folder / "preprocessor_config.json"
    if change is None:
        path.unlink()
    else:
        path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    with pytest.raises(Refused) as refusal:
        run_here(folder, tmp_path / "run", photo)
    assert found in refusal.value.reason["found"] + refusal.value.reason["expected"]


def test_a_depth_pro_without_field_of_view_is_refused(tmp_path, photo):
    folder = save_depth_pro(tmp_path / "model")
    config = json.loads((folder / "config.json").read_text())
    (folder / "config.json").write_text(json.dumps({**config, "use_fov_model": False}))
    with pytest.raises(Refused, match="field of view"):
        run_here(folder, tmp_path / "run", photo)


def test_a_model_of_something_else_is_refused(tmp_path, photo):
    folder = save_tiny("dpt", tmp_path / "model")
    shutil.copy(folder / "config.json", tmp_path / "kept.json")
    transformers.BertConfig().save_pretrained(folder)
    with pytest.raises(Refused, match="does not estimate depth"):
        run_here(folder, tmp_path / "run", photo)
