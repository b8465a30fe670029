"""Results masks a part at a time, as workers decode them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, overload

import numpy as np
from numpy.typing import NDArray

from legoworld.evaluation.masks import areas_px, pixels_covered

#: Masks of a part: a quarter of a second of work.
_PART_MASKS: Final = 8000
#: As many parts are decoded by the time that other processes have started.
_FEW: Final = 3


@dataclass(frozen=True, kw_only=True)
class MaskPart:
    """Some masks. counts: compressed, unchecked text; sizes_hw: (n, 2) of their images."""

    counts: list[str]
    sizes_hw: NDArray[np.int64]


class MaskParts(Sequence[MaskPart]):
    """The masks of results in their order, a part made each time it is asked for."""

    def __init__(self, entries: Sequence[dict[str, Any]]) -> None:
        self._entries = entries

    @property
    def many(self) -> bool:
        """Whether other processes are worth starting."""
        return len(self) > _FEW

    def __len__(self) -> int:
        return -(-len(self._entries) // _PART_MASKS)

    @overload
    def __getitem__(self, index: int) -> MaskPart: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[MaskPart]: ...
    def __getitem__(self, index: Any) -> Any:
        """The part of that number."""
        assert isinstance(index, int)
        first = index * _PART_MASKS
        masks = [e["segmentation"] for e in self._entries[first : first + _PART_MASKS]]
        sizes_hw = np.array([m["size"] for m in masks], np.int64)
        return MaskPart(counts=[m["counts"] for m in masks], sizes_hw=sizes_hw)


def decode_masks(part: MaskPart) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Pixels that each mask's run lengths cover (see `pixels_covered`), and pixels inside it.

    The second is empty unless every mask covers its image: pycocotools must not read the others.
    """
    covered = pixels_covered(part.counts)
    if (covered != part.sizes_hw.prod(axis=1)).any():
        return covered, np.empty(0)
    masks = zip(part.counts, part.sizes_hw.tolist(), strict=True)
    return covered, areas_px([{"size": size, "counts": counts} for counts, size in masks])
