"""SAM 3's checkpoint into the network and its tokenizer, or a refusal that says why not."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from legoworld_baseline import Refused
from legoworld_baseline.hugging_face import load_pretrained
from sam3_network import IMAGE_MEAN, IMAGE_STD, PHRASE_TOKENS, too_long
from transformers import CLIPTokenizer, Sam3Model

#: The published checkpoint is the video model's; its detector is the image model.
_MODEL_TYPES = ("sam3", "sam3_video")


def load_network(folder: Path, device: str) -> Any:
    """Sam3Model with every parameter out of the checkpoint, in float32. Refused otherwise."""
    config = _json(folder / "config.json")
    if config.get("model_type") not in _MODEL_TYPES:
        raise Refused(
            "this is not a SAM 3 checkpoint",
            found=f"model_type {config.get('model_type')!r}",
            expected=" or ".join(_MODEL_TYPES),
            next_step="pass facebook/sam3 or a folder with its files",
        )
    network = load_pretrained(Sam3Model, folder, device=device, dtype="float32")
    _check_preprocessing(folder, network)
    return network


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
            "category names exceed the text encoder's limit",
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
                "the checkpoint needs another preprocessing",
                found=f"{name} {described[name]}",
                expected=str(value),
            )


def _json(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
