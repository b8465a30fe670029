"""The server of `legoworld view`: what it answers, to whom, and that its pages are the report's."""

from __future__ import annotations

import http.client
import json
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from urllib.parse import urlsplit

import pytest
from report.chromium import Browser, browser
from report.pages import evaluate
from waiting import until

import legoworld
from legoworld.errors import UsageError
from legoworld.viewing.pages import Pages
from legoworld.viewing.watched import Watch

PNG = b"\x89PNG\r\n\x1a\nand more"


@pytest.fixture(scope="module")
def top(tmp_path_factory):
    """A folder with a run and its evaluation, a picture, and a file that is none."""
    folder = tmp_path_factory.mktemp("watched")
    evaluate(folder / "results", "coco", images=4)
    (folder / "pictures").mkdir()
    (folder / "pictures" / "one.png").write_bytes(PNG)
    (folder / "pictures" / "text.png").write_bytes(b"no picture")
    (folder / "outside.png").symlink_to(folder / "pictures" / "one.png")
    return folder


@pytest.fixture(scope="module")
def served(top):
    view = legoworld.view(top, photos=top / "pictures")
    yield view
    view.close()


@pytest.fixture(scope="module")
def shown() -> Iterator[Browser]:
    with browser(viewport={"width": 1280, "height": 900}) as opened:
        yield opened


def ask(url: str, path: str, method: str = "GET", **headers: str):
    parts = urlsplit(url)
    connection = http.client.HTTPConnection(parts.hostname, parts.port)
    address = path if path.startswith("/") else parts.path + path
    connection.request(method, address, headers=headers)
    answer = connection.getresponse()
    answer.content = answer.read()
    connection.close()
    return answer


def test_the_state_is_sent_again_only_when_it_is_another(served):
    answer = ask(served.url, "state.json")
    state = json.loads(answer.content)
    assert {one["kind"] for one in state["sources"]} >= {"run", "evaluation"}
    assert all(one["problem"] is None for one in state["sources"])
    again = ask(served.url, "state.json", **{"If-None-Match": answer.headers["ETag"]})
    assert (again.status, again.content) == (304, b"")


def test_a_page_has_the_bytes_of_the_report(served, top, tmp_path):
    state = json.loads(ask(served.url, "state.json").content)
    name = next(one["name"] for one in state["sources"] if one["page"])
    answer = ask(served.url, f"report/{name}")
    assert answer.status == 303
    shown = ask(served.url, answer.headers["Location"])
    legoworld.write_report([top / name], tmp_path / "report.html", photos=top / "pictures")
    assert shown.content == (tmp_path / "report.html").read_bytes()
    assert ask(served.url, f"report/{name}").headers["Location"] == answer.headers["Location"]


def test_a_page_made_again_takes_the_place_of_the_earlier_one(top, tmp_path):
    state = Watch(top).look()
    name = next(one.name for one in state.sources if one.page)
    photos, scratch = tmp_path / "photos", tmp_path / "scratch"
    photos.mkdir(), scratch.mkdir()
    pages = Pages(top=top, scratch=scratch, photos=photos, scene_folders=())
    first = pages.make(state, name)
    assert pages.make(state, name) == first
    (photos / "late.jpg").write_bytes(b"")
    second = pages.make(state, name)
    assert [path.name for path in scratch.iterdir()] == [second] != [first]


def test_the_page_of_the_folder_itself(served, top, tmp_path):
    state = json.loads(ask(served.url, "state.json").content)
    name = next(one["name"] for one in state["sources"] if one["page"])
    shutil.copytree(top / name, tmp_path / "here")
    view = legoworld.view(tmp_path / "here")
    (source,) = json.loads(ask(view.url, "state.json").content)["sources"]
    assert (source["name"], source["page"]) == (".", True)
    assert ask(view.url, "report/").status == 303  # a browser makes it of report/.
    (tmp_path / "here" / "late.json").symlink_to(tmp_path / "gone")
    answer = ask(view.url, "report/")
    assert (answer.status, b"late.json" in answer.content) == (422, True)
    view.close()


def test_a_folder_without_a_page(served):
    state = json.loads(ask(served.url, "state.json").content)
    run = next(one["name"] for one in state["sources"] if one["kind"] == "run")
    for name in (run, "nothing", "../x"):
        assert ask(served.url, f"report/{name}").status in (404, 422)


@pytest.mark.parametrize(
    ("path", "status"),
    [
        ("pictures/one.png", 200),
        ("pictures/text.png", 404),
        ("outside.png", 404),
        ("none.png", 404),
        ("../../etc/passwd", 404),
        ("%2e%2e/one.png", 404),
    ],
)
def test_pictures_alone_are_shown_and_no_link_is_followed(served, path, status):
    answer = ask(served.url, f"picture/{path}")
    assert answer.status == status
    if status == 200:
        assert (answer.content, answer.headers["Content-Type"]) == (PNG, "image/png")


@pytest.mark.parametrize(
    ("path", "method", "headers", "status"),
    [
        ("/", "GET", {}, 404),
        ("/state.json", "GET", {}, 404),
        ("/another-token/state.json", "GET", {}, 404),
        ("state.json", "GET", {"Host": "evil.example"}, 400),
        ("state.json", "POST", {}, 405),
        ("state.json", "DELETE", {}, 405),
        ("pages/", "GET", {}, 404),
        ("nothing.js", "GET", {}, 404),
    ],
)
def test_who_is_answered(served, path, method, headers, status):
    assert ask(served.url, path, method, **headers).status == status


@pytest.mark.parametrize("path", ["", "view.js", "view.css", "state.json", "picture/none"])
def test_the_address_is_told_to_no_other_site(served, path):
    headers = ask(served.url, path).headers
    assert headers["Referrer-Policy"] == "no-referrer"
    assert headers["X-Content-Type-Options"] == "nosniff"


def test_a_notebook_shows_a_frame(served):
    assert f'<iframe src="{served.url}"' in served._repr_html_()


def test_a_folder_that_is_not_there(tmp_path):
    with pytest.raises(UsageError, match="cannot be watched"):
        legoworld.view(tmp_path / "none")


def test_the_command_until_ctrl_c(top):
    command = [sys.executable, "-m", "legoworld", "view", str(top), "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        line = process.stdout.readline()
        url = line.split()[1]
        until(lambda: ask(url, "state.json").status == 200, "an answer")
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 0
    assert not list(top.glob(".*"))


def test_what_is_new_appears_without_a_new_page(served, top, shown):
    page = shown.page
    page.goto(served.url)
    page.get_by_text("not finished").first.wait_for()
    shutil.copytree(next(top.rglob("run.json")).parent, top / "copied" / "here")
    page.get_by_role("heading", name="copied/here").wait_for()
    shutil.rmtree(top / "copied")
    page.get_by_role("heading", name="copied/here").wait_for(state="detached")
    assert shown.said == []
