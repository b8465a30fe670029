"""Files that a .blend refers to: FIFOs and devices are refused before they are read, and a font
that Blender replaces by its own is said."""

from __future__ import annotations

import gzip
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from scene.snapshots import snapshot_of

from legoworld.errors import IrregularFileError
from legoworld.scene.blender_process import BlenderProcess, Limits

pytestmark = pytest.mark.blender

SCENES = """
import shutil
own = Path(bpy.utils.resource_path("LOCAL")) / "datafiles" / "fonts"

def text(name, *, packed=False):
    folder = OUT / name
    folder.mkdir()
    shutil.copy(next(own.glob("*Mono*.woff2")), folder / "own.woff2")
    fresh(); camera(); quad("Card", category="chair")
    curve = bpy.data.curves.new("Title", "FONT")
    curve.body = "mmmmiiii"
    curve.font = bpy.data.fonts.load(str(folder / "own.woff2"))
    if packed:
        curve.font.pack()
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Title", curve))
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"), relative_remap=True)

text("text"); text("packed", packed=True)

for name, compress in (("linked", True), ("plain", False)):
    folder = OUT / name
    folder.mkdir()
    fresh(); quad("Part", category="chair")
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "parts.blend"), check_existing=False)
    fresh(); camera()
    with bpy.data.libraries.load(str(folder / "parts.blend"), link=True, relative=True) as (_, to):
        to.objects = ["Part"]
    bpy.context.scene.collection.objects.link(to.objects[0])
    image = bpy.data.images.new("Paint", 4, 4)
    image.filepath_raw, image.file_format = str(folder / "paint.png"), "PNG"
    image.save()
    image.source = "FILE"
    image.use_fake_user = True
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"), compress=compress,
                                check_existing=False)
"""


@pytest.fixture(scope="module")
def blender() -> Iterator[BlenderProcess]:
    with BlenderProcess(Limits(time_s=300)) as process:
        yield process


@pytest.fixture
def folder(request: pytest.FixtureRequest, scenes: Path, tmp_path: Path) -> Path:
    """A copy of one scene folder whose files may be changed."""
    return Path(shutil.copytree(scenes / request.param, tmp_path / "scenes" / request.param))


def no_font(path: Path) -> None:
    path.unlink()


def a_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def half_a_font(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:2000])


def a_dangling_link(path: Path) -> None:
    path.unlink()
    path.symlink_to("elsewhere.woff2")


@pytest.mark.parametrize("folder", ["text"], indirect=True)
@pytest.mark.parametrize(
    ("damage", "why"),
    [
        (no_font, "no such file or directory"),
        (a_folder, "is a directory"),
        (half_a_font, "unsupported font format"),
        (a_dangling_link, "no such file or directory"),
    ],
)
def test_a_font_that_blender_replaces_is_a_warning(
    folder: Path, blender: BlenderProcess, damage: Callable[[Path], None], why: str
) -> None:
    sound = snapshot_of(folder, blender).snapshot
    assert sound.warnings == ()
    damage(folder / "own.woff2")
    other = snapshot_of(folder, blender).snapshot
    (warning,) = other.warnings
    assert f"(own.woff2) cannot be read: {why}; Blender's own font is used" in warning
    assert str(folder) not in warning
    assert (other.vertices.max(0) != sound.vertices.max(0)).any()


@pytest.mark.parametrize("folder", ["text", "packed"], indirect=True)
def test_a_font_that_is_linked_or_packed_is_read(folder: Path, blender: BlenderProcess) -> None:
    (folder / "own.woff2").rename(folder / "other.woff2")
    (folder / "own.woff2").symlink_to("other.woff2")
    assert snapshot_of(folder, blender).snapshot.warnings == ()


@pytest.mark.parametrize(
    ("folder", "name"),
    [("text", "own.woff2"), ("linked", "paint.png"), ("linked", "parts.blend"),
     ("plain", "parts.blend")],
    indirect=["folder"],
)  # fmt: skip
@pytest.mark.parametrize("kind", ["FIFO", "device"])
def test_a_fifo_or_device_is_refused_before_blender_reads_it(
    folder: Path, blender: BlenderProcess, name: str, kind: str
) -> None:
    (folder / name).unlink()
    if kind == "FIFO":
        os.mkfifo(folder / name)
    else:
        (folder / name).symlink_to("/dev/zero")
    with pytest.raises(IrregularFileError, match=f"found: {name} is a {kind}"):
        snapshot_of(folder, blender)


@pytest.mark.parametrize("folder", ["plain"], indirect=True)
def test_a_file_of_an_older_blender_s_compression_is_looked_at(
    folder: Path, blender: BlenderProcess
) -> None:
    blend = folder / "scene.blend"
    blend.write_bytes(gzip.compress(blend.read_bytes()))
    assert snapshot_of(folder, blender).snapshot.warnings == ()
    (folder / "parts.blend").unlink()
    os.mkfifo(folder / "parts.blend")
    with pytest.raises(IrregularFileError):
        snapshot_of(folder, blender)
