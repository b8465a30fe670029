"""SAM 3's network, asked many phrases about one photo: image and text are encoded once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn import functional
from transformers.modeling_outputs import BaseModelOutputWithPooling

#: Of the processor that SAM 3's checkpoint comes with; checked against its file when loading.
IMAGE_MEAN = (0.5, 0.5, 0.5)
IMAGE_STD = (0.5, 0.5, 0.5)
#: Tokens of a phrase, as Sam3Processor pads them.
PHRASE_TOKENS = 32


@dataclass(frozen=True, kw_only=True)
class TextFeatures:
    """Of n phrases. embeds: (n, tokens, channels); attention_mask: (n, tokens), 0 = padding."""

    embeds: torch.Tensor
    attention_mask: torch.Tensor


@dataclass(frozen=True, kw_only=True)
class Answers:
    """What the network says to n phrases, q candidates each.

    scores: (n, q) float32, sigmoid(logit) * sigmoid(presence). mask_logits: (n, q, h, w) at the
    network's own resolution, on its device.
    """

    scores: torch.Tensor
    mask_logits: torch.Tensor


def computing_in(dtype: str, model: Any) -> AbstractContextManager[Any]:
    """float32 as it is; another type by autocast over float32 weights, as the original runs it."""
    if dtype == "float32":
        return nullcontext()
    return torch.autocast(device_type=model.device.type, dtype=getattr(torch, dtype))


def pixel_values(photo: NDArray[np.uint8], side_px: int) -> torch.Tensor:
    """(1, 3, side, side) float32 of a photo (H, W, 3): stretched to a square, antialiased.

    Resized as 8-bit numbers, bilinear, like the checkpoint's own processor; then x / 255
    normalised with mean and deviation 0.5.
    """
    planes = torch.from_numpy(np.ascontiguousarray(photo.transpose(2, 0, 1)))[None]
    resized = functional.interpolate(
        planes, size=(side_px, side_px), mode="bilinear", antialias=True, align_corners=False
    )
    mean = torch.tensor(IMAGE_MEAN).view(1, 3, 1, 1)
    std = torch.tensor(IMAGE_STD).view(1, 3, 1, 1)
    return (resized.float() / 255.0 - mean) / std


def tokens(tokenizer: Any, phrases: Sequence[str]) -> tuple[torch.Tensor, torch.Tensor]:
    """input_ids and attention_mask, each (n, PHRASE_TOKENS). ValueError for a longer phrase."""
    encoded = tokenizer(
        list(phrases), padding="max_length", max_length=PHRASE_TOKENS, return_tensors="pt"
    )
    return encoded["input_ids"], encoded["attention_mask"]


def too_long(tokenizer: Any, phrases: Sequence[str]) -> list[str]:
    """The phrases that have more tokens than the text encoder reads."""
    lengths = [len(ids) for ids in tokenizer(list(phrases))["input_ids"]]
    return [p for p, n in zip(phrases, lengths, strict=True) if n > PHRASE_TOKENS]


@torch.inference_mode()
def text_features(model: Any, tokenizer: Any, phrases: Sequence[str], at_once: int) -> TextFeatures:
    """Every phrase encoded once, `at_once` of them together."""
    ids, mask = (part.to(model.device) for part in tokens(tokenizer, phrases))
    embeds = [
        model.get_text_features(input_ids=ids[rows], attention_mask=mask[rows]).pooler_output
        for rows in _chunks(len(phrases), at_once)
    ]
    return TextFeatures(embeds=torch.cat(embeds), attention_mask=mask)


@torch.inference_mode()
def image_features(model: Any, photo: NDArray[np.uint8]) -> Any:
    """The vision encoder's output for one photo (H, W, 3)."""
    pixels = pixel_values(photo, int(model.config.image_size))
    return model.get_vision_features(pixel_values=pixels.to(model.device, model.dtype))


@torch.inference_mode()
def answers(
    model: Any, image: Any, text: TextFeatures, rows: Sequence[int], at_once: int
) -> Iterator[tuple[list[int], Answers]]:
    """Ask phrases `rows` of `text` about an image, `at_once` together; in order."""
    for chunk in _chunks(len(rows), at_once):
        asked = list(rows[chunk])
        out = model(
            vision_embeds=_repeated(image, len(asked)),
            text_embeds=BaseModelOutputWithPooling(pooler_output=text.embeds[asked]),
            attention_mask=text.attention_mask[asked],
        )
        scores = out.pred_logits.float().sigmoid() * out.presence_logits.float().sigmoid()
        yield asked, Answers(scores=scores, mask_logits=out.pred_masks)


def _repeated(image: Any, n: int) -> Any:
    """The one image's features as those of a batch of n, without copying them."""
    return type(image)(
        fpn_hidden_states=tuple(t.expand(n, -1, -1, -1) for t in image.fpn_hidden_states),
        fpn_position_encoding=tuple(t.expand(n, -1, -1, -1) for t in image.fpn_position_encoding),
    )


def _chunks(n: int, size: int) -> Iterator[slice]:
    return (slice(start, min(start + size, n)) for start in range(0, n, size))
