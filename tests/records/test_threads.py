"""Record types are first used by several threads at once: by pools of readers and servers."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import legoworld

PACKAGE = Path(legoworld.__file__).parent

#: Types with many fields inside each other: the tables of a small one are full before it is seen.
PROGRAM = """
import faulthandler, json, sys, threading
import msgspec
from legoworld.records import base

faulthandler.enable()
sys.setswitchinterval(1e-6)
kinds = []
for k in range(60):
    inner = msgspec.defstruct(f"Inner{k}", [(f"f{i}", int) for i in range(30)])
    fields = [(f"g{i}", dict[str, list[inner]]) for i in range(20)]
    kinds.append(msgspec.defstruct(f"Outer{k}", fields))
value = {f"g{i}": {"a": [{f"f{j}": j for j in range(30)}]} for i in range(20)}
text = json.dumps(value)
barrier = threading.Barrier(4)

def use(number):
    for kind in kinds:
        barrier.wait()
        base.decode(kind, text) if number % 2 else base.to_record(kind, value)

threads = [threading.Thread(target=use, args=(n,)) for n in range(4)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
print("alive")
"""


@pytest.mark.parametrize("attempt", range(6))
def test_types_that_threads_use_first_at_the_same_time_are_whole(attempt):
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert done.stdout.startswith("alive")


def test_only_the_base_of_records_has_msgspec_use_a_type():
    """`convert` or a typed decoder elsewhere would use a type before its tables are full."""
    users = {
        path.relative_to(PACKAGE).as_posix()
        for path in PACKAGE.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if (isinstance(node, ast.Attribute) and node.attr in ("convert", "Decoder", "decode_lines")
        and "msgspec" in ast.unparse(node.value))
        or (isinstance(node, ast.Call) and ast.unparse(node.func) == "msgspec.json.decode"
        and node.keywords)
    }  # fmt: skip
    assert users == {"records/base.py"}
