"""Build hook: compiles the C++ of two packages. Everything else is in pyproject.toml."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType
from typing import ClassVar

from setuptools import Command, Distribution, find_packages, setup
from setuptools.command.build import build
from setuptools.errors import CompileError

try:
    from setuptools.command.bdist_wheel import bdist_wheel
except ImportError:  # setuptools before 70.1
    from wheel.bdist_wheel import bdist_wheel

ROOT = Path(__file__).resolve().parent
#: Each becomes one library beside its sources: what is drawn, and what is accumulated.
PACKAGE_FOLDERS = (Path("legoworld") / "visibility", Path("legoworld") / "evaluation" / "kernels")
#: Folders of the checkout that ship inside the package (legoworld/shipped/catalog.py finds them).
CATALOG = ("readouts", "datasets", "baselines", "examples")


def compilation() -> ModuleType:
    """legoworld/visibility/compilation.py, without importing the package that is being built."""
    spec = importlib.util.spec_from_file_location(
        "compilation", ROOT / PACKAGE_FOLDERS[0] / "compilation.py"
    )
    if spec is None or spec.loader is None:
        raise CompileError("legoworld/visibility/compilation.py is missing")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class BuildKernel(Command):
    """Compile the libraries into the build folder, or beside their sources where editable."""

    description = "compile the C++ of legoworld.visibility and legoworld.evaluation.kernels"
    user_options: ClassVar[list[tuple[str, str | None, str]]] = [
        ("build-lib=", "b", "folder to build into"),
        ("inplace", "i", "build beside the sources"),
    ]
    boolean_options: ClassVar[list[str]] = ["inplace"]

    def initialize_options(self) -> None:
        """Sets the defaults (asked for by setuptools)."""
        self.build_lib: str | None = None
        self.inplace = False
        self.editable_mode = False

    def finalize_options(self) -> None:
        """Takes the build folder from `build` (asked for by setuptools)."""
        self.set_undefined_options("build", ("build_lib", "build_lib"))

    def run(self) -> None:
        """Compiles; a failure ends the installation with its reason."""
        module = compilation()
        for folder in PACKAGE_FOLDERS:
            try:
                command = module.compile_kernel(ROOT / folder, self._library(module, folder))
            except module.CompilationError as error:
                raise CompileError(str(error)) from error
            self.announce(" ".join(command), level=2)

    def _library(self, module: ModuleType, folder: Path) -> Path:
        in_sources = self.inplace or self.editable_mode
        base = ROOT if in_sources else Path(str(self.build_lib))
        return base / folder / str(module.LIBRARY_NAME)

    def get_outputs(self) -> list[str]:
        """Files this command makes (asked for by setuptools)."""
        module = compilation()
        return [str(self._library(module, folder)) for folder in PACKAGE_FOLDERS]

    def get_output_mapping(self) -> dict[str, str]:
        """No output is a copy of a source file (asked for by setuptools)."""
        return {}

    def get_source_files(self) -> list[str]:
        """Files that belong into the source distribution (asked for by setuptools)."""
        module = compilation()
        folders = [module.SHARED, *(ROOT / folder for folder in PACKAGE_FOLDERS)]
        return [str(p.relative_to(ROOT)) for folder in folders for p in module.sources(folder)]


class Build(build):
    """The usual build, and the libraries."""

    sub_commands: ClassVar[list] = [*build.sub_commands, ("build_kernel", None)]


class BinaryDistribution(Distribution):
    """Not pure Python: the wheel carries a library for one platform."""

    def has_ext_modules(self) -> bool:
        """Yes, so that setuptools treats the wheel as one for a platform."""
        return True


class PlatformWheel(bdist_wheel):
    """The library is loaded with ctypes, so one wheel serves every Python 3 of the platform."""

    def get_tag(self) -> tuple[str, str, str]:
        """Any Python 3, no ABI, this platform."""
        return "py3", "none", super().get_tag()[2]


def extra_build_requirements() -> list[str]:
    """The ziglang wheel (a whole C++ compiler), asked for only where there is no other."""
    module = compilation()  # once: every load makes a CompilationError of its own
    try:
        module.compiler()
    except module.CompilationError:
        return ["ziglang"]
    return []


setup(
    packages=[
        *find_packages(include=["legoworld", "legoworld.*"]),
        *(f"legoworld._catalog.{folder}" for folder in CATALOG),
    ],
    package_dir={f"legoworld._catalog.{folder}": folder for folder in CATALOG},
    setup_requires=extra_build_requirements(),
    cmdclass={"build": Build, "build_kernel": BuildKernel, "bdist_wheel": PlatformWheel},
    distclass=BinaryDistribution,
)
