"""What a program reads of the processes around it: the report of what is kept from it is true."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="/proc is Linux's")

#: Tries to read a secret out of every process that it sees.
THIEF = """
import pathlib
def holds(path):
    try:
        return b"hidden-" + b"value" in path.read_bytes()
    except OSError:
        return False
found = [p.parent.name for p in pathlib.Path("/proc").glob("[0-9]*/environ") if holds(p)]
print("stolen" if found else "nothing")
"""
OWNER = """
import json, pathlib, sys
from legoworld.workers.protections import protections
from legoworld.workers.sandbox import Sandbox, SandboxLimits
scratch, held = pathlib.Path(sys.argv[1]), protections(sys.argv[2])
limits = SandboxLimits(time_s=300.0, memory_bytes=1 << 30)
with Sandbox(scratch, limits, held, owner=scratch) as sandbox:
    sandbox.start([sys.executable, "-c", sys.argv[3]], [])
    print(json.dumps([sandbox.wait().last_output.strip(), held.holds, held.does_not_hold]))
"""


def test_the_environment_is_said_to_be_kept_only_where_no_program_can_read_it(
    confinement, tmp_path
):
    words = [sys.executable, "-c", OWNER, str(tmp_path), confinement, THIEF]
    environment = {**os.environ, "API_TOKEN": "hidden-value"}
    done = subprocess.run(words, env=environment, capture_output=True, check=True)
    said, holds, does_not_hold = json.loads(done.stdout)
    assert ("environment" in holds) is (confinement == "bubblewrap")
    assert ("environment" in does_not_hold) is (confinement == "limits")
    if "environment" in holds:
        assert said == "nothing"


#: Of a user without privileges, whose child reads the environment of its parent.
HIDDEN = """
import ctypes, os, subprocess, sys
from legoworld.workers.process_privacy import hide_process
if os.getuid() == 0:
    os.setgroups([])
    os.setgid(65534)
    os.setuid(65534)
    ctypes.CDLL(None).prctl(4, 1, 0, 0, 0)  # as if it had been that user's from the beginning
def stolen():
    for name in ("environ", "maps", "fd"):
        reader = "ls" if name == "fd" else "cat"
        yield subprocess.run([reader, f"/proc/{os.getpid()}/{name}"], capture_output=True).stdout
print([bool(text) for text in stolen()])
hide_process()
print([bool(text) for text in stolen()])
"""


def test_a_hidden_process_is_closed_to_its_user_s_programs():
    words = [sys.executable, "-c", textwrap.dedent(HIDDEN)]
    done = subprocess.run(words, capture_output=True, text=True, check=True, cwd=Path("/"))
    assert done.stdout.splitlines() == ["[True, True, True]", "[False, False, False]"]
