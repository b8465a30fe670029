"""The copy of a live scene, in a folder that the code in Blender can write to."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Iterator
from pathlib import Path, PurePath
from typing import Final

from legoworld.beneath import Beneath, RefusedFileError, name_beneath
from legoworld.endpoint.trial_record import LARGEST_FILE
from legoworld.files import sha256_of_file
from legoworld.plugin.connection import BlenderRefusedError

#: Beside the scene, so that what it names by relative paths is found from the copy, too.
COPY: Final = ".legoworld-live.blend"


class LiveCopy:
    """A saved copy that may be exchanged for anything at any moment.

    path: as Blender said it; workspace: the folder that an endpoint's Blender is confined to, None
    for a Blender that can write what its user can. Methods raise BlenderRefusedError for a path
    that is not the copy's or leads out of the workspace, and for anything but a regular file.
    """

    def __init__(self, path: Path, workspace: Path | None) -> None:
        self.path = path
        self.workspace = workspace or path.parent.resolve()
        name = name_beneath(str(path), workspace) if workspace else PurePath(path.name)
        if path.name != COPY or not path.is_absolute() or name is None:
            raise self._refused_error(str(path))
        self._name: PurePath = name

    @property
    def folder(self) -> str:
        """The name below the workspace of the folder that it is in."""
        return str(self._name.parent)

    def sha256(self) -> str:
        """Hash of its current bytes."""
        with self._files() as files, files.open_file(self._name, most_bytes=LARGEST_FILE) as stream:
            if stream is None:
                raise self._refused_error("no such file")
            return hashlib.file_digest(stream, "sha256").hexdigest()

    def keep(self, store: Path) -> Path:
        """Copy it into a folder of ours, as <sha256>.blend of what was copied."""
        incoming = store / f".incoming{COPY}"
        with self._files() as files:
            if not files.copy_out(self._name, incoming, most_bytes=LARGEST_FILE):
                raise self._refused_error("no such file")
        return incoming.replace(store / f"{sha256_of_file(incoming)}.blend")

    def write(self, stored: Path) -> None:
        """Write a file of ours in its place."""
        with self._files() as files:
            files.copy_in(stored, self._name)

    def remove(self) -> None:
        """Remove it, where it is still there; what the code put in its folder's place stays."""
        with contextlib.suppress(BlenderRefusedError), self._files() as files:
            files.unlink(self._name)

    @contextlib.contextmanager
    def _files(self) -> Iterator[Beneath]:
        try:
            with Beneath(self.workspace) as files:
                yield files
        except RefusedFileError as error:
            raise self._refused_error(error.found) from error

    def _refused_error(self, found: str) -> BlenderRefusedError:
        return BlenderRefusedError(
            "the copy of the live scene cannot be read from here",
            found=f"{self.path}: {found}",
            expected="a file in a folder that both Blender and this process see",
            next_step="run the plugin on Blender's machine, and save the scene there once",
        )
