"""Build hook: compiles the visibility kernel. Everything else is in pyproject.toml."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType
from typing import ClassVar

from setuptools import Command, Distribution, setup
from setuptools.command.build import build
from setuptools.errors import CompileError

try:
    from setuptools.command.bdist_wheel import bdist_wheel
except ImportError:  # setuptools before 70.1
    from wheel.bdist_wheel import bdist_wheel

ROOT = Path(__file__).resolve().parent
PACKAGE_FOLDER = Path("legoworld") / "visibility"


def compilation() -> ModuleType:
    """legoworld/visibility/compilation.py, without importing the package that is being built."""
    spec = importlib.util.spec_from_file_location(
        "compilation", ROOT / PACKAGE_FOLDER / "compilation.py"
    )
    if spec is None or spec.loader is None:
        raise CompileError("legoworld/visibility/compilation.py is missing")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class BuildKernel(Command):
    """Compile the kernel into the build folder, or beside its sources in an editable install."""

    description = "compile the visibility kernel"
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
        try:
            command = module.compile_kernel(ROOT / PACKAGE_FOLDER, self._library(module))
        except module.CompilationError as error:
            raise CompileError(str(error)) from error
        self.announce(" ".join(command), level=2)

    def _library(self, module: ModuleType) -> Path:
        in_sources = self.inplace or self.editable_mode
        base = ROOT if in_sources else Path(str(self.build_lib))
        return base / PACKAGE_FOLDER / str(module.LIBRARY_NAME)

    def get_outputs(self) -> list[str]:
        """Files this command makes (asked for by setuptools)."""
        return [str(self._library(compilation()))]

    def get_output_mapping(self) -> dict[str, str]:
        """No output is a copy of a source file (asked for by setuptools)."""
        return {}

    def get_source_files(self) -> list[str]:
        """Files that belong into the source distribution (asked for by setuptools)."""
        folder = ROOT / PACKAGE_FOLDER
        return [str(path.relative_to(ROOT)) for path in compilation().sources(folder)]


class Build(build):
    """The usual build, and the kernel."""

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
    setup_requires=extra_build_requirements(),
    cmdclass={"build": Build, "build_kernel": BuildKernel, "bdist_wheel": PlatformWheel},
    distclass=BinaryDistribution,
)
