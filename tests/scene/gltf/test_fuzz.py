"""Damaged files end in a verdict or a picture, soon."""

from __future__ import annotations

import pytest
from scene.gltf.mutants import KINDS, mutant, outcome, rich_glb

#: Of CPU: what ends takes hundredths of a second, however slow the machine is.
LIMIT_S = 60.0


def test_the_undamaged_file_is_read(tmp_path):
    assert outcome(rich_glb(), tmp_path)[0] == "ok"


@pytest.mark.parametrize("seed", range(40))
def test_a_mutant_ends_in_a_verdict_or_a_picture(seed, tmp_path):
    kind, data = mutant(rich_glb(), seed)
    assert kind in KINDS
    code, seconds = outcome(data, tmp_path)
    assert code in {
        "ok", "unreadable_gltf", "unsupported_gltf", "invalid_scene", "no_camera", "no_mesh",
        "non_finite_geometry", "unsupported_camera",
    }  # fmt: skip
    assert seconds < LIMIT_S


def test_mutants_are_damaged_and_reach_every_kind(tmp_path):
    whole = rich_glb()
    made = [mutant(whole, seed) for seed in range(40)]
    assert {kind for kind, _ in made} == set(KINDS)
    assert all(data != whole for _, data in made)
    assert {outcome(data, tmp_path)[0] == "ok" for _, data in made} == {True, False}
