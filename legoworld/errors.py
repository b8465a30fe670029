"""Every error a user can get: what, found, expected, next step, in one line."""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import TracebackType
from typing import ClassVar, Final

from legoworld import exit_codes

#: What `__exit__` is given.
Raised = type[BaseException] | BaseException | TracebackType | None

_UNPRINTABLE: Final = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff]"
)


def printable(text: str) -> str:
    """Replace characters that control a terminal or cannot be encoded by U+FFFD.

    Names and messages come from untrusted files. Replaced: C0 and C1 controls except tab and
    newline (escape sequences), bidirectional formatting characters, and lone surrogates.
    """
    return _UNPRINTABLE.sub("\ufffd", text)


def name_on_line(name: str) -> str:
    """A name as part of a line of output: printable, no newlines or tabs, which forge lines."""
    return printable(name.replace("\n", "\0").replace("\t", "\0"))


def escape_json(json_text: str) -> str:
    r"""JSON with what `printable` replaces as \u escapes: the same value, and nothing is lost."""
    return _UNPRINTABLE.sub(lambda found: f"\\u{ord(found[0]):04x}", json_text)


def one_line(text: str, limit: int = 400) -> str:
    """Printable text with runs of white space collapsed, truncated to `limit` characters."""
    flat = printable(" ".join(text.split()))
    return flat if len(flat) <= limit else flat[: limit - 1] + "…"


def cause(error: Exception) -> str:
    """An error's message for `found`; of an OSError without errno and path."""
    words = error.strerror if isinstance(error, OSError) else None
    return words or str(error) or type(error).__name__


class LegoWorldError(Exception):
    """The base of all errors: what went wrong, what was found and expected, what to do next.

    `code` is a stable identifier for programs; `status` is how a per-image row records the error;
    `exit_code` is the exit code of a command that the error ends. `trace` is the traceback of an
    unexpected error, printed with -v; it names files of this machine and is never stored in a
    result.
    """

    code: ClassVar[str] = "error"
    status: ClassVar[str] = "failed"
    exit_code: ClassVar[int] = exit_codes.UNUSABLE
    trace: str = ""

    def __init__(
        self, what: str, *, found: str = "", expected: str = "", next_step: str = ""
    ) -> None:
        self.what = one_line(what)
        self.found = one_line(found)
        self.expected = one_line(expected)
        self.next_step = one_line(next_step)
        super().__init__(str(self))

    def __str__(self) -> str:
        parts = [self.what]
        for name, text in (
            ("found", self.found),
            ("expected", self.expected),
            ("next", self.next_step),
        ):
            if text:
                parts.append(f"{name}: {text}")
        return "; ".join(parts)

    def reason(self) -> dict[str, str]:
        """The error as a per-image row stores it."""
        return {
            "code": self.code,
            "what": self.what,
            "found": self.found,
            "expected": self.expected,
            "next": self.next_step,
        }


class ShapeError(LegoWorldError):
    """An array does not have the required shape or type."""

    code = "shape"


class KernelBuildError(LegoWorldError):
    """The visibility kernel's library is missing, stale, or could not be compiled."""

    code = "kernel_build"
    exit_code = exit_codes.BLOCKED


class UsageError(LegoWorldError):
    """A command was called with unusable arguments; nothing was written."""

    code = "usage"


class NotAssessedError(LegoWorldError):
    """There is nothing to certify or score, or it cannot be read: neither a yes nor a no."""

    code = "not_assessed"
    exit_code = exit_codes.NOT_ASSESSED


class ConfigurationMismatchError(LegoWorldError):
    """A run folder holds results of a different configuration."""

    code = "configuration"


class CatalogError(LegoWorldError):
    """A card, vocabulary or track file cannot be used by this version."""

    code = "catalog"


class InstallationError(CatalogError):
    """A file that ships with legoworld is missing or does not match the code."""

    code = "installation"
    exit_code = exit_codes.BLOCKED


class SceneMissingError(LegoWorldError):
    """An image of the track has no scene."""

    code = "missing_scene"
    status = "missing"


class SceneInvalidError(LegoWorldError):
    """A scene artefact exists but cannot be used."""

    code = "invalid_scene"
    status = "invalid"


class SideFileInvalidError(SceneInvalidError):
    """A JSON file beside the scene cannot be read, or is not a file of the scene folder."""

    code = "invalid_side_file"


class LabelsInvalidError(SceneInvalidError):
    """labels.json cannot be read or does not follow its schema."""

    code = "invalid_labels"


class NoCameraError(SceneInvalidError):
    """The scene has no active camera."""

    code = "no_camera"


class UnsupportedCameraError(SceneInvalidError):
    """The camera's projection is neither perspective nor orthographic."""

    code = "unsupported_camera"


class NoMeshError(SceneInvalidError):
    """Nothing in the scene renders as a surface."""

    code = "no_mesh"


class NonFiniteGeometryError(SceneInvalidError):
    """A vertex, a matrix or a camera number is NaN or infinite."""

    code = "non_finite_geometry"


class MissingLibraryError(SceneInvalidError):
    """A linked library, or the data it should hold, is missing."""

    code = "missing_library"


class IrregularFileError(SceneInvalidError):
    """A .blend refers to a FIFO, socket or device."""

    code = "irregular_file"


class UnreadableBlendError(SceneInvalidError):
    """Blender cannot read the file."""

    code = "unreadable_blend"


class TiersNotNestedError(SceneInvalidError):
    """The object sets of a reference scene's tiers do not lie one in the other."""

    code = "tiers_not_nested"


class SceneChangedError(LegoWorldError):
    """The sha256 of a frozen file differs from the recorded one."""

    code = "changed"
    status = "changed"


class NotFrozenError(LegoWorldError):
    """--require-frozen was given and the scene has no frozen.json."""

    code = "not_frozen"
    status = "invalid"


class WorkerCrashedError(LegoWorldError):
    """The Blender process ended unexpectedly while reading the scene."""

    code = "worker_crashed"


class WorkerMemoryError(LegoWorldError):
    """The Blender process exceeded its memory limit."""

    code = "worker_memory"


class WorkerTimeoutError(LegoWorldError):
    """The Blender process did not answer within the time limit."""

    code = "worker_timeout"
    status = "timeout"


#: Errors a Blender worker may report by code; their type survives the process boundary.
BY_CODE: dict[str, type[LegoWorldError]] = {
    cls.code: cls
    for cls in (
        LegoWorldError,
        ShapeError,
        SceneInvalidError,
        NoCameraError,
        UnsupportedCameraError,
        NoMeshError,
        NonFiniteGeometryError,
        MissingLibraryError,
        IrregularFileError,
        UnreadableBlendError,
        TiersNotNestedError,
    )
}


def from_reason(reason: Mapping[str, str]) -> LegoWorldError:
    """The inverse of `reason()`; the error has its original type where the code is known."""
    cls = BY_CODE.get(reason["code"], LegoWorldError)
    return cls(
        reason["what"],
        found=reason["found"],
        expected=reason["expected"],
        next_step=reason["next"],
    )
