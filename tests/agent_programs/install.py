"""Install the four agents from npm, as people do (`npm install -g`), in a folder of their own.

    python tests/agent_programs/install.py FOLDER [--newest]

The versions are those of package.json beside this file. Each program is then FOLDER/bin/NAME.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path


def main() -> int:
    """Install what is not there in its version."""
    folder, newest = Path(sys.argv[1]), "--newest" in sys.argv[2:]
    pinned = json.loads(Path(__file__).with_name("package.json").read_text())["dependencies"]
    wanted = []
    for name, version in pinned.items():
        there = folder / "lib" / "node_modules" / name / "package.json"
        if newest:
            wanted.append(f"{name}@latest")
        elif not there.is_file() or json.loads(there.read_text())["version"] != version:
            wanted.append(f"{name}@{version}")
    if not wanted:
        return 0
    quiet = ["--silent", "--no-audit", "--no-fund"]
    command = ["npm", "install", "-g", *quiet, "--prefix", str(folder), *wanted]
    return subprocess.run(command, check=False).returncode


if __name__ == "__main__":
    raise SystemExit(main())
