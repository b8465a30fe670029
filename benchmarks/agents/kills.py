"""`reconstruct` with one of its processes killed at any moment, and run again.

    python benchmarks/agents/kills.py [--kind main agent ...] [--kills 10] [--seed 0]
    python benchmarks/agents/kills.py --agent claude --programs .agents [--photos DIR] [--limit 12]

Each kill is a SIGKILL at a drawn moment of the process's life; the same command then makes the
rest. All files of the scenes and a readout of them are compared, field by field, with those of an
undisturbed run; where the kill has cost `program` a call, with one of the calls that were answered.
`program` plays ten recorded steps; the real agents, from npm as `make test-agents` installs them,
follow a script. Needs Linux, bubblewrap, mcp-for-blender and the program `zstd`.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))

from agent_programs.model_server import ModelServer
from agent_programs.programs import AGENTS
from campaign import CODES, Campaign, environment, make_campaign
from trial_files import OF_EACH_TRIAL, differences

import legoworld
from legoworld.workers.descendants import descendants

_LOOK_EVERY_S = 0.2
_GONE_WITHIN_S = 60.0
Words = Sequence[str]


def _finalises(words: Words) -> bool:
    return ".finalised.blend" in " ".join(words)


#: What is killed besides `main`: by a process's words and its parent's. The recorder is a thread of
#: legoworld, and ends with it.
KINDS: dict[str, Callable[[Words, Words], bool]] = {
    "agent": lambda _, above: above[3:4] != () and above[4:6] == ("/bin/sh", "-c"),
    "mcp": lambda words, _: any(word.endswith("/mcp-for-blender") for word in words[:2]),
    "blender": lambda words, _: (
        words[3:4] == ("legoworld.scene.blender.endpoint",) and not _finalises(words)
    ),
    "finaliser": lambda words, _: (
        words[3:4] == ("legoworld.scene.blender.endpoint",) and _finalises(words)
    ),
    "reader": lambda words, _: words[2:3] == ("legoworld.scene.blender.worker",),
}


@dataclass(frozen=True, kw_only=True)
class Run:
    """An undisturbed run: where its files are, and when each kind of process was there."""

    folder: Path
    lives: dict[str, tuple[float, float]]


def words_of(pid: int) -> Words:
    """The command of a process; nothing of one that has ended."""
    with suppress(OSError):
        return tuple(Path(f"/proc/{pid}/cmdline").read_bytes().decode().rstrip("\0").split("\0"))
    return ()


def parent_of(pid: int) -> int:
    """The parent of a process; 0 of one that has ended."""
    with suppress(OSError):
        return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
    return 0


def find(kind: str, main: int) -> list[int]:
    """The processes of a kind below legoworld's own."""
    if kind == "main":
        return [main]
    found = [(pid, words_of(pid), words_of(parent_of(pid))) for pid in descendants(main)]
    return [pid for pid, words, above in found if words and KINDS[kind](words, above)]


class Bench:
    """Campaigns of one agent, one after the other in the same folder: no path differs."""

    def __init__(self, top: Path, given: argparse.Namespace, server: ModelServer | None) -> None:
        self.top, self.given, self.server = top, given, server
        self.photos = sorted(given.photos.iterdir())[: given.limit] if given.photos else []
        self.environment = environment(None if server is None else given.programs)
        self._undisturbed: dict[Sequence[str], Run] = {}

    def make(self, codes: Sequence[str] = CODES) -> Campaign:
        """A new campaign."""
        return make_campaign(self.top / "run", self.given.agent, self.photos, self.server, codes)

    def popen(self, made: Campaign) -> subprocess.Popen[bytes]:
        """Its command, just begun."""
        return subprocess.Popen(
            made.command, env=self.environment, start_new_session=True,
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        )  # fmt: skip

    def keep(self, made: Campaign, name: str) -> Path:
        """Read out the scenes, and move the campaign out of the next one's way."""
        legoworld.readout(
            made.scenes, made.folder / "readout", task="coco", track=made.folder / "track.json",
            workers=1, cache=False,
        )  # fmt: skip
        return made.folder.rename(self.top / name)

    def undisturbed(self, codes: Sequence[str]) -> Run:
        """A run of these calls that is left alone; of the same calls the same."""
        codes = tuple(codes)
        if codes not in self._undisturbed:
            made, seen = self.make(codes), {}
            begun, cpu = time.monotonic(), _cpu_s()
            with self.popen(made) as run:
                while run.poll() is None:
                    for kind in ("main", *KINDS):
                        if find(kind, run.pid):
                            now = time.monotonic() - begun
                            seen[kind] = (seen.get(kind, (now,))[0], now)
                    time.sleep(_LOOK_EVERY_S)
                wall_s = time.monotonic() - begun
                rows = json.loads(run.communicate()[0])["trials"]
            print(json.dumps({
                "undisturbed": self.given.agent, "calls": len(codes), "code": run.returncode,
                "wall_s": round(wall_s, 1), "cpu_s": round(_cpu_s() - cpu, 1),
                **outcome(made, rows),
            }), flush=True)  # fmt: skip
            folder = self.keep(made, f"undisturbed-{len(self._undisturbed)}")
            self._undisturbed[codes] = Run(folder=folder, lives=seen)
        return self._undisturbed[codes]

    def kill(self, kind: str, number: int, share: float) -> dict[str, Any]:
        """Kill a process of a kind once, resume, and compare."""
        first, last = self.undisturbed(CODES).lives[kind]
        made = self.make()
        with self.popen(made) as run:
            while run.poll() is None and not find(kind, run.pid):
                time.sleep(_LOOK_EVERY_S)
            with suppress(subprocess.TimeoutExpired):
                run.wait(share * (last - first))
            there, below = find(kind, run.pid), descendants(run.pid)
            begun = {pid: words_of(pid) for pid in (*below, run.pid)}
            answered = _answered(made)
            if run.poll() is not None:  # this time it was quicker
                there = []
            for pid in there:
                os.kill(pid, signal.SIGKILL)
            run.communicate()
        with self.popen(made) as again:
            rows = json.loads(again.communicate()[0])["trials"]
        deadline = time.monotonic() + _GONE_WITHIN_S
        while (alive := [p for p, w in begun.items() if w and words_of(p) == w]) and (
            time.monotonic() < deadline
        ):
            time.sleep(_LOOK_EVERY_S)
        reached = outcome(made, rows)
        codes = _codes(made)[1] if self.server is None and not self.photos else CODES
        left = sorted(path.name for path in made.scenes.iterdir())
        folder = self.keep(made, f"{kind}-{number}")
        alone = self.undisturbed(codes).folder
        found = differences(alone / "scenes", folder / "scenes")
        found += differences(alone / "readout", folder / "readout")
        return {
            "kind": kind, "share": round(share, 2), "there": len(there), "answered": answered,
            "codes": [run.returncode, again.returncode], **reached,
            "lost": len(CODES) - len(codes), "left": left, "alive": len(alive),
            "differs": {k: n for k, n in sorted(found.items()) if not OF_EACH_TRIAL.search(k)},
        }  # fmt: skip


def outcome(made: Campaign, rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """What the trials came to, and their tokens beside the server's own count."""
    used = [row["usage"] or {} for row in rows]
    totals = [
        sum(one.get(key) or 0 for one in used)
        for key in ("prompt_tokens", "cached_tokens", "completion_tokens")
    ]
    continued = [
        json.loads(path.read_text())["continued"]
        for path in made.scenes.glob("*/reconstruction.json")
    ]
    about: dict[str, Any] = {
        "statuses": dict(Counter(row["status"] for row in rows)),
        "reasons": sorted({row["reason"] for row in rows if row["reason"]}),
        "frozen": sum(
            json.loads(path.read_text())["status"] == "ok"
            for path in made.scenes.glob("*/frozen.json")
        ),
        "continued": sum(continued),
    }
    if made.server is not None:
        about |= {"tokens": totals, "server": list(made.server.tokens)}
        about["requests"] = len(made.server.asked)
    return about


def _codes(made: Campaign) -> tuple[int, list[str]]:
    """How many calls were answered; the code of those that succeeded."""
    calls = [
        json.loads(row) for path in made.folder.rglob("calls.jsonl") for row in path.open() if row
    ]
    codes = [c["code"] for c in calls if c["command"] == "execute_code"]
    return len(codes), [c["code"] for c in calls if c["code"] and c["status"] == "success"]


def _answered(made: Campaign) -> int:
    with suppress(ValueError):  # in the midst of being written
        return _codes(made)[0]
    return -1


def _cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kind", nargs="*", choices=("main", *KINDS), default=["main"])
    parser.add_argument("--agent", choices=("program", *AGENTS), default="program")
    parser.add_argument("--programs", type=Path, help="the folder of the real agents' programs")
    parser.add_argument("--photos", type=Path, help="a folder of photos, for one grey one")
    parser.add_argument("--limit", type=int, help="only the first N photos")
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    with ExitStack() as stack:
        name = stack.enter_context(tempfile.TemporaryDirectory(prefix="legoworld-kills-"))
        server = None
        if given.agent != "program":
            server = stack.enter_context(ModelServer(()).serving())
        bench = Bench(Path(name), given, server)
        bench.undisturbed(CODES)
        for kind in given.kind if given.kills else ():
            moments = random.Random(f"{given.seed} {kind}")
            for number in range(given.kills):
                print(json.dumps(bench.kill(kind, number, moments.uniform(0.05, 0.95))), flush=True)


if __name__ == "__main__":
    main()
