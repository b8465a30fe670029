"""A photo as a segmenter's input: as its checkpoint says, or as the networks' authors made it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from legoworld_baseline import Refused
from legoworld_baseline.image_processors import load_processor, processor_record
from numpy.typing import NDArray
from PIL import Image
from transformers.image_utils import SizeDict

#: A photo (H, W, 3) uint8 to pixel_values (1, 3, h, w) and a mask (1, h, w) of what is photo.
Prepare = Callable[[NDArray[np.uint8]], tuple[torch.Tensor, torch.Tensor]]


def preparation(folder: Path, how: str) -> tuple[Prepare, dict[str, Any]]:
    """The preparation of a checkpoint's folder, and its record.

    how: "checkpoint" is transformers' processor, on Pillow: each side of the resized photo is
    stretched to a multiple of its size_divisor. "authors" is detectron2's, as both papers
    evaluate: the aspect is kept, and zeros after normalisation pad the right and the bottom.
    Refused when the checkpoint does not describe its input, or not by two edges.
    """
    processor = load_processor(folder)
    record = {**processor_record(processor), "input": how}
    if how == "checkpoint":

        def as_described(photo: NDArray[np.uint8]) -> tuple[torch.Tensor, torch.Tensor]:
            inputs = processor(images=Image.fromarray(photo), return_tensors="pt")
            return inputs["pixel_values"], inputs["pixel_mask"]

        return as_described, record
    size, multiple = processor.size, int(processor.size_divisor or 1)
    if not (size.shortest_edge and size.longest_edge):
        raise Refused(
            "the authors' preprocessing needs a shortest and a longest edge",
            found=f"size {processor.to_dict()['size']}",
            expected="shortest_edge and longest_edge in preprocessor_config.json",
            next_step="omit --option input",
        )
    edges = int(size.shortest_edge), int(size.longest_edge)

    def as_authors(photo: NDArray[np.uint8]) -> tuple[torch.Tensor, torch.Tensor]:
        size_hw = authors_size_hw((photo.shape[0], photo.shape[1]), *edges)
        padded_hw = [-(-side // multiple) * multiple for side in size_hw]
        inputs = processor(
            images=Image.fromarray(photo),
            size={"height": size_hw[0], "width": size_hw[1]},
            size_divisor=0,
            pad_size=SizeDict(height=padded_hw[0], width=padded_hw[1]),
            return_tensors="pt",
        )
        return inputs["pixel_values"], inputs["pixel_mask"]

    return as_authors, record


def authors_size_hw(size_hw: tuple[int, int], shortest: int, longest: int) -> tuple[int, int]:
    """The resized height and width, by detectron2's ResizeShortestEdge.get_output_shape.

    The short side is `shortest`, unless the long one would pass `longest`; halves round up.
    """
    height, width = size_hw
    scale = shortest / min(height, width)
    new_h, new_w = (shortest, scale * width) if height < width else (scale * height, shortest)
    if max(new_h, new_w) > longest:
        scale = longest / max(new_h, new_w)
        new_h, new_w = new_h * scale, new_w * scale
    return int(new_h + 0.5), int(new_w + 0.5)
