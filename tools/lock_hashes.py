"""Write the hashes of what a lock names: constraints/NAME.txt to constraints/NAME.hashes.txt.

    python tools/lock_hashes.py constraints/python-3.11.txt

The sha256 of every file of a version that PyPI offers for the lock's Python; then
`pip install --no-deps --require-hashes -r FILE` takes nothing else. A version without a usable file
ends this with an error that names it. What `make demo` and `make test` install comes first; what
only checks and clusters need follows the line REST.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
import tomllib
import urllib.request
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from pip._internal.models.index import PyPI

#: The package index that pip takes (PEP 503), whose links end in a hash.
_INDEX = os.environ.get("PIP_INDEX_URL") or PyPI.simple_url
_LINK = re.compile(r"/([^/\"#]+)#sha256=([0-9a-f]{64})")
REST = "# What checks and clusters need besides."


def hashed_lock(lock: str, python: str, first: set[str]) -> str:
    """A requirements file with hashes of a lock's text.

    python: such as "3.11"; first: the names of packages that come before REST, normalised.
    """
    head, *lines = lock.splitlines()
    pins = [line.split("==") for line in lines if line and not line.startswith("#")]
    tag = "cp" + python.replace(".", "")
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(lambda pin: _sha256s(*pin, tag), pins))
    before, after = [], []
    for (name, version), hashes in zip(pins, found, strict=True):
        entry = " \\\n".join([f"{name}=={version}", *(f"    --hash=sha256:{h}" for h in hashes)])
        (before if not first or _normalise(name) in first else after).append(entry)
    rest = [REST, *after] if after else []
    return "\n".join([head.partition(" Versions")[0], *before, *rest, ""])


def names_of_tests(lock: Path, python: str) -> set[str]:
    """The packages that examples and tests need with this Python, as pip resolves them."""
    project = tomllib.loads(Path("pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    needed = [*project["dependencies"], *extras["examples"], *extras["test"]]
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        pip = [sys.executable, "-m", "pip", "install", "--quiet", "--dry-run", "--ignore-installed"]
        pip += ["--only-binary", ":all:", "--python-version", python, "--target", folder]
        # pip holds markers and Requires-Python against the Python that runs it.
        pip += ["--ignore-requires-python"]
        needed = [n.partition(";")[0] for n in needed if ";" not in n or f"'{python}'" in n]
        subprocess.run([*pip, "--report", report, "-c", lock, *needed], check=True)
        installed = json.loads(report.read_text(encoding="utf-8"))["install"]
    return {_normalise(item["metadata"]["name"]) for item in installed} | {"lvis"}


def _normalise(name: str) -> str:
    """A project's name as an index has it (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()


def _sha256s(name: str, version: str, tag: str) -> list[str]:
    listed = _LINK.findall(_read(f"{_INDEX.rstrip('/')}/{_normalise(name)}/"))
    files = {file: sha256 for file, sha256 in listed if _version_of(file) == version}
    usable = sorted({sha256 for file, sha256 in files.items() if _is_for(file, tag)})
    if not usable:
        sys.exit(f"{name}=={version} has no file for {tag}; found: {', '.join(files) or 'none'}")
    return usable


def _version_of(file: str) -> str:
    """The version that a distribution's file name holds (PEP 427, PEP 625)."""
    if file.endswith(".whl"):
        return file.split("-")[1]
    return re.sub(r"\.(tar\.gz|tar\.bz2|zip)$", "", file).rpartition("-")[2]


def _is_for(file: str, tag: str) -> bool:
    """Whether a file is a source distribution, or a wheel that this Python can take."""
    if not file.endswith(".whl"):
        return file.endswith((".tar.gz", ".zip"))
    python, abi, _ = file.removesuffix(".whl").split("-")[-3:]
    tags = python.split(".")
    return tag in tags or abi == "abi3" or any(t.startswith("py") for t in tags)


def _read(url: str) -> str:
    with urllib.request.urlopen(url, timeout=60) as answer:
        return answer.read().decode()


def main() -> None:
    """Write the hashes of each lock that is named."""
    for path in map(Path, sys.argv[1:]):
        found = re.search(r"python-(3\.\d+)", path.name)
        first = names_of_tests(path, found[1]) if found else set()
        lock = path.read_text(encoding="utf-8")
        text = hashed_lock(lock, found[1] if found else "3.11", first)
        path.with_suffix(".hashes.txt").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
