"""What a scene.blend reads besides itself: nested libraries, packed ones, simulation caches."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from scene.snapshots import snapshot_of

from legoworld.readouts.family import protocol
from legoworld.running.image import read_image, still_valid
from legoworld.running.image_record import ImageOptions
from legoworld.running.shared_scene import HashedScene
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.cache import SnapshotCache
from legoworld.tracks.track import TrackImage

pytestmark = pytest.mark.blender

PROGRAM = """
def part(folder, half):
    fresh()
    quad("Part", half=half, category="chair")
    folder.mkdir(parents=True, exist_ok=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "parts.blend"), check_existing=False)

def linked(path, kind, name):
    with bpy.data.libraries.load(str(path), link=True, relative=True) as (_, wanted):
        setattr(wanted, kind, [name])
    return getattr(wanted, kind)[0]

# Two libraries in folders of their own, each with a library of the same name beside it.
nested = OUT / "nested"
for name, half in (("a", 0.5), ("b", 1.5)):
    part(nested / name, half)
    fresh()
    bpy.ops.wm.save_as_mainfile(filepath=str(nested / name / "set.blend"))
    collection = bpy.data.collections.new(name)
    collection.objects.link(linked(nested / name / "parts.blend", "objects", "Part"))
    bpy.context.scene.collection.children.link(collection)
    bpy.ops.wm.save_as_mainfile(filepath=str(nested / name / "set.blend"), check_existing=False)
fresh(); camera()
save("nested")
for name in "ab":
    bpy.context.scene.collection.children.link(
        linked(nested / name / "set.blend", "collections", name)
    )
save("nested")

# The same object of one library twice: a packed copy of what it was, and what it is.
packed = OUT / "packed"
part(packed, 0.5)
fresh(); camera()
save("packed")
before = linked(packed / "parts.blend", "objects", "Part")
bpy.context.scene.collection.objects.link(bpy.data.pack_linked_ids_hierarchy(before))
bpy.data.objects.remove(before)
save("packed")
part(packed, 1.5)
bpy.ops.wm.open_mainfile(filepath=str(packed / "scene.blend"))
bpy.context.scene.collection.objects.link(linked(packed / "parts.blend", "objects", "Part"))
save("packed")

fresh(); camera(); quad("Card", category="chair")
save("plain")
"""


@pytest.fixture(scope="module")
def scenes(build_scenes, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("libraries")
    build_scenes(PROGRAM, folder)
    return folder


@pytest.fixture(scope="module")
def blender() -> Iterator[BlenderProcess]:
    with BlenderProcess(Limits(time_s=600)) as process:
        yield process


def test_libraries_of_libraries_are_found_where_they_lie(scenes, blender):
    made = snapshot_of(scenes / "nested", blender)
    names = ["a/parts.blend", "a/set.blend", "b/parts.blend", "b/set.blend"]
    assert sorted(made.files.dependencies) == names
    assert None not in made.files.dependencies.values()
    parts = [o.library for o in made.snapshot.objects if o.name == "Part"]
    assert parts == ["//a/parts.blend", "//b/parts.blend"]


def test_packed_and_linked_objects_of_one_name_are_two(scenes, blender):
    made = snapshot_of(scenes / "packed", blender).snapshot
    (first, second) = (i for i, o in enumerate(made.objects) if o.name == "Part")
    assert made.objects[first].library != made.objects[second].library
    shown = made.occurrence_object[made.surface_occurrence]
    assert sorted(shown.tolist()) == [first, second]


def test_a_simulation_cache_that_appears_or_goes_is_noticed(scenes, blender, tmp_path):
    place = tmp_path / "scenes" / "plain"
    shutil.copytree(scenes / "plain", place)
    cache = SnapshotCache(tmp_path / "cache")
    assert snapshot_of(place, blender, cache).files.dependencies == {}
    baked = place / "blendcache_scene" / "cloth" / "0001.bphys"
    baked.parent.mkdir(parents=True)
    baked.write_bytes(b"one")
    for content in (b"one", b"two"):
        baked.write_bytes(content)
        for _ in range(2):  # made, and from the cache
            files = snapshot_of(place, blender, cache).files.dependencies
            assert [*files] == ["blendcache_scene/cloth/0001.bphys"]
    baked.unlink()
    assert snapshot_of(place, blender, cache).files.dependencies == {}


@pytest.mark.parametrize("cached", [True, False])
def test_a_resumed_run_reads_a_scene_with_a_new_simulation_cache_again(
    cached, scenes, blender, tmp_path
):
    place = tmp_path / "scenes" / "plain"
    shutil.copytree(scenes / "plain", place)
    options = ImageOptions(
        scenes=place.parent,
        run=tmp_path,
        protocol=protocol("coco", None),
        source="blend",
        cache=SnapshotCache(tmp_path / "cache") if cached else None,
        require_frozen=False,
        max_side=None,
        threads=1,
    )
    image = TrackImage(id=1, file_name="plain.jpg", size_wh=(64, 48), scene="plain")
    record = read_image(image, options, blender)
    assert record.row.status == "ok"
    assert still_valid(record, HashedScene(image.scene, options), options)
    (place / "blendcache_scene").mkdir()
    assert still_valid(record, HashedScene(image.scene, options), options)
    (place / "blendcache_scene" / "0001.bphys").write_bytes(b"one")
    assert not still_valid(record, HashedScene(image.scene, options), options)
