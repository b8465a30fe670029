"""The Python of a baseline: one given by the user, or an environment created for it."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

from legoworld import exit_codes
from legoworld.baselines.cards import PROJECT, BaselineCard
from legoworld.errors import LegoWorldError, UsageError, one_line
from legoworld.files import canonical_json, home_folder, sha256_of_text, write_text
from legoworld.records.base import decode

_STAMP: Final = "legoworld-requirements"
_PIN: Final = re.compile(r"(?P<name>[A-Za-z0-9._-]+)(\[[^]]*])?\s*(==\s*(?P<version>[^;,\s]+))?")
#: The packages served by an index of torch builds.
_TORCH_PACKAGES: Final = ("torch", "torchvision", "torchaudio")
#: Run by a baseline's Python: prints the installed versions of distributions.
_VERSIONS: Final = """
import importlib.metadata as m, json, sys
found = {}
for name in json.loads(sys.argv[1]):
    try: found[name] = m.version(name)
    except m.PackageNotFoundError: found[name] = None
print(json.dumps(found))
"""


class IsolatedProject(Protocol):
    """What an environment is made for: a baseline, or the server that agents reach Blender by."""

    @property
    def name(self) -> str:
        """Its environment's folder."""
        ...

    @property
    def shelf(self) -> str:
        """What that folder is in."""
        ...

    @property
    def folder(self) -> Path:
        """Where its pyproject.toml is."""
        ...


class EnvironmentFailedError(LegoWorldError):
    """A baseline's environment could not be created or queried."""

    code = "baseline_environment"
    exit_code = exit_codes.BLOCKED


@dataclass(frozen=True, kw_only=True)
class Requirements:
    """The requirements in a baseline's pyproject.toml.

    dependencies: installed with their dependencies; no_deps: installed without them
    ([tool.legoworld] no-deps), for packages whose own pins cannot be satisfied.
    """

    dependencies: tuple[str, ...]
    no_deps: tuple[str, ...]

    @property
    def sha256(self) -> str:
        """Hash that tells whether an environment is current."""
        return sha256_of_text(canonical_json([self.dependencies, self.no_deps]))


def requirements(card: IsolatedProject) -> Requirements:
    """The requirements of a baseline; none where it has no pyproject.toml."""
    path = card.folder / PROJECT
    if not path.is_file():
        return Requirements(dependencies=(), no_deps=())
    values = tomllib.loads(path.read_text(encoding="utf-8"))
    own = values.get("tool", {}).get("legoworld", {})
    return Requirements(
        dependencies=tuple(values.get("project", {}).get("dependencies", ())),
        no_deps=tuple(own.get("no-deps", ())),
    )


def environment_folder(card: IsolatedProject) -> Path:
    """The folder of the environment that an `install` command creates."""
    from platformdirs import user_data_path

    try:
        folder = Path(user_data_path("legoworld"))
    except RuntimeError:  # no home is known
        folder = home_folder() / ".local" / "share" / "legoworld"
    return folder / card.shelf / card.name


def installed_python(card: IsolatedProject) -> Path | None:
    """The Python of a project's environment; None without one, or if it is incomplete."""
    folder = environment_folder(card)
    return _python_in(folder) if (folder / _STAMP).is_file() else None


def chosen_python(card: BaselineCard, given: Path | None) -> Path:
    """The Python to run a baseline with. UsageError if there is none."""
    python = given or installed_python(card)
    if python is None:
        raise UsageError(
            f"the baseline {card.name} has no environment yet",
            found=f"nothing in {environment_folder(card)}",
            expected="an environment with its own requirements",
            next_step=f"`legoworld baseline install {card.name}`, or pass one with --python",
        )
    return python


def problems(card: IsolatedProject, python: Path) -> list[str]:
    """What a Python lacks of a baseline's requirements; empty when it is ready.

    Versions are compared if the requirement pins one with ==.
    """
    needed = requirements(card)
    pins = [m for text in (*needed.dependencies, *needed.no_deps) if (m := _PIN.match(text))]
    versions = _ask(python, [pin["name"] for pin in pins])
    lacking = []
    for pin in pins:
        version, wanted = versions[pin["name"]], pin["version"]
        if version is None:
            lacking.append(f"{pin['name']} is not installed")
        elif wanted and version.partition("+")[0] != wanted.partition("+")[0]:
            lacking.append(f"{pin['name']} is {version}, not {wanted}")
    if python == installed_python(card) and _stamp(card) != needed.sha256:
        lacking.append("installed for other requirements")
    return lacking


def install(
    card: IsolatedProject,
    notice: Callable[[str], None],
    *,
    torch_index: str | None = None,
    extra: Sequence[str] = (),
) -> Path:
    """Create the baseline's environment anew, with uv if available, and return its Python.

    torch_index: URL of the package index for torch and torchvision, such as one with CPU-only
    wheels; everything else comes from the default index. extra: additional packages.
    """
    folder, needed = environment_folder(card), requirements(card)
    uv = shutil.which("uv")
    notice(f"making {folder} with {'uv' if uv else 'venv and pip'}")
    if folder.exists():
        shutil.rmtree(folder)
    folder.parent.mkdir(parents=True, exist_ok=True)
    if uv:
        _run([uv, "venv", "--quiet", "--python", sys.executable, str(folder)])
        # pip compiles what it installs, uv only when told; a baseline's process never writes
        # bytecode, so without it every start compiles torch and transformers anew.
        pip = [uv, "pip", "install", "--quiet", "--compile-bytecode"]
        pip += ["--python", str(_python_in(folder))]
    else:
        _run([sys.executable, "-m", "venv", str(folder)])
        pip = [str(_python_in(folder)), "-m", "pip", "install", "--quiet"]
    for arguments, packages in install_steps(needed, torch_index=torch_index, extra=extra):
        notice("installing " + ", ".join(packages))
        _run([*pip, *arguments, *packages])
    write_text(folder / _STAMP, needed.sha256 + "\n")
    return _python_in(folder)


def install_steps(
    needed: Requirements, *, torch_index: str | None, extra: Sequence[str]
) -> list[tuple[list[str], list[str]]]:
    """Arguments and packages of each call of pip, in order.

    Torch's own packages are installed first and without dependencies from `torch_index`; the later
    steps find them installed and add their dependencies from the default index.
    """
    everything = [*needed.dependencies, *extra]
    of_torch = [text for text in everything if torch_index and _name(text) in _TORCH_PACKAGES]
    steps = [
        (["--no-deps", "--index-url", torch_index or ""], of_torch),
        ([], everything),
        (["--no-deps"], list(needed.no_deps)),
    ]
    return [(arguments, packages) for arguments, packages in steps if packages]


def ask_python(python: Path, program: str, *arguments: str) -> str:
    """The output of a program run by a Python. EnvironmentFailedError if it fails."""
    return _run([str(python), "-c", program, *arguments])


def _name(requirement: str) -> str | None:
    match = _PIN.match(requirement)
    return match["name"].lower() if match else None


def _stamp(card: IsolatedProject) -> str:
    return (environment_folder(card) / _STAMP).read_text(encoding="utf-8").strip()


def _python_in(folder: Path) -> Path:
    return folder / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")


def _ask(python: Path, names: list[str]) -> dict[str, str | None]:
    return decode(dict[str, str | None], ask_python(python, _VERSIONS, json.dumps(names)))


def _run(command: list[str]) -> str:
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as error:
        raise EnvironmentFailedError(
            f"{Path(command[0]).name} cannot be started",
            found=error.strerror or str(error),
            expected="a Python that runs",
        ) from error
    if done.returncode:
        raise EnvironmentFailedError(
            f"`{one_line(' '.join(command[:4]), 100)} ...` failed",
            found=one_line(done.stderr[-400:]),
            expected="exit code 0",
        )
    return done.stdout
