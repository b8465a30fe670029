"""Copy the tests and what they read, but not legoworld/: they can only run what is installed.

python tests/packaging/copy_suite.py FOLDER
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
#: legoworld/ must not be importable from the copy; the rest is made by builds and by tests.
LEFT_OUT = {"legoworld", "build", "dist", "node_modules", "__pycache__", "legoworld.egg-info"}


def left_out(folder: str, names: list[str]) -> set[str]:
    """What shutil.copytree ignores: at the top and below, what is built, and hidden folders."""
    hidden = {n for n in names if n.startswith(".") and (Path(folder) / n).is_dir()}
    return (LEFT_OUT & set(names)) | hidden | {n for n in names if n.endswith((".pyc", ".so"))}


def copy_suite(target: Path) -> None:
    """Replace a folder by a copy of the checkout without the package; tools of npm are linked."""
    shutil.rmtree(target, ignore_errors=True)
    shutil.copytree(ROOT, target, ignore=left_out)
    modules = Path("tools", "page", "node_modules")
    if (ROOT / modules).is_dir():
        (target / modules).symlink_to(ROOT / modules)


if __name__ == "__main__":
    copy_suite(Path(sys.argv[1]).absolute())
