"""Run by a Python that has Harbor: what Harbor makes of task folders and of a reward, as JSON.

python harbor_check.py TASKS REWARD.json
"""

from __future__ import annotations

import json
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

from harbor.models.task.task import Task  # pyright: ignore[reportMissingImports]
from harbor.models.task.verifier_mode import (  # pyright: ignore[reportMissingImports]
    resolve_task_verifier_mode,
    resolve_verifier_environment_definition,
)
from harbor.models.verifier.result import (  # pyright: ignore[reportMissingImports]
    VerifierResult,
)


def read(folder: Path) -> dict[str, Any]:
    """One task as Harbor's own models have it; whatever they refuse is raised."""
    task = Task(folder)
    definition = resolve_verifier_environment_definition(task.config, task.paths)
    assert definition is not None
    return {
        "valid": Task.is_valid_dir(folder),
        "name": task.name,
        "instruction": task.instruction,
        "schema_version": task.config.schema_version,
        "verifier": resolve_task_verifier_mode(task.config).value,
        "verifier_folder": definition.directory.name,
        "bundled_tests": definition.bundled_tests,
        "artifacts": [getattr(a, "source", a) for a in task.config.artifacts],
        "cpus": task.config.environment.cpus,
        "memory_mb": task.config.environment.memory_mb,
        "agent_timeout_s": task.config.agent.timeout_sec,
        "verifier_timeout_s": task.config.verifier.timeout_sec,
    }


def main() -> None:
    tasks, reward = Path(sys.argv[1]), Path(sys.argv[2])
    rewards = json.loads(reward.read_text(encoding="utf-8"))
    found = {
        "harbor": version("harbor"),
        "tasks": {folder.name: read(folder) for folder in sorted(tasks.iterdir())},
        "rewards": VerifierResult(rewards=rewards).rewards,
    }
    print(json.dumps(found))


if __name__ == "__main__":
    main()
