"""scene.blend to its snapshot around the Blender process, which a stand-in answers for here."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from scene.by_hand import CAMERA, HandScene
from scene.gltf.documents import Document
from scene.stand_in import FACTS, StandIn

from legoworld.conventions import MOST_OBJECTS
from legoworld.errors import (
    SceneChangedError,
    SceneInvalidError,
    WorkerCrashedError,
    WorkerTimeoutError,
)
from legoworld.scene.cache import SnapshotCache
from legoworld.scene.folder import SceneFolder
from legoworld.scene.freeze import checked_artefacts, hash_files, write_frozen
from legoworld.scene.open_scene import CardRender, OpenedScene
from legoworld.scene.read_scene import read_scene

CARD = CardRender(size_wh=(4, 3), samples=1, seed=2, denoise=False)
PNG = b"\x89PNG\r\n\x1a\n" + bytes(4) + b"IEND" + bytes(4)


def snapshot_of(name: str):
    scene = HandScene()
    scene.object(name, category="chair")
    scene.occurs(name)
    return replace(scene.snapshot(), camera=replace(CAMERA, name=name))


def stand_in(**options) -> StandIn:
    """A process whose scenes have one object, named after the file's content."""
    pictures = (PNG,) * 9
    return StandIn(
        snapshot_of=lambda blend: snapshot_of(blend.read_text()), pictures=pictures, **options
    )


@pytest.fixture
def scene(tmp_path):
    folder = tmp_path / "scenes" / "scene"
    folder.mkdir(parents=True)
    (folder / "scene.blend").write_text("Chair")
    (folder / "wood.png").write_bytes(b"wood")
    return SceneFolder(path=folder, name="scene")


def read(scene, blender, cache=None, source="blend"):
    with blender:
        files = checked_artefacts(scene, require_frozen=False)
        return read_scene(scene, source=source, blender=blender, cache=cache, files=files)


def test_with_and_without_a_cache_the_same_answer(scene, tmp_path):
    cache = SnapshotCache(tmp_path / "cache")
    blenders = [stand_in(), stand_in(), stand_in()]
    without = read(scene, blenders[0])
    first, second = (read(scene, blender, cache) for blender in blenders[1:])
    assert without.snapshot.camera.name == first.snapshot.camera.name == "Chair"
    assert without.snapshot_sha256 == first.snapshot_sha256 == second.snapshot_sha256
    assert without.snapshot_sha256 == snapshot_of("Chair").content_sha256()
    assert without.files == first.files == second.files
    assert list(without.files.dependencies) == ["wood.png"]
    assert [[m["passing"] for m in b.asked] for b in blenders] == [[True], [False], []]
    assert sorted(p.suffix for p in cache.folder.rglob("*") if p.is_file()) == [
        ".json", ".snapshot",
    ]  # fmt: skip


def test_the_name_is_asked_for_and_not_what_it_links(scene, tmp_path):
    (scene.path / "scene.blend").rename(tmp_path / "store.blend")
    (scene.path / "scene.blend").symlink_to(tmp_path / "store.blend")
    blender = stand_in()
    read(scene, blender)
    assert blender.asked[0]["blend"] == str(scene.path.resolve() / "scene.blend")


def test_whatever_it_reads_is_part_of_the_key(scene, tmp_path):
    cache = SnapshotCache(tmp_path / "cache")
    read(scene, stand_in(), cache)

    def asked_again():
        blender = stand_in()
        read(scene, blender, cache)
        return len(blender.asked)

    (scene.path / "wood.png").write_bytes(b"oak")
    assert asked_again() == 1
    assert asked_again() == 0
    (scene.path / "baked").mkdir()
    (scene.path / "baked" / "0.bphys").write_bytes(b"cloth")
    assert asked_again() == 1
    assert asked_again() == 0
    (scene.path / "baked" / "1.bphys").write_bytes(b"another frame")
    assert asked_again() == 1


def test_a_damaged_snapshot_is_made_again(scene, tmp_path):
    cache = SnapshotCache(tmp_path / "cache")
    read(scene, stand_in(), cache)
    (stored,) = cache.folder.rglob("*.snapshot")
    whole = stored.read_bytes()
    stored.write_bytes(b"half of it")
    blender = stand_in()
    assert read(scene, blender, cache).snapshot.camera.name == "Chair"
    assert len(blender.asked) == 1
    assert stored.read_bytes() == whole


def test_a_scene_that_changes_while_it_is_read(scene):
    path = scene.path / "scene.blend"
    with pytest.raises(SceneInvalidError, match=r"scene\.blend changed while it was read"):
        read(scene, stand_in(meanwhile=lambda: path.write_text("Table")))
    files = checked_artefacts(scene, require_frozen=False)
    write_frozen(scene, files.artefacts, hash_files(scene.path, ["wood.png"]), {})
    with pytest.raises(SceneChangedError):
        read(scene, stand_in(meanwhile=lambda: path.write_text("Stool")))


def test_a_file_that_frozen_json_does_not_list(scene):
    files = checked_artefacts(scene, require_frozen=False)
    write_frozen(scene, files.artefacts, {}, {})
    with pytest.raises(SceneInvalidError, match=r"scene\.blend reads files.*found: wood\.png"):
        read(scene, stand_in())


@pytest.mark.parametrize(
    ("there", "source", "found", "next_step"),
    [
        ((), "blend", "nothing", "legoworld execute"),
        (("final.png",), "blend", "final.png", "legoworld execute"),
        (("scene.glb", "scene.py"), "blend", "scene.glb, scene.py", "--source glb"),
        (("scene.blend",), "glb", "scene.blend", "--source blend"),
    ],
)
def test_a_folder_without_the_file_says_what_it_has(there, source, found, next_step, scene):
    (scene.path / "scene.blend").unlink()
    for name in there:
        (scene.path / name).write_text("")
    with pytest.raises(SceneInvalidError) as caught:
        read(scene, stand_in(), source=source)
    assert caught.value.found == found
    assert caught.value.expected == f"scene.{source}"
    assert next_step in str(caught.value.next_step)


def test_the_source_says_which_file_is_read(scene):
    made = Document()
    made.quad("Quad", 4, 4, extras={"category": "chair"})
    (scene.path / "scene.glb").write_bytes(made.glb())
    blender = stand_in()
    assert read(scene, blender, source="glb").snapshot.camera.name != "Chair"
    assert blender.asked == []


def open_artefacts(scene, blender, cache=None, content=None):
    files = checked_artefacts(scene, require_frozen=False)
    return OpenedScene(scene, files, blender, cache, content=content)


def test_a_render_is_asked_for_once_and_kept(scene, tmp_path):
    cache = SnapshotCache(tmp_path / "cache")
    with stand_in() as blender:
        assert open_artefacts(scene, blender, cache).render(CARD) == PNG
        assert open_artefacts(scene, blender, cache).render(replace(CARD, threads=3)) == PNG
        assert len(blender.asked) == 1
        assert blender.asked[0]["card"] == {
            "size_wh": (4, 3), "samples": 1, "seed": 2, "denoise": False, "threads": 0,
        }  # fmt: skip
        assert open_artefacts(scene, blender, cache).render(replace(CARD, seed=3)) == PNG
        assert open_artefacts(scene, blender).render(replace(CARD, threads=3)) == PNG
        assert [m["card"]["threads"] for m in blender.asked] == [0, 0, 3]
        (scene.path / "scene.blend").write_text("Table")
        open_artefacts(scene, blender, cache).render(CARD)
        assert len(blender.asked) == 4
        open_artefacts(scene, blender, cache, content={"a": 1}).render(CARD)
        open_artefacts(scene, blender, cache, content={"a": 1}).render(CARD)
        assert len(blender.asked) == 5


def test_what_a_render_meets_is_asked_for_once_and_kept(scene, tmp_path):
    hand = HandScene()
    for name in ("Chair", "Table", "Lamp"):
        hand.object(name)
    hand.occurs("Chair")
    made = hand.snapshot()
    chair, table, lamp = made.objects
    linked = replace(table, library="//more.blend")
    snapshot = replace(
        made, objects=(chair, linked, lamp), render=replace(made.render, unit_scale=0.5)
    )
    names = (("Table", "//more.blend"), ("Table", ""), ("Chair", ""))
    cache = SnapshotCache(tmp_path / "cache")
    with stand_in(names=names) as blender:
        met = open_artefacts(scene, blender, cache).first_hits(CARD, snapshot)
        assert met.depth_z_m.tolist() == [[0.5, 0.5, 0.5]]
        assert met.object.tolist() == [[0, 1, 2]]
        assert met.place.tolist() == [2, 0, -1]
        again = open_artefacts(scene, blender, cache).first_hits(replace(CARD, threads=3), snapshot)
        assert (again.depth_z_m == met.depth_z_m).all()
        assert (again.place == met.place).all()
        assert [m["kind"] for m in blender.asked] == ["card_depth"]
        open_artefacts(scene, blender, cache).render(CARD)
        assert (
            open_artefacts(scene, blender, cache)
            .first_hits(replace(CARD, seed=3), snapshot)
            .depth_z_m.max()
            == 1.5
        )
        assert open_artefacts(scene, blender).first_hits(CARD, snapshot).depth_z_m.max() == 2.0
        assert open_artefacts(scene, blender).first_hits(CARD, snapshot).depth_z_m.max() == 2.5
    entries = [p for p in cache.folder.rglob("*.npz") if p.is_file()]
    assert len(entries) == 2


def test_an_object_s_number_in_a_render_begins_again_after_the_most(scene):
    hand = HandScene()
    hand.object("Last")
    hand.occurs("Last")
    names = (*((f"{n}", "") for n in range(MOST_OBJECTS + 1)), ("Last", ""))
    with stand_in(names=names) as blender:
        assert open_artefacts(scene, blender).first_hits(CARD, hand.snapshot()).place.tolist() == [
            1
        ]


def test_facts_are_asked_for_once_and_kept(scene, tmp_path):
    cache = SnapshotCache(tmp_path / "cache")
    with stand_in() as blender:
        first, again = (open_artefacts(scene, blender, cache).facts((8, 8)) for _ in range(2))
        assert first.values == again.values == FACTS
        assert first.textures.tolist() == again.textures.tolist() == [[[[1] * 3] * 2] * 2]
        assert blender.asked[0]["thumbnail_wh"] == (8, 8)
        other = open_artefacts(scene, blender, cache).facts((9, 8))
        assert other.textures.max() == 2
        assert open_artefacts(scene, blender).facts((8, 8)).textures.max() == 3


def test_a_question_is_asked_again_once_where_the_process_was_lost(scene):
    """And a question that took too long is not: it would take as long again."""
    for lost, expected in ((1, 2), (2, 2), (0, 1)):
        with stand_in(lost=lost, slow=lost == 0) as blender:
            if lost == 1:
                assert open_artefacts(scene, blender).facts((8, 8)).values == FACTS
            else:
                with pytest.raises(WorkerCrashedError if lost else WorkerTimeoutError):
                    open_artefacts(scene, blender).render(CARD)
            assert len(blender.asked) == expected


def test_what_is_kept_can_be_read_by_others(scene, tmp_path):
    cache = SnapshotCache(tmp_path / "cache")
    with stand_in() as blender:
        open_artefacts(scene, blender, cache).facts((8, 8))
    (stored,) = cache.folder.rglob("*.npz")
    with np.load(stored) as arrays:
        assert json.loads(arrays["facts"].tobytes()) == FACTS
