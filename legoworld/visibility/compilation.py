"""Compiles a folder's C++: which sources, which compiler, which flags. Standard library only.

setup.py loads this file by its path, so it must not import anything of the package.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

LIBRARY_NAME = {"darwin": "_kernel.dylib", "win32": "_kernel.dll"}.get(sys.platform, "_kernel.so")

#: Headers that more than one library includes.
SHARED = Path(__file__).resolve().parent / "shared"

# Contraction off: shared edges are watertight only while a*b - c*d negates exactly.
FLAGS = ("-std=c++17", "-O3", "-ffp-contract=off", "-fvisibility=hidden", "-shared", "-Wno-psabi")

NO_COMPILER = (
    "legoworld needs a C++17 compiler and none was found: looked for $CXX, c++, g++, "
    "clang++ and the ziglang package. Install a system compiler (Debian: apt install g++; macOS: "
    "xcode-select --install) or `pip install ziglang`, then install again"
)


class CompilationError(Exception):
    """No compiler was found, or compilation failed. The message has the next step."""


def sources(folder: Path) -> list[Path]:
    """The C++ files of a folder, sorted by name; empty where only the library was installed."""
    return sorted([*folder.glob("*.cpp"), *folder.glob("*.hpp")], key=lambda path: path.name)


def source_hash(folder: Path) -> str:
    """sha256, in hex, over the flags and over names and contents of shared and own C++ files."""
    digest = hashlib.sha256(" ".join(FLAGS).encode())
    for path in [*sources(SHARED), *sources(folder)]:
        content = path.read_bytes().replace(b"\r\n", b"\n")
        digest.update(f"\n{path.name} {len(content)}\n".encode())
        digest.update(content)
    return digest.hexdigest()


def compiler() -> list[str]:
    """The command that compiles C++. Raises CompilationError where there is none."""
    chosen = os.environ.get("CXX", "").strip()
    if chosen:
        command = shlex.split(chosen)
        if shutil.which(command[0]) is None:
            raise CompilationError(f"$CXX is {chosen!r}, which is not a command here")
        return command
    for name in ("c++", "g++", "clang++"):
        path = shutil.which(name)
        if path is not None:
            return [path]
    if importlib.util.find_spec("ziglang") is not None:
        return [sys.executable, "-m", "ziglang", "c++"]
    raise CompilationError(NO_COMPILER)


def compile_kernel(folder: Path, output: Path) -> list[str]:
    """Compiles the .cpp files of `folder` into `output`; returns the command that was run.

    The library is written to a temporary file and moved, so a failed build, CompilationError,
    leaves nothing behind.
    """
    command = [*compiler(), *FLAGS, f'-DLEGOWORLD_SOURCE_HASH="{source_hash(folder)}"']
    command += ["-I", str(SHARED)]
    if sys.platform != "win32":
        command += ["-fPIC", "-pthread"]
    unfinished = output.with_name(f"{output.stem}.{os.getpid()}.unfinished{output.suffix}")
    command += [str(path) for path in sources(folder) if path.suffix == ".cpp"]
    command += ["-o", str(unfinished)]
    output.parent.mkdir(parents=True, exist_ok=True)
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise CompilationError(
                f"the C++ in {folder.name} could not be compiled by {shlex.join(command)}\n"
                f"{done.stderr.strip()}"
            )
        unfinished.replace(output)
    finally:
        unfinished.unlink(missing_ok=True)
    return command
