"""A trajectory held to Harbor's own validator, which needs Python 3.12: `make test-harbor`."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

PYTHON = "LEGOWORLD_HARBOR_PYTHON"


def harbor_python() -> str:
    """A Python that has Harbor, or skip."""
    python = os.environ.get(PYTHON)
    if not python:
        pytest.skip(f"{PYTHON} names no Python with Harbor: `make test-harbor` makes one")
    return python


def refusal_of_harbor(trajectory: Path) -> str:
    """What Harbor's validator says against a trajectory.json; "" where it is valid."""
    command = [harbor_python(), "-m", "harbor.utils.trajectory_validator", str(trajectory)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return "" if done.returncode == 0 else done.stdout + done.stderr
