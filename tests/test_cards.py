"""Cards that declare what the code does not do."""

from __future__ import annotations

from dataclasses import replace

import pytest

from legoworld.cards import load_card, read_card
from legoworld.errors import CatalogError
from legoworld.evaluation.depth.protocol import depth_protocol
from legoworld.evaluation.reconstruction.protocol import bench_protocol
from legoworld.shipped.catalog import folder


@pytest.mark.parametrize("task", ["coco", "lvis", "eth3d"])
def test_a_card_that_declares_something_else_is_refused(task, tmp_path):
    load_card(task)
    text = (folder("readouts") / f"{task}.toml").read_text(encoding="utf-8")
    changed = tmp_path / "card.toml"
    changed.write_text(text.replace("alpha_threshold = 0.5", "alpha_threshold = 0.3"))
    with pytest.raises(CatalogError, match=r"alpha_threshold = 0\.3"):
        read_card(changed, task)
    changed.write_text(text.replace("alpha_threshold = 0.5", ""))
    with pytest.raises(CatalogError, match="alpha_threshold"):
        read_card(changed, task)


@pytest.mark.parametrize(("read", "task"), [(depth_protocol, "eth3d"), (bench_protocol, "bench")])
def test_a_card_that_scores_otherwise_is_refused(read, task):
    card = load_card(task)
    other = {**card.values, "scoring": {**card.values["scoring"], "bootstrap_unit": "pixel"}}
    with pytest.raises(CatalogError, match=r"scoring\.bootstrap_unit = 'pixel'"):
        read(replace(card, values=other))
