"""How often a 95 % interval from one track holds the mean AP of tracks of its size.

    python benchmarks/evaluate/interval_coverage.py [--equal]

Draws tracks of 100 images out of 800 synthetic ones. For each: AP, a bootstrap over its images, and
three intervals. Prints how often each holds the mean AP of 120 such tracks.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from synthetic import coco_like, run_of

from legoworld.comparison.detections import restrict_table
from legoworld.evaluation.bootstrap import resample_counts
from legoworld.evaluation.detection.inputs.prediction_checks import as_predictions
from legoworld.evaluation.detection.inputs.predictions import (
    check_predictions,
    prediction_type,
    with_equal_confidence,
)
from legoworld.evaluation.detection.inputs.truth import read_truth
from legoworld.evaluation.detection.matching.matches import match_states
from legoworld.evaluation.detection.matching.outcomes import MatchTable, match_table
from legoworld.evaluation.detection.problem import build_problem
from legoworld.evaluation.detection.protocols import detection_protocol
from legoworld.evaluation.detection.ranking.resampling import resampled_metrics
from legoworld.workers.tasks import IN_PROCESS

POPULATION, TRACK, TRACKS, JUDGED, DRAWS = 800, 100, 120, 60, 200


def population_table(*, equal: bool) -> MatchTable:
    """Matches of all images, fewer predictions when none is ranked."""
    protocol = detection_protocol("coco")
    per_image = 9 if equal else 20
    document, results = coco_like(POPULATION, POPULATION * per_image, seed=5, n_categories=40)
    run = run_of(document, "coco")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "truth.json"
        path.write_text(json.dumps(document))
        truth = read_truth(path, protocol, run)
    batches = [as_predictions(results, prediction_type(protocol))]
    predictions = check_predictions(batches, run=run, truth=truth, protocol=protocol)
    if equal:
        predictions = with_equal_confidence(predictions)
    problem = build_problem(truth, predictions, protocol)
    return match_table(problem, match_states(problem, truth, predictions, IN_PROCESS))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--equal", action="store_true", help="all scores 1")
    options = parser.parse_args()
    protocol = replace(detection_protocol("coco"), metrics=detection_protocol("coco").metrics[:1])
    whole = population_table(equal=options.equal)
    random = np.random.default_rng(1)
    tracks = [
        restrict_table(
            whole, np.isin(np.arange(POPULATION), random.choice(POPULATION, TRACK, replace=False))
        )
        for _ in range(TRACKS)
    ]
    once = np.ones((1, TRACK), np.int32)
    aps = np.array([resampled_metrics(t, protocol, once)["AP"][0] for t in tracks])
    mean = aps.mean()
    held = dict.fromkeys(("percentile", "basic", "centred"), 0)
    biases = []
    for seed, (table, ap) in enumerate(zip(tracks[:JUDGED], aps, strict=False)):
        samples = resampled_metrics(table, protocol, resample_counts(TRACK, DRAWS, seed))["AP"]
        low, high = np.quantile(samples, [0.025, 0.975])
        bias = samples.mean() - ap
        biases.append(bias)
        held["percentile"] += low <= mean <= high
        held["basic"] += 2 * ap - high <= mean <= 2 * ap - low
        held["centred"] += low - bias <= mean <= high - bias
    print(
        f"mean AP {mean:.4f}, sd over tracks {aps.std():.4f}, bias of samples {np.mean(biases):.4f}"
    )
    for name, count in held.items():
        print(f"{name:<12} {count / JUDGED:.2f}")


if __name__ == "__main__":
    main()
