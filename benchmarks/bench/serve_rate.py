"""Scores a minute of `legoworld bench serve --no-render`, each scene opened anew by Blender.

python benchmarks/bench/serve_rate.py DATASET KEPT_SCENES [--requests 200] [--workers 2]
"""

from __future__ import annotations

import argparse
import itertools
import json
import subprocess
import sys
import time
from pathlib import Path


def main() -> None:
    """Warm up with one request a worker, then time the others; CPU seconds of all processes."""
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
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        wanted = itertools.islice(itertools.cycle(requests), chosen.requests + chosen.workers)
        lines = [json.dumps(request) + "\n" for request in wanted]
        process.stdin.writelines(lines[: chosen.workers])
        process.stdin.flush()
        for _ in range(chosen.workers):
            process.stdout.readline()
        begin = time.perf_counter()
        process.stdin.writelines(lines[chosen.workers :])
        process.stdin.close()
        answers = [json.loads(line) for line in process.stdout]
        seconds = time.perf_counter() - begin
    good = sum(answer["status"] == "ok" for answer in answers)
    print(f"{good} of {len(answers)} ok; {60 * len(answers) / seconds:.0f} a minute")


if __name__ == "__main__":
    main()
