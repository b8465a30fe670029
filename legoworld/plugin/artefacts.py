"""What a case made, by hash: reports, plans and pictures, as MCP resources serve them."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Final, Literal

from legoworld.errors import UsageError
from legoworld.files import atomic_path

ARTEFACTS: Final = "artefacts"
Kind = Literal["json", "md", "png"]
#: What comes before the hash in the address of a resource.
URIS: Final[dict[Kind, str]] = {
    "json": "legoworld://reports/",
    "md": "legoworld://texts/",
    "png": "legoworld://renders/",
}
MIME_TYPES: Final[dict[Kind, str]] = {
    "json": "application/json",
    "md": "text/markdown",
    "png": "image/png",
}


def find_kind(name: str) -> Kind:
    """The kind of a file by its name."""
    kinds: dict[str, Kind] = {".json": "json", ".md": "md", ".png": "png"}
    return kinds[Path(name).suffix]


class Artefacts:
    """A folder of files named by their sha256."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def keep(self, data: bytes, kind: Kind) -> str:
        """Store bytes; their sha256."""
        sha256 = hashlib.sha256(data).hexdigest()
        path = self._folder / f"{sha256}.{kind}"
        if not path.exists():
            with atomic_path(path) as temporary:
                temporary.write_bytes(data)
        return sha256

    def files(self) -> list[Path]:
        """All of them, oldest first."""
        kept = [path for path in self._folder.glob("*.*") if len(path.stem) == 64]
        return sorted(kept, key=lambda path: (path.stat().st_mtime_ns, path.name))

    def read(self, sha256: str, kind: Kind) -> bytes:
        """The bytes with a hash. UsageError if this case did not create them."""
        path = self._folder / f"{sha256}.{kind}"
        if not (len(sha256) == 64 and sha256.isalnum() and path.is_file()):
            raise UsageError(
                "the case has no such artefact",
                found=f"{sha256[:64]!r}",
                expected="a sha256 that a tool's answer names",
            )
        return path.read_bytes()
