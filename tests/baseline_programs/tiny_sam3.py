"""A tiny untrained SAM 3 and its tokenizer, in the layout of the image model's checkpoint."""

from __future__ import annotations

import torch
import transformers
from baseline_programs.child import spread

QUERIES, SIDE = 7, 112


def byte_level_tokenizer():
    from tokenizers.pre_tokenizers import ByteLevel

    letters = sorted(ByteLevel.alphabet())
    words = ["<|startoftext|>", "<|endoftext|>", *letters, *(f"{x}</w>" for x in letters)]
    return transformers.CLIPTokenizer(vocab={w: i for i, w in enumerate(words)}, merges=[])


def tiny_network(tokenizer):
    part = {"hidden_size": 32, "num_attention_heads": 4, "intermediate_size": 48}
    layers = {**part, "num_layers": 2}
    backbone = {
        "model_type": "sam3_vit_model",
        **part,
        "num_hidden_layers": 2,
        "image_size": SIDE,
        "patch_size": 14,
        "window_size": 4,
        "global_attn_indexes": [1],
        "pretrain_image_size": 56,
    }
    text = {
        "model_type": "clip_text_model",
        **part,
        "vocab_size": len(tokenizer),
        "num_hidden_layers": 2,
        "projection_dim": 16,
        "max_position_embeddings": 32,
        "bos_token_id": tokenizer.bos_token_id,
        "eos_token_id": tokenizer.eos_token_id,
    }
    config = transformers.Sam3Config(
        vision_config={
            "backbone_config": backbone,
            "fpn_hidden_size": 32,
            "backbone_feature_sizes": [[32, 32], [16, 16], [8, 8]],
        },
        text_config=text,
        geometry_encoder_config=layers,
        detr_encoder_config=layers,
        detr_decoder_config={**layers, "num_queries": QUERIES},
        mask_decoder_config={"hidden_size": 32, "num_attention_heads": 4},
    )
    torch.manual_seed(0)
    return spread(transformers.Sam3Model(config).eval(), 6)


def save_tiny(folder):
    tokenizer = byte_level_tokenizer()
    tiny_network(tokenizer).save_pretrained(folder)
    tokenizer.save_pretrained(folder)
    return folder
