"""What an agent's code cannot do, and that a crash, a hang or a limit is an answer."""

from __future__ import annotations

import os
import re
import socket
from dataclasses import replace
from pathlib import Path

import pytest
from endpoint.clients import LIMITS, serve_session
from workers.confinements import bubblewrap_or_skip

from legoworld.workers.descendants import descendants
from legoworld.workers.sandbox import SandboxLimits

pytestmark = pytest.mark.blender


@pytest.fixture
def bubblewrap():
    bubblewrap_or_skip()


CUBE = "bpy.ops.mesh.primitive_cube_add(location=(5, 0, 0))"
COUNT = "print(len(bpy.data.objects))"


def test_secrets_of_the_caller_do_not_reach_the_code(confinement, tmp_path, monkeypatch):
    monkeypatch.setenv("OPENAI_API_KEY", "very-secret")
    with serve_session(tmp_path, confinement=confinement) as endpoint:
        printed = endpoint.client().run("import os; print(dict(os.environ))")
    assert "very-secret" not in printed
    assert str(Path.home()) + "'" not in printed


def test_nothing_is_written_outside_of_the_workspace(bubblewrap, tmp_path):
    with serve_session(tmp_path) as endpoint:
        client = endpoint.client()
        client.run("open('inside.txt', 'w').write('x')")
        assert (endpoint.workspace / "inside.txt").read_text() == "x"
        mine = [tmp_path / "outside.txt", Path.home() / "x", Path("/etc/x")]
        for path in (*mine, tmp_path / "record" / "calls.jsonl"):
            # In its own /tmp it may; that is not this one.
            client.ask("execute_code", code=f"open({str(path)!r}, 'w').write('spoiled')")
            assert not path.exists() or not path.read_text().startswith("spoiled")
        secret = tmp_path / "secret.txt"
        secret.write_text("very-secret")
        assert "FileNotFoundError" in client.refused(f"print(open({str(secret)!r}).read())")


@pytest.mark.parametrize("network", [False, True])
def test_there_is_a_network_only_where_it_is_given(bubblewrap, tmp_path, network):
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        code = f"import socket; print(socket.create_connection(('127.0.0.1', {port}), 3).fileno())"
        with serve_session(tmp_path, network=network) as endpoint:
            status = endpoint.client().ask("execute_code", code=code)["status"]
            held = endpoint.session._trial.protections
    assert status == ("success" if network else "error")
    assert ("network" in held.holds) is not network


@pytest.mark.parametrize(
    "crash",
    [
        "import os; os.kill(os.getpid(), 11)",
        "import ctypes; ctypes.string_at(0)",
        "import os; os._exit(3)",
        "import os; os.abort()",
    ],
)
def test_a_crash_is_an_answer_and_the_scene_survives(confinement, tmp_path, crash):
    with serve_session(tmp_path, confinement=confinement) as endpoint:
        client = endpoint.client()
        client.run(CUBE)
        said = client.refused("bpy.data.objects.remove(bpy.data.objects[0])\n" + crash)
        assert "as call 1 left it" in said
        assert client.run(COUNT) == "4\n"
        assert [c.status for c in endpoint.session.record.calls] == [
            "success",
            "crashed",
            "success",
        ]


def give_calls(endpoint, seconds: float) -> None:
    """The time of a call from now on: little for what never ends, plenty for what does."""
    session = endpoint.session
    session._trial = replace(session._trial, call_time_s=seconds)


PLENTY_S = 300.0


def test_code_that_does_not_end_is_stopped_and_the_scene_goes_on(confinement, tmp_path):
    with serve_session(tmp_path, confinement=confinement) as endpoint:
        client = endpoint.client()
        give_calls(endpoint, PLENTY_S)
        assert client.run(COUNT) == "3\n"
        for seconds in (1.0, 10.0, 60.0):  # a busy machine does not come to the loop in the first
            give_calls(endpoint, seconds)
            said = client.refused("if len(bpy.data.objects) == 3: " + CUBE + "\nwhile True: pass")
            assert f"stopped after {seconds:g} s" in said
            give_calls(endpoint, PLENTY_S)
            if client.run(COUNT) == "4\n":
                break
        give_calls(endpoint, 1.0)
        assert "stopped after 1 s" in client.refused("import time; time.sleep(1000)")
        give_calls(endpoint, PLENTY_S)
        assert client.run(COUNT) == "4\n"
        statuses = [c.status for c in endpoint.session.record.calls]
        assert (statuses[1], statuses[-2]) == ("timeout", "timeout")
        assert "crashed" not in statuses


def test_code_that_cannot_be_stopped_is_ended_with_its_blender(tmp_path, monkeypatch):
    monkeypatch.setattr("legoworld.endpoint.blender._GRACE_S", 2.0)
    stubborn = "import signal; signal.pthread_sigmask(0, [signal.SIGALRM])\nwhile True: pass"
    with serve_session(tmp_path) as endpoint:
        client = endpoint.client()
        give_calls(endpoint, PLENTY_S)
        client.run(CUBE)
        give_calls(endpoint, 1.0)
        said = client.refused(stubborn)
        assert "Blender was ended" in said
        give_calls(endpoint, PLENTY_S)
        assert client.run(COUNT) == "4\n"


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("x = bytearray(1200 << 20); x[::4096] = b'1' * len(x[::4096])\nwhile True: pass", "GiB"),
        (
            "import os\nwhile True: open(os.urandom(8).hex(), 'wb').write(os.urandom(20 << 20))",
            "GiB|No space|File too large",
        ),
        # Where the kernel itself counts processes, it is the code that is told. No more than
        # what it takes: others on this machine need processes, too.
        (
            "import os, time\nfor _ in range(6): os.fork()\ntime.sleep(3600)",
            "processes|Resource temporarily unavailable",
        ),
        ("import os\nwhile True: os.write(1, b'x' * 65536)", "MiB"),
    ],
)
def test_a_limit_is_an_answer(tmp_path, code, said):
    limits = SandboxLimits(
        time_s=600, memory_bytes=1 << 30, disk_bytes=100 << 20, output_bytes=4 << 20, processes=50
    )
    with serve_session(tmp_path, limits=limits) as endpoint:
        client = endpoint.client()
        client.run(CUBE)
        assert re.search(said, client.refused(code))
        for file in endpoint.workspace.iterdir():
            if file.suffix != ".blend":
                file.unlink()
        assert client.run(COUNT) == "4\n"


def test_the_trial_s_time_is_the_end(tmp_path):
    for seconds in (6.0, 30.0, 120.0):  # the first is over before a busy machine's Blender starts
        folder = tmp_path / f"{seconds:g}"
        limits = SandboxLimits(time_s=seconds, memory_bytes=LIMITS.memory_bytes)
        with serve_session(folder, limits=limits) as endpoint:
            client = endpoint.client()
            if client.ask("execute_code", code=CUBE)["status"] != "success":
                continue
            # The call's end and the trial's are one moment: either may be noticed first.
            assert re.search("stopped|over", client.refused("import time; time.sleep(600)"))
            assert "no further call is possible" in client.refused(COUNT)
            if endpoint.session.record.last("live") is not None:
                return
    raise AssertionError("no call came back within two minutes")


def test_what_the_agent_saved_is_kept_whatever_it_does_to_it_later(tmp_path):
    with serve_session(tmp_path) as endpoint:
        client = endpoint.client()
        path = str(endpoint.workspace / "scene.blend")
        client.run(f"bpy.ops.wm.save_as_mainfile(filepath={path!r})")
        saved = endpoint.session.record.last("saved")
        assert saved is not None
        before = endpoint.session.record.blend(saved).read_bytes()
        client.run(f"import os; os.remove({path!r}); os.symlink('/etc/passwd', {path!r})")
        client.run(COUNT)
        assert endpoint.session.record.last("saved") == saved
        assert endpoint.session.record.blend(saved).read_bytes() == before


def test_a_scene_to_begin_with_is_never_written(tmp_path, build_scenes):
    build_scenes("fresh(); camera(); quad('Mine'); save('given')", tmp_path)
    given = tmp_path / "given" / "scene.blend"
    before = given.read_bytes()
    with serve_session(tmp_path, blend=given) as endpoint:
        client = endpoint.client()
        assert client.run("print([o.name for o in bpy.data.objects])") == "['Camera', 'Mine']\n"
        client.run("bpy.data.objects['Mine'].location.x = 3\nbpy.ops.wm.save_mainfile()")
        client.refused("import os; os._exit(1)")
        client.run("bpy.ops.wm.save_mainfile()")
    assert given.read_bytes() == before


def test_the_same_folder_continues_with_the_last_scene(tmp_path):
    with serve_session(tmp_path) as endpoint:
        endpoint.client().run(CUBE)
    with serve_session(tmp_path) as endpoint:
        assert endpoint.client().run(COUNT) == "4\n"
        assert [c.number for c in endpoint.session.record.calls] == [1, 2]


def test_nothing_runs_when_it_is_closed(confinement, tmp_path):
    mine = descendants(os.getpid())
    with serve_session(tmp_path, confinement=confinement) as endpoint:
        endpoint.client().run("import os, time\nif not os.fork(): os.setsid(); time.sleep(999)")
    assert [p for p in descendants(os.getpid()) if p not in mine] == []
