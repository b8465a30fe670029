"""What an evaluation of a bench says of itself, word for word."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from legoworld.evaluation.reconstruction.text import (
    _joints,
    _noise,
    _rows,
    _size,
    _title,
    noise_floor,
)
from legoworld.records.base import UNSET
from legoworld.records.reconstruction import Mean, NoiseSummary

NOISE = NoiseSummary(
    reference_mean=0.9876, reference_sd=0.0012, n_reference=2, two_seeds=0.0345, n_two_seeds=1
)


@pytest.mark.parametrize(
    ("sampling", "partial", "said"),
    [("raster", False, ": "), ("all", False, ", all: "), ("random:7", True, ", random:7: ")],
)
def test_the_first_line(sampling, partial, said):
    summary = SimpleNamespace(
        coverage=SimpleNamespace(attempted=3, scored=2, valid=1), partial=partial,
        protocol=SimpleNamespace(reference_sampling=sampling),
        evaluator=SimpleNamespace(name="legoworld", version="1"),
        bootstrap=SimpleNamespace(groups=1),
    )  # fmt: skip
    assert _title(summary) == (
        f"legoworld 1, bench{said}3 cases attempted, 2 compared, 1 valid; intervals over 1 family"
        + ("; partial run" if partial else "")
    )


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({}, "0.9876, sd 0.0012 between seeds (2 cases)"),
        ({"reference_sd": None}, "0.9876 (2 cases)"),
        ({"reference_sd": 0.0, "n_reference": 1}, "0.9876 (1 case)"),
    ],
)
def test_the_noise_floor(changes, said):
    noise = NoiseSummary(
        **{name: getattr(NOISE, name) for name in NOISE.__struct_fields__} | changes
    )
    assert noise_floor(noise) == f"A's noise floor: the reference's own renders score {said}"


def mean(value):
    return Mean(value=value, n=2, over="attempted", interval=None)


def test_what_is_said_of_noise():
    none = NoiseSummary(reference_mean=None, reference_sd=None, n_reference=0, two_seeds=None,
                        n_two_seeds=0)  # fmt: skip
    assert noise_floor(none) == ""
    assert _noise(SimpleNamespace(noise=NOISE)) == [
        noise_floor(NOISE),
        "two seeds of a submission's render differ at 3.45% of the pixels (1 case)",
    ]
    (line,) = _noise(SimpleNamespace(noise=none, metrics={"A": mean(0.5)}))
    assert line == "A's noise floor was not measured when the dataset was made"
    (line,) = _noise(SimpleNamespace(noise=none, metrics={"A": mean(None)}))
    assert line == "A and S are undefined: valid cases have no render (readout --no-render)"


def test_the_pilot():
    counts = dict(zip("CWPOJE", range(1, 7), strict=True))
    joints = SimpleNamespace(**counts, score=0.25, card_version="0.1", cases=2)
    assert _joints(SimpleNamespace(articulation=joints)) == [
        "articulation (pilot 0.1, in no score): 0.2500 (C 1, W 2, P 3, O 4, J 5, E 6; 2 cases)"
    ]
    joints.score, joints.cases = None, 1
    (line,) = _joints(SimpleNamespace(articulation=joints))
    assert line.endswith(": - (C 1, W 2, P 3, O 4, J 5, E 6; 1 case)")
    assert _joints(SimpleNamespace(articulation=UNSET)) == []


def test_the_scores_come_first_and_all_others_by_name():
    names = ["b", "S_valid", "R", "a", "V", "A_valid", "S", "A", "R_valid"]
    rows = _rows({name: mean(0.5) for name in names})
    assert [row.name for row in rows] == [
        "V", "R", "A", "S", "R_valid", "A_valid", "S_valid", "a", "b",
    ]  # fmt: skip
    assert rows[0].over == "2 cases, attempted"
    assert _size(SimpleNamespace(cases=1, families=2)) == "1 case, 2 families"
