"""The whole network against a second one, written in numpy from the paper and the original code.

The second network shares no line with the first: float64, loops over samples, im2col convolutions,
no torch. Both read the same state dict.
"""

from __future__ import annotations

import copy

import numpy as np
import pytest
from baseline_programs.child import importable

torch = pytest.importorskip("torch")

importable("dino")

from dino_network import Dino  # noqa: E402
from dino_transformer import DinoSize  # noqa: E402

SMALL = DinoSize(
    dim=64,
    heads=4,
    points=2,
    encoder_layers=2,
    decoder_layers=3,
    feedforward=24,
    queries=9,
    classes=7,
    backbone_blocks=(1, 2, 1, 1),
    backbone_width=4,
)


@pytest.fixture(scope="module")
def network():
    generator = torch.Generator().manual_seed(5)
    found = Dino(SMALL).double().eval()
    with torch.no_grad():
        for name, tensor in found.state_dict().items():
            drawn = torch.randn(tensor.shape, generator=generator, dtype=torch.float64)
            drawn *= 0.15 if "bbox_embed" in name else 0.25  # boxes that move, and not to a corner
            tensor.copy_(drawn.abs() + 0.5 if name.endswith("running_var") else drawn)
    return found


def photo(height=75, width=118):
    generator = torch.Generator().manual_seed(6)
    return torch.randn(3, height, width, generator=generator, dtype=torch.float64)


class Second:
    """DINO in numpy: `state` maps the original's parameter names to arrays."""

    def __init__(self, state):
        self.state = state

    def linear(self, name, x):
        return x @ self.state[f"{name}.weight"].T + self.state[f"{name}.bias"]

    def norm(self, name, x):
        x = x - x.mean(-1, keepdims=True)
        x = x / np.sqrt((x**2).mean(-1, keepdims=True) + 1e-5)
        return x * self.state[f"{name}.weight"] + self.state[f"{name}.bias"]

    def layers(self, name, x, count):
        for index in range(count):
            x = self.linear(f"{name}.layers.{index}", x)
            if index < count - 1:
                x = np.maximum(x, 0)
        return x

    def convolve(self, name, x, stride=1, padding=0):
        weight = self.state[f"{name}.weight"]
        outputs, _, side, _ = weight.shape
        x = np.pad(x, ((0, 0), (padding,) * 2, (padding,) * 2))
        windows = np.lib.stride_tricks.sliding_window_view(x, (side, side), axis=(1, 2))
        windows = windows[:, ::stride, ::stride]
        y = np.einsum("chwij,ocij->ohw", windows, weight, optimize=True)
        bias = self.state.get(f"{name}.bias", np.zeros(outputs))
        return y + bias[:, None, None]

    def frozen(self, name, x):
        part = {
            k: self.state[f"{name}.{k}"][:, None, None]
            for k in ("weight", "bias", "running_mean", "running_var")
        }
        x = (x - part["running_mean"]) / np.sqrt(part["running_var"] + 1e-5)
        return x * part["weight"] + part["bias"]

    def group_norm(self, name, x, groups=32):
        y = x.reshape(groups, -1)
        y = (y - y.mean(1, keepdims=True)) / np.sqrt(y.var(1, keepdims=True) + 1e-5)
        y = y.reshape(x.shape)
        weight, bias = self.state[f"{name}.weight"], self.state[f"{name}.bias"]
        return y * weight[:, None, None] + bias[:, None, None]

    def block(self, name, x, stride):
        y = np.maximum(self.frozen(f"{name}.bn1", self.convolve(f"{name}.conv1", x)), 0)
        y = self.convolve(f"{name}.conv2", y, stride, 1)
        y = np.maximum(self.frozen(f"{name}.bn2", y), 0)
        y = self.frozen(f"{name}.bn3", self.convolve(f"{name}.conv3", y))
        if f"{name}.downsample.0.weight" in self.state:
            x = self.convolve(f"{name}.downsample.0", x, stride)
            x = self.frozen(f"{name}.downsample.1", x)
        return np.maximum(x + y, 0)

    def backbone(self, x):
        body = "backbone.0.body"
        x = np.maximum(self.frozen(f"{body}.bn1", self.convolve(f"{body}.conv1", x, 2, 3)), 0)
        x = np.pad(x, ((0, 0), (1, 1), (1, 1)), constant_values=-np.inf)
        x = np.lib.stride_tricks.sliding_window_view(x, (3, 3), axis=(1, 2))
        x = x[:, ::2, ::2].max((3, 4))
        stages = []
        for stage, blocks in enumerate(SMALL.backbone_blocks, start=1):
            for index in range(blocks):
                stride = 2 if stage > 1 and index == 0 else 1
                x = self.block(f"{body}.layer{stage}.{index}", x, stride)
            stages.append(x)
        return stages[1:]

    def maps(self, x):
        c3, c4, c5 = self.backbone(x)
        found = [self.convolve(f"input_proj.{i}.0", c) for i, c in enumerate((c3, c4, c5))]
        found.append(self.convolve("input_proj.3.0", c5, 2, 1))
        return [self.group_norm(f"input_proj.{i}.1", m) for i, m in enumerate(found)]

    def deformable(self, name, queries, references, features, shapes):
        heads, points = SMALL.heads, SMALL.points
        values = self.linear(f"{name}.value_proj", features)
        offsets = self.linear(f"{name}.sampling_offsets", queries)
        logits = self.linear(f"{name}.attention_weights", queries)
        shape = (len(queries), heads, len(shapes), points)
        share = np.exp(logits.reshape(len(queries), heads, -1))
        share = (share / share.sum(-1, keepdims=True)).reshape(shape)
        offsets = offsets.reshape(*shape, 2)
        out = np.zeros((len(queries), heads, SMALL.dim // heads))
        for q, h, level, p in np.ndindex(*shape):
            height, width = shapes[level]
            start = sum(a * b for a, b in shapes[:level])
            head = slice(h * SMALL.dim // heads, (h + 1) * SMALL.dim // heads)
            grid = values[start : start + height * width, head].reshape(height, width, -1)
            shift = offsets[q, h, level, p]
            if references.shape[1] == 2:
                shift = shift / (width, height)
            else:
                shift = shift / points * references[q, 2:] / 2
            x, y = (references[q, :2] + shift) * (width, height) - 0.5
            for row in (int(np.floor(y)), int(np.floor(y)) + 1):
                for column in (int(np.floor(x)), int(np.floor(x)) + 1):
                    if 0 <= row < height and 0 <= column < width:
                        part = (1 - abs(x - column)) * (1 - abs(y - row))
                        out[q, h] += share[q, h, level, p] * part * grid[row, column]
        return self.linear(f"{name}.output_proj", out.reshape(len(queries), -1))

    def attend(self, name, placed, x):
        weight, bias = self.state[f"{name}.in_proj_weight"], self.state[f"{name}.in_proj_bias"]
        dim, heads = SMALL.dim, SMALL.heads
        q, k, v = (
            (source @ weight[i * dim : (i + 1) * dim].T + bias[i * dim : (i + 1) * dim])
            .reshape(len(x), heads, -1)
            .transpose(1, 0, 2)
            for i, source in enumerate((placed, placed, x))
        )
        share = np.exp(q @ k.transpose(0, 2, 1) / np.sqrt(dim // heads))
        mixed = (share / share.sum(-1, keepdims=True)) @ v
        return self.linear(f"{name}.out_proj", mixed.transpose(1, 0, 2).reshape(len(x), dim))

    def forward_block(self, name, x):
        return self.linear(f"{name}.linear2", np.maximum(self.linear(f"{name}.linear1", x), 0))

    def encode(self, maps, shapes):
        x = np.concatenate([m.reshape(SMALL.dim, -1).T for m in maps])
        placed, centres = [], []
        for level, (height, width) in enumerate(shapes):
            rows, columns = np.mgrid[:height, :width].reshape(2, -1)
            y = sines((rows + 1) / (height + 1e-6), SMALL.dim // 2, 20)
            x_part = sines((columns + 1) / (width + 1e-6), SMALL.dim // 2, 20)
            shift = self.state["transformer.level_embed"][level]
            placed.append(np.concatenate((y, x_part), 1) + shift)
            centres.append(np.stack(((columns + 0.5) / width, (rows + 0.5) / height), 1))
        positions, centres = np.concatenate(placed), np.concatenate(centres)
        for index in range(SMALL.encoder_layers):
            name = f"transformer.encoder.layers.{index}"
            y = self.deformable(f"{name}.self_attn", x + positions, centres, x, shapes)
            x = self.norm(f"{name}.norm1", x + y)
            x = self.norm(f"{name}.norm2", x + self.forward_block(name, x))
        return x, centres

    def select(self, memory, centres, shapes):
        side = np.concatenate([np.full(h * w, 0.05 * 2**i) for i, (h, w) in enumerate(shapes)])
        boxes = np.concatenate((centres, side[:, None], side[:, None]), 1)
        inside = ((boxes > 0.01) & (boxes < 0.99)).all(1)
        features = np.where(inside[:, None], memory, 0)
        features = self.linear("transformer.enc_output", features)
        features = self.norm("transformer.enc_output_norm", features)
        best = self.linear("transformer.enc_out_class_embed", features).max(1)
        chosen = np.argsort(-best)[: SMALL.queries]
        delta = self.layers("transformer.enc_out_bbox_embed", features[chosen], 3)
        logits = np.log(boxes[chosen] / (1 - boxes[chosen])) + delta
        return np.where(inside[chosen][:, None], sigmoid(logits), 1.0)

    def __call__(self, x):
        maps = self.maps(x)
        shapes = [m.shape[1:] for m in maps]
        memory, centres = self.encode(maps, shapes)
        references = [self.select(memory, centres, shapes)]
        x, outputs = self.state["transformer.tgt_embed.weight"], []
        for index in range(SMALL.decoder_layers):
            name, boxes = f"transformer.decoder.layers.{index}", references[-1]
            encoded = [sines(boxes[:, axis], SMALL.dim // 2, 10000) for axis in (1, 0, 2, 3)]
            encoded = np.concatenate(encoded, 1)
            positions = self.layers("transformer.decoder.ref_point_head", encoded, 2)
            y = self.attend(f"{name}.self_attn", x + positions, x)
            x = self.norm(f"{name}.norm2", x + y)
            y = self.deformable(f"{name}.cross_attn", x + positions, boxes, memory, shapes)
            x = self.norm(f"{name}.norm1", x + y)
            x = self.norm(f"{name}.norm3", x + self.forward_block(name, x))
            delta = self.layers(f"bbox_embed.{index}", x, 3)
            references.append(sigmoid(delta + logit(boxes)))
            outputs.append(self.norm("transformer.decoder.norm", x))
        last = SMALL.decoder_layers - 1
        delta = self.layers(f"bbox_embed.{last}", outputs[last], 3)
        boxes = sigmoid(delta + logit(references[last]))
        return self.linear(f"class_embed.{last}", outputs[last]), boxes


def sines(fraction, dim, temperature):
    found = np.zeros((len(fraction), dim))
    for k in range(dim // 2):
        angle = 2 * np.pi * fraction / temperature ** (2 * k / dim)
        found[:, 2 * k], found[:, 2 * k + 1] = np.sin(angle), np.cos(angle)
    return found


def sigmoid(x):
    return 1 / (1 + np.exp(-x))


def logit(x):
    return np.log(np.maximum(x, 1e-3) / np.maximum(1 - x, 1e-3))


def test_the_network_equals_a_second_one_in_numpy(network):
    x = photo()
    with torch.no_grad():
        logits, boxes = network(x)
    state = {name: tensor.numpy() for name, tensor in network.state_dict().items()}
    with np.errstate(divide="ignore", invalid="ignore"):
        expected_logits, expected_boxes = Second(state)(x.numpy())
    assert np.ptp(expected_logits, axis=0).min() > 0.01
    assert np.ptp(expected_boxes, axis=0).min() > 1e-3
    np.testing.assert_allclose(logits.numpy(), expected_logits, rtol=0, atol=1e-12)
    np.testing.assert_allclose(boxes.numpy(), expected_boxes, rtol=0, atol=1e-12)


def test_the_same_photo_gives_the_same_bytes_twice(network):
    single = Dino(SMALL)
    single.load_state_dict({k: v.float() for k, v in network.state_dict().items()})
    x = photo().float()
    with torch.inference_mode():
        first, second = single.eval()(x), single(x)
    for a, b in zip(first, second, strict=True):
        assert a.numpy().tobytes() == b.numpy().tobytes()


def test_the_output_depends_on_every_parameter_that_inference_has(network):
    """A parameter without effect would be one that is wired to nothing."""
    copy_of = copy.deepcopy(network)
    tensors = copy_of.state_dict(keep_vars=True)
    for tensor in tensors.values():
        tensor.requires_grad_(True)
    outputs = torch.cat(copy_of(photo()), 1)
    weights = torch.randn(outputs.shape, generator=torch.Generator().manual_seed(7))
    (outputs * weights).sum().backward()
    # Heads between the layers are for training; this head only orders the proposals.
    spared = ("class_embed.0.", "class_embed.1.", "transformer.enc_out_class_embed.")
    dead = {name for name, t in tensors.items() if t.grad is None or not t.grad.abs().max() > 0}
    assert {name for name in dead if not name.startswith(spared)} == set()
