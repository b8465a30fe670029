"""Tiny untrained detectors of transformers, labelled in the layouts that checkpoints have."""

from __future__ import annotations

import json

import transformers
from baseline_programs.child import ROOT

CATEGORIES = json.loads((ROOT / "datasets" / "coco" / "categories.json").read_text("utf-8"))
NAMES = [category["name"] for category in CATEGORIES]
OLD_OF = {
    "motorcycle": "motorbike",
    "airplane": "aeroplane",
    "couch": "sofa",
    "potted plant": "pottedplant",
    "dining table": "diningtable",
    "tv": "tvmonitor",
}
#: What every encoder and decoder is made of.
SMALL = {
    "encoder_attention_heads": 2,
    "decoder_attention_heads": 2,
    "encoder_ffn_dim": 16,
    "decoder_ffn_dim": 16,
    "num_queries": 20,
}
SIZE = {"shortest_edge": 64, "longest_edge": 100}


def contiguous_labels():
    """80 labels in COCO's order, six of them by their old names, as RT-DETR's checkpoints."""
    return {index: OLD_OF.get(name, name) for index, name in enumerate(NAMES)}


def sparse_labels():
    """91 labels at COCO's ids, the others "N/A", as DETR's checkpoints."""
    by_id = {category["id"]: category["name"] for category in CATEGORIES}
    return {index: by_id.get(index, "N/A") for index in range(91)}


def labelled(names):
    return {"id2label": names, "label2id": {name: index for index, name in names.items()}}


def resnet():
    return transformers.ResNetConfig(
        embedding_size=8,
        hidden_sizes=[8, 8, 16, 16],
        depths=[1, 1, 1, 1],
        out_features=["stage2", "stage3", "stage4"],
    )


def rt_detr():
    config = transformers.RTDetrConfig(
        backbone_config=transformers.RTDetrResNetConfig(
            embedding_size=8,
            hidden_sizes=[8, 8, 16, 16],
            depths=[1, 1, 1, 1],
            out_features=["stage2", "stage3", "stage4"],
        ),
        encoder_hidden_dim=16,
        encoder_in_channels=[8, 16, 16],
        d_model=16,
        decoder_in_channels=[16, 16, 16],
        decoder_layers=2,
        hidden_expansion=1.0,
        **SMALL,
        **labelled(contiguous_labels()),
    )
    processor = transformers.RTDetrImageProcessorPil(size={"height": 96, "width": 96})
    return transformers.RTDetrForObjectDetection(config), processor


def d_fine():
    config = transformers.DFineConfig(
        backbone_config=transformers.HGNetV2Config(
            stem_channels=[3, 8, 8],
            stage_in_channels=[8, 8, 16, 16],
            stage_mid_channels=[8, 8, 8, 8],
            stage_out_channels=[8, 16, 16, 16],
            stage_num_blocks=[1, 1, 1, 1],
            stage_downsample=[False, True, True, True],
            stage_light_block=[False, False, True, True],
            stage_kernel_size=[3, 3, 3, 3],
            stage_numb_of_layers=[1, 1, 1, 1],
            hidden_sizes=[8, 16, 16, 16],
            out_features=["stage2", "stage3", "stage4"],
        ),
        encoder_hidden_dim=16,
        encoder_in_channels=[16, 16, 16],
        d_model=16,
        decoder_in_channels=[16, 16, 16],
        decoder_layers=2,
        decoder_n_points=[3, 6, 3],
        **SMALL,
        **labelled(contiguous_labels()),
    )
    processor = transformers.RTDetrImageProcessorPil(size={"height": 96, "width": 96})
    return transformers.DFineForObjectDetection(config), processor


def deformable_detr():
    config = transformers.DeformableDetrConfig(
        backbone_config=resnet(),
        d_model=32,
        encoder_layers=1,
        decoder_layers=2,
        disable_custom_kernels=True,
        **SMALL,
        **labelled(sparse_labels()),
    )
    processor = transformers.DeformableDetrImageProcessorPil(size=SIZE)
    return transformers.DeformableDetrForObjectDetection(config), processor


def detr():
    config = transformers.DetrConfig(
        backbone_config=resnet(),
        d_model=16,
        encoder_layers=1,
        decoder_layers=1,
        **SMALL,
        **labelled(sparse_labels()),
    )
    return transformers.DetrForObjectDetection(config), transformers.DetrImageProcessorPil(
        size=SIZE
    )


def rt_detr_v2():
    network, processor = rt_detr()
    settings = network.config.to_dict()
    settings.pop("model_type")
    config = transformers.RTDetrV2Config(**settings)
    return transformers.RTDetrV2ForObjectDetection(config), processor


def conditional_detr():
    config = transformers.ConditionalDetrConfig(
        backbone_config=resnet(),
        d_model=32,
        encoder_layers=1,
        decoder_layers=1,
        **SMALL,
        **labelled(sparse_labels()),
    )
    processor = transformers.ConditionalDetrImageProcessorPil(size=SIZE)
    return transformers.ConditionalDetrForObjectDetection(config), processor


def yolos():
    config = transformers.YolosConfig(
        hidden_size=16,
        num_hidden_layers=2,
        num_attention_heads=2,
        intermediate_size=16,
        image_size=[64, 96],
        num_detection_tokens=20,
        **labelled(sparse_labels()),
    )
    processor = transformers.YolosImageProcessorPil(size=SIZE)
    return transformers.YolosForObjectDetection(config), processor


KINDS = {"rt-detr": rt_detr, "d-fine": d_fine, "deformable-detr": deformable_detr, "detr": detr}
MORE = {"rt-detr-v2": rt_detr_v2, "conditional-detr": conditional_detr, "yolos": yolos}
