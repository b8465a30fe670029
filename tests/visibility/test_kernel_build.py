"""The compiled kernel belongs to the sources beside it, and a missing compiler is explained."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest

import legoworld.visibility
from legoworld.errors import KernelBuildError
from legoworld.visibility import compilation, library

FOLDER = Path(legoworld.visibility.__file__).parent


@pytest.fixture
def copy(tmp_path):
    for path in [*compilation.sources(FOLDER), FOLDER / compilation.LIBRARY_NAME]:
        shutil.copy(path, tmp_path)
    return tmp_path


def test_the_sources_are_there():
    assert (FOLDER / "kernel.cpp") in compilation.sources(FOLDER)
    assert len(compilation.sources(FOLDER)) > 5


def test_a_library_of_these_sources_loads(copy):
    assert library.load_library(copy).lw_source_hash().decode() == compilation.source_hash(copy)


def test_a_library_without_sources_loads(copy):
    for path in compilation.sources(copy):
        path.unlink()
    library.load_library(copy)


def test_a_changed_source_makes_the_library_stale(copy):
    with (copy / "tile.hpp").open("a") as source:
        source.write("// changed\n")
    with pytest.raises(KernelBuildError, match=r"older than its sources.*pip install -e \."):
        library.load_library(copy)


def test_line_ends_do_not_make_it_stale(copy):
    for path in compilation.sources(copy):
        path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    library.load_library(copy)


def test_a_missing_library_says_what_to_do(tmp_path):
    with pytest.raises(KernelBuildError, match=r"was not compiled.*pip install"):
        library.load_library(tmp_path)


def test_a_broken_library_says_what_to_do(tmp_path):
    (tmp_path / compilation.LIBRARY_NAME).write_bytes(b"not a library")
    with pytest.raises(KernelBuildError, match="cannot be loaded"):
        library.load_library(tmp_path)


def test_no_compiler_names_what_to_install(monkeypatch):
    monkeypatch.delenv("CXX", raising=False)
    monkeypatch.setattr(compilation.shutil, "which", lambda _name: None)
    monkeypatch.setattr(compilation.importlib.util, "find_spec", lambda _name: None)
    with pytest.raises(
        compilation.CompilationError, match=r"apt install g\+\+.*pip install ziglang"
    ):
        compilation.compiler()


def test_ziglang_is_the_last_resort(monkeypatch):
    monkeypatch.delenv("CXX", raising=False)
    monkeypatch.setattr(compilation.shutil, "which", lambda _name: None)
    monkeypatch.setattr(compilation.importlib.util, "find_spec", lambda _name: object())
    assert compilation.compiler() == [sys.executable, "-m", "ziglang", "c++"]


def test_cxx_is_obeyed_and_checked(monkeypatch):
    monkeypatch.setenv("CXX", f"{sys.executable} -m something")
    assert compilation.compiler() == [sys.executable, "-m", "something"]
    monkeypatch.setenv("CXX", "no-such-compiler")
    with pytest.raises(compilation.CompilationError, match="no-such-compiler"):
        compilation.compiler()


def test_a_failed_compilation_leaves_no_library_and_shows_why(monkeypatch, tmp_path):
    (tmp_path / "kernel.cpp").write_text("this is not C++\n")
    monkeypatch.delenv("CXX", raising=False)
    try:
        compilation.compiler()
    except compilation.CompilationError:
        pytest.skip("no compiler here")
    with pytest.raises(compilation.CompilationError, match=r"(?s)could not be compiled.*error"):
        compilation.compile_kernel(tmp_path, tmp_path / "out" / "library.so")
    assert list((tmp_path / "out").iterdir()) == []


def test_names_and_contents_are_hashed_apart(tmp_path):
    def hashed(**files):
        folder = tmp_path / "-".join(map("".join, files.items()))
        folder.mkdir()
        for name, content in files.items():
            (folder / f"{name}.cpp").write_text(content)
        return compilation.source_hash(folder)

    hashes = {hashed(a="12", b="3"), hashed(a="1", b="23"), hashed(a="12", c="3")}
    assert len(hashes) == 3
    assert all(len(value) == 64 and int(value, 16) >= 0 for value in hashes)


def test_a_changed_shared_header_makes_every_library_stale(copy, monkeypatch, tmp_path):
    shared = tmp_path / "shared"
    shutil.copytree(compilation.SHARED, shared)
    monkeypatch.setattr(compilation, "SHARED", shared)
    library.load_library(copy)
    with (shared / "instruction_sets.hpp").open("a") as source:
        source.write("// changed\n")
    with pytest.raises(KernelBuildError, match="older than its sources"):
        library.load_library(copy)


def test_a_folder_is_compiled_by_the_first_compiler_there_is(monkeypatch, tmp_path):
    monkeypatch.delenv("CXX", raising=False)
    there = {"g++": "/there/g++", "clang++": "/there/clang++"}
    monkeypatch.setattr(compilation.shutil, "which", there.get)
    assert compilation.compiler() == ["/there/g++"]
    del there["g++"]
    assert compilation.compiler() == ["/there/clang++"]
    there["c++"] = "/there/c++"
    assert compilation.compiler() == ["/there/c++"]


def test_a_compiled_folder_knows_its_sources(monkeypatch, tmp_path):
    try:
        compilation.compiler()
    except compilation.CompilationError:
        pytest.skip("no compiler here")
    (tmp_path / "kernel.cpp").write_text(
        '#include "more.hpp"\n'
        'extern "C" __attribute__((visibility("default"))) const char* lw_source_hash() '
        "{ return LEGOWORLD_SOURCE_HASH; }\n"
    )
    (tmp_path / "more.hpp").write_text("#include <thread>\n")
    output = tmp_path / "not" / "there" / compilation.LIBRARY_NAME
    command = compilation.compile_kernel(tmp_path, output)
    assert str(tmp_path / "kernel.cpp") in command
    assert str(tmp_path / "more.hpp") not in command
    assert {*compilation.FLAGS, "-fPIC", "-pthread"} <= set(command)
    assert [path.name for path in output.parent.iterdir()] == [output.name]
    compilation.compile_kernel(tmp_path, output)  # again, over the first
    output.rename(tmp_path / output.name)
    loaded = library.open_library(tmp_path, "test's library")
    assert loaded.lw_source_hash().decode() == compilation.source_hash(tmp_path)
    (tmp_path / "more.hpp").write_text("// other\n")
    with pytest.raises(KernelBuildError, match="the test's library is older") as caught:
        library.open_library(tmp_path, "test's library")
    assert compilation.source_hash(tmp_path)[:12] in str(caught.value)


def test_what_only_unix_compilers_take_is_left_out_on_windows(monkeypatch, tmp_path):
    (tmp_path / "kernel.cpp").write_text("")
    fake = tmp_path / "compiler.py"
    fake.write_text("import pathlib, sys; pathlib.Path(sys.argv[-1]).touch()")
    monkeypatch.setenv("CXX", f"{sys.executable} {fake}")
    monkeypatch.setattr(compilation.sys, "platform", "win32")
    command = compilation.compile_kernel(tmp_path, tmp_path / "out" / "library.dll")
    assert not {"-fPIC", "-pthread"} & set(command)
    assert (tmp_path / "out" / "library.dll").exists()


def test_what_a_compiler_said_is_shown_as_it_wrote_it(monkeypatch, tmp_path):
    (tmp_path / "kernel.cpp").write_text("x\n")
    script = tmp_path / "says.py"
    script.write_text("import sys; sys.stderr.write('one: size\\n  two\\n'); sys.exit(1)\n")
    monkeypatch.setenv("CXX", f"{sys.executable} -X utf8 {script}")
    with pytest.raises(compilation.CompilationError) as caught:
        compilation.compile_kernel(tmp_path, tmp_path / "out" / "library.so")
    assert str(caught.value).endswith("\none: size\n  two")
