"""DA3MONO-LARGE: its input, the sky, the written array, and the whole network end to end."""

from __future__ import annotations

import json

import numpy as np
import pytest
from baseline_programs.child import (
    ROOT,
    ask,
    defaults,
    importable,
    program,
    refusal,
    request,
    some_photo,
)
from PIL import Image

torch = pytest.importorskip("torch")
cv2 = pytest.importorskip("cv2")
pytest.importorskip("omegaconf")
importable("da3")

import da3_network  # noqa: E402
from da3_grid import written_array  # noqa: E402
from da3_input import network_photo  # noqa: E402
from da3_sky import without_sky  # noqa: E402
from legoworld_baseline import Refused  # noqa: E402

# What the package itself does at import, in versions that are pinned.
pytestmark = [
    pytest.mark.filterwarnings("ignore:register_new_resolver:UserWarning"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
]


def eth3d_request(weights, output, photos, **options):
    return request("eth3d", weights, output, photos, options={**defaults("da3"), **options})


def pixels(width, height, seed=0):
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), np.uint8)


# The input


@pytest.mark.parametrize(
    ("size_wh", "expected_wh"),
    [
        ((6048, 4032), (504, 336)),
        ((4032, 6048), (336, 504)),
        ((640, 480), (504, 378)),
        ((640, 427), (504, 336)),
        ((640, 428), (504, 336)),  # 337.05 rounds to 337
        ((1008, 686), (504, 350)),  # 343 is halfway between 336 and 350: up
        ((320, 213), (504, 336)),
        ((504, 504), (504, 504)),
        ((5000, 20), (504, 14)),  # 2 px is nearer to 0 than to 14; 14 is the least
    ],
)
def test_the_size_the_network_sees(size_wh, expected_wh):
    width, height = size_wh
    found = network_photo(np.zeros((height, width, 3), np.uint8))
    assert found.shape == (3, expected_wh[1], expected_wh[0])
    assert found.dtype == np.float32


def test_halving_a_photo_is_the_mean_of_four_pixels():
    photo = pixels(1008, 672)
    blocks = photo.reshape(336, 2, 504, 2, 3).astype(np.float64).mean(axis=(1, 3))
    mean, std = np.array([0.485, 0.456, 0.406]), np.array([0.229, 0.224, 0.225])
    levels = network_photo(photo).transpose(1, 2, 0) * std * 255 + mean * 255
    assert np.abs(levels - levels.round()).max() < 1e-3  # 8-bit numbers, as officially
    assert np.abs(levels - blocks).max() <= 0.5 + 1e-3


def test_the_second_resize_is_cubic_when_one_side_grows():
    photo = pixels(504, 345)
    expected = cv2.resize(photo, (504, 350), interpolation=cv2.INTER_CUBIC)
    mean, std = np.array([0.485, 0.456, 0.406]), np.array([0.229, 0.224, 0.225])
    levels = network_photo(photo).transpose(1, 2, 0) * std * 255 + mean * 255
    assert np.array_equal(levels.round().astype(np.uint8), expected)


# The sky


@pytest.fixture
def view():
    """Depth and sky (400, 500): the upper half is sky; 100,000 pixels are not, and more below."""
    generator = torch.Generator().manual_seed(5)
    depth = torch.rand(400, 500, generator=generator) * 9 + 1
    sky = torch.zeros(400, 500)
    sky[:150] = 0.3
    return depth, sky


def test_the_seeded_sky_is_the_same_twice_and_whatever_was_drawn_before(view):
    depth, sky = view
    one, n_sky = without_sky(depth, sky, "seeded", 7)
    torch.rand(1000)
    other, _ = without_sky(depth, sky, "seeded", 7)
    assert torch.equal(one, other)
    assert n_sky == 150 * 500
    assert torch.equal(one[150:], depth[150:])
    far = one[:150].unique()
    assert len(far) == 1
    # 125,000 pixels are no sky, so the quantile is of a sample: near the whole's, not equal to it
    whole = torch.quantile(depth[150:], 0.99)
    assert abs(far[0] - whole) < 0.02
    assert far[0] != without_sky(depth, sky, "seeded", 8)[0][0, 0]


def test_the_quantile_of_few_pixels_is_of_all_of_them(view):
    depth, sky = view
    sky[:250] = 1.0
    found, _ = without_sky(depth, sky, "seeded", 0)
    ordered = np.sort(depth[250:].numpy().ravel().astype(np.float64))
    place = 0.99 * (len(ordered) - 1)
    below, share = int(place), place - int(place)
    expected = ordered[below] * (1 - share) + ordered[below + 1] * share
    assert found[0, 0].item() == pytest.approx(expected, rel=1e-6)


def test_masked_sky_is_no_prediction_and_off_changes_nothing(view):
    depth, sky = view
    masked, n_sky = without_sky(depth, sky, "mask", 0)
    assert torch.isinf(masked[:150]).all()
    assert torch.equal(masked[150:], depth[150:])
    assert n_sky == 150 * 500
    unchanged, n_sky = without_sky(depth, sky, "off", 0)
    assert torch.equal(unchanged, depth)
    assert n_sky == 0


@pytest.mark.parametrize("policy", ["seeded", "mask"])
@pytest.mark.parametrize("inverted", [False, True])
def test_ten_pixels_of_sky_or_of_anything_else_are_left_alone(policy, inverted):
    depth = torch.rand(20, 20) + 1
    sky = torch.zeros(20, 20)
    sky.view(-1)[:10] = 1.0
    sky = 1 - sky if inverted else sky
    assert torch.equal(without_sky(depth, sky, policy, 0)[0], depth)
    sky.view(-1)[10] = 0.0 if inverted else 1.0
    assert not torch.equal(without_sky(depth, sky, policy, 0)[0], depth)


# The array


def test_an_array_no_larger_than_the_photo_is_left_as_it_is():
    depth = np.random.default_rng(0).random((336, 504), np.float32) + 1
    assert written_array(depth, (6048, 4032)) is depth
    assert written_array(depth, (504, 336)) is depth


def test_a_larger_array_is_read_at_the_pixel_centres_in_one_over_z():
    generator = np.random.default_rng(1)
    depth = (generator.random((12, 18)) * 5 + 1).astype(np.float32)
    depth[:4, :6] = np.inf
    found = written_array(depth, (11, 7))
    assert found.shape == (7, 11)
    assert found.dtype == np.float32
    for y in range(7):
        for x in range(11):
            u, v = (x + 0.5) * 18 / 11 - 0.5, (y + 0.5) * 12 / 7 - 0.5
            total = weight = 0.0
            for row, row_weight in ((int(v), 1 - v % 1), (int(v) + 1, v % 1)):
                for col, col_weight in ((int(u), 1 - u % 1), (int(u) + 1, u % 1)):
                    z = depth[min(row, 11), min(col, 17)]
                    if np.isfinite(z):
                        total += row_weight * col_weight / z
                        weight += row_weight * col_weight
            expected = weight / total if weight >= 0.5 else np.inf
            assert found[y, x] == pytest.approx(expected, rel=1e-5)
    assert np.isinf(found).any()


# The checkpoint


class Small(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.a = torch.nn.Linear(2, 3)


def weights_of(network, prefix="model."):
    return {prefix + key: value + 1 for key, value in network.state_dict().items()}


def test_a_checkpoint_fills_the_network_with_or_without_the_training_token():
    network = Small()
    before = {key: value.clone() for key, value in network.state_dict().items()}
    token = {"model.backbone.pretrained.mask_token": torch.zeros(1, 4)}
    da3_network.load_weights(network, {**weights_of(network), **token})
    for key, value in network.state_dict().items():
        assert torch.equal(value, before[key] + 1)


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (lambda w: {k: v for k, v in w.items() if k != "model.a.bias"}, "a.bias"),
        (lambda w: {**w, "model.b": torch.zeros(1)}, "1 unknown (b)"),
        (lambda w: {k.removeprefix("model."): v for k, v in w.items()}, "a.weight"),
        (lambda w: {**w, "model.a.bias": torch.zeros(4)}, "shape (4,)"),
    ],
)
def test_a_checkpoint_that_does_not_fit_is_refused(change, found):
    network = Small()
    with pytest.raises(Refused) as caught:
        da3_network.load_weights(network, change(weights_of(network)))
    assert found in caught.value.reason["found"]


@pytest.mark.parametrize("config", [None, {"model_name": "da3metric-large"}, {}])
def test_weights_that_do_not_say_they_are_the_mono_model_are_refused(config, tmp_path):
    from safetensors.torch import save_file

    save_file({"model.x": torch.zeros(1)}, tmp_path / "model.safetensors")
    if config is not None:
        (tmp_path / "config.json").write_text(json.dumps(config))
    words = refusal("da3", eth3d_request(tmp_path, tmp_path / "run", []))
    assert "does not identify" in words["message"]


# The whole network


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    """A photo (640x426 where it is the real one) and a strip of a picture."""
    strip = tmp_path_factory.mktemp("photos") / "strip.jpg"
    with Image.open(ROOT / "examples/coffee/final.png") as picture:
        picture.convert("RGB").resize((640, 106)).save(strip)
    return [some_photo(), strip]


@pytest.fixture(scope="module")
def network(photos):
    """The full network with random weights; its sky head calls a fifth of the first photo sky."""
    torch.manual_seed(0)
    network = da3_network.build()
    with torch.inference_mode():
        head = network.head.scratch.sky_output_conv2[2]
        head.weight.mul_(20)
        head.bias.add_(5.0)  # above 0, so that nothing is cut off while its level is measured
        photo = network_photo(np.asarray(Image.open(photos[0]).convert("RGB")))
        output = network(torch.from_numpy(photo)[None, None])
        assert output["sky"].min() > 0
        head.bias.add_(0.3 - output["sky"].quantile(0.8))
    return network


@pytest.fixture(scope="module")
def checkpoint(network, tmp_path_factory):
    """The real layout: every key behind "model.", a token the network does not have, a config."""
    from safetensors.torch import save_file

    folder = tmp_path_factory.mktemp("da3")
    weights = {f"model.{key}": value for key, value in network.state_dict().items()}
    weights["model.backbone.pretrained.mask_token"] = torch.zeros(1, 1024)
    save_file(weights, folder / "model.safetensors")
    (folder / "config.json").write_text(json.dumps({"model_name": "da3mono-large"}))
    yield folder
    (folder / "model.safetensors").unlink()  # 1.3 GB


def test_the_full_network_end_to_end(network, checkpoint, photos, tmp_path):
    said = ask("da3", eth3d_request(checkpoint, tmp_path / "one", photos))
    with np.load(tmp_path / "one" / "depth" / f"{photos[1].stem}.npz") as stored:
        assert (str(stored["space"]), str(stored["unit"])) == ("depth", "")
        assert stored["values"].shape == (84, 504)
    whole, strip = said.results[1], said.results[2]
    width, height = whole["depth"]["size_wh"]
    assert max(width, height) == 504
    assert strip["depth"]["size_wh"] == [504, 84]
    assert strip["depth"]["unit"] is None
    # a fifth of it is sky, so the quantile is of a sample of the rest
    assert 10_000 < whole["counts"]["sky_px"] < width * height - 100_000
    assert said.provenance["sky"]["policy"] == "seeded"
    assert said.provenance["seed"] == 0
    assert said.provenance["libraries"]["depth-anything-3"] == "0.1.1"
    # the other way round, in this process, by the network that was saved: the same bytes
    run, asked = program("da3"), eth3d_request(checkpoint, tmp_path / "two", photos)
    model = run.Model(network=network, dtype=torch.float32, sky="seeded", seed=0, request=asked)
    for image, other in zip(asked["images"][::-1], (strip, whole), strict=True):
        result = run.predict(model, image)
        assert result["depth"]["sha256"] == other["depth"]["sha256"]
        assert result["counts"] == other["counts"]


def test_without_sky_the_depth_is_what_the_package_gives(network, photos):
    """Its own forward pass, sky treatment included, agrees on every pixel that is not sky."""
    prepared = network_photo(np.asarray(Image.open(photos[1]).convert("RGB")))
    own, n_sky = da3_network.predict_depth(network, prepared, torch.float32, "mask", 0)
    assert n_sky > 100
    with torch.inference_mode():
        del network._process_mono_sky_estimation
        theirs = network(torch.from_numpy(prepared)[None, None])["depth"][0, 0].numpy()
        network._process_mono_sky_estimation = lambda output: output
    ground = np.isfinite(own)
    assert np.array_equal(own[ground], theirs[ground])
    # so few pixels are no sky that theirs takes them all, too: the same far value
    assert ground.sum() < 100_000
    seeded, _ = da3_network.predict_depth(network, prepared, torch.float32, "seeded", 0)
    assert np.array_equal(seeded, theirs)
