"""What the endpoint costs beside the agent's own code: a call, a checkpoint, eight trials at once.

    python benchmarks/endpoint/run.py [--calls 200] [--trials 8] [--growth 1000]

Everything is measured side by side in one run, on a machine that may be busy: medians, and ratios
of what alternates. Blender's own save is timed inside Blender, by its own process.
"""

from __future__ import annotations

import argparse
import json
import os
import socket
import statistics
import tempfile
import threading
import time
from contextlib import closing
from pathlib import Path
from typing import Any

from legoworld.endpoint.listener import HOST
from legoworld.endpoint.server import EndpointServer
from legoworld.endpoint.session import Session, Trial
from legoworld.workers.protections import protections
from legoworld.workers.sandbox import SandboxLimits

ROOM = """
import bpy, random
random.seed(0)
for n in range({objects}):
    bpy.ops.mesh.primitive_uv_sphere_add(location=[random.uniform(-4, 4) for _ in range(3)])
"""
SAVE = """
import bpy, time
begun = time.perf_counter()
bpy.ops.wm.save_as_mainfile(filepath="own.blend", copy=True, compress=True, check_existing=False)
print(time.perf_counter() - begun)
"""
MOVE = "import bpy\nbpy.data.objects[0].location.x += 0.001"


class Client:
    """A line to an endpoint; `ask` gives the answer and how long it took."""

    def __init__(self, port: int) -> None:
        self.line = socket.create_connection((HOST, port))

    def ask(self, kind: str, **params: Any) -> tuple[Any, float]:
        begun = time.perf_counter()
        self.line.sendall(json.dumps({"type": kind, "params": params}).encode())
        data = b""
        while True:
            data += self.line.recv(1 << 16)
            try:
                return json.loads(data), time.perf_counter() - begun
            except ValueError:
                continue


def session(folder: Path) -> Session:
    (folder / "workspace").mkdir(parents=True)
    limits = SandboxLimits(time_s=3600.0, memory_bytes=4 << 30)
    return Session(
        Trial(
            workspace=folder / "workspace",
            record=folder / "record",
            limits=limits,
            protections=protections("auto"),
        )
    )


def calls(folder: Path, n: int) -> dict[str, float]:
    """Milliseconds of a call beyond its code's own time, without and with a checkpoint."""
    found = {}
    with closing(session(folder)) as made, EndpointServer(made, 0) as server:
        client = Client(server.port)
        client.ask("execute_code", code=ROOM.format(objects=20))
        for name, kind, code in (
            ("a question", "get_scene_info", None),
            ("code that changes nothing", "execute_code", "print(1)"),
            ("code that changes the scene", "execute_code", MOVE),
        ):
            over = []
            for _ in range(n):
                params = {} if code is None else {"code": code}
                _, took = client.ask(kind, **params)
                over.append(1000 * (took - made.record.calls[-1].seconds))
            found[name] = statistics.median(over)
            found[f"{name}, 95th percentile"] = sorted(over)[int(0.95 * n)]
        picture = folder / "workspace" / "look.png"
        looks = [
            client.ask("get_viewport_screenshot", filepath=str(picture), max_size=512)[1]
            for _ in range(3)
        ]
        found["screenshot at 512, s"] = statistics.median(looks)
        client.line.close()
    return found


def checkpoints(folder: Path, objects: int, n: int) -> dict[str, float]:
    """A changed call with its checkpoint, beside Blender's own save of the same scene."""
    own, ours = [], []
    with closing(session(folder)) as made, EndpointServer(made, 0) as server:
        client = Client(server.port)
        client.ask("execute_code", code=ROOM.format(objects=objects))
        for _ in range(n):
            answer, _ = client.ask("execute_code", code=SAVE)
            own.append(float(answer["result"]["result"].strip().splitlines()[-1]))
            _, took = client.ask("execute_code", code=MOVE)
            ours.append(took - made.record.calls[-1].seconds)
        last = made.record.checkpoints[-1]
        client.line.close()
    return {
        "bytes": last.bytes,
        "Blender's own save, ms": 1000 * statistics.median(own),
        "checkpoint, ms": 1000 * statistics.median(ours),
        "ratio": statistics.median(b / a for a, b in zip(own, ours, strict=True)),
    }


def together(folder: Path, trials: int) -> dict[str, Any]:
    """Trials at once, one of which crashes and one of which spins: the others end as alone."""
    said: dict[int, str] = {}

    def work(number: int) -> None:
        with closing(session(folder / str(number))) as made, EndpointServer(made, 0) as server:
            client = Client(server.port)
            client.ask("execute_code", code=ROOM.format(objects=10))
            if number == 0:
                client.ask("execute_code", code="import os; os.abort()")
            if number == 1:
                client.ask("execute_code", code="x = bytearray(1 << 30)\nx[::4096] = x[::4096]")
            answer, _ = client.ask("execute_code", code="print(len(bpy.data.objects))")
            said[number] = str(answer["result"]["result"]).strip()
            client.line.close()

    begun = time.perf_counter()
    threads = [threading.Thread(target=work, args=(number,)) for number in range(trials)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return {"s": time.perf_counter() - begun, "objects": sorted(said.values()), "trials": trials}


HELD = """
import os
pages = int(open("/proc/self/statm").read().split()[1])
print(pages * os.sysconf("SC_PAGE_SIZE"), len(os.listdir("/proc/self/fd")))
"""


def growth(folder: Path, n: int) -> dict[str, Any]:
    """MB and descriptors of Blender and of legoworld after a tenth of n calls and after all.

    A third of them each: a change, an error, a look at the scene; one object moves, so that the
    scene keeps its size.
    """
    with closing(session(folder)) as made, EndpointServer(made, 0) as server:
        client = Client(server.port)
        client.ask("execute_code", code=ROOM.format(objects=20))
        found = {}
        for number in range(1, n + 1):
            if number % 3 == 0:
                client.ask("get_scene_info")
            else:
                client.ask("execute_code", code=MOVE if number % 3 == 1 else "1 / 0")
            if number in (n // 10, n):
                said = client.ask("execute_code", code=HELD)[0]["result"]["result"]
                bytes_of_blender, of_blender = map(int, said.split())
                pages = int(Path("/proc/self/statm").read_text().split()[1])
                found[f"after {number}"] = {
                    "Blender MB": round(bytes_of_blender / 1e6, 1),
                    "Blender descriptors": of_blender,
                    "legoworld MB": round(pages * os.sysconf("SC_PAGE_SIZE") / 1e6, 1),
                    "legoworld descriptors": len(os.listdir("/proc/self/fd")),  # noqa: PTH208
                    "legoworld threads": threading.active_count(),
                }
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--calls", type=int, default=200)
    parser.add_argument("--trials", type=int, default=8)
    parser.add_argument("--growth", type=int, default=1000)
    given = parser.parse_args()
    print(json.dumps({"cores": os.cpu_count(), "load": os.getloadavg()[0]}))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        print(json.dumps({"overhead of a call, ms": calls(folder / "calls", given.calls)}))
        for objects in (10, 100, 400):
            found = checkpoints(folder / f"c{objects}", objects, 15)
            print(json.dumps({f"checkpoint, {objects} spheres": found}))
        print(json.dumps({"growth": growth(folder / "growth", given.growth)}))
        print(json.dumps({"at once": together(folder / "together", given.trials)}))


if __name__ == "__main__":
    main()
