"""The key of a cached snapshot covers all code that decides what is in one."""

from __future__ import annotations

import ast
import functools
from pathlib import Path

import legoworld
from legoworld.scene import cache

PACKAGE = Path(legoworld.__file__).parent

#: What makes a snapshot: the requests of the Blender process, and the readers of a .glb.
STARTS = (
    "scene/blender/worker.py",
    "scene/gltf/snapshot.py",
    "scene/gltf/container.py",
    "scene/gltf/draco_worker.py",
)

#: Its imports of the API are made when a name of it is asked for, which no reader does.
LAZY = PACKAGE / "__init__.py"

#: Imported, and no part of what a snapshot holds: words of verdicts, which are never cached, the
#: version, and names and folders of scenes.
NOT_IN_A_SNAPSHOT = ("__init__.py", "scene/__init__.py", "errors.py", "exit_codes.py",
                     "pluralize.py", "extras.py", "scene/folder.py",
                     # how a program that was executed ended
                     "scene/programs/report.py", "records/base.py", "records/scene_folder.py",
                     # the types of what the process is asked, which no code that runs looks into
                     "scene/requests.py", "records/bench_dataset.py", "records/joints.py",
                     "records/render_card.py", "records/track.py",
                     # the names of USD's labels, which only its import looks for
                     "scene/usd_labels.py",
                     # what a transaction compares, beside the snapshot
                     "records/plugin_state.py")  # fmt: skip


def imported_files(path: Path) -> set[Path]:
    """The package's files that a file imports, inside functions and for types, too."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name} imports relatively"
            names |= {str(node.module), *(f"{node.module}.{alias.name}" for alias in node.names)}
    files = set()
    for name in names:
        place = PACKAGE.parent.joinpath(*name.split("."))
        files |= {p for p in (place.with_suffix(".py"), place / "__init__.py") if p.is_file()}
    return {path for path in files if path.is_relative_to(PACKAGE)}


@functools.cache
def reached_files() -> set[str]:
    todo, seen = [PACKAGE / name for name in STARTS], set()
    while todo:
        path = todo.pop()
        if path not in seen:
            seen.add(path)
            todo += imported_files(path) if path != LAZY else []
    return {path.relative_to(PACKAGE).as_posix() for path in seen}


def test_every_module_that_a_reader_imports_is_in_the_key():
    known = {path.relative_to(PACKAGE).as_posix() for path in cache.reader_sources()}
    assert len(reached_files()) > 40
    assert reached_files() - known - set(NOT_IN_A_SNAPSHOT) == set()


def test_nothing_in_the_key_or_left_out_of_it_is_there_for_no_reason():
    in_folders = ("scene/blender/", "scene/gltf/")
    known = {path.relative_to(PACKAGE).as_posix() for path in cache.reader_sources()}
    assert {name for name in known if not name.startswith(in_folders)} - reached_files() == set()
    assert set(NOT_IN_A_SNAPSHOT) - reached_files() <= {"scene/__init__.py"}


def test_a_changed_byte_or_name_of_any_source_changes_the_key(tmp_path, monkeypatch):
    copies = []
    for i in range(3):
        copies.append(tmp_path / f"{i}.py")
        copies[-1].write_text(f"x = {i}\n")
    monkeypatch.setattr(cache, "reader_sources", lambda: copies)

    def key():
        cache.reader_sha256.cache_clear()
        return cache.reader_sha256()

    try:
        keys = [key()]
        for path in copies:
            path.write_text(path.read_text() + "#\n")
            keys.append(key())
        copies[0] = copies[0].rename(tmp_path / "renamed.py")
        keys.append(key())
    finally:
        cache.reader_sha256.cache_clear()
    assert len(set(keys)) == 5
