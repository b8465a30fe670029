"""What a dependency graph's paths of indices mean; the paths are those Blender 5.0.1 reports."""

from __future__ import annotations

import random

import numpy as np
import pytest

from legoworld.scene.blender.placements import (
    Generator,
    GraphEntry,
    Placements,
    Scatter,
    resolve_placements,
)

UNIT = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)


def at(x: float) -> tuple[float, ...]:
    return (1.0, 0.0, 0.0, x, *UNIT[4:])


def node(top: str, path: tuple[int, ...], name: str, x: float = 0.0, **facts: object) -> GraphEntry:
    values = {"mesh": 0, "holdout_mesh": -1, "by_particles": False, **facts}
    return GraphEntry(top=(top, ""), path=path, object=(name, ""), world_from_mesh=at(x), **values)  # type: ignore[arg-type]


def makes(
    kind: str = "NONE",
    members: str = "",
    ancestors: str = "",
    stands_x: float | None = 0.0,
    *,
    own: bool = False,
    scatters: bool = False,
) -> Generator:
    return Generator(
        instance_type=kind,
        members=frozenset((m, "") for m in members.split()),
        ancestors=frozenset((a, "") for a in ancestors.split()),
        makes_own_mesh=own,
        scatters=scatters,
        stands_at=None if stands_x is None else at(stands_x),
    )


def resolve_entries(entries: list[GraphEntry], **generators: Generator) -> Placements:
    names = sorted({e.object[0] for e in entries} | {e.top[0] for e in entries})
    facts = {(n, ""): generators.get(n, makes()) for n in names}
    return resolve_placements(entries, facts, {(n, ""): i for i, n in enumerate(names)})


def rows(placements: Placements, entries: list[GraphEntry]) -> list[tuple[str, int, int]]:
    """(object, instancer's row, frame) of every occurrence."""
    names = sorted({e.object[0] for e in entries} | {e.top[0] for e in entries})
    a = placements.arrays
    return [
        (names[o], int(i), int(f))
        for o, i, f in zip(
            a["occurrence_object"], a["occurrence_instancer"], a["occurrence_frame"], strict=True
        )
    ]


def makers(placements: Placements, entries: list[GraphEntry]) -> list[str]:
    found = rows(placements, entries)
    return [f"{name}<{found[i][0]}" if i >= 0 else name for name, i, _ in found]


def frames_of(placements: Placements, entries: list[GraphEntry], name: str) -> list[int]:
    return [frame for found, _, frame in rows(placements, entries) if found == name]


def test_nested_collections():
    entries = [
        node("E", (), "E", mesh=-1),
        node("E", (0,), "F", mesh=-1),
        node("E", (0, 0), "M"),
        node("E", (0, 1), "M2"),
        node("E", (1,), "N"),
    ]
    found = resolve_entries(entries, E=makes("COLLECTION", "F N"), F=makes("COLLECTION", "M M2"))
    assert makers(found, entries) == ["E", "F<E", "M<F", "M2<F", "N<E"]
    assert len({f for _, _, f in rows(found, entries)}) == 1


def test_a_curve_and_its_mesh_are_one_occurrence():
    entries = [node("C", (), "C", mesh=-1), node("C", (0,), "C")]
    found = resolve_entries(entries, C=makes(own=True))
    assert makers(found, entries) == ["C"]
    assert found.arrays["surface_occurrence"].tolist() == [0]


def test_a_curve_inside_an_instanced_collection_is_one_occurrence():
    entries = [node("E", (), "E", mesh=-1), node("E", (0,), "C", mesh=-1), node("E", (0, 0), "C")]
    found = resolve_entries(entries, E=makes("COLLECTION", "C"), C=makes(own=True))
    assert makers(found, entries) == ["E", "C<E"]
    assert found.arrays["surface_occurrence"].tolist() == [1]


def test_geometry_nodes_that_scatter_their_own_mesh_are_one_occurrence():
    entries = [node("S", (), "S"), node("S", (0, 0), "S", 1.0), node("S", (1, 0), "S", 2.0)]
    found = resolve_entries(entries, S=makes(own=True, scatters=True))
    assert makers(found, entries) == ["S"]
    assert found.arrays["surface_occurrence"].tolist() == [0, 0, 0]


def test_geometry_nodes_that_scatter_an_object_place_each_apart():
    entries = [node("S", (), "S"), node("S", (0, 0), "A", 0.0), node("S", (1, 0), "A", 5.0)]
    found = resolve_entries(entries, S=makes(own=True, scatters=True))
    assert makers(found, entries) == ["S", "A<S", "A<S"]
    assert len(set(frames_of(found, entries, "A"))) == 2


def test_geometry_nodes_that_place_a_whole_collection_keep_its_members_together():
    entries = [node("S", (), "S")]
    for i, x in enumerate((0.0, 10.0)):
        entries += [
            node("S", (i, 0, 0), "A", x + 0.1),
            node("S", (i, 0, 2), "B", x + 0.2),
            node("S", (i, 0, 4), "F", x + 0.3, mesh=-1),
            node("S", (i, 0, 5, 0), "Leaf", x + 0.3),
        ]
    found = resolve_entries(
        entries,
        S=makes(own=True, scatters=True),
        A=makes(stands_x=0.1),
        B=makes(stands_x=0.2),
        F=makes("COLLECTION", "Leaf", stands_x=0.3),
    )
    assert sorted(makers(found, entries)) == sorted(["S", *["A<S", "B<S", "F<S", "Leaf<F"] * 2])
    a, b, f = (frames_of(found, entries, name) for name in "ABF")
    assert a == b == f
    assert len(set(a)) == 2


def test_geometry_nodes_that_pick_members_place_each_apart():
    """The same paths as one placement of two members, but moved differently."""
    entries = [node("S", (), "S")]
    for i, x in enumerate((0.0, 100.0)):
        entries += [node("S", (i, 0), "A", x + 0.1), node("S", (i, 1), "B", x + 10.2)]
    found = resolve_entries(
        entries,
        S=makes(own=True, scatters=True),
        A=makes(stands_x=0.1),
        B=makes(stands_x=0.2),
    )
    frames = frames_of(found, entries, "A") + frames_of(found, entries, "B")
    assert len(set(frames)) == 4


def test_members_that_stand_nowhere_are_placed_apart():
    entries = [node("S", (), "S"), node("S", (0, 0), "A"), node("S", (0, 1), "B")]
    found = resolve_entries(entries, S=makes(scatters=True), A=makes(stands_x=None), B=makes())
    assert frames_of(found, entries, "A") != frames_of(found, entries, "B")


def test_particles_place_whole_collections_by_particle():
    entries = [node("P", (), "P")]
    for i in range(3):
        entries += [node("P", (0, i), name, i, by_particles=True) for name in ("A", "B")]
    found = resolve_entries(entries, P=makes(scatters=True))
    assert frames_of(found, entries, "A") == frames_of(found, entries, "B")
    assert len(set(frames_of(found, entries, "A"))) == 3


def test_vertex_duplicates_share_their_vertex_and_find_their_own_instancer():
    entries = [node("P", (), "P")]
    for i in range(2):
        entries += [
            node("P", (i,), "A"),
            node("P", (i,), "F", mesh=-1),
            node("P", (i,), "G"),
            node("P", (i, 0), "Leaf"),
        ]
    found = resolve_entries(
        entries,
        P=makes("VERTS"),
        A=makes(ancestors="P"),
        F=makes("COLLECTION", "Leaf", ancestors="P"),
        G=makes(ancestors="A P"),
    )
    assert sorted(makers(found, entries)) == sorted(["P", *["A<P", "F<P", "G<P", "Leaf<F"] * 2])
    assert frames_of(found, entries, "A") == frames_of(found, entries, "G")


def test_the_order_of_entries_does_not_matter():
    entries = [node("E", (), "E", mesh=-1), node("Z", (), "Z", 3.0)]
    entries += [node("E", (i,), f"M{i}", float(i)) for i in range(6)]
    members = " ".join(f"M{i}" for i in range(6))
    first = resolve_entries(entries, E=makes("COLLECTION", members))
    for seed in range(5):
        shuffled = random.Random(seed).sample(entries, len(entries))
        again = resolve_entries(shuffled, E=makes("COLLECTION", members))
        assert first.mesh_order == again.mesh_order
        for name, array in first.arrays.items():
            assert np.array_equal(array, again.arrays[name]), name


def test_the_order_of_a_collections_members_does_not_matter():
    def listed(*names: str) -> Placements:
        entries = [node("E", (), "E", mesh=-1)]
        entries += [node("E", (i,), n, float(ord(n)), mesh=ord(n)) for i, n in enumerate(names)]
        return resolve_entries(entries, E=makes("COLLECTION", "A B C"))

    first, again = listed("A", "B", "C"), listed("C", "A", "B")
    assert first.mesh_order == again.mesh_order == [65, 66, 67]
    for name, array in first.arrays.items():
        assert np.array_equal(array, again.arrays[name]), name


def test_a_surface_in_part_held_out_is_two_surfaces_of_one_occurrence():
    entries = [node("A", (), "A", mesh=3, holdout_mesh=7)]
    arrays = resolve_entries(entries).arrays
    assert arrays["surface_occurrence"].tolist() == [0, 0]
    assert arrays["surface_holdout"].tolist() == [0, 1]
    assert resolve_entries(entries).mesh_order == [3, 7]


@pytest.mark.parametrize("n", [70_000])
def test_many_placements_take_little_time(n):
    entries = [node("S", (), "S")]
    entries += [node("S", (i, 0), "A", float(i)) for i in range(n)]
    found = resolve_entries(entries, S=makes(scatters=True))
    assert len(set(frames_of(found, entries, "A"))) == n


def test_hair_belongs_to_the_occurrence_that_grows_it():
    entries = [node("Tuft", (), "Tuft", mesh=0), node("Tuft", (), "Tuft", mesh=3)]
    entries += [node("Box", (4,), "Tuft", mesh=0), node("Box", (4,), "Tuft", mesh=5)]
    found = resolve_entries(entries, Box=makes("COLLECTION", "Tuft"))
    arrays = found.arrays
    assert makers(found, entries) == ["Box", "Tuft<Box", "Tuft"]
    assert arrays["surface_occurrence"].tolist() == [1, 1, 2, 2]
    assert [found.mesh_order[i] for i in arrays["surface_mesh"]] == [0, 5, 0, 3]


def test_points_are_placements_of_their_own_occurrence():
    places = np.zeros((3, 3, 4))
    places[:, 0, 3] = (7, 8, 9)
    cloud = Scatter(mesh=np.array([4, 2, 4]), world_from_mesh=places, holdout=True)
    entries = [node("A", (), "A", mesh=0), node("C", (), "C", mesh=1)]
    entries.append(node("B", (), "B", mesh=-1, scatter=cloud))
    found = resolve_entries(entries)
    arrays = found.arrays
    assert arrays["surface_occurrence"].tolist() == [0, 1, 1, 1, 2]
    assert arrays["surface_holdout"].tolist() == [0, 1, 1, 1, 0]
    assert arrays["world_from_mesh"][:, 0, 3].tolist() == [0, 7, 8, 9, 0]
    assert found.mesh_order == [0, 4, 2, 1]
    assert arrays["surface_mesh"].tolist() == [0, 1, 2, 1, 3]


def test_one_object_placed_twice_at_one_place_is_two():
    entries = [node("S", (), "S"), node("S", (0,), "A"), node("S", (1,), "A")]
    found = resolve_entries(entries, S=makes(own=True, scatters=True))
    assert len(set(frames_of(found, entries, "A"))) == 2


def test_members_that_follow_each_other_are_one_placement_until_one_comes_again():
    entries = [node("S", (), "S")]
    for i, x in enumerate((0.0, 10.0)):
        entries += [node("S", (2 * i,), "A", x), node("S", (2 * i + 1,), "B", x)]
    found = resolve_entries(entries, S=makes(own=True, scatters=True))
    a, b = (frames_of(found, entries, name) for name in "AB")
    assert a == b
    assert len(set(a)) == 2


def test_objects_moved_alike_under_different_paths_are_placed_apart():
    entries = [node("S", (), "S"), node("S", (0, 0), "A"), node("S", (1, 0), "B")]
    found = resolve_entries(entries, S=makes(own=True, scatters=True))
    assert frames_of(found, entries, "A") != frames_of(found, entries, "B")


@pytest.mark.parametrize(("apart", "one"), [(5.0, True), (20.0, False)])
def test_moved_alike_is_within_a_share_of_the_distance(apart, one):
    entries = [node("S", (), "S"), node("S", (0,), "A", 1e5), node("S", (1,), "B", 1e5 + apart)]
    found = resolve_entries(entries, S=makes(own=True, scatters=True))
    assert (frames_of(found, entries, "A") == frames_of(found, entries, "B")) == one


def test_what_follows_an_even_index_is_not_of_the_one_before():
    entries = [node("S", (), "S"), node("S", (1,), "E", mesh=-1), node("S", (2, 0), "M")]
    found = resolve_entries(entries, S=makes(scatters=True), E=makes("COLLECTION", "M"))
    assert "M<S" in makers(found, entries)


def test_of_two_that_could_have_made_it_the_first_by_name_did():
    entries = [
        node("S", (), "S", mesh=-1),
        node("S", (0,), "G", mesh=-1),
        node("S", (0,), "F", mesh=-1),
        node("S", (0, 0), "M"),
    ]
    both = {"F": makes("COLLECTION", "M"), "G": makes("COLLECTION", "M")}
    for order in (entries, entries[::-1]):
        found = resolve_entries(order, S=makes("COLLECTION", "F G"), **both)
        assert "M<F" in makers(found, order)


def test_surfaces_of_an_occurrence_stay_in_order():
    entries = [node("S", (i,) if i else (), "S", float(i), mesh=i % 3) for i in range(200)]
    found = resolve_entries(entries, S=makes(own=True, scatters=True))
    assert set(found.arrays["surface_occurrence"].tolist()) == {0}
    assert found.arrays["world_from_mesh"][:, 0, 3].tolist() == list(range(200))
