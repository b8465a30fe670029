"""The pages of what is below a watched folder, made when they are asked for."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Final

from legoworld.api.report_page import write_report
from legoworld.errors import CatalogError
from legoworld.trajectories.api import trajectory_report
from legoworld.viewing.watched import Watched, WatchedState

#: As `legoworld report -o report.html` names it, and what is beside it.
PAGE: Final = "report.html"


@dataclass(frozen=True, kw_only=True)
class Pages:
    """Makes pages below `scratch`, one at a time. photos, scene_folders: as `write_report` has."""

    top: Path
    scratch: Path
    photos: Path | None
    scene_folders: Sequence[Path]
    write_lock: threading.Lock = field(default_factory=threading.Lock)
    written_pages: dict[str, Path] = field(default_factory=dict)

    def make(self, state: WatchedState, name: str) -> str:
        """The folder below `scratch` with the page of a source; made once for each content.

        It takes the place of an earlier one. CatalogError where the folder has no page,
        LegoWorldError where it cannot be made.
        """
        source = next((one for one in state.sources if one.name == name), None)
        if source is None or not source.page:
            raise CatalogError(
                f"there is no page of {name}",
                found="no folder of this name" if source is None else f"a {source.kind} folder",
                expected="an evaluation, a comparison, or trials that have ended",
            )
        with self.write_lock:
            read = [self.top / name, *([self.photos] if self.photos else []), *self.scene_folders]
            content = f"{name} {[_signature(one) for one in read]}"
            folder = self.scratch / sha256(content.encode()).hexdigest()
            if not (folder / PAGE).is_file():
                folder.mkdir(exist_ok=True)
                self._write(source, folder / PAGE)
                if earlier := self.written_pages.get(name):
                    shutil.rmtree(earlier)
                self.written_pages[name] = folder
            return folder.name

    def _write(self, source: Watched, page: Path) -> None:
        folder = self.top / source.name
        if source.kind == "trials":
            trajectory_report(folder, page, photos=self.photos)
        else:
            write_report([folder], page, photos=self.photos, scene_folders=self.scene_folders)


def _signature(folder: Path) -> list[tuple[str, int, int]]:
    """What changes with the files of a folder, or with the number of its trials or photos."""
    found = [(path.name, path.stat()) for path in sorted(folder.iterdir())]
    return [(name, status.st_size, status.st_mtime_ns) for name, status in found]
