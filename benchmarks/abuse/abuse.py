"""What hostile code does in both sandboxes, as the table of docs/sandbox.md.

    python benchmarks/abuse/abuse.py [--write docs/sandbox.md]

Each snippet runs alone, under small limits, against targets of this program alone: a folder, a
sleeping process, a port and a socket. Code that comes to its goal prints DID; what it leaves behind
is looked at from outside. Without bubblewrap it has your permissions: only these targets are aimed
at.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from legoworld.workers.descendants import descendants
from legoworld.workers.protections import Confinement, protections
from legoworld.workers.sandbox import Sandbox, SandboxLimits

LIMITS = SandboxLimits(
    time_s=15.0, memory_bytes=256 << 20, disk_bytes=64 << 20, output_bytes=1 << 20, processes=48
)
DID = "DID"
FORK = "import os, time\nfor n in range(200):\n    if os.fork() == 0:\n        time.sleep(60)\n"
#: @NAME@ is filled in: FOLDER, PID, PORT, SOCKET, NAME (of an abstract socket).
SNIPPETS = {
    "files": {
        "read a file of the caller": "print(open('@FOLDER@/secret.txt').read())",
        "list the caller's folder": "import os; print(os.listdir('@FOLDER@'))",
        "read it through /proc/PID/root": "open('/proc/@PID@/root@FOLDER@/secret.txt').read()",
        "overwrite a file of the caller": "open('@FOLDER@/mine.txt', 'w').write('spoiled')",
        "delete a file of the caller": "import os; os.remove('@FOLDER@/mine.txt')",
        "add a file beside it": "open('@FOLDER@/new.txt', 'w').write('spoiled')",
        "rename the caller's folder": "import os; os.rename('@FOLDER@', '@FOLDER@-gone')",
        "write to Python's own library": "import os; p = os.__file__ + '.abuse'"
        "; open(p, 'w').close(); os.remove(p)",
        "make a device file and open it": "import os, stat"
        "; os.mknod('x', 0o600 | stat.S_IFCHR, os.makedev(1, 3)); open('x', 'wb').write(b'x')",
        "read the disk's device": "import os, glob"
        "; open(glob.glob('/dev/[vs]d[a-z]')[0], 'rb').read(1)",
    },
    "results": {
        "leave a link to a secret as a result": "import os; os.symlink('@FOLDER@/secret.txt',"
        " '../output/scene.blend'); print(open('../output/scene.blend').read())",
        "leave a hard link to a secret": "import os; os.link('@FOLDER@/secret.txt', '../output/x')",
        "replace the results' folder by a link": "import os; os.rmdir('../output')"
        "; os.symlink('@FOLDER@', '../output'); open('../output/new.txt', 'w').close()",
    },
    "environment": {
        "read the caller's variables": "import os; os.environ['ABUSE_SECRET']",
        "read those of the caller's process": "b = open('/proc/@PID@/environ', 'rb').read()"
        "; assert b'ABUSE_SECRET' in b",
        "read its parent's": "import os; b = open(f'/proc/{os.getppid()}/environ', 'rb').read()"
        "; assert b'ABUSE_SECRET' in b",
    },
    "network": {
        "connect to a port of this machine": "import socket"
        "; socket.create_connection(('127.0.0.1', @PORT@), 3)",
        "send a datagram to a port": "import socket; s = socket.socket(2, 2)"
        "; s.connect(('127.0.0.1', @PORT@)); s.send(b'x'); len(socket.if_nameindex()) > 1 or 1 / 0",
        "connect to a socket file": "import socket; socket.socket(1).connect('@SOCKET@')",
        "connect to an abstract socket": "import socket; socket.socket(1).connect('\\0@NAME@')",
        "listen where others can connect": "import socket; s = socket.create_server(('', 0))"
        "; len(socket.if_nameindex()) > 1 or 1 / 0",
    },
    "processes": {
        "see the caller's process": "import os; os.stat('/proc/@PID@/cmdline')"
        "; assert b'sleep' in open('/proc/@PID@/cmdline', 'rb').read()",
        "kill it": "import os; assert b'sleep' in open('/proc/@PID@/cmdline', 'rb').read()"
        "; os.kill(@PID@, 9)",
        "trace it": "import ctypes; assert ctypes.CDLL(None).ptrace(16, @PID@, 0, 0) == 0",
        "change its priority": "import os; os.setpriority(0, @PID@, 19)"
        "; assert b'sleep' in open('/proc/@PID@/cmdline', 'rb').read()",
        "leave a daemon (double fork, setsid)": "import os, time\nif os.fork() == 0:"
        "\n    os.setsid()\n    if os.fork() == 0:\n        time.sleep(600)\n    os._exit(0)\n",
        "ignore every signal and sleep": "import signal, time\nfor n in range(1, 32):\n    try:"
        " signal.signal(n, 1)\n    except OSError: pass\ntime.sleep(600)",
        "stop itself": "import os; os.kill(os.getpid(), 19)",
    },
    "limits": {
        "loop for ever": "while True: pass",
        "take memory": "a = []\nwhile True: a.append(bytearray(1 << 20))",
        "take memory in children": "import os, time\nfor n in range(8):\n    if os.fork() == 0:\n"
        "        a = [os.urandom(64 << 20)]\n        time.sleep(60)\ntime.sleep(60)",
        "fork 200 times": FORK + "time.sleep(60)",
        "fill the folder": "f = open('big', 'wb')\nwhile True: f.write(bytes(1 << 20)); f.flush()",
        "fill /dev/shm": "import os, shutil\ntry:\n    f = open('/dev/shm/legoworld-abuse', 'wb')\n"
        "    for n in range(96): f.write(bytes(1 << 20)); f.flush()\n"
        "    import time; time.sleep(3)\nfinally: os.remove('/dev/shm/legoworld-abuse')",
        "print without end": "while True: print('x' * 1000)",
        "raise its own limits": "import resource as r; n = r.RLIMIT_FSIZE; s, h = r.getrlimit(n)"
        "; r.setrlimit(n, (h + 1, h + 1)) if h > 0 else 1 / 0",
        "die of a segmentation fault": "import ctypes; ctypes.string_at(0)",
    },
}  # fmt: skip


@contextmanager
def targets() -> Iterator[dict[str, str]]:
    """What the code aims at, by placeholder."""
    folder = Path(tempfile.mkdtemp(prefix="legoworld-abuse-"))
    (folder / "secret.txt").write_text("ABUSE_SECRET")
    (folder / "mine.txt").write_text("mine")
    os.environ["ABUSE_SECRET"] = "1"
    sleeper = subprocess.Popen(["sleep", "600"])
    name = f"legoworld-abuse-{os.getpid()}"
    with (
        socket.create_server(("127.0.0.1", 0)) as port,
        socket.socket(socket.AF_UNIX) as plain,
        socket.socket(socket.AF_UNIX) as abstract,
    ):
        plain.bind(str(folder / "socket"))
        abstract.bind("\0" + name)
        for one in (plain, abstract):
            one.listen()
        try:
            yield {
                "FOLDER": str(folder), "PID": str(sleeper.pid), "NAME": name,
                "PORT": str(port.getsockname()[1]), "SOCKET": str(folder / "socket"),
            }  # fmt: skip
        finally:
            sleeper.kill()
            sleeper.wait()
            for left in (folder, Path(f"{folder}-gone")):
                shutil.rmtree(left, ignore_errors=True)


def outcome(code: str, confinement: Confinement) -> str:
    """What became of one snippet."""
    with targets() as aims:
        filled = re.sub(r"@([A-Z]+)@", lambda found: aims[found[1]], code)
        scratch = Path(tempfile.mkdtemp(prefix="legoworld-abuse-scratch-"))
        held = protections(confinement)
        with Sandbox(scratch, LIMITS, held, owner=scratch) as sandbox:
            sandbox.start([sys.executable, "-c", f"{filled}\nprint({DID!r})"], [])
            ending = sandbox.wait()
        left = [pid for pid in descendants(os.getpid()) if str(pid) != aims["PID"]]
        shutil.rmtree(scratch, ignore_errors=True)
    if left:
        return f"**{len(left)} processes left**"
    if ending.over is not None:
        return f"ended: {ending.over}"
    if DID in ending.last_output:
        return DID
    return f"signal {-ending.code}" if (ending.code or 0) < 0 else "refused"


def main() -> int:
    """Print the table, or put it between its marks in a page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", type=Path)
    given = parser.parse_args()
    kinds: tuple[Confinement, ...] = ("bubblewrap", "limits")
    lines = ["| | code that tries to | with bubblewrap | limits alone |", "|---|---|---|---|"]
    for group, snippets in SNIPPETS.items():
        for what, code in snippets.items():
            found = [outcome(code, kind) for kind in kinds]
            shown = ["**went through**" if one == DID else one for one in found]
            if "daemon" in what:  # it ends well, and so do those that it left
                shown = ["ended with it" if one == DID else one for one in found]
            lines.append(f"| {group} | {what} | {' | '.join(shown)} |")
            print(lines[-1], flush=True)
    if given.write:
        page = given.write.read_text(encoding="utf-8")
        begin, end = "<!-- abuse.py -->\n", "\n<!-- abuse.py ends -->"
        head, _, rest = page.partition(begin)
        given.write.write_text(head + begin + "\n".join(lines) + end + rest.partition(end)[2])
    return 0


if __name__ == "__main__":
    sys.exit(main())
