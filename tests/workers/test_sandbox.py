"""The sandbox against hostile programs, without Blender: with bubblewrap and without."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest
from waiting import until

from legoworld.workers.descendants import descendants
from legoworld.workers.protections import SandboxUnavailableError, protections
from legoworld.workers.sandbox import Ending, Sandbox, SandboxLimits

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="namespaces and /proc are Linux's")
#: Time is only for what never ends.
LIMITS = SandboxLimits(time_s=300.0, memory_bytes=1 << 30)


@pytest.fixture
def run(confinement, tmp_path):
    """Run a program's text to its end; the folder it could write to is `run.scratch`."""

    def run(program: str, limits: SandboxLimits = LIMITS, inputs: tuple[Path, ...] = ()) -> Ending:
        scratch = tmp_path / "scratch"
        scratch.mkdir()
        run.scratch = scratch  # pyright: ignore[reportFunctionMemberAccess]
        code = textwrap.dedent(program)
        with Sandbox(scratch, limits, protections(confinement), owner=scratch) as sandbox:
            sandbox.start([sys.executable, "-c", code], inputs)
            run.keeper = sandbox._keeper.pid  # pyright: ignore[reportFunctionMemberAccess, reportOptionalMemberAccess]
            ending = sandbox.wait()
            assert descendants(run.keeper) == []  # pyright: ignore[reportFunctionMemberAccess]
        return ending

    return run


def alive(name: str) -> list[int]:
    """Processes whose command line holds a name."""
    found = []
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit() and int(folder.name) != os.getpid():
            try:
                if name.encode() in (folder / "cmdline").read_bytes():
                    found.append(int(folder.name))
            except OSError:
                continue
    return found


def test_exit_codes_signals_and_the_last_words_come_back(run):
    ending = run("import sys; print('it was me'); sys.exit(7)")
    assert (ending.code, ending.over, ending.last_output) == (7, None, "it was me\n")


def test_a_crash_is_a_signal(run):
    assert run("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)").code == -signal.SIGSEGV


@pytest.mark.parametrize("code", [1, 127, 128, 137, 139, 192, 255])
def test_an_exit_code_is_no_signal(run, code):
    """Bubblewrap says 139 of a program that crashed, and of one that ended with 139."""
    assert run(f"import os; os._exit({code})").code == code


@pytest.mark.parametrize("number", [signal.SIGABRT, signal.SIGKILL, signal.SIGTERM])
def test_a_signal_is_no_exit_code(run, number):
    assert run(f"import os; os.kill(os.getpid(), {int(number)})").code == -number


def test_both_ends_of_the_output_are_kept(run):
    ending = run("print('first'); print('x' * 200_000); print('last')")
    assert ending.first_output.startswith("first\nxxx")
    assert ending.last_output.endswith("xxx\nlast\n")
    assert len(ending.first_output) == len(ending.last_output) == 64 << 10


def test_a_program_sees_no_variable_that_is_not_named(run, monkeypatch):
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "hidden-value")
    monkeypatch.setenv("HF_TOKEN", "hidden-value")
    program = "import os; print(dict(os.environ)); print(open('/proc/self/environ').read())"
    printed = run(program).last_output
    assert "hidden-value" not in printed
    assert "PYTHONHASHSEED" in printed
    assert str(Path.home()) + "'" not in printed


def test_a_program_holds_its_three_descriptors_only(run):
    program = "import os; print(sorted(int(n) for n in os.listdir('/proc/self/fd')))"
    assert run(program).last_output == "[0, 1, 2, 3]\n"  # 3: the listing itself


DOUBLE_FORK = """
    import os, sys, time
    if os.fork() == 0:
        os.setsid()
        if os.fork() == 0:
            os.execv(sys.executable, [sys.executable, "-c", "import time; time.sleep(600)", NAME])
        os._exit(0)
    os.wait()
    END
"""


@pytest.mark.parametrize("end", ["pass", "time.sleep(600)"], ids=["ends", "hangs"])
def test_what_a_program_starts_does_not_outlive_it(run, end, tmp_path):
    """However it was forked away, and whether the program ends or is ended."""
    name = f"escaped-{os.getpid()}-{tmp_path.name}"
    program = DOUBLE_FORK.replace("NAME", repr(name)).replace("END", end)
    limits = SandboxLimits(time_s=1.0 if end != "pass" else 300.0, memory_bytes=1 << 30)
    ending = run(program, limits)
    assert ending.over == ("time" if end != "pass" else None)
    assert alive(name) == []


def test_the_memory_of_children_counts(run):
    program = """
        import os, time
        for _ in range(4):
            if os.fork() == 0:
                held = bytearray(80 << 20)
                time.sleep(600)
        time.sleep(600)
    """
    ending = run(program, SandboxLimits(time_s=300.0, memory_bytes=200 << 20))
    assert ending.over == "memory"


def test_memory_that_forks_share_counts_once(run):
    program = """
        import os, time
        held = bytearray(b'x') * (80 << 20)
        for _ in range(4):
            if os.fork() == 0:
                time.sleep(600)
        time.sleep(600)
    """
    ending = run(program, SandboxLimits(time_s=1.5, memory_bytes=200 << 20))
    assert ending.over == "time"


def test_a_flood_of_output_is_cut(run):
    began = time.process_time()
    ending = run("while True: print('x' * 10000)")
    assert ending.over == "output"
    assert len(ending.last_output) <= 64 << 10
    assert time.process_time() - began < 60  # of CPU; a tenth of a second is usual


def test_a_file_cannot_be_larger_than_the_limit(run):
    program = """
        with open("big", "wb") as stream:
            for _ in range(64):
                stream.write(bytes(1 << 20))
    """
    ending = run(program, SandboxLimits(time_s=300.0, memory_bytes=1 << 30, disk_bytes=8 << 20))
    assert (ending.code == 1 and "File too large" in ending.last_output) or ending.over == "disk"
    assert (run.scratch / "empty" / "big").stat().st_size <= 8 << 20


def test_many_files_together_cannot_be_larger_than_the_limit(run):
    program = """
        import os, time
        for n in range(16):
            with open(str(n), "wb") as stream:
                stream.write(os.urandom(1 << 20))  # zeros take no room on some file systems
        time.sleep(600)
    """
    ending = run(program, SandboxLimits(time_s=300.0, memory_bytes=1 << 30, disk_bytes=8 << 20))
    assert ending.over == "disk"


def test_shared_memory_is_counted_with_the_files(confined_run):
    """Nothing maps it, so it is in no process's memory: bubblewrap's own /dev/shm took 12 GiB."""
    program = """
        import os, time
        for n in range(16):
            with open(f"/dev/shm/{n}", "wb") as stream:
                stream.write(os.urandom(1 << 20))
        time.sleep(600)
    """
    limits = SandboxLimits(time_s=300.0, memory_bytes=1 << 30, disk_bytes=8 << 20)
    assert confined_run(program, limits).over == "disk"


def test_shared_memory_serves_what_it_is_for(run):
    program = """
        from multiprocessing import Lock, shared_memory
        with Lock():
            memory = shared_memory.SharedMemory(create=True, size=1 << 20)
        memory.buf[:4] = b"word"
        other = shared_memory.SharedMemory(memory.name)
        print(bytes(other.buf[:4]))
        other.close()
        memory.close()
        memory.unlink()
    """
    ending = run(program)
    assert ending.code == 0, ending.last_output
    assert "b'word'" in ending.last_output


def test_a_fork_bomb_is_ended(run, tmp_path):
    # It ends at 64: other tests need processes, too. Where the kernel counts them, 64 still may be.
    program = """
        import os, time
        try:
            for _ in range(6):
                os.fork()
        except BlockingIOError:
            print("the machine has no more", flush=True)
        time.sleep(600)
    """
    ending = run(program, SandboxLimits(time_s=60.0, memory_bytes=4 << 30, processes=20))
    refused = "the machine has no more" in ending.last_output
    assert ending.over == "processes" or (ending.over == "time" and refused)


def test_a_program_that_kills_its_whole_group_harms_itself_only(run):
    assert run("import os, signal; os.killpg(0, signal.SIGKILL)").code == -signal.SIGKILL


def test_a_program_that_kills_its_witness_has_ended(confined_run):
    program = "import os, signal, time; os.kill(os.getppid(), signal.SIGKILL); time.sleep(600)"
    assert confined_run(program).code == -signal.SIGKILL


@pytest.mark.parametrize(("word", "code"), [("", 139), ("x", 0), ("9" * 400, 255)])
def test_a_program_that_speaks_for_its_witness_spoils_its_own_verdict(confined_run, word, code):
    program = f"""
        import os, signal
        os.write(os.open(f"/proc/{{os.getppid()}}/fd/3", os.O_WRONLY), {word!r}.encode())
        os._exit(139)
    """
    assert confined_run(program).code == code


def test_killed_with_legoworld_nothing_is_left(confinement, tmp_path):
    """kill -9 of the process that has a sandbox: neither a process nor the folder stays."""
    scratch = tmp_path / "scratch"
    name = f"orphan-{os.getpid()}-{confinement}"
    # In pieces: the owner's own command line is not to hold the name.
    program = DOUBLE_FORK.replace("NAME", " + ".join(map(repr, name))).replace(
        "END", "time.sleep(600)"
    )
    owner = f"""
import sys, pathlib
from legoworld.workers.protections import protections
from legoworld.workers.sandbox import Sandbox, SandboxLimits
scratch = pathlib.Path({str(scratch)!r})
scratch.mkdir()
sandbox = Sandbox(scratch, SandboxLimits(time_s=600.0, memory_bytes=1 << 30),
                  protections({confinement!r}), owner=scratch)
sandbox.start([sys.executable, "-c", {textwrap.dedent(program)!r}], [])
sandbox.wait()
"""
    with subprocess.Popen([sys.executable, "-c", owner]) as process:
        until(lambda: alive(name))
        process.kill()
    until(lambda: not alive(name) and not scratch.exists())


@pytest.fixture
def confined_run(run, confinement):
    if confinement != "bubblewrap":
        pytest.skip("only bubblewrap holds this")
    return run


def test_bubblewrap_shows_nothing_of_the_callers(confined_run, tmp_path, monkeypatch):
    private = tmp_path / "private.txt"
    private.write_text("secret")
    program = f"""
        import os
        print(os.path.exists({str(private)!r}), os.path.exists({str(Path.home())!r} + "/.bashrc"))
        print(os.path.exists("/etc/passwd"), os.path.exists({str(Path(__file__))!r}))
        print(sorted(n for n in os.listdir("/proc") if n.isdigit()), os.getcwd())
    """
    printed = confined_run(program).last_output.splitlines()
    assert printed[:2] == ["False False", "False False"]
    # Bubblewrap, the witness and the program.
    assert printed[2] == "['1', '2', '3'] /sandbox/empty"


def test_bubblewrap_shows_inputs_read_only(confined_run, tmp_path):
    texture = tmp_path / "textures" / "wood.txt"
    texture.parent.mkdir()
    texture.write_text("grain")
    program = f"""
        path = {str(texture)!r}
        print(open(path).read())
        for place in (path, "/usr/here", "/here", "/dev/here"):
            try:
                open(place, "w")
            except OSError as error:
                print(error.strerror)
        open("/tmp/here", "w").write("x")
    """
    ending = confined_run(program, inputs=(texture.parent,))
    assert ending.last_output.splitlines() == ["grain", *["Read-only file system"] * 4]
    assert ending.code == 0
    assert texture.read_text() == "grain"


def test_bubblewrap_has_no_network(confined_run):
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        program = f"import socket; socket.create_connection(('127.0.0.1', {port}), 5)"
        ending = confined_run(program)
    assert "Connection refused" in ending.last_output or "unreachable" in ending.last_output


def test_what_holds_is_said():
    held = protections("limits")
    assert set(held.does_not_hold) == {
        "network", "files", "other processes", "environment", "child processes ended"
    }  # fmt: skip
    assert not set(held.holds) & set(held.does_not_hold)


def test_bubblewrap_that_cannot_run_is_said_and_can_be_demanded(monkeypatch):
    monkeypatch.setattr(
        "legoworld.workers.protections.find_bubblewrap", lambda: "bubblewrap is not installed"
    )
    assert protections("auto").why_not == "bubblewrap is not installed"
    assert "network" in protections("auto").does_not_hold
    with pytest.raises(SandboxUnavailableError, match="apt-get install bubblewrap"):
        protections("bubblewrap")
    monkeypatch.setattr(
        "legoworld.workers.protections.find_bubblewrap", lambda: "it cannot make namespaces here"
    )
    with pytest.raises(SandboxUnavailableError, match="next: allow user namespaces"):
        protections("bubblewrap")
