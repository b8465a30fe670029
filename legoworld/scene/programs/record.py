"""What execution.json says of a scene that other commands have to pass on."""

from __future__ import annotations

from pathlib import Path

from legoworld.errors import SideFileInvalidError, one_line
from legoworld.records.execution import ExecutionFile
from legoworld.scene.folder import BLEND, EXECUTION
from legoworld.scene.side_files import read_side_file


def execution_warnings(folder: Path, blend_sha256: str | None) -> tuple[str, ...]:
    """A warning where the program that built the scene was stopped by an error.

    blend_sha256: of the scene.blend that is there; an execution.json of another one says nothing of
    it. The file is no part of the frozen scene: one that cannot be used is a warning, too.
    """
    try:
        record = read_side_file(folder, EXECUTION, ExecutionFile)
    except SideFileInvalidError as error:
        return (f"{error.what}; found: {error.found}",)
    if record is None or record.value.status != "stopped":
        return ()
    if record.value.files.get(BLEND) != blend_sha256:
        return ()
    by = record.value.error
    where = f" at line {by.line}" if by and by.line is not None else ""
    kind = one_line(by.type, 100) if by else "an error"
    return (
        f"the program that built the scene stopped{where} ({kind}): the scene is what it had built "
        "by then",
    )
