"""Scores a minute of `legoworld bench serve --no-render`, each scene opened anew by Blender.

    python benchmarks/bench/serve_rate.py DATASET KEPT_SCENES [--requests 200] [--workers 2]

KEPT_SCENES is what `bench make --keep-scenes` leaves. The server is started twice: to answer one
request a worker, and to answer all. The difference in CPU seconds of all processes, Blender's
included, is what an answer costs; it holds on a loaded machine, where scores a minute do not.
"""

from __future__ import annotations

import argparse
import itertools
import json
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import Any


def serve(command: list[str], lines: list[str], warm: int) -> tuple[list[Any], float, float]:
    """Answers after the first `warm`, the seconds that they took, CPU seconds of everything."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.writelines(lines[:warm])
        process.stdin.flush()
        for _ in range(warm):
            process.stdout.readline()
        begin = time.perf_counter()
        process.stdin.writelines(lines[warm:])
        process.stdin.close()
        answers = [json.loads(line) for line in process.stdout]
        seconds = time.perf_counter() - begin
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return answers, seconds, cpu


def main() -> None:
    """Warm up with one request a worker, then time the others."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("dataset", type=Path)
    parser.add_argument("scenes", type=Path)
    parser.add_argument("--requests", type=int, default=200)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--cached", action="store_true", help="with the user's snapshot cache")
    chosen = parser.parse_args()
    track = json.loads((chosen.dataset / "public" / "track.json").read_text(encoding="utf-8"))
    requests = [
        {"scene": str(chosen.scenes / Path(image["file_name"]).stem), "image_id": image["id"]}
        for image in track["images"]
    ]
    command = [sys.executable, "-m", "legoworld", "bench", "serve", str(chosen.dataset)]
    command += ["--no-render", "--workers", str(chosen.workers)]
    command += [] if chosen.cached else ["--no-cache"]
    wanted = itertools.islice(itertools.cycle(requests), chosen.requests + chosen.workers)
    lines = [json.dumps(request) + "\n" for request in wanted]
    _, _, start = serve(command, lines[: chosen.workers], chosen.workers)
    answers, seconds, cpu = serve(command, lines, chosen.workers)
    good = sum(answer["status"] == "ok" for answer in answers)
    each = (cpu - start) / len(answers)
    print(
        f"{good} of {len(answers)} ok; {60 * len(answers) / seconds:.0f} a minute; "
        f"{1e3 * each:.0f} CPU ms an answer, so {60 * 2 / each:.0f} a minute of two whole cores"
    )


if __name__ == "__main__":
    main()
