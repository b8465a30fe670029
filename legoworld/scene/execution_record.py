"""What execution.json says of a scene that other commands have to pass on."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from legoworld.errors import SideFileInvalidError, one_line
from legoworld.scene.folder import BLEND, EXECUTION
from legoworld.scene.side_files import read_side_file

_STOPPED: Final = "stopped"


def execution_warnings(folder: Path, blend_sha256: str | None) -> tuple[str, ...]:
    """A warning where the program that built the scene was stopped by an error.

    blend_sha256: of the scene.blend that is there; an execution.json of another one says nothing of
    it. The file is no part of the frozen scene: one that cannot be used is a warning, too.
    """
    try:
        found = read_side_file(folder, EXECUTION)
    except SideFileInvalidError as error:
        return (f"{error.what}; found: {error.found}",)
    document = found.value if found is not None else None
    if not isinstance(document, dict) or document.get("status") != _STOPPED:
        return ()
    if _mapping(document.get("files")).get(BLEND) != blend_sha256:
        return ()
    error_of = _mapping(document.get("error"))
    line = error_of.get("line")
    where = f" at line {line}" if isinstance(line, int) else ""
    kind = one_line(str(error_of.get("type", "an error")), 100)
    return (
        f"the program that built the scene stopped{where} ({kind}): the scene is what it had built "
        "by then",
    )


def _mapping(value: Any) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}
