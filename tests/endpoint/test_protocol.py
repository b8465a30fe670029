"""Blender MCP's socket protocol, spoken with a real Blender without a display."""

from __future__ import annotations

import json
import threading

import cv2
import numpy as np
import pytest
from endpoint.clients import serve_session
from waiting import until

pytestmark = pytest.mark.blender


@pytest.fixture(scope="module")
def endpoint(tmp_path_factory):
    with serve_session(tmp_path_factory.mktemp("endpoint")) as found:
        yield found


@pytest.fixture
def client(endpoint):
    found = endpoint.client()
    yield found
    found.line.close()


def test_code_runs_and_what_it_prints_is_the_answer(client):
    assert client.run("print(bpy.app.background, 1 + 1)") == "True 2\n"


def test_each_call_has_a_namespace_of_its_own_and_the_scene_stays(client):
    client.run("mine = 5\nbpy.context.scene['kept'] = 7")
    assert "NameError" in client.refused("print(mine)")
    assert client.run("print(bpy.context.scene['kept'])") == "7\n"


def test_an_error_says_type_message_and_the_line_of_the_code(client):
    said = json.loads(client.refused("x = 1\nraise ValueError('no such chair')"))
    assert said["exception_type"] == "ValueError"
    assert said["message"] == "no such chair"
    assert 'File "<code>", line 2' in said["traceback"]
    assert "endpoint_calls" not in said["traceback"]


@pytest.mark.parametrize(
    "code", ["exit()", "import sys; sys.exit(0)", "bpy.ops.wm.quit_blender()", "quit()"]
)
def test_leaving_is_an_end_like_any_other(client, code):
    client.run("bpy.context.scene['before'] = 1")
    client.run(code)
    assert client.run("print(bpy.context.scene['before'])") == "1\n"


def test_scene_and_object_info_are_what_the_add_on_says(client):
    client.run("bpy.ops.wm.read_factory_settings()")
    scene = client.ask("get_scene_info")["result"]
    assert scene["object_count"] == 3
    assert scene["objects"][0] == {"name": "Cube", "type": "MESH", "location": [0.0, 0.0, 0.0]}
    cube = client.ask("get_object_info", name="Cube")["result"]
    assert cube["world_bounding_box"] == [[-1.0] * 3, [1.0] * 3]
    assert cube["mesh"] == {"vertices": 8, "edges": 12, "polygons": 6}
    assert client.ask("get_object_info", name="Sofa") == {
        "status": "error",
        "message": "Object not found: Sofa",
    }


def test_a_screenshot_is_a_render_from_the_camera_and_changes_nothing(endpoint, client):
    client.run("bpy.ops.wm.read_factory_settings()")
    client.run(
        "import bpy\nr = bpy.context.scene.render\nr.engine = 'BLENDER_EEVEE'\nr.resolution_x = 640"
    )
    rows = len(endpoint.session.record.checkpoints)
    path = endpoint.workspace / "look.png"
    answer = client.ask("get_viewport_screenshot", filepath=str(path), max_size=200)
    assert (answer["result"]["width"], answer["result"]["height"]) == (119, 200)
    picture = cv2.imread(str(path))
    assert picture.shape[:2] == (200, 119)
    assert np.unique(picture.reshape(-1, 3), axis=0).shape[0] > 50
    assert client.run("r = bpy.context.scene.render; print(r.engine, r.resolution_x)") == (
        "BLENDER_EEVEE 640\n"
    )
    assert len(endpoint.session.record.checkpoints) == rows


def test_a_picture_of_extreme_aspect_has_the_size_that_the_answer_states(endpoint, client):
    client.run("bpy.ops.wm.read_factory_settings()")
    path = endpoint.workspace / "thin.png"
    for pixels, aspect, size in (
        ((4, 8000), (1, 1), (4, 16)),
        ((8000, 4), (1, 1), (16, 4)),
        ((64, 64), (2, 1), (16, 8)),
        ((64, 64), (1, 2), (8, 16)),
    ):
        client.run(
            "r = bpy.context.scene.render\n"
            f"r.resolution_x, r.resolution_y = {pixels}\n"
            f"r.pixel_aspect_x, r.pixel_aspect_y = {aspect}"
        )
        answer = client.ask("get_viewport_screenshot", filepath=str(path), max_size=3)
        assert (answer["result"]["width"], answer["result"]["height"]) == size
        assert cv2.imread(str(path)).shape[:2] == size[::-1]


def test_without_a_camera_a_screenshot_says_so(endpoint, client):
    client.run("bpy.context.scene.camera = None")
    path = endpoint.workspace / "none.png"
    answer = client.ask("get_viewport_screenshot", filepath=str(path), max_size=64)
    assert "no active camera" in answer["result"]["error"]
    assert not path.exists()


def test_export_writes_to_the_workspace_alone(endpoint, client, tmp_path):
    inside = endpoint.workspace / "out" / "scene.glb"
    assert client.ask("export_scene", filepath=str(inside))["result"]["path"] == str(inside)
    assert inside.read_bytes()[:4] == b"glTF"
    outside = tmp_path / "scene.glb"
    assert client.ask("export_scene", filepath=str(outside))["status"] == "error"
    assert not outside.exists()


def test_a_screenshot_is_not_written_over_anything_outside(endpoint, client, tmp_path):
    client.run("bpy.ops.wm.read_factory_settings()")
    precious = tmp_path / "precious.png"
    precious.write_text("mine")
    link = endpoint.workspace / "link.png"
    link.symlink_to(precious)
    for path in (precious, "/etc/look.png", f"{endpoint.workspace}/a\0.png", "\0", ""):
        answer = client.ask("get_viewport_screenshot", filepath=str(path), max_size=32)
        assert answer["status"] == "error", path
    assert client.ask("export_scene", filepath="a\0.glb")["status"] == "error"
    answer = client.ask("get_viewport_screenshot", filepath=str(link), max_size=32)
    assert answer["status"] == "success"
    assert not link.is_symlink()
    assert precious.read_text() == "mine"


def test_messages_with_newlines_are_answered_with_newlines(endpoint):
    client = endpoint.client()
    client.line.sendall(b'{"type": "ping"}\n{"type": "get_scene_info"}\n')
    data = b""
    while data.count(b"\n") < 2:
        data += client.line.recv(4096)
    first, second = (json.loads(line) for line in data.splitlines())
    assert first == {"status": "success", "result": {"pong": True}}
    assert second["result"]["name"] == "Scene"


def test_large_messages_both_ways(client):
    text = "ä" * 3_000_000
    assert client.run(f"x = {text!r}\nprint(len(x))") == "3000000\n"
    printed = client.run("print('y' * 700_000)")
    assert printed == "y" * 700_000 + "\n"


def test_more_print_than_an_answer_holds_keeps_both_ends(client):
    printed = client.run("print('begin'); print('x' * 30_000_000); print('end')")
    assert printed.startswith("begin\n")
    assert printed.endswith("end\n")
    assert len(printed) < 2_000_000
    assert "characters are left out" in printed


@pytest.mark.parametrize(
    "sent",
    [b'{"type": 5}', b'{"params": {}}', b"[]", b'{"type": "execute_code", "params": []}', b"{]"],
)
def test_what_is_no_command_is_answered_and_the_line_stays(endpoint, sent):
    client = endpoint.client()
    client.line.sendall(sent)
    assert client.receive()["status"] == "error"
    assert client.ask("ping")["status"] == "success"


def test_what_is_no_json_is_answered_and_the_line_closed(endpoint):
    client = endpoint.client()
    client.line.sendall(b"GET / HTTP/1.1\r\n\r\n")
    assert client.receive()["status"] == "error"
    assert client.line.recv(10) == b""


@pytest.mark.parametrize("params", [{}, {"code": 5}, {"code": "", "more": 1}])
def test_wrong_parameters_are_an_answer(client, params):
    assert client.ask("execute_code", **params)["status"] == "error"


def test_an_unknown_command_is_the_add_on_s_error(client):
    answer = client.ask("get_hunyuan3d_statistics")
    assert answer["message"] == "Unknown command type: get_hunyuan3d_statistics"


def test_two_clients_get_their_own_answers(endpoint):
    said: dict[int, list[str]] = {1: [], 2: []}

    def work(number: int) -> None:
        client = endpoint.client()
        for step in range(20):
            said[number].append(client.run(f"print({number}, {step})"))

    threads = [threading.Thread(target=work, args=(number,)) for number in said]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert said == {n: [f"{n} {step}\n" for step in range(20)] for n in said}


def test_a_client_that_vanishes_takes_nothing_with_it(endpoint, client):
    other = endpoint.client()
    code = "import time; time.sleep(1); bpy.context.scene['late'] = 3; print('x' * 1_000_000)"
    other.line.sendall(json.dumps({"type": "execute_code", "params": {"code": code}}).encode())
    half = endpoint.client()
    half.line.sendall(b'{"type": "execute_code", "params": {"code": "pri')
    half.line.close()
    calls = endpoint.session.record.calls
    before = len(calls)
    until(lambda: endpoint.session._busy.locked() or len(calls) > before, "the call")
    other.line.close()
    assert client.run("print(bpy.context.scene['late'])") == "3\n"
