"""What a depth comparison shows: which way is better, what is resampled, what is a detail."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest

from legoworld.comparison.depth import COMPARED
from legoworld.comparison.measures import EVERYTHING, HEADLINE, TABLE
from legoworld.comparison.pixels import (
    list_pixel_metrics,
    measure_pixels,
)
from legoworld.evaluation.bootstrap import draw_groups
from legoworld.evaluation.depth.family import PIXELS
from legoworld.evaluation.pixels.family import metric_policies
from legoworld.evaluation.pixels.summary import resampling_unit


def rows_of(*groups: str) -> list[SimpleNamespace]:
    return [SimpleNamespace(group=group) for group in groups]


def test_deltas_are_better_higher_and_errors_lower():
    better = {metric.id.split(".")[0]: metric.better for metric in list_pixel_metrics(PIXELS)}
    assert better == {
        name: "higher" if name in ("delta1", "delta2", "delta3") else "lower"
        for name, _ in metric_policies(PIXELS.metrics)
    }


def test_the_headline_is_abs_rel_and_the_primary_delta1_and_higher_deltas_are_details():
    level = {metric.id: metric.level for metric in list_pixel_metrics(PIXELS)}
    headline = {name for name, value in level.items() if value == HEADLINE}
    pairs = metric_policies(PIXELS.metrics)
    assert headline == {
        *(f"{name}.{policy}" for name, policy in pairs if name == "abs_rel"),
        "delta1.error_1",
    }
    details = {name.split(".")[0] for name, value in level.items() if value == EVERYTHING}
    assert details == {"delta2", "delta3"}
    assert level["rmse_m.exclude"] == TABLE


@pytest.mark.parametrize(
    ("names", "unit"),
    [
        ([], "image"),
        (["courtyard/images/dslr_images/A.JPG", "office/images/dslr_images/B.JPG"], "scene"),
        (["courtyard/images/dslr_images/A.JPG", "B.JPG"], "image"),
        (["A.JPG", "B.JPG"], "image"),
    ],
)
def test_scenes_are_resampled_only_where_every_photo_is_of_one(names, unit):
    rows = [SimpleNamespace(file_name=name, group=PIXELS.group(name)) for name in names]
    assert resampling_unit(rows) == unit


def test_one_group_shows_no_spread():
    assert not draw_groups(["a", "a"], 10, 0).spread
    assert not draw_groups([], 10, 0).spread
    two = draw_groups(["b", "a"], 10, 0)
    assert two.spread
    assert two.column == {"a": 0, "b": 1}
    assert two.counts.shape == (10, 2)
    assert (two.counts.sum(axis=1) == 2).all()


def test_a_side_without_a_scored_image_has_no_mean_and_no_samples():
    class Empty:
        rows = ()

        def kept_rows(self, _kept):
            return []

    measures = measure_pixels(
        COMPARED,
        Empty(),
        "scored",
        (),
        draw_groups(["a", "b"], 10, 0),
    )
    assert {f"{name}.{policy}" for name, policy in metric_policies(PIXELS.metrics)} == set(measures)
    for measure in measures.values():
        assert math.isnan(measure.value)
        assert math.isnan(measure.extra["constant"])
        assert measure.samples is None
        assert measure.over == {"images": 0}
