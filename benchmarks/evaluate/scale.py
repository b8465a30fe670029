"""What scoring costs, stage by stage, and whether the fast and the official evaluator agree.

    python benchmarks/evaluate/scale.py --task coco --images 5000 --predictions 500000
    python benchmarks/evaluate/scale.py --task lvis --images 2000 --predictions 200000 --official
    python benchmarks/evaluate/scale.py --images 1000 --predictions 100000 --only-images --workers 2

Prints of each stage its seconds, the CPU seconds of all its processes, and the largest memory of
this process in it; first what the made-up data alone take, which are given back once they are
written into files. With --official also the official evaluator's,
and the largest difference of any number and of the whole precision array. Linux only.
"""

from __future__ import annotations

import argparse
import gc
import json
import resource
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from synthetic import coco_like, lvis_like, run_of

from legoworld.evaluation.bootstrap import resample_counts
from legoworld.evaluation.detection.evaluators import run_evaluator
from legoworld.evaluation.detection.inputs.predictions import (
    check_predictions,
    prediction_type,
    with_equal_confidence,
)
from legoworld.evaluation.detection.inputs.truth import read_truth
from legoworld.evaluation.detection.matching.matched_metrics import matched_counts, matched_metrics
from legoworld.evaluation.detection.matching.matches import match_and_pair
from legoworld.evaluation.detection.matching.outcomes import match_table
from legoworld.evaluation.detection.problem import build_problem
from legoworld.evaluation.detection.protocols import detection_protocol
from legoworld.evaluation.detection.ranking.accumulation import accumulate, metric_value
from legoworld.evaluation.detection.ranking.resampling import resampled_metrics
from legoworld.evaluation.detection.ranking.ties import tie_orders
from legoworld.evaluation.detection.scoring import category_frequencies
from legoworld.records.folders.prediction_files import stored_batches
from legoworld.workers.tasks import WorkerPool


@contextmanager
def timed(stage: str) -> Iterator[None]:
    gc.collect()
    Path("/proc/self/clear_refs").write_text("5")  # the largest memory starts anew
    start, start_cpu = time.perf_counter(), cpu_s()
    yield
    seconds, cpu = time.perf_counter() - start, cpu_s() - start_cpu
    print(f"{stage:<44} {seconds:8.2f} s {cpu:8.2f} CPU s   {memory('VmHWM'):5.2f} GB", flush=True)


def memory(name: str) -> float:
    """GB of this process: VmRSS now, VmHWM the most."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(x.split()[1]) for x in lines if x.startswith(name)) * 1024 / 1e9


def cpu_s() -> float:
    """Of this process and of those that it has waited for."""
    used = [resource.getrusage(w) for w in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in used)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--task", choices=["coco", "lvis"], default="coco")
    parser.add_argument("--images", type=int, default=5000)
    parser.add_argument("--predictions", type=int, default=500_000)
    parser.add_argument("--draws", type=int, default=2000)
    parser.add_argument("--equal", action="store_true", help="all scores 1")
    parser.add_argument("--official", action="store_true", help="run the official one, too")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--only-images", action="store_true", help="stop after the matching")
    options = parser.parse_args()
    pool = WorkerPool(workers=options.workers)
    make = coco_like if options.task == "coco" else lvis_like
    before = memory("VmRSS")
    document, results = make(options.images, options.predictions)
    print(f"{'made-up data':<69} {memory('VmRSS') - before:5.2f} GB, the benchmark's own")
    protocol = detection_protocol(options.task)
    run = run_of(document, options.task)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "truth.json"
        path.write_text(json.dumps(document))
        results_path = Path(folder) / "predictions.json"
        lines = (json.dumps(entry, separators=(",", ":")) for entry in results)
        results_path.write_text("[\n" + ",\n".join(lines) + "\n]\n")
        del results
        with timed("truth read and checked"):
            truth = read_truth(path, protocol, run)
        del document
        with timed("predictions read, checked and ordered"):
            batches = stored_batches([results_path], prediction_type(protocol))
            predictions = check_predictions(batches, run=run, truth=truth, protocol=protocol)
            if options.equal:
                predictions = with_equal_confidence(predictions)
    with timed("matching, greedy and score-free"):
        problem = build_problem(truth, predictions, protocol)
        matches = match_and_pair(problem, truth, predictions, pool)
        table = match_table(problem, matches.state)
    if options.only_images:
        return
    with timed("precision and recall from the matches"):
        curves = accumulate(table, protocol)
        ours = [metric_value(m, curves, category_frequencies(truth)) for m in protocol.metrics]
    kinds = ["fast", "official"] if options.official else ["fast"]
    for kind in kinds:
        with timed(f"{kind} evaluator"):
            scores = run_evaluator(truth, predictions, protocol, kind)  # type: ignore[arg-type]
        difference = np.abs(np.array(ours) - scores.official).max()
        array = np.abs(curves.precision - scores.precision).max()
        print(f"  {scores.name}: metrics differ by {difference:.1e}, precision by {array:.1e}")
    with timed(f"{options.draws} tie orders"):
        print(" ", tie_orders(table, draws=options.draws, seed=0))
    samples = resample_counts(options.images, options.draws, 0)
    with timed(f"{options.draws} bootstrap samples, official metrics"):
        resampled = resampled_metrics(table, protocol, samples, category_frequencies(truth))
    with timed(f"{options.draws} bootstrap samples, score-free"):
        for pairs in (matches.aware, matches.agnostic):
            matched_metrics(matched_counts(problem, pairs), samples)
    print(f"  AP {ours[0]:.6f}, bootstrap sd {np.nanstd(resampled['AP']):.6f}")


if __name__ == "__main__":
    main()
