"""MaskFormer and Mask2Former of a few thousand random parameters, saved as checkpoints."""

from __future__ import annotations

import torch
import transformers
from baseline_programs.child import spread

LABELS = {0: "sofa", 1: "sky-other-merged", 2: "Cat"}
QUERIES = 6


def swin():
    return transformers.SwinConfig(
        image_size=64,
        embed_dim=16,
        depths=[1, 1, 1, 1],
        num_heads=[2, 2, 2, 2],
        window_size=4,
        out_features=["stage1", "stage2", "stage3", "stage4"],
    )


def mask2former():
    config = transformers.Mask2FormerConfig(
        backbone_config=swin(),
        feature_size=32,
        mask_feature_size=32,
        hidden_dim=32,
        encoder_feedforward_dim=48,
        encoder_layers=2,
        decoder_layers=3,
        num_attention_heads=4,
        dim_feedforward=48,
        num_queries=QUERIES,
        id2label=LABELS,
    )
    return transformers.Mask2FormerForUniversalSegmentation(config)


def maskformer():
    decoder = transformers.DetrConfig(
        d_model=32,
        encoder_layers=1,
        decoder_layers=2,
        encoder_attention_heads=4,
        decoder_attention_heads=4,
        encoder_ffn_dim=48,
        decoder_ffn_dim=48,
        num_queries=QUERIES,
    )
    config = transformers.MaskFormerConfig(
        fpn_feature_size=32,
        mask_feature_size=32,
        backbone_config=swin(),
        decoder_config=decoder,
        id2label=LABELS,
    )
    return transformers.MaskFormerForInstanceSegmentation(config)


def save_tiny(build, processor, folder, **settings):
    torch.manual_seed(1)
    spread(build().eval(), 3).save_pretrained(folder)
    size = {"shortest_edge": 64, "longest_edge": 128}
    processor(size=size, **settings).save_pretrained(folder)
    return folder
