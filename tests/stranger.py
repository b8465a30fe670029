"""A page run as a stranger does: its marked blocks in order, in an empty folder, as one process.

`<!-- run -->` before a block runs it: `sh` by bash, `python` in one namespace;
`<!-- save: NAME -->` saves it as a file. The indented block that follows a shell block is what it
prints.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

_BLOCK = re.compile(
    r"^<!-- (run|save: [\w.]+) -->\n```(\w+)\n(.*?)^```$(?:\n\n((?: {4}[^\n]*\n|\n(?= {4}))+))?",
    re.MULTILINE | re.DOTALL,
)
_FENCE = re.compile(r"^```(?:sh|python|diff)$", re.MULTILINE)

_PROGRAM = """
import json, subprocess, sys
names = {"__name__": "__main__"}
printed = []
for number, (what, language, text) in enumerate(json.load(sys.stdin)):
    if what != "run":
        open(what.removeprefix("save: "), "w").write(text)
    elif language == "sh":
        done = subprocess.run(["bash", "-euo", "pipefail", "-c", text], stdin=subprocess.DEVNULL,
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        sys.stderr.write(done.stdout)
        printed.append((number, done.stdout))
        if done.returncode:
            sys.exit(f"exit code {done.returncode}: {text}")
    else:
        exec(compile(text, f"block {number}", "exec"), names)
json.dump(printed, open("printed.json", "w"))
"""


def blocks(page: Path) -> list[tuple[str, str, str, str]]:
    """The marked blocks: what to do, language, text, and the lines it prints if they are given."""
    return _BLOCK.findall(page.read_text(encoding="utf-8"))


def count_unmarked(page: Path) -> int:
    """How many blocks of code are neither run nor saved."""
    return len(_FENCE.findall(page.read_text(encoding="utf-8"))) - len(blocks(page))


def run_page(page: Path, folder: Path) -> str:
    """Run a page in a new folder, with nothing of the caller's environment but the installation.

    Fails where a block fails, and where it does not print a line that the page shows; a line of
    "..." stands for any, and a size in MB is any size. Returns what was printed.
    """
    found = blocks(page)
    home = folder.with_name(f"{folder.name}-home")
    for new in (folder, home):
        new.mkdir()
    kept = {name: os.environ[name] for name in ("PYTHONPATH", "LANG") if name in os.environ}
    programs = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    done = subprocess.run(
        [sys.executable, "-c", _PROGRAM],
        input=json.dumps([block[:3] for block in found]),
        capture_output=True, text=True, check=False, cwd=folder,
        env={**kept, "HOME": str(home), "PATH": programs},
    )  # fmt: skip
    assert done.returncode == 0, f"{page.name}: {done.stdout[-2000:]}\n{done.stderr[-4000:]}"
    for number, text in json.loads((folder / "printed.json").read_text(encoding="utf-8")):
        shown, lines = (
            [re.sub(r"[\d.]+ MB", "MB", line.strip()) for line in printed.splitlines()]
            for printed in (found[number][3], text)
        )
        lacking = [line for line in shown if line not in ("", "...") and line not in lines]
        assert lacking == [], f"{page.name} shows {lacking} where this is printed:\n{text}"
    return done.stdout + done.stderr
