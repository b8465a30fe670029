"""Run by a Python that has verifiers and Harbor: what verifiers reads of task folders, as JSON.

python verifiers_check.py TASKS
"""

from __future__ import annotations

import json
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

from verifiers.v1.tasksets.harbor.taskset import (  # pyright: ignore[reportMissingImports]
    HarborConfig,
    parse_task,
    resolve_image,
)


def read(folder: Path) -> dict[str, Any]:
    """One task as verifiers has it; whatever it refuses is raised."""
    task = parse_task(folder, 0, HarborConfig())
    image = resolve_image(folder, task.image, require_image=True)
    return {
        "image": image,
        "verifier_image": task.verifier_image,
        "separate": task.verifier is not None,
        "upload_environment": task.upload_environment,
        "workdir": task.workdir,
        "prompt": task.prompt,
        "mcp": [server["name"] for server in task.mcp_servers],
        "artifacts": [one.source for one in task.artifacts],
    }


tasks = sorted(Path(sys.argv[1]).iterdir())
print(
    "\n"
    + json.dumps({"verifiers": version("verifiers"), "tasks": {t.name: read(t) for t in tasks}})
)
