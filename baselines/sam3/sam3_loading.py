"""SAM 3's checkpoint into the network and its tokenizer, or a refusal that says why not."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
import transformers
from legoworld_baseline import Refused
from sam3_network import IMAGE_MEAN, IMAGE_STD, PHRASE_TOKENS, too_long
from transformers import CLIPTokenizer, Sam3Model

#: The published checkpoint is the video model's; its detector is the image model.
_MODEL_TYPES = ("sam3", "sam3_video")
DTYPES = ("float32", "bfloat16", "float16")


def load_network(folder: Path, device: str, dtype: str) -> Any:
    """Sam3Model with every parameter out of the checkpoint. Refused otherwise."""
    if dtype not in DTYPES:
        raise Refused("a dtype that is not offered", found=dtype, expected=", ".join(DTYPES))
    config = _json(folder / "config.json")
    if config.get("model_type") not in _MODEL_TYPES:
        raise Refused(
            "this is no checkpoint of SAM 3",
            found=f"model_type {config.get('model_type')!r}",
            expected=" or ".join(_MODEL_TYPES),
            next_step="give facebook/sam3 or a folder with its files",
        )
    torch.backends.cudnn.allow_tf32 = False
    if not sys.stderr.isatty():
        transformers.logging.disable_progress_bar()
    loaded: Any = Sam3Model.from_pretrained(
        folder,
        dtype=getattr(torch, dtype),
        local_files_only=True,
        output_loading_info=True,
        ignore_mismatched_sizes=True,  # so that they are reported; then refused, below
    )
    network, report = loaded
    wrong = [*report["missing_keys"], *report["mismatched_keys"], *report["error_msgs"]]
    if wrong:
        raise Refused(
            "the checkpoint does not fill the network: the rest would be random",
            found=f"{len(wrong)} parameters, such as {', '.join(sorted(map(str, wrong))[:3])}",
            expected="every parameter of Sam3Model",
        )
    _check_preprocessing(folder, network)
    return network.to(device).eval()


def load_tokenizer(folder: Path, phrases: Sequence[str]) -> Any:
    """The checkpoint's tokenizer. Refused when there is none, or it cannot hold a phrase."""
    if not any((folder / name).is_file() for name in ("tokenizer.json", "vocab.json")):
        raise Refused(
            "the checkpoint has no tokenizer",
            found="neither tokenizer.json nor vocab.json",
            expected="the files of a CLIP tokenizer beside the weights",
        )
    tokenizer = CLIPTokenizer.from_pretrained(folder, local_files_only=True)
    long = too_long(tokenizer, phrases)
    if long:
        raise Refused(
            "categories have names that the text encoder cannot read whole",
            found=f"{long[0]!r}, {len(long)} in all",
            expected=f"at most {PHRASE_TOKENS} tokens",
        )
    return tokenizer


def preprocessing(network: Any) -> dict[str, Any]:
    """What is done to a photo, for the record."""
    side = int(network.config.image_size)
    return {
        "size_wh": [side, side],
        "resize": "uint8, bilinear, antialiased, aspect not kept",
        "mean": list(IMAGE_MEAN),
        "std": list(IMAGE_STD),
        "exif_orientation": "not applied",
    }


def _check_preprocessing(folder: Path, network: Any) -> None:
    """The checkpoint's own description of its input, where there is one, must be what is done."""
    described = _json(folder / "preprocessor_config.json")
    described = described or _json(folder / "processor_config.json").get("image_processor", {})
    side = int(network.config.image_size)
    expected = {
        "image_mean": list(IMAGE_MEAN),
        "image_std": list(IMAGE_STD),
        "size": {"height": side, "width": side},
        "resample": 2,
    }
    for name, value in expected.items():
        if described.get(name, value) != value:
            raise Refused(
                "the checkpoint wants another preprocessing",
                found=f"{name} {described[name]}",
                expected=str(value),
            )


def _json(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
