"""Tiny untrained depth estimators of transformers, each with its processor, on disk."""

from __future__ import annotations

import json

import torch
import transformers
from baseline_programs.child import spread

SMALL = {"neck_hidden_sizes": [8, 8, 16, 16], "fusion_hidden_size": 16}
STAGES = ["stage1", "stage2", "stage3", "stage4"]
PART = {"hidden_size": 32, "num_hidden_layers": 4, "num_attention_heads": 4}


def dinov2(**more):
    return {"model_type": "dinov2", **PART, "mlp_ratio": 2, "image_size": 56, **more}


def depth_anything(kind="relative"):
    backbone = transformers.Dinov2Config(**dinov2(out_features=STAGES, reshape_hidden_states=False))
    return transformers.DepthAnythingForDepthEstimation(
        transformers.DepthAnythingConfig(
            backbone_config=backbone,
            reassemble_hidden_size=32,
            head_hidden_size=8,
            depth_estimation_type=kind,
            max_depth=20,
            **SMALL,
        )
    )


def dpt_config():
    return transformers.DPTConfig(
        **PART,
        **SMALL,
        intermediate_size=48,
        image_size=32,
        patch_size=8,
        backbone_out_indices=[0, 1, 2, 3],
    )


def dpt():
    return transformers.DPTForDepthEstimation(dpt_config())


def glpn():
    return transformers.GLPNForDepthEstimation(
        transformers.GLPNConfig(
            depths=[1, 1, 1, 1],
            hidden_sizes=[8, 8, 16, 16],
            num_attention_heads=[1, 1, 2, 2],
            mlp_ratios=[2, 2, 2, 2],
            decoder_hidden_size=16,
        )
    )


def zoedepth():
    backbone = transformers.BeitConfig(
        **PART,
        image_size=32,
        patch_size=8,
        intermediate_size=48,
        out_features=STAGES,
        reshape_hidden_states=False,
        use_absolute_position_embeddings=False,
    )
    bins = {"n_bins": 8, "min_depth": 0.001, "max_depth": 10.0, "name": "nyu"}
    return transformers.ZoeDepthForDepthEstimation(
        transformers.ZoeDepthConfig(
            **SMALL,
            backbone_config=backbone,
            backbone_hidden_size=32,
            bottleneck_features=16,
            num_relative_features=8,
            bin_embedding_dim=16,
            num_attractors=[4, 2, 2, 1],
            bin_configurations=[bins],
        )
    )


def depth_pro():
    network = transformers.DepthProForDepthEstimation(
        transformers.DepthProConfig(
            patch_size=56,
            fusion_hidden_size=16,
            intermediate_hook_ids=[1, 0],
            intermediate_feature_dims=[16, 16],
            scaled_images_feature_dims=[16, 16, 16],
            merge_padding_value=1,
            use_fov_model=True,
            image_model_config=dinov2(),
            patch_model_config=dinov2(),
            fov_model_config=dinov2(),
        )
    )
    last = [m for m in network.fov_model.modules() if isinstance(m, torch.nn.Conv2d)][-1]
    torch.nn.init.constant_(last.bias, 60.0)  # degrees: a field of view that cameras have
    return network


def square(side):
    return {"size": {"height": side, "width": side}}


#: model, its processor's class and settings, space, unit.
TINY = {
    "depth_anything": (
        depth_anything,
        "DPTImageProcessorPil",
        {**square(140), "keep_aspect_ratio": True, "ensure_multiple_of": 14},
        ("disparity", None),
    ),
    "metric": (
        lambda: depth_anything("metric"),
        "DPTImageProcessorPil",
        {**square(140), "keep_aspect_ratio": True, "ensure_multiple_of": 14},
        ("depth", "m"),
    ),
    "dpt": (dpt, "DPTImageProcessorPil", square(32), ("disparity", None)),
    "glpn": (glpn, "GLPNImageProcessorPil", {}, ("depth", "m")),
    "zoedepth": (
        zoedepth,
        "ZoeDepthImageProcessorPil",
        {**square(32), "keep_aspect_ratio": False, "ensure_multiple_of": 8},
        ("depth", "m"),
    ),
}


def save_tiny(name, folder):
    build, processor, settings, _ = TINY[name]
    torch.manual_seed(0)
    spread(build().eval(), 4).save_pretrained(folder)
    getattr(transformers, processor)(**settings).save_pretrained(folder)
    return folder


def save_depth_pro(folder):
    torch.manual_seed(0)
    depth_pro().save_pretrained(folder)
    described = {"image_processor_type": "DepthProImageProcessor", **square(224)}
    half = [0.5, 0.5, 0.5]
    text = json.dumps({**described, "image_mean": half, "image_std": half, "resample": 2})
    (folder / "preprocessor_config.json").write_text(text)
    return folder
