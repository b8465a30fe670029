"""What a page holds besides its tables: views, photos, renders and scenes, each file once."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from legoworld.records.report_page import BenchPageView, PageView
from legoworld.records.report_tables import PageSection
from legoworld.report.photos import page_photo
from legoworld.report.scene_files import SceneFiles
from legoworld.workers.processors import usable_cores


@dataclass(kw_only=True)
class PageDocument:
    """Everything a page shows. views: of every photo of every section; photos: each file once.

    overlays: lossless pictures of a bench's outcomes. single_photo: no lists or tables.
    A view's "photo" is a position in photos, or None with "said" saying why; likewise of the
    renders and scenes of its sides in `scenes`.
    """

    sections: list[PageSection] = field(default_factory=list)
    views: list[PageView] = field(default_factory=list)
    photos: list[bytes] = field(default_factory=list)
    overlays: list[bytes] = field(default_factory=list)
    scenes: SceneFiles = field(default_factory=lambda: SceneFiles(folders=()))
    single_photo: bool = False

    @property
    def pictures(self) -> dict[str, list[bytes]]:
        """Every WebP of the page by its kind."""
        return {"photo": self.photos, "render": self.scenes.renders, "overlay": self.overlays}

    @property
    def without_photo(self) -> list[PageView]:
        """The views that have no photo; each says why."""
        return [view for view in self.views if view.photo is None]

    @property
    def in_3d(self) -> bool:
        """Whether something is shown in 3D: a scene, or points."""
        points = any(isinstance(v, BenchPageView) and v.raster for v in self.views)
        return any(self.scenes.glbs) or points


@dataclass(kw_only=True)
class Photos:
    """Photos by file name and size: sections over the same photos share them."""

    folder: Path | None
    document: PageDocument
    embedded_photos: dict[tuple[str, tuple[int, int] | None], tuple[int | None, str]] = field(
        default_factory=dict
    )

    def read(self, wanted: Sequence[tuple[str, tuple[int, int] | None]]) -> None:
        """Read photos, several at a time; the page holds them in the order wanted."""
        new = [key for key in dict.fromkeys(wanted) if key not in self.embedded_photos]
        with ThreadPoolExecutor(usable_cores()) as pool:
            read = pool.map(lambda key: page_photo(self.folder, *key), new)
            for key, photo in zip(new, read, strict=True):
                position = None
                if photo.webp is not None:
                    position = len(self.document.photos)
                    self.document.photos.append(photo.webp)
                self.embedded_photos[key] = (position, photo.note)

    def place(self, file_name: str, size_wh: tuple[int, int] | None) -> tuple[int | None, str]:
        """Where the page holds a photo that was read, or None and why it does not."""
        return self.embedded_photos[file_name, size_wh]
