"""Load on `legoworld bench serve --http --no-render`: latency, CPU an answer, memory, kills.

    python benchmarks/bench/http_load.py DATASET KEPT_SCENES [--clients 200] [--rate 1000]
        [--seconds 600] [--kill 5]

KEPT_SCENES is what `bench make --keep-scenes` leaves. Requests have fixed times, `--rate` a minute,
and the next free client sends each: its latency counts from its time, so that a slow server hides
nothing. A client that gets 429 or 503 asks again, as Retry-After says. --kill SECONDS: kill -9 a
worker and a Blender in turn, so often. Every answer has to be that of the first, quiet round.
"""

from __future__ import annotations

import argparse
import http.client
import io
import itertools
import json
import os
import resource
import signal
import statistics
import subprocess
import sys
import tarfile
import threading
import time
from pathlib import Path
from typing import Any

TOKEN = "load-test-token-0123"
NAMES = ("task_process", "blender.worker")


def tarred(folder: Path) -> bytes:
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w") as archive:
        archive.add(folder, ".")
    return stream.getvalue()


def tree(pid: int) -> dict[int, str]:
    """Processes below one and itself, with their command lines."""
    listed = subprocess.run(
        ["ps", "-eo", "pid=,ppid=,args="], capture_output=True, text=True, check=True
    )
    table = [line.split(None, 2) for line in listed.stdout.splitlines()]
    below = {str(pid)}
    for _ in range(3):
        below |= {child for child, parent, _ in table if parent in below}
    return {int(child): words for child, _, words in table if child in below}


def resident_mib(pids: list[int]) -> float:
    pages = 0
    for pid in pids:
        try:
            pages += int(Path(f"/proc/{pid}/statm").read_text().split()[1])
        except OSError:
            continue  # it has ended
    return pages * resource.getpagesize() / 2**20


class Load:
    """Clients that share a schedule."""

    def __init__(self, port: int, cases: list[tuple[int, bytes]]) -> None:
        self.port, self.cases = port, cases
        self.expected: list[Any] = []
        self.latencies: list[float] = []
        self.again: dict[int, int] = {}
        self.wrong: list[str] = []
        self._numbers, self._lock = itertools.count(), threading.Lock()

    def ask(self, client: http.client.HTTPConnection, number: int) -> Any:
        """The answer; asks until it has one."""
        image_id, data = self.cases[number % len(self.cases)]
        headers = {"authorization": f"Bearer {TOKEN}"}
        while True:
            try:
                client.request("POST", f"/score?image_id={image_id}", data, headers)
                response = client.getresponse()
                text, status = response.read(), response.status
            except (OSError, http.client.HTTPException):
                client.close()  # such as an idle connection that has ended
                status, wait_s = 0, 0.1
            else:
                wait_s = float(response.headers.get("retry-after", 1))
            if status == 200:
                return json.loads(text)
            with self._lock:
                self.again[status] = self.again.get(status, 0) + 1
            time.sleep(wait_s)

    def run(self, clients: int, rate: float, seconds: float) -> None:
        begin = time.monotonic() + 0.5
        total = int(seconds * rate / 60)

        def work() -> None:
            client = http.client.HTTPConnection("127.0.0.1", self.port, timeout=300)
            while (number := next(self._numbers)) < total:
                due = begin + number * 60 / rate
                time.sleep(max(0.0, due - time.monotonic()))
                answer = self.ask(client, number)
                took = time.monotonic() - due
                with self._lock:
                    self.latencies.append(took)
                    if answer != self.expected[number % len(self.cases)]:
                        self.wrong.append(json.dumps(answer))
            client.close()

        threads = [threading.Thread(target=work) for _ in range(clients)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()


def watch(pid: int, over: threading.Event, kill_s: float, seen: dict[str, list[Any]]) -> None:
    """Note the memory each second; kill a worker and a Blender in turn."""
    names, next_kill = itertools.cycle(NAMES), time.monotonic() + kill_s
    while not over.wait(1.0):
        there = tree(pid)
        seen["all"].append(resident_mib([*there]))
        seen["server"].append(resident_mib([pid]))
        if kill_s and time.monotonic() > next_kill:
            next_kill, name = time.monotonic() + kill_s, next(names)
            victim = next((one for one, words in there.items() if name in words), None)
            if victim is not None:
                os.kill(victim, signal.SIGKILL)
                seen["killed"].append(name)


def main() -> None:
    """Start the service, ask each case once, then load it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("dataset", type=Path)
    parser.add_argument("scenes", type=Path)
    parser.add_argument("--clients", type=int, default=200)
    parser.add_argument("--rate", type=float, default=1000.0, help="requests a minute")
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--kill", type=float, default=0.0, metavar="SECONDS")
    chosen = parser.parse_args()
    track = json.loads((chosen.dataset / "public" / "track.json").read_text(encoding="utf-8"))
    cases = [
        (image["id"], tarred(chosen.scenes / Path(image["file_name"]).stem))
        for image in track["images"]
    ]
    command = [sys.executable, "-m", "legoworld", "bench", "serve", str(chosen.dataset)]
    command += ["--http", "--port", "0", "--no-render", "--no-cache"]
    command += ["--workers", str(chosen.workers)]
    with subprocess.Popen(
        command, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "LEGOWORLD_SERVE_TOKEN": TOKEN},
    ) as process:  # fmt: skip
        assert process.stderr is not None
        load = Load(int(process.stderr.readline().rpartition(":")[2]), cases)
        quiet = http.client.HTTPConnection("127.0.0.1", load.port, timeout=300)
        load.expected = [load.ask(quiet, number) for number in range(len(cases))]
        over, seen = threading.Event(), {"all": [], "server": [], "killed": []}
        watcher = threading.Thread(target=watch, args=(process.pid, over, chosen.kill, seen))
        watcher.start()
        begin = time.monotonic()
        load.run(chosen.clients, chosen.rate, chosen.seconds)
        seconds = time.monotonic() - begin
        over.set()
        watcher.join()
        process.send_signal(signal.SIGTERM)
        code = process.wait()
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    answers, took = len(load.latencies), sorted(load.latencies)
    p50, p95, p99 = (took[min(answers - 1, int(share * answers))] for share in (0.5, 0.95, 0.99))
    third = max(1, len(seen["all"]) // 3)
    parts = [
        f"{kind} {statistics.median(seen[kind][:third]):.0f} MiB in the first third, "
        f"{statistics.median(seen[kind][-third:]):.0f} in the last"
        for kind in ("server", "all")
    ]
    print(
        f"{answers} answers of {chosen.clients} clients in {seconds:.0f} s: "
        f"{60 * answers / seconds:.0f} a minute; p50 {p50:.2f} s, p95 {p95:.2f}, p99 {p99:.2f}\n"
        f"{1e3 * (used.ru_utime + used.ru_stime) / (answers + len(cases)):.0f} CPU ms an answer, "
        f"starts included; load {os.getloadavg()[0]:.1f}\n"
        f"memory: {'; '.join(parts)}\n"
        f"asked again by status: {load.again}; killed: {len(seen['killed'])}; "
        f"wrong answers: {len(load.wrong)}; exit code {code}"
    )
    if load.wrong or code:
        sys.exit(1)


if __name__ == "__main__":
    main()
