"""What the package asks for is what its other files say it asks for."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib

from checkout import CHECKOUT

from legoworld.commands.doctor_command import BPY_OF_PYTHON
from legoworld.system_libraries import NEEDED

ROOT = CHECKOUT
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_doctor_knows_the_bpy_of_every_supported_python():
    pinned = dict(
        re.fullmatch(r"bpy==([\d.]+); python_version == '([\d.]+)'", line).groups()[::-1]
        for line in PROJECT["dependencies"]
        if line.startswith("bpy")
    )
    assert pinned == {f"{a}.{b}": bpy for (a, b), bpy in BPY_OF_PYTHON.items()}


def test_a_python_without_a_bpy_is_refused_by_pip():
    allowed = PROJECT["requires-python"]
    assert allowed == ">=3.11,<3.14,!=3.12.*"
    assert sys.version_info[:2] in BPY_OF_PYTHON


def test_the_image_installs_every_library_that_bpy_links():
    listed = subprocess.run(
        [sys.executable, ROOT / "legoworld" / "system_libraries.py", "--packages"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split()
    assert listed == list(NEEDED.values())
    assert "system_libraries.py --packages" in (ROOT / "Dockerfile").read_text(encoding="utf-8")
