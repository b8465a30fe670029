"""What matches are counted at: IoU thresholds, ranges of size, recalls."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

#: Of every grid.
N_THRESHOLDS: Final = 10
RECALL_THRESHOLDS: Final[NDArray[np.float64]] = np.linspace(0.0, 1.0, 101, endpoint=True)
#: The threshold of outcomes, curves and score-free numbers.
HALF: Final = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class Grid:
    """IoU thresholds, and ranges of a size by name, both ends included; the first is "all".

    iou: (N_THRESHOLDS,) ascending, HALF among them; unit: of sizes, as matches.npz says it.
    """

    iou: NDArray[np.float64]
    areas: tuple[str, ...]
    ranges: tuple[tuple[float, float], ...]
    unit: str

    def thresholds(self, iou: float | None) -> NDArray[np.bool_]:
        """(N_THRESHOLDS,) the threshold of a metric, all for None, none where the grid lacks it."""
        return np.full(N_THRESHOLDS, True) if iou is None else np.isclose(self.iou, iou)

    @property
    def half(self) -> int:
        """The place of HALF."""
        return int(np.flatnonzero(self.thresholds(HALF))[0])


#: COCO's and LVIS's: px^2. Both evaluators build their thresholds this way; 0.05 steps by arange
#: differ in the last bit.
PICTURE: Final = Grid(
    iou=np.linspace(0.5, 0.95, N_THRESHOLDS, endpoint=True),
    areas=("all", "small", "medium", "large"),
    ranges=((0.0, 1e10), (0.0, 1024.0), (1024.0, 9216.0), (9216.0, 1e10)),
    unit="px",
)
#: Omni3D's: depth of the centre, metres.
SPACE: Final = Grid(
    iou=np.linspace(0.05, 0.5, N_THRESHOLDS, endpoint=True),
    areas=("all", "near", "medium", "far"),
    ranges=((0.0, 1e5), (0.0, 10.0), (10.0, 35.0), (35.0, 1e5)),
    unit="m",
)
