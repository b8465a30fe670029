"""Each part of DINO's network against another formulation: loops, scipy, transformers' modules."""

from __future__ import annotations

import math

import numpy as np
import pytest
from baseline_programs.child import importable

torch = pytest.importorskip("torch")
transformers = pytest.importorskip("transformers")
signal = pytest.importorskip("scipy.signal")

importable("dino")

import dino_attention  # noqa: E402
from dino_backbone import Bottleneck, ResNetBody  # noqa: E402
from dino_transformer import (  # noqa: E402
    DecoderLayer,
    DinoSize,
    EncoderLayer,
    moved,
    proposals,
)

SHAPES_HW = ((6, 9), (3, 5), (2, 3), (1, 2))
SIZE = DinoSize(dim=32, heads=4, feedforward=48, queries=11)


def randomise_parameters(module, seed=0, scale=0.3):
    """Every parameter and buffer drawn; a variance stays positive."""
    generator = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for name, tensor in module.state_dict().items():
            drawn = torch.randn(tensor.shape, generator=generator, dtype=torch.float64) * scale
            tensor.copy_(drawn.abs() + 0.5 if name.endswith("running_var") else drawn)
    return module.double().eval()


def draw(*shape, seed=1):
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(*shape, generator=generator, dtype=torch.float64)


def n_pixels():
    return sum(height * width for height, width in SHAPES_HW)


# --- deformable attention ---------------------------------------------------------------------


def bilinear(feature_map, x_px, y_px):
    """(H, W, C) read at a point in pixel-edge coordinates; 0 outside, pixel (0, 0) at (.5, .5)."""
    height, width, channels = feature_map.shape
    total = np.zeros(channels)
    left, top = math.floor(x_px - 0.5), math.floor(y_px - 0.5)
    for row in (top, top + 1):
        for column in (left, left + 1):
            if 0 <= row < height and 0 <= column < width:
                share = (1 - abs(x_px - 0.5 - column)) * (1 - abs(y_px - 0.5 - row))
                total += share * feature_map[row, column]
    return total


def attention_by_loops(module, queries, references, features):
    """What eq. 3 of Deformable DETR says, one sample at a time."""
    weights = {k: v.numpy() for k, v in module.state_dict().items()}

    def linear(name, x):
        return x @ weights[f"{name}.weight"].T + weights[f"{name}.bias"]

    heads, levels, points = module.heads, module.levels, module.points
    values = linear("value_proj", features).reshape(len(features), heads, -1)
    offsets = linear("sampling_offsets", queries).reshape(-1, heads, levels, points, 2)
    logits = linear("attention_weights", queries).reshape(-1, heads, levels * points)
    gathered = np.zeros((len(queries), heads, values.shape[2]))
    for q in range(len(queries)):
        for h in range(heads):
            share = np.exp(logits[q, h]) / np.exp(logits[q, h]).sum()
            start = 0
            for level, (height, width) in enumerate(SHAPES_HW):
                block = values[start : start + height * width, h].reshape(height, width, -1)
                start += height * width
                for p in range(points):
                    dx, dy = offsets[q, h, level, p]
                    x, y = references[q, :2]
                    if references.shape[1] == 2:
                        x_px, y_px = x * width + dx, y * height + dy
                    else:
                        x_px = (x + dx / points * references[q, 2] / 2) * width
                        y_px = (y + dy / points * references[q, 3] / 2) * height
                    gathered[q, h] += share[level * points + p] * bilinear(block, x_px, y_px)
    return linear("output_proj", gathered.reshape(len(queries), -1))


@pytest.mark.parametrize("coordinates", [2, 4])
def test_deformable_attention_equals_sampling_in_loops(coordinates):
    module = randomise_parameters(dino_attention.DeformableAttention(32, 4, 4, 4))
    queries, features = 4 * draw(7, 32), draw(n_pixels(), 32, seed=2)
    references = draw(7, coordinates, seed=3).sigmoid()
    with torch.no_grad():
        found = module(queries, references, features, SHAPES_HW)
    expected = attention_by_loops(module, queries.numpy(), references.numpy(), features.numpy())
    np.testing.assert_allclose(found.numpy(), expected, rtol=0, atol=1e-12)


def deformable_config():
    return transformers.DeformableDetrConfig(
        d_model=SIZE.dim,
        encoder_attention_heads=SIZE.heads,
        decoder_attention_heads=SIZE.heads,
        encoder_ffn_dim=SIZE.feedforward,
        decoder_ffn_dim=SIZE.feedforward,
        dropout=0.0,
        activation_dropout=0.0,
        attention_dropout=0.0,
        disable_custom_kernels=True,
        attn_implementation="eager",
    )


def level_arguments():
    shapes = torch.tensor(SHAPES_HW)
    starts = torch.cat((shapes.new_zeros(1), shapes.prod(1).cumsum(0)[:-1]))
    return {
        "spatial_shapes": shapes,
        "spatial_shapes_list": list(SHAPES_HW),
        "level_start_index": starts,
    }


def renamed(module, names):
    found = {}
    for name, tensor in module.state_dict().items():
        for ours, theirs in names.items():
            if name.startswith(ours):
                name = theirs + name.removeprefix(ours)
                break
        found[name] = tensor
    return found


def test_an_encoder_layer_equals_transformers_deformable_detr():
    from transformers.models.deformable_detr import modeling_deformable_detr as authority

    ours = randomise_parameters(EncoderLayer(SIZE))
    theirs = authority.DeformableDetrEncoderLayer(deformable_config()).double().eval()
    names = {
        "norm1.": "self_attn_layer_norm.",
        "norm2.": "final_layer_norm.",
        "linear1.": "mlp.fc1.",
        "linear2.": "mlp.fc2.",
    }
    theirs.load_state_dict(renamed(ours, names))
    x, positions = draw(n_pixels(), 32), draw(n_pixels(), 32, seed=2)
    centres = dino_attention.pixel_centres(SHAPES_HW, x)
    with torch.no_grad():
        found = ours(x, positions, centres, SHAPES_HW)
        expected = theirs(
            hidden_states=x[None],
            attention_mask=torch.ones(1, n_pixels(), dtype=torch.bool),
            spatial_position_embeddings=positions[None],
            reference_points=centres[None, :, None].expand(1, -1, 4, 2),
            **level_arguments(),
        )
    expected = expected[0] if isinstance(expected, tuple) else expected
    torch.testing.assert_close(found, expected.reshape(found.shape), rtol=0, atol=1e-12)


def test_a_decoder_layer_equals_transformers_deformable_detr():
    from transformers.models.deformable_detr import modeling_deformable_detr as authority

    ours = randomise_parameters(DecoderLayer(SIZE))
    theirs = authority.DeformableDetrDecoderLayer(deformable_config()).double().eval()
    state = renamed(
        ours,
        {
            "norm1.": "encoder_attn_layer_norm.",
            "norm2.": "self_attn_layer_norm.",
            "norm3.": "final_layer_norm.",
            "cross_attn.": "encoder_attn.",
            "self_attn.out_proj.": "self_attn.o_proj.",
            "linear1.": "mlp.fc1.",
            "linear2.": "mlp.fc2.",
        },
    )
    for kind in ("weight", "bias"):
        for name, part in zip("qkv", state.pop(f"self_attn.in_proj_{kind}").chunk(3), strict=True):
            state[f"self_attn.{name}_proj.{kind}"] = part
    theirs.load_state_dict(state)
    x, positions, memory = draw(11, 32), draw(11, 32, seed=2), draw(n_pixels(), 32, seed=3)
    boxes = draw(11, 4, seed=4).sigmoid()
    with torch.no_grad():
        found = ours(x, positions, boxes, memory, SHAPES_HW)
        expected = theirs(
            hidden_states=x[None],
            object_queries_position_embeddings=positions[None],
            reference_points=boxes[None, :, None].expand(1, -1, 4, 4),
            encoder_hidden_states=memory[None],
            encoder_attention_mask=torch.ones(1, n_pixels(), dtype=torch.bool),
            **level_arguments(),
        )
    expected = expected[0] if isinstance(expected, tuple) else expected
    torch.testing.assert_close(found, expected.reshape(found.shape), rtol=0, atol=1e-12)


def test_self_attention_equals_einsum():
    module = randomise_parameters(DecoderLayer(SIZE)).self_attn
    placed, x = draw(11, 32), draw(11, 32, seed=2)
    q, k, v = (
        (source @ w.T + b).reshape(11, 4, 8)
        for source, w, b in zip(
            (placed, placed, x),
            module.in_proj_weight.chunk(3),
            module.in_proj_bias.chunk(3),
            strict=True,
        )
    )
    share = torch.einsum("qhc,khc->hqk", q, k).div(math.sqrt(8)).softmax(-1)
    expected = module.out_proj(torch.einsum("hqk,khc->qhc", share, v).reshape(11, 32))
    found = module(placed, placed, x, need_weights=False)[0]
    torch.testing.assert_close(found, expected, rtol=0, atol=1e-12)


# --- positions, proposals, boxes ----------------------------------------------------------------


def sine_by_loop(angle, channel, dim, temperature):
    value = angle / temperature ** (2 * (channel // 2) / dim)
    return math.cos(value) if channel % 2 else math.sin(value)


def test_image_positions_equal_a_loop():
    height, width, dim = 3, 5, 16
    found = dino_attention.image_positions(height, width, dim, draw(1)).reshape(height, width, dim)
    for row in range(height):
        for column in range(width):
            for channel in range(dim):
                count, size = (row, height) if channel < dim // 2 else (column, width)
                angle = 2 * math.pi * (count + 1) / (size + 1e-6)
                expected = sine_by_loop(angle, channel % (dim // 2), dim // 2, 20)
                assert found[row, column, channel].item() == pytest.approx(expected, abs=1e-13)


def test_box_positions_equal_a_loop():
    boxes = draw(4, 4).sigmoid()
    found = dino_attention.box_positions(boxes, 16)
    assert found.shape == (4, 32)
    for query in range(4):
        for channel in range(32):
            axis = (1, 0, 2, 3)[channel // 8]
            angle = 2 * math.pi * boxes[query, axis].item()
            expected = sine_by_loop(angle, channel % 8, 8, 10000)
            assert found[query, channel].item() == pytest.approx(expected, abs=1e-13)


def test_proposals_equal_a_loop():
    found, valid = proposals(((3, 60), (2, 2), (1, 1), (1, 1), (1, 1)), draw(1))
    expected = []
    for level, (height, width) in enumerate(((3, 60), (2, 2), (1, 1), (1, 1), (1, 1))):
        for row in range(height):
            for column in range(width):
                side = 0.05 * 2**level
                box = ((column + 0.5) / width, (row + 0.5) / height, side, side)
                inside = all(0.01 < value < 0.99 for value in box)
                expected.append(
                    [math.log(v / (1 - v)) if inside else math.inf for v in box] + [inside]
                )
    np.testing.assert_allclose(found, np.array(expected)[:, :4].astype(float), atol=1e-12)
    assert valid[:, 0].tolist() == [row[4] for row in expected]
    assert not valid.all()
    assert valid.any()


def test_moved_boxes_start_from_clamped_fractions():
    boxes = torch.tensor([[0.0, 1.0, 0.5, 0.2]], dtype=torch.float64)
    delta = torch.tensor([[0.3, -0.4, 0.0, 1.0]], dtype=torch.float64)
    found = moved(boxes, delta)[0].tolist()

    def one(start, end, by):
        logit = math.log(max(start, 1e-3) / max(end, 1e-3)) + by
        return 1 / (1 + math.exp(-logit))

    assert found == pytest.approx(
        [one(0, 1, 0.3), one(1, 0, -0.4), 0.5, one(0.2, 0.8, 1.0)], abs=1e-14
    )


# --- backbone -------------------------------------------------------------------------------------


def convolve(x, weight, stride, padding):
    """(C, H, W) with (O, C, k, k), by scipy."""
    x = np.pad(x, ((0, 0), (padding, padding), (padding, padding)))
    full = [signal.correlate(x, kernel, mode="valid")[0] for kernel in weight]
    return np.stack(full)[:, ::stride, ::stride]


@pytest.mark.parametrize(("inputs", "stride"), [(6, 2), (16, 1)])
def test_a_residual_block_equals_scipy(inputs, stride):
    block = randomise_parameters(Bottleneck(inputs, 4, stride))
    state = {name: tensor.numpy() for name, tensor in block.state_dict().items()}

    def normed(x, name):
        mean, var = state[f"{name}.running_mean"], state[f"{name}.running_var"]
        weight, bias = state[f"{name}.weight"], state[f"{name}.bias"]
        shape = (-1, 1, 1)
        centred = (x - mean.reshape(shape)) / np.sqrt(var.reshape(shape) + 1e-5)
        return centred * weight.reshape(shape) + bias.reshape(shape)

    x = draw(inputs, 7, 8).numpy()
    y = np.maximum(normed(convolve(x, state["conv1.weight"], 1, 0), "bn1"), 0)
    y = np.maximum(normed(convolve(y, state["conv2.weight"], stride, 1), "bn2"), 0)
    y = normed(convolve(y, state["conv3.weight"], 1, 0), "bn3")
    beside = x
    if inputs != 16 or stride != 1:
        beside = normed(convolve(x, state["downsample.0.weight"], stride, 0), "downsample.1")
    expected = np.maximum(y + beside, 0)
    with torch.no_grad():
        found = block(torch.from_numpy(x)[None])[0].numpy()
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def test_the_body_equals_transformers_resnet_50():
    ours = randomise_parameters(ResNetBody((3, 4, 6, 3), 4), scale=0.15)
    config = transformers.ResNetConfig(
        embedding_size=4,
        hidden_sizes=[16, 32, 64, 128],
        depths=[3, 4, 6, 3],
        layer_type="bottleneck",
        downsample_in_bottleneck=False,
        out_features=["stage2", "stage3", "stage4"],
    )
    theirs = transformers.ResNetBackbone(config).double().eval()
    state = _in_transformers_names(ours)
    untouched = theirs.state_dict().keys() - state.keys()
    assert all(name.endswith("num_batches_tracked") for name in untouched)
    theirs.load_state_dict({**{name: theirs.state_dict()[name] for name in untouched}, **state})
    x = draw(1, 3, 67, 90)
    with torch.no_grad():
        for found, expected in zip(ours(x), theirs(x).feature_maps, strict=True):
            assert expected.abs().max() > 1e-3
            torch.testing.assert_close(found, expected, rtol=1e-10, atol=1e-12)


def _in_transformers_names(body):
    found = {}
    for name, tensor in body.state_dict().items():
        parts = name.split(".")
        if parts[0] in ("conv1", "bn1"):
            kind = "convolution" if parts[0] == "conv1" else "normalization"
            found[f"embedder.embedder.{kind}.{parts[1]}"] = tensor
            continue
        stage, block = int(parts[0][-1]) - 1, parts[1]
        prefix = f"encoder.stages.{stage}.layers.{block}"
        if parts[2] == "downsample":
            kind = "convolution" if parts[3] == "0" else "normalization"
            found[f"{prefix}.shortcut.{kind}.{parts[4]}"] = tensor
        else:
            kind = "convolution" if parts[2].startswith("conv") else "normalization"
            found[f"{prefix}.layer.{int(parts[2][-1]) - 1}.{kind}.{parts[3]}"] = tensor
    return found
