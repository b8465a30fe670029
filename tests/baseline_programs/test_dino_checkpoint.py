"""The published checkpoint's format: its names, what is dropped, what is refused and how.

No trained weights are at hand: files are written here as IDEA-Research/DINO's main.py writes them.
Names and sizes come from that repository's published training log (logs/DINO/R50-MS4/info.txt)
and, for the backbone, from torchvision's resnet50 with IDEA's frozen norm; not from our network.
"""

from __future__ import annotations

import argparse
import collections
import math
import os
import pathlib
import pickle
import sys
import types
import zipfile
from pathlib import Path

import pytest
from baseline_programs.child import importable

torch = pytest.importorskip("torch")

importable("dino")

from dino_checkpoint import build, read_checkpoint  # noqa: E402
from dino_network import Dino  # noqa: E402
from dino_transformer import DinoSize  # noqa: E402
from legoworld_baseline import Refused  # noqa: E402

SMALL = DinoSize(
    dim=32,
    heads=4,
    encoder_layers=1,
    decoder_layers=2,
    feedforward=8,
    queries=5,
    backbone_blocks=(1, 1, 1, 1),
    backbone_width=2,
)
ARGUMENTS = {"pe_temperatureH": 20, "pe_temperatureW": 20, "nheads": 8, "num_select": 300}


def original_layout(size, seed=0):
    """A state dict as the original saves it: with label_enc and the heads' second names."""
    generator = torch.Generator().manual_seed(seed)
    model = collections.OrderedDict()
    for name, tensor in Dino(size).state_dict().items():
        drawn = torch.randn(tensor.shape, generator=generator) * 0.05
        model[name] = drawn.abs() + 0.5 if name.endswith("running_var") else drawn
    for name in [n for n in model if n.startswith(("bbox_embed.", "class_embed."))]:
        model[f"transformer.decoder.{name}"] = model[name]
    model["label_enc.weight"] = torch.randn(size.classes + 1, size.dim, generator=generator)
    return model


def save_checkpoint(path, model, arguments=ARGUMENTS, **other):
    content = {
        "model": model,
        "optimizer": {"state": {0: {"step": 7, "exp_avg": torch.zeros(2)}}, "param_groups": [{}]},
        "lr_scheduler": {"step_size": 20, "gamma": 0.1, "base_lrs": [1e-4], "_last_lr": [1e-5]},
        "epoch": 23,
        "args": argparse.Namespace(**arguments, options={"dn_scalar": 100, "use_ema": False}),
    }
    torch.save(content | other, path)
    return path


def refusal(path, size=SMALL):
    with pytest.raises(Refused) as caught:
        build(read_checkpoint(path), size)
    reason = caught.value.reason
    assert all(reason.values())
    return " | ".join(reason.values())


def published_transformer():
    """Number of values by name, as the published log prints them."""
    deformable = {
        "sampling_offsets.weight": 65536,
        "sampling_offsets.bias": 256,
        "attention_weights.weight": 32768,
        "attention_weights.bias": 128,
        "value_proj.weight": 65536,
        "value_proj.bias": 256,
        "output_proj.weight": 65536,
        "output_proj.bias": 256,
    }
    feedforward = {
        "linear1.weight": 524288,
        "linear1.bias": 2048,
        "linear2.weight": 524288,
        "linear2.bias": 256,
    }
    own = {
        "self_attn.in_proj_weight": 196608,
        "self_attn.in_proj_bias": 768,
        "self_attn.out_proj.weight": 65536,
        "self_attn.out_proj.bias": 256,
    }
    found = {"level_embed": 1024, "tgt_embed.weight": 230400}
    for layer in range(6):
        encoder, decoder = f"encoder.layers.{layer}", f"decoder.layers.{layer}"
        found |= {f"{encoder}.self_attn.{k}": v for k, v in deformable.items()}
        found |= {f"{decoder}.cross_attn.{k}": v for k, v in deformable.items()}
        found |= {f"{decoder}.{k}": v for k, v in own.items()}
        found |= {f"{top}.{k}": v for top in (encoder, decoder) for k, v in feedforward.items()}
        norms = [f"{encoder}.norm{i}" for i in (1, 2)] + [f"{decoder}.norm{i}" for i in (1, 2, 3)]
        found |= {f"{norm}.{kind}": 256 for norm in norms for kind in ("weight", "bias")}
    found |= {f"decoder.norm.{kind}": 256 for kind in ("weight", "bias")}
    found |= {"decoder.ref_point_head.layers.0.weight": 131072}
    found |= {"decoder.ref_point_head.layers.0.bias": 256}
    found |= {"decoder.ref_point_head.layers.1.weight": 65536}
    found |= {"decoder.ref_point_head.layers.1.bias": 256}
    found |= {"enc_output.weight": 65536, "enc_output.bias": 256}
    found |= {"enc_output_norm.weight": 256, "enc_output_norm.bias": 256}
    found |= {f"enc_out_bbox_embed.{k}": v for k, v in box_head().items()}
    found |= {"enc_out_class_embed.weight": 23296, "enc_out_class_embed.bias": 91}
    return {f"transformer.{name}": count for name, count in found.items()}


def box_head():
    return {
        "layers.0.weight": 65536,
        "layers.0.bias": 256,
        "layers.1.weight": 65536,
        "layers.1.bias": 256,
        "layers.2.weight": 1024,
        "layers.2.bias": 4,
    }


def published_heads():
    found = {f"bbox_embed.{i}.{k}": v for i in range(6) for k, v in box_head().items()}
    for layer in range(6):
        found |= {f"class_embed.{layer}.weight": 23296, f"class_embed.{layer}.bias": 91}
    return found


def published_backbone():
    found = {"conv1.weight": 64 * 3 * 49} | frozen("bn1", 64)
    inputs = 64
    for stage, blocks in enumerate((3, 4, 6, 3)):
        width = 64 * 2**stage
        for block in range(blocks):
            name = f"layer{stage + 1}.{block}"
            found |= {f"{name}.conv1.weight": inputs * width}
            found |= {f"{name}.conv2.weight": 9 * width * width}
            found |= {f"{name}.conv3.weight": 4 * width * width}
            for index, channels in ((1, width), (2, width), (3, 4 * width)):
                found |= frozen(f"{name}.bn{index}", channels)
            if block == 0:
                found |= {f"{name}.downsample.0.weight": 4 * inputs * width}
                found |= frozen(f"{name}.downsample.1", 4 * width)
            inputs = 4 * width
    return {f"backbone.0.body.{name}": count for name, count in found.items()}


def frozen(name, channels):
    kinds = ("weight", "bias", "running_mean", "running_var")
    return {f"{name}.{kind}": channels for kind in kinds}


def published_projections():
    inputs, sides = (512, 1024, 2048, 2048), (1, 1, 1, 3)
    found = {}
    for level, (channels, side) in enumerate(zip(inputs, sides, strict=True)):
        found[f"input_proj.{level}.0.weight"] = 256 * channels * side * side
        found |= {f"input_proj.{level}.{name}": 256 for name in ("0.bias", "1.weight", "1.bias")}
    return found


def test_the_full_network_has_exactly_the_published_names_and_sizes():
    with torch.device("meta"):
        found = {k: math.prod(v.shape) for k, v in Dino(DinoSize()).state_dict().items()}
    published = (
        published_transformer() | published_heads() | published_backbone() | published_projections()
    )
    assert found == published


def test_a_checkpoint_in_the_original_layout_is_loaded_whole(tmp_path):
    model = original_layout(SMALL)
    checkpoint = read_checkpoint(save_checkpoint(tmp_path / "checkpoint0023_4scale.pth", model))
    assert checkpoint.epochs == 24
    assert checkpoint.settings == {"pe_temperatureH": 20, "pe_temperatureW": 20, "nheads": 8}
    dropped = {name for name in model if name not in checkpoint.parameters}
    assert all(n.startswith(("label_enc.", "transformer.decoder.")) for n in dropped)
    assert len(dropped) == 1 + 2 * 6 + 2 * 2
    network = build(checkpoint, SMALL)
    assert not network.training
    for name, tensor in network.state_dict().items():
        assert torch.equal(tensor, model[name])


def test_the_old_file_format_of_torch_is_read_too(tmp_path):
    path = tmp_path / "old.pth"
    content = {"model": original_layout(SMALL), "epoch": 11}
    torch.save(content, path, _use_new_zipfile_serialization=False)
    checkpoint = read_checkpoint(path)
    assert checkpoint.epochs == 12
    assert checkpoint.settings == {}
    build(checkpoint, SMALL)


def test_a_file_without_training_state_is_read(tmp_path):
    path = tmp_path / "model_only.pth"
    torch.save({"model": original_layout(SMALL)}, path)
    assert read_checkpoint(path).epochs is None


class Harm:
    def __reduce__(self):
        return os.mkdir, (str(Harm.folder),)


def test_nothing_in_a_checkpoint_is_executed(tmp_path):
    Harm.folder = tmp_path / "executed"
    path = save_checkpoint(tmp_path / "harm.pth", original_layout(SMALL), extra=Harm())
    assert "mkdir" in refusal(path)
    assert not Harm.folder.exists()


@pytest.mark.parametrize("content", [b"", b"not a checkpoint", pickle.dumps([1, 2], protocol=2)])
def test_a_file_that_is_no_checkpoint_is_refused(tmp_path, content):
    path = tmp_path / "file.pth"
    path.write_bytes(content)
    assert "file.pth" not in refusal(path)


def test_a_missing_file_is_refused(tmp_path):
    assert "the weight file does not exist" in refusal(tmp_path / "absent.pth")


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (["neck.convs.0.conv.weight", "transformer.level_embeds"], "detrex's DINO: 80 contiguous"),
        (["bbox_head.cls_branches.0.weight"], "MMDetection's DINO: 80 contiguous"),
        (["backbone.0.patch_embed.proj.weight"], "Swin"),
        (["input_proj.4.0.weight"], "DINO-5scale"),
    ],
)
@pytest.mark.parametrize("key", ["model", "state_dict"])
def test_a_relative_is_refused_by_its_name(tmp_path, names, said, key):
    path = tmp_path / "other.pth"
    torch.save({key: {name: torch.zeros(2) for name in names}}, path)
    assert said in refusal(path)


def test_detrex_is_told_apart_by_every_difference(tmp_path):
    path = tmp_path / "dino_r50_4scale_24ep.pth"
    torch.save({"model": {"transformer.level_embeds": torch.zeros(4, 256)}}, path)
    text = refusal(path)
    for difference in ("80 contiguous classes", "10000", "-0.5", "other parameter names"):
        assert difference in text


def test_second_names_with_other_numbers_are_refused(tmp_path):
    model = original_layout(SMALL)
    model["transformer.decoder.bbox_embed.1.layers.2.bias"] = torch.ones(4)
    text = refusal(save_checkpoint(tmp_path / "c.pth", model))
    assert "transformer.decoder.bbox_embed.1.layers.2.bias is not bbox_embed.1" in text


def without(model, name):
    del model[name]


def fine_tuned(model, name):
    model[name] = model[name][:21]


def not_a_number(model, name):
    model[name] = model[name].clone()
    model[name].view(-1)[3] = math.nan


@pytest.mark.parametrize(
    ("change", "name", "said"),
    [
        (without, "transformer.tgt_embed.weight", "transformer.tgt_embed.weight is missing"),
        (without, "backbone.0.body.bn1.running_var", "backbone.0.body.bn1.running_var is missing"),
        (fine_tuned, "transformer.enc_out_class_embed.weight", "[21, 32], not [91, 32]"),
        (not_a_number, "input_proj.2.0.weight", "input_proj.2.0.weight holds NaN"),
    ],
)
def test_every_difference_is_refused(tmp_path, change, name, said):
    model = original_layout(SMALL)
    change(model, name)
    assert said in refusal(save_checkpoint(tmp_path / "c.pth", model))


def test_an_unknown_parameter_is_refused(tmp_path):
    model = original_layout(SMALL)
    model["transformer.encoder.norm.weight"] = torch.ones(32)
    text = refusal(save_checkpoint(tmp_path / "c.pth", model))
    assert "transformer.encoder.norm.weight is not known" in text


@pytest.mark.parametrize(
    "setting", [{"pe_temperatureH": 10000}, {"nheads": 4}, {"transformer_activation": "gelu"}]
)
def test_settings_that_leave_no_trace_in_the_shapes_are_checked(tmp_path, setting):
    path = save_checkpoint(tmp_path / "c.pth", original_layout(SMALL), ARGUMENTS | setting)
    ((name, value),) = setting.items()
    assert f"{name} = {value!r}" in refusal(path)


def test_paths_among_the_arguments_are_plain_values(tmp_path, monkeypatch):
    """Training scripts keep pathlib's paths; Python 3.13 writes them under another name."""
    arguments = ARGUMENTS | {
        "output_dir": Path("/runs/dino"),
        "data": pathlib.PureWindowsPath("c:/x"),
    }
    path = save_checkpoint(tmp_path / "c.pth", original_layout(SMALL), arguments)
    assert read_checkpoint(path).epochs == 24
    build(read_checkpoint(path), SMALL)
    monkeypatch.setattr(pathlib.PosixPath, "__module__", "pathlib._local")
    monkeypatch.setitem(sys.modules, "pathlib._local", pathlib)
    save_checkpoint(path, original_layout(SMALL), arguments)
    monkeypatch.undo()
    with zipfile.ZipFile(path) as archive:
        (name,) = [n for n in archive.namelist() if n.endswith("data.pkl")]
        assert b"pathlib._local" in archive.read(name)
    assert read_checkpoint(path).epochs == 24


@pytest.mark.parametrize(
    ("module", "name", "words"),
    [
        ("ultralytics.nn.tasks", "DetectionModel", "baseline import"),
        ("somewhere.config", "Settings", "save it again with tensors and plain values"),
    ],
)
def test_a_file_that_asks_for_an_object_is_not_downloaded_again(tmp_path, module, name, words):
    made = type(name, (), {"__module__": module})
    parts = [".".join(module.split(".")[: n + 1]) for n in range(module.count(".") + 1)]
    for part in parts:
        sys.modules[part] = types.ModuleType(part)
    setattr(sys.modules[module], name, made)
    try:
        torch.save({"model": made()}, tmp_path / "yolo.pt")
    finally:
        for part in parts:
            del sys.modules[part]
    text = refusal(tmp_path / "yolo.pt")
    assert f"{module}.{name}" in text
    assert words in text
    assert "download it again" not in text
