"""The shared libraries that bpy links but its wheel does not include; a bare server lacks them.

Also a standalone program, for checking before anything is installed:
`python legoworld/system_libraries.py` prints what is missing and how to install it; with
`--packages` it prints the Debian packages that contain all of them.
"""

from __future__ import annotations

import ctypes
import sys

#: Library file and the Debian or Ubuntu package that contains it.
NEEDED = {
    "libX11.so.6": "libx11-6",
    "libXrender.so.1": "libxrender1",
    "libXfixes.so.3": "libxfixes3",
    "libXi.so.6": "libxi6",
    "libxkbcommon.so.0": "libxkbcommon0",
    "libXext.so.6": "libxext6",
    "libSM.so.6": "libsm6",
    "libICE.so.6": "libice6",
    "libGL.so.1": "libgl1",
}


def missing_libraries() -> list[str]:
    """Files of `NEEDED` that this system cannot load; always empty on systems other than Linux."""
    if sys.platform != "linux":
        return []
    missing = []
    for name in NEEDED:
        try:
            ctypes.CDLL(name)
        except OSError:
            missing.append(name)
    return missing


def install_line(missing: list[str]) -> str:
    """The command that installs the missing packages on Debian and Ubuntu."""
    return "sudo apt-get install -y " + " ".join(NEEDED[name] for name in missing)


def main() -> int:
    """Print what is missing; exit code 1 when something is."""
    if sys.argv[1:] == ["--packages"]:
        print(*NEEDED.values())
        return 0
    missing = missing_libraries()
    if missing:
        print(
            f"Blender's Python module needs {', '.join(missing)}, which this system lacks. "
            f"Install with:\n    {install_line(missing)}",
            file=sys.stderr,
        )
    return 1 if missing else 0


if __name__ == "__main__":
    sys.exit(main())
