"""What the commands of agents, of a live Blender and of trials print; the work is stood in for."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import click
import pytest

from legoworld import cli
from legoworld.agents.agent_cards import agent_cards, load_agent
from legoworld.agents.exposed_paths import AgentNotStartedError
from legoworld.commands.param_types import EXISTING_PLACE, PLACE, ShardType, SizeType
from legoworld.records.agents import Finalisation
from legoworld.trajectories.pick import Pick
from legoworld.workers.protections import protections

HELD = protections("limits")


@pytest.fixture
def run(capsys: Any) -> Any:
    """Run a command; its exit code, and what it printed."""

    def go(*words: object) -> tuple[int, str, str]:
        code = cli.run([str(word) for word in words])
        said = capsys.readouterr()
        return code, said.out, said.err

    return go


@pytest.fixture
def checked(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Let an agent lack some things; its version, or the error of asking for it."""

    def go(problems: list[str], version: Any) -> list[Any]:
        asked: list[Any] = []

        def version_in_sandbox(card: Any, held: Any) -> Any:
            asked.append((card.name, held))
            if isinstance(version, Exception):
                raise version
            return version

        def protect(kind: str, *, network: bool) -> Any:
            asked.append((kind, network))
            return HELD

        monkeypatch.setattr("legoworld.agents.agent_cards.agent_problems", lambda _: [*problems])
        monkeypatch.setattr("legoworld.agents.exposed_paths.version_in_sandbox", version_in_sandbox)
        monkeypatch.setattr("legoworld.workers.protections.protections", protect)
        monkeypatch.setattr("legoworld.agents.mcp_server.server_problems", list)
        monkeypatch.setattr("legoworld.agents.handshake.offered_tools", lambda *_: ["look", "do"])
        return asked

    return go


def test_an_agent_that_lacks_something_says_what(run: Any, checked: Any) -> None:
    card = load_agent("codex")
    asked = checked(["no login"], AgentNotStartedError("it does not start", found="rc 1"))
    code, said, _ = run("agent", "check", "codex")
    problem = str(AgentNotStartedError("it does not start", found="rc 1"))
    assert code == 1
    assert asked == [("auto", card.about.network), ("codex", HELD)]
    assert said.splitlines() == [
        f"codex: {card.about.title}; version not known",
        f"kept from it: {', '.join(HELD.holds)}",
        "lacks: no login",
        f"lacks: {problem}",
    ]
    code, said, _ = run("agent", "check", "codex", "--json")
    document = json.loads(said)
    assert (code, document["problems"]) == (1, ["no login", problem])
    assert (document["name"], document["version"]) == ("codex", None)
    assert document["sandbox"]["holds"] == HELD.holds


def test_an_agent_that_lacks_nothing_is_ready(run: Any, checked: Any) -> None:
    checked([], "9.1")
    code, said, _ = run("agent", "check", "program")
    assert code == 0
    first, _, tools, last = said.splitlines()
    assert tools == "Blender's tools: look, do"
    assert first == f"program: {load_agent('program').about.title}; 9.1"
    assert last == "ready", "it was run here: there is no warning"
    document = json.loads(run("agent", "check", "program", "--json")[1])
    assert (document["version"], document["tools"]) == ("9.1", ["look", "do"])


def test_agents_are_listed_with_what_they_were_checked_against(run: Any) -> None:
    code, said, _ = run("agent", "list")
    assert code == 0
    for card in agent_cards():
        (line,) = [text for text in said.splitlines() if text.startswith(card.name)]
        assert ("yes" if card.about.run else "no") in line.split()
    (agents,) = [json.loads(run("agent", "list", "--json")[1])["agents"]]
    assert [agent["name"] for agent in agents] == [card.name for card in agent_cards()]


def test_where_the_server_was_installed_is_said(run: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def install(notice: Any) -> Path:
        notice("a step")
        return Path("/there/python")

    monkeypatch.setattr("legoworld.agents.mcp_server.install_server", install)
    assert run("agent", "install") == (0, "ready: /there/python\n", "a step\n")
    code, said, _ = run("agent", "install", "--json")
    assert (code, json.loads(said)["python"]) == (0, "/there/python")


@pytest.mark.parametrize(
    ("source", "refused", "code", "printed", "error"),
    [
        ("saved", (), 0, "the saved scene -> {out}\n", ""),
        ("checkpoint", ("a",), 0, "the checkpoint scene -> {out}\n", ""),
        ("none", ("a", "b"), 1, "", "no scene could be exported: a; b\n"),
        ("none", (), 1, "", "no scene could be exported: none\n"),
    ],
)
def test_which_scene_was_finalised_is_said(
    source: Any, refused: Any, code: int, printed: str, error: str, run: Any, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    found = Finalisation(source=source, checkpoint=None, sha256=None, refused=refused)
    asked: list[Any] = []

    def finalise(*words: Any, **how: Any) -> Finalisation:
        asked.append((words, how))
        return found

    monkeypatch.setattr("legoworld.endpoint.workspace_finalisation.blender_finalise", finalise)
    out = tmp_path / "out"
    words = ("blender", "finalise", tmp_path, "-o", out, "--memory-limit", "3")
    assert run(*words) == (code, printed.format(out=out), error)
    assert asked == [((tmp_path, out), {"sandbox": "auto", "memory_limit_gib": 3.0})]
    again, said, _ = run(*words, "--json")
    assert again == code
    assert json.loads(said)["finalisation"]["source"] == source
    assert json.loads(said)["finalisation"]["refused"] == list(refused)


def test_what_was_picked_and_what_it_saved_is_said(
    run: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def picked(ordinal: int | None, submitted: int | None) -> Pick:
        return Pick(
            by="last", scene="s", ordinal=ordinal, sha256=None, submitted=submitted, passed={}
        )

    picks = [picked(1, 1), picked(2, 1), picked(None, 3)]
    monkeypatch.setattr("legoworld.trajectories.api.pick", lambda *_: picks)
    monkeypatch.setattr("legoworld.trajectories.pick.saved_regret", lambda *_: (0.125, 2))
    monkeypatch.setattr("legoworld.trajectories.page.final_scores", lambda _: None)
    out = tmp_path / "out"
    words = ("trajectory", "pick", tmp_path, "--by", "last", "-o", out)
    first = f"2 of 3 submissions are another checkpoint -> {out}\n"
    monkeypatch.setattr("legoworld.trajectories.page.read_scores", lambda _: None)
    assert run(*words)[:2] == (0, first)
    assert json.loads(run(*words, "--json")[1])["regret_saved"] is None
    monkeypatch.setattr("legoworld.trajectories.page.read_scores", lambda _: "scores")
    assert run(*words)[1] == f"{first}mean regret saved: +0.1250 over 2 scenes\n"
    document = json.loads(run(*words, "--json")[1])
    assert document["regret_saved"] == [0.125, 2]
    assert [pick["ordinal"] for pick in document["picks"]] == [1, 2, None]


@pytest.mark.parametrize(
    ("words", "workers", "threads"),
    [("--workers 3", 3, 2), ("--workers 9", 9, 1), ("", 7, 1), ("--workers 1", 1, 7)],
)
def test_the_cores_are_shared_among_a_server_s_workers(
    words: str, workers: int, threads: int, run: Any, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    served: list[Any] = []

    class Server:
        def __init__(self, options: Any, count: int) -> None:
            served.append((options, count))

        def __enter__(self) -> Any:
            return SimpleNamespace(serve=lambda *_: None)

        def __exit__(self, *_error: object) -> None:
            pass

    monkeypatch.setattr("legoworld.api.bench.ScoreServer", Server)
    monkeypatch.setattr("legoworld.api.bench.usable_cores", lambda: 7)
    monkeypatch.setattr("legoworld.api.bench.read_dataset", lambda path: path)
    monkeypatch.chdir(tmp_path)
    assert run("bench", "serve", tmp_path, "--no-cache", *words.split())[0] == 0
    ((options, count),) = served
    assert (count, options.threads) == (workers, threads)
    assert options.root == tmp_path
    assert options.dataset == tmp_path / "private"
    assert (options.diagnostics, options.cache) == (False, None)


@pytest.mark.parametrize(
    ("kind", "text", "found"),
    [
        (SizeType(), "640x480", (640, 480)), (SizeType(), "1X8192", (1, 8192)),
        (SizeType(), (3, 4), (3, 4)), (SizeType(), "0x480", None), (SizeType(), "640x8193", None),
        (SizeType(), "640", None), (SizeType(), "1x2x3", None), (SizeType(), "-1x2", None),
        (ShardType(), "1/1", (1, 1)), (ShardType(), "3/16", (3, 16)), (ShardType(), (2, 5), (2, 5)),
        (ShardType(), "0/2", None), (ShardType(), "3/2", None), (ShardType(), "1", None),
        (ShardType(), "1/2/3", None), (ShardType(), "a/2", None), (ShardType(), "1/0", None),
    ],
)  # fmt: skip
def test_sizes_and_shards_are_two_numbers(kind: Any, text: Any, found: Any) -> None:
    if found is not None:
        assert kind.convert(text, None, None) == found
        return
    with pytest.raises(click.BadParameter):
        kind.convert(text, None, None)


def test_shards_that_cannot_be_are_told_from_those_that_can() -> None:
    with pytest.raises(click.BadParameter, match=r"'3/2': shards are counted from 1/2 to 2/2"):
        ShardType().convert("3/2", None, None)
    with pytest.raises(click.BadParameter, match=r"'1/0': shards are counted from 1/1 to 1/1"):
        ShardType().convert("1/0", None, None)


def test_a_file_url_is_a_path_and_another_stays_text(tmp_path: Path) -> None:
    (tmp_path / "a b").mkdir()
    url = f"file://{tmp_path}/a%20b"
    for kind in (PLACE, EXISTING_PLACE):
        assert kind.convert(url, None, None) == tmp_path / "a b"
        assert kind.convert(str(tmp_path), None, None) == tmp_path
        assert kind.convert("s3://bucket/run", None, None) == "s3://bucket/run"
    assert PLACE.convert(f"{url}c", None, None) == tmp_path / "a bc"
    with pytest.raises(click.BadParameter, match="does not exist"):
        EXISTING_PLACE.convert(f"{url}c", None, None)
