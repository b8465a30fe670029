"""Write the hashes of what a lock names: constraints/NAME.txt to constraints/NAME.hashes.txt.

    python tools/lock_hashes.py constraints/python-3.11.txt

The sha256 of every file of a version that PyPI offers for the lock's Python; then
`pip install --no-deps --require-hashes -r FILE` takes nothing else. A version without a usable file
ends this with an error that names it.
"""

from __future__ import annotations

import os
import re
import sys
import urllib.request
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from pip._internal.models.index import PyPI

#: The package index that pip takes (PEP 503), whose links end in a hash.
_INDEX = os.environ.get("PIP_INDEX_URL") or PyPI.simple_url
_LINK = re.compile(r"/([^/\"#]+)#sha256=([0-9a-f]{64})")


def hashed_lock(lock: str, tag: str) -> str:
    """A requirements file with hashes of a lock's text. tag: the Python's, such as "cp311"."""
    head, *lines = lock.splitlines()
    pins = [line.split("==") for line in lines if line and not line.startswith("#")]
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(lambda pin: _sha256s(*pin, tag), pins))
    entries = [
        " \\\n".join([f"{name}=={version}", *(f"    --hash=sha256:{h}" for h in hashes)])
        for (name, version), hashes in zip(pins, found, strict=True)
    ]
    return "\n".join([head.partition(" Versions")[0], *entries, ""])


def _sha256s(name: str, version: str, tag: str) -> list[str]:
    project = re.sub(r"[-_.]+", "-", name).lower()  # PEP 503
    listed = _LINK.findall(_read(f"{_INDEX.rstrip('/')}/{project}/"))
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
        version = re.search(r"python-3\.(\d+)", path.name)
        text = hashed_lock(path.read_text(encoding="utf-8"), f"cp3{version[1] if version else 11}")
        path.with_suffix(".hashes.txt").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
