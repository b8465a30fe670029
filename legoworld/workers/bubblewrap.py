"""Bubblewrap: a program sees only its workspace, Python and Blender, and by default no network.

https://github.com/containers/bubblewrap; `apt-get install bubblewrap`.
"""

from __future__ import annotations

import functools
import importlib.util
import shutil
import site
import subprocess
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from legoworld.errors import cause, one_line
from legoworld.files import home_folder

#: Paths of the scratch folder inside the sandbox; the default TMPDIR is in the scratch folder, too.
INSIDE: Final = Path("/sandbox")
TEMPORARY_INSIDE: Final = Path("/tmp")
#: Shared memory is files of the scratch folder as well: bubblewrap's own /dev/shm has no limit but
#: half of the machine's memory.
_SHARED_MEMORY_INSIDE: Final = Path("/dev/shm")

#: The system's programs and libraries, and the files that locate them.
_SYSTEM: Final = (
    "/usr", "/bin", "/sbin", "/lib", "/lib32", "/lib64", "/libx32", "/nix/store",
    "/etc/alternatives", "/etc/fonts", "/etc/ld.so.cache", "/etc/ld.so.conf", "/etc/ld.so.conf.d",
    "/etc/localtime",
)  # fmt: skip
#: What names of hosts and certificates are looked up in, shown where a network is.
_NETWORK: Final = (
    "/etc/ca-certificates", "/etc/hosts", "/etc/nsswitch.conf", "/etc/pki", "/etc/resolv.conf",
    "/etc/ssl",
)  # fmt: skip
#: What drivers and their libraries look up about GPUs and processors.
_ABOUT_DEVICES: Final = (
    "/proc/driver/nvidia", "/sys/bus", "/sys/class", "/sys/dev", "/sys/devices", "/sys/module",
)  # fmt: skip
_NOT_INSTALLED: Final = "bubblewrap is not installed"
_PROBE_WITHIN_S: Final = 20.0
_PACKAGE: Final = Path(__file__).parents[1]
_EXIT_REPORTER: Final = Path(__file__).with_name("exit_reporter.py")


@dataclass(frozen=True, kw_only=True)
class Bubblewrap:
    """A working bubblewrap. program: its path; version: as printed by it."""

    program: str
    version: str


@functools.cache
def find_bubblewrap() -> Bubblewrap | str:
    """The installed bubblewrap after a trial run, or the reason why it cannot be used."""
    program = shutil.which("bwrap")
    if program is None:
        return _NOT_INSTALLED
    try:
        version = _output([program, "--version"]).split()[-1]
        _output(
            [
                program,
                *_namespaces(),
                *_expose_paths([]),
                "--",
                sys.executable,
                "-I",
                "-S",
                "-c",
                "",
            ]
        )
    except (OSError, subprocess.SubprocessError, IndexError) as error:
        words = getattr(error, "stderr", None) or cause(error)
        return one_line(f"bubblewrap cannot make namespaces here: {words}", 200)
    return Bubblewrap(program=program, version=version)


def how_to_have(why_not: str) -> str:
    """Next step for a reason given by `find_bubblewrap`."""
    if why_not == _NOT_INSTALLED:
        return "apt-get install bubblewrap"
    return "allow user namespaces on this machine, or in its container; docs/sandbox.md"


def confine(
    bubblewrap: Bubblewrap,
    argv: Sequence[str],
    *,
    scratch: Path,
    read_only: Sequence[Path],
    workspace: Path | None = None,
    network: bool = False,
    writable: Sequence[Path] = (),
    accelerators: bool = False,
) -> list[str]:
    """The command that runs `argv` confined.

    scratch: a folder it can write to, seen as INSIDE; its `temporary` is TEMPORARY_INSIDE and its
    `shared` /dev/shm. workspace: the other one, seen under its own name, where it starts; without
    one it starts in an empty folder. read_only: files and folders it can read besides Python,
    Blender and the system's libraries. network: shared with the machine. writable: further folders
    it can write to, under their own names. accelerators: it has the machine's GPUs. How `argv` ends
    is said on descriptor 3 (exit_reporter.py).
    """
    devices = _existing(_accelerators()) if accelerators else []
    about_devices = _existing(_ABOUT_DEVICES) if accelerators else []
    return [
        bubblewrap.program,
        *_namespaces(),
        *(["--share-net"] if network else []),
        "--bind", str(scratch), str(INSIDE),
        "--bind", str(scratch / "temporary"), str(TEMPORARY_INSIDE),
        "--bind", str(scratch / "shared"), str(_SHARED_MEMORY_INSIDE),
        *_expose_paths([*read_only, *about_devices, *(_existing(_NETWORK) if network else ())]),
        *(word for path in devices for word in ("--dev-bind", str(path), str(path))),
        *(word for path in writable for word in ("--bind", str(path), str(path))),
        *(["--bind", str(workspace), str(workspace)] if workspace else []),
        "--remount-ro", "/",
        "--remount-ro", "/dev",
        "--chdir", str(workspace or INSIDE / "empty"),
        "--", sys.executable, "-I", "-S", str(_EXIT_REPORTER), *argv,
    ]  # fmt: skip


def _namespaces() -> list[str]:
    """Options that unshare network, processes and message queues, and die with the parent."""
    return [
        "--unshare-all", "--die-with-parent", "--new-session", "--cap-drop", "ALL",
        "--proc", "/proc", "--dev", "/dev",
    ]  # fmt: skip


def _accelerators() -> list[str]:
    """The devices of NVIDIA's, AMD's and Intel's GPUs, and of those that Windows lends."""
    return [*map(str, Path("/dev").glob("nvidia*")), "/dev/dri", "/dev/kfd", "/dev/dxg"]


def _existing(names: Sequence[str]) -> list[Path]:
    return [path for name in names if (path := Path(name)).exists()]


def always_shown() -> list[Path]:
    """Paths visible to every program: the system, this Python, this package, bpy."""
    return [*_existing(_SYSTEM), *_python()]


def _expose_paths(read_only: Sequence[Path]) -> list[str]:
    """Options that expose folders and files under their own names, without their neighbours."""
    options: list[str] = []
    for name in _SYSTEM:
        path = Path(name)
        if path.is_symlink() and path.parent == Path("/"):
            options += ["--symlink", str(path.readlink()), name]
        elif path.exists():
            options += ["--ro-bind", name, name]
    shown = [Path(name) for name in _SYSTEM]
    for path in sorted({*_python(), *read_only}, key=lambda p: len(p.parts)):
        if not any(path.is_relative_to(other) for other in shown):
            # A program that is bound under its link's name does not find what lies beside it.
            link = path.is_symlink()
            options += ["--symlink" if link else "--ro-bind", str(path.resolve() if link else path)]
            options.append(str(path))
            shown.append(path)
    return options


@functools.cache
def _python() -> tuple[Path, ...]:
    """The files of this Python, with this package, bpy and NumPy."""
    folders = {Path(sys.prefix), Path(sys.base_prefix), Path(sys.base_exec_prefix), _PACKAGE}
    if site.ENABLE_USER_SITE:
        folders.add(Path(site.getusersitepackages()))
    for name in ("bpy", "numpy"):
        spec = importlib.util.find_spec(name)
        if spec is not None and spec.origin is not None:
            folders.add(Path(spec.origin).parents[1])
    return exposable_paths({*folders, *follow_links(Path(sys.executable))})


def follow_links(python: Path) -> Iterator[Path]:
    """Targets of a virtual environment's python, link by link."""
    while python.is_symlink():
        python = python.parent / python.readlink()
        yield python


def exposable_paths(paths: Iterable[Path]) -> tuple[Path, ...]:
    """The existing paths, except the home and root folders themselves."""
    too_much = {Path("/"), home_folder(), *home_folder().parents}
    return tuple(path for path in paths if path.exists() and path not in too_much)


def _output(command: list[str]) -> str:
    done = subprocess.run(
        command, capture_output=True, text=True, check=True, timeout=_PROBE_WITHIN_S, env={}
    )
    return done.stdout
