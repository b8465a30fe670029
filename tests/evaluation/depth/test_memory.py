"""What scoring one image allocates besides its two arrays does not grow with the picture."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from evaluation.depth.folders import evaluate_depth, plane, write_eth3d, write_run

from legoworld.cards import load_card
from legoworld.evaluation.depth.arrays import DepthArray
from legoworld.evaluation.depth.protocol import depth_protocol
from legoworld.evaluation.depth.scoring import score_image
from legoworld.evaluation.pixels.resampling import sampler

MEGABYTE = 1 << 20


def peak_of_scoring(size_wh: tuple[int, int], step: int) -> int:
    """Bytes allocated at most while scoring a prediction of every step-th pixel."""
    truth = plane(size_wh).astype(np.float32)  # every pixel valid: the worst case
    values = truth[::step, ::step]
    array = DepthArray(values=values, space="depth", unit="m", intrinsics_px=None)
    tracemalloc.start()
    score_image(truth, sampler(array, size_wh, None), depth_protocol(load_card("eth3d")))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


@pytest.mark.parametrize("step", [1, 2], ids=["same size", "resampled"])
def test_scoring_works_in_bands(step: int) -> None:
    two_megapixels = peak_of_scoring((2048, 1024), step)
    assert two_megapixels < 64 * MEGABYTE
    assert abs(two_megapixels - peak_of_scoring((1024, 512), step)) < MEGABYTE


def test_images_are_let_go_of_one_by_one(tmp_path: Path) -> None:
    size_wh = (1000, 700)
    names = [f"courtyard/images/dslr_images/DSC_{i}.JPG" for i in range(4)]
    z = plane(size_wh).astype(np.float32)
    truth = write_eth3d(tmp_path / "truth", dict.fromkeys(names, z))
    peaks = []
    for n in (1, 4):
        run = write_run(tmp_path / f"run{n}", dict.fromkeys(names[:n], z), size_wh=size_wh)
        tracemalloc.start()
        evaluate_depth(run, truth, tmp_path / f"e{n}", draws=9)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] - peaks[0] < z.nbytes  # three images more, and not even one array more
