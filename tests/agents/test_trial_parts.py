"""The parts of a trial that start nothing: its folder, its steps, its end, its plugin, its rows."""

from __future__ import annotations

import json
import socket
import sys
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest
from msgspec.structs import replace as with_fields

from legoworld.agents import mcp_endpoint, mcp_server, reconstruct, trial_plugin
from legoworld.agents.plugin_host import PluginHost
from legoworld.agents.recorded_steps import (
    StepsUnusableError,
    encode_steps,
    may_continue,
    remaining_steps,
)
from legoworld.agents.stop import Stop, TrialStoppedError
from legoworld.agents.trial import NoPhotoError
from legoworld.agents.trial_plugin import PluginOptions, PluginPlan, plan_plugin, read_plugin_calls
from legoworld.agents.unfinished_trial import (
    UnfinishedTrial,
    begun_before,
    mark_finished,
    remove_finished,
    unfinished_folder,
    unfinished_trial,
)
from legoworld.api.listener import Listener
from legoworld.errors import LegoWorldError, UsageError
from legoworld.plugin.evidence import EvidenceInvalidError
from legoworld.records.agents import (
    UNLIMITED,
    AgentMcp,
    BegunTrial,
    EndedAgent,
    RecordedStep,
    Usage,
)
from legoworld.records.plugin_install import PluginUsed
from legoworld.trajectories.folder import TRIAL

IMAGE = SimpleNamespace(id=7, scene="room", file_name="a/room.jpg", hfov_deg=51.0)
BEGUN = BegunTrial(
    scene="room", agent="a", card_sha256="c", prompt_sha256="p", time_limit_s=5.0, parts=(0,)
)


@pytest.fixture
def unfinished(tmp_path):
    made = UnfinishedTrial(folder=tmp_path, stays=True)
    for folder in (made.workspace, made.scene_folder / TRIAL):
        folder.mkdir(parents=True)
    return made


def test_a_cleared_folder_keeps_its_lock_and_its_owner_alone(unfinished, tmp_path):
    for name in ("lock", ".owner-1", "begun.json", "workspace/left", "made/scene.blend"):
        (tmp_path / name).write_text("")
    (tmp_path / "link").symlink_to(unfinished.workspace)
    unfinished.clear()
    left = sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*"))
    assert left == [".owner-1", "lock", "made", "workspace"]


def test_of_a_finalisation_that_was_killed_the_trial_alone_stays(unfinished):
    (unfinished.scene_folder / "scene.blend").write_text("")
    (unfinished.scene_folder / "folder" / "in").mkdir(parents=True)
    unfinished.keep_trial_alone()
    assert [path.name for path in unfinished.scene_folder.iterdir()] == [TRIAL]


def test_what_is_noted_is_read_again_and_what_is_broken_is_not_there(unfinished, tmp_path):
    ended = EndedAgent(code=1, over=None, last_output="it", seconds=2.0)
    assert (unfinished.read_begun(), unfinished.read_ended()) == (None, None)
    unfinished.note_begun(BEGUN)
    unfinished.note_ended(ended)
    assert (unfinished.read_begun(), unfinished.read_ended()) == (BEGUN, ended)
    (tmp_path / "ended.json").write_text("{")
    assert unfinished.read_ended() is None
    mark_finished(unfinished)
    mark_finished(unfinished)
    assert unfinished.read_begun() is None


def test_transcripts_are_numbered_but_the_last(unfinished):
    trial = unfinished.scene_folder / TRIAL
    assert unfinished.transcripts() == [trial / "transcript"]
    unfinished.note_begun(with_fields(BEGUN, parts=(0, 4, 6)))
    assert unfinished.transcripts() == [
        trial / "transcript-1", trial / "transcript-2", trial / "transcript",
    ]  # fmt: skip


def test_a_killed_part_leaves_its_transcript_and_what_it_continues_from(unfinished):
    unfinished.note_begun(with_fields(BEGUN, parts=(0, 4)))
    output = unfinished.agent / "sandbox" / "output"
    (output / "session" / "new").mkdir(parents=True)
    (output / "said").write_text("words")
    (unfinished.session / "old").mkdir(parents=True)
    (unfinished.scene_folder / TRIAL).rmdir()  # killed before its first call
    unfinished.put_part_aside("said")
    assert (unfinished.scene_folder / TRIAL / "transcript-2").read_text() == "words"
    assert [path.name for path in unfinished.session.iterdir()] == ["new"]
    assert not unfinished.agent.exists()
    (unfinished.agent / "sandbox" / "output").mkdir(parents=True)
    unfinished.put_part_aside("said")
    assert [path.name for path in unfinished.session.iterdir()] == ["new"], "it kept nothing new"


def test_a_trial_that_is_not_finished_stays_and_another_goes(tmp_path):
    scenes = tmp_path / "scenes"
    folder = unfinished_folder(scenes, IMAGE)
    assert folder == scenes / ".unfinished-7"
    with unfinished_trial(scenes, IMAGE, stays=True) as trial:
        assert (trial.folder, trial.stays) == (folder, True)
        assert isinstance(trial.lease, int)
        trial.note_begun(BEGUN)
    assert begun_before(scenes, IMAGE) == BEGUN
    with unfinished_trial(scenes, IMAGE, stays=False) as trial:
        assert (trial.stays, trial.lease, trial.folder.parent) == (False, None, scenes)
        assert trial.folder != folder
        trial.note_begun(BEGUN)
    assert [path.name for path in scenes.iterdir()] == [folder.name]
    remove_finished(scenes, IMAGE)
    assert list(scenes.iterdir()) == []
    remove_finished(scenes, IMAGE)
    assert list(scenes.iterdir()) == []


def stepping(tmp_path, *, resume="continue", plugin=None, programs=True):
    card = SimpleNamespace(about=SimpleNamespace(resume=resume))
    return SimpleNamespace(card=card, plugin=plugin, programs=tmp_path if programs else None)


def test_steps_are_those_recorded_with_the_workspace_in_the_place_of_its_name(tmp_path):
    workspace = SimpleNamespace(folder=tmp_path / "work")
    plan = stepping(tmp_path)
    step = RecordedStep(tool="t", arguments={"code": "é {workspace}/a {workspace}"})
    (tmp_path / "room.steps.jsonl").write_text(encode_steps([step, step]))
    assert encode_steps([step, step]).count("\n") == 2
    left = remaining_steps(plan, IMAGE, workspace, [])
    code = f"é {tmp_path}/work/a {tmp_path}/work"
    assert [s.arguments for s in left] == [{"code": code}] * 2
    assert remaining_steps(stepping(tmp_path, programs=False), IMAGE, workspace, []) is None
    (tmp_path / "room.steps.jsonl").write_text("{}\n")
    with pytest.raises(StepsUnusableError, match=r"steps of room cannot be played.*room\.steps"):
        remaining_steps(plan, IMAGE, workspace, [])


def test_a_program_is_cut_and_saves_last(tmp_path):
    workspace = SimpleNamespace(folder=tmp_path / "work")
    with pytest.raises(StepsUnusableError, match=r"no room/scene\.py and no room\.steps\.jsonl"):
        remaining_steps(stepping(tmp_path), IMAGE, workspace, [])
    (tmp_path / "room").mkdir()
    (tmp_path / "room" / "scene.py").write_text("print(1)\nprint(2)\n")
    steps = remaining_steps(stepping(tmp_path), IMAGE, workspace, [])
    assert len(steps) == 3
    assert f"{tmp_path}/work/scene.blend" in steps[-1].arguments["code"]


def test_a_trial_continues_where_nothing_is_lost_with_its_processes(tmp_path):
    assert may_continue(stepping(tmp_path, programs=False), IMAGE)
    assert not may_continue(stepping(tmp_path, programs=False, resume="restart"), IMAGE)
    assert not may_continue(stepping(tmp_path, programs=False, plugin="on"), IMAGE)
    assert not may_continue(stepping(tmp_path), IMAGE)
    (tmp_path / "room.steps.jsonl").write_text("")
    assert may_continue(stepping(tmp_path), IMAGE)


def test_what_runs_is_ended_when_the_run_is_stopped_and_nothing_before_or_after():
    stop, ended = Stop(), []
    stop.check()
    with stop.ends(lambda: ended.append("first")):
        pass
    with stop.ends(lambda: ended.append("second")):
        assert ended == []
        stop.now()
        assert ended == ["second"]
    with pytest.raises(TrialStoppedError, match="the run was stopped"):
        stop.check()
    with stop.ends(lambda: ended.append("third")):
        assert ended == ["second", "third"]
    stop.now()
    assert ended == ["second", "third"]


def test_each_client_of_the_plugin_has_a_server_of_its_own(tmp_path):
    script = "import sys; print('log', file=sys.stderr); print(sys.stdin.readline().upper())"
    with PluginHost([sys.executable, "-c", script], tmp_path / "log") as host:
        for word in (b"one", b"two"):
            with socket.create_connection(("127.0.0.1", host.port), timeout=60) as line:
                line.sendall(word + b"\n")
                assert line.makefile("rb").read().strip() == word.upper()
    assert (tmp_path / "log").read_text() == "log\nlog\n"
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.1", host.port), timeout=60)


def test_calls_of_the_plugin_are_counted_by_what_became_of_them(monkeypatch):
    def entry(tool, error=None, phase="open"):
        return SimpleNamespace(tool=tool, error=error, phase=phase)

    ledger = [
        entry("serve"), entry("begin"), entry("commit"), entry("commit", "bad"),
        entry("commit", "bad", "idle"), entry("commit", phase="idle"), entry("measure", "bad"),
        entry("begin", "bad"), entry("begin"), entry("rollback", phase="idle"), entry("resume"),
        entry("begin"),
    ]  # fmt: skip
    monkeypatch.setattr(trial_plugin, "read_ledger", lambda record: {"r": ledger, "e": []}[record])
    found = read_plugin_calls("r")
    assert (found.calls, found.failed, found.transactions) == (10, 4, 3)
    assert (found.committed, found.rolled_back, found.left_open) == (1, 1, True)
    assert (read_plugin_calls("e").calls, read_plugin_calls("e").left_open) == (0, False)
    ledger.append(entry("commit", phase="idle"))
    assert (read_plugin_calls("r").committed, read_plugin_calls("r").left_open) == (2, False)


@pytest.fixture
def evidence(tmp_path, monkeypatch):
    """Folders: a run, a results file, arrays; what the evidence of a trial is made from."""
    given = []
    for name in ("run", "covering"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "run.json").write_text("{}")
    (tmp_path / "results.json").write_text("[]")
    (tmp_path / "arrays" / "a").mkdir(parents=True)
    (tmp_path / "photo.jpg").write_text("photo")
    monkeypatch.setattr(trial_plugin, "require_server", lambda: None)
    monkeypatch.setattr(trial_plugin, "usable_run", lambda run: given.append(("usable", run)))
    monkeypatch.setattr(trial_plugin, "make_evidence", lambda *words: given.append(words))
    monkeypatch.setattr(trial_plugin, "covers", lambda run, _: run.name == "covering")
    return given


def test_evidence_is_made_of_what_covers_the_photo(tmp_path, evidence, monkeypatch):
    runs, arrays = (tmp_path / "run", tmp_path / "covering"), tmp_path / "arrays"
    options = PluginOptions(
        modules=("evidence",), regions=(*runs, tmp_path / "results.json"), depth=arrays
    )
    made = PluginPlan(options=options, vocabulary="the vocabulary")
    asked = []
    monkeypatch.setattr(
        trial_plugin, "depth_file", lambda *words: asked.append(words) or ("array", "disparity")
    )
    trial_plugin._make_evidence(made, IMAGE, tmp_path / "photo.jpg", tmp_path / "into")
    ((given, into),) = evidence
    assert asked == [(arrays, "a/room.jpg")]
    assert into == tmp_path / "into"
    assert (given.photo, given.regions, given.runs) == (
        tmp_path / "photo.jpg", [tmp_path / "results.json"], [runs[1]],
    )  # fmt: skip
    assert (given.image_id, given.vocabulary, given.hfov_deg) == (7, "the vocabulary", 51.0)
    assert (given.depth, given.depth_space, given.all_images) == ("array", "disparity", True)
    for depth, found in ((None, ("array", "disparity")), (runs[1], ("array", "x")), (arrays, None)):
        monkeypatch.setattr(trial_plugin, "depth_file", lambda *_, found=found: found)
        both = PluginOptions(modules=("evidence",), regions=(runs[1],), depth=depth)
        trial_plugin._make_evidence(
            PluginPlan(options=both, vocabulary=None), IMAGE, tmp_path / "photo.jpg", into
        )
        given = evidence[-1][0]
        assert (given.depth, given.depth_space, given.runs) == (None, "depth", [runs[1]])


def test_the_plugin_is_served_with_the_evidence_of_the_track_s_photo(
    tmp_path, evidence, monkeypatch
):
    started, by = [], []

    @contextmanager
    def host(command, log):
        started.append((command, log))
        yield "the host"

    @contextmanager
    def blender(session, port, by_whom=None, **how):
        by.append((session, port, how))
        yield SimpleNamespace(port=4321)

    monkeypatch.setattr(trial_plugin, "PluginHost", host)
    monkeypatch.setattr(trial_plugin, "EndpointServer", blender)
    record, photo = tmp_path / "record", tmp_path / "photo.jpg"

    def served(modules):
        options = PluginOptions(modules=modules, regions=(), depth=None)
        plan = PluginPlan(options=options, vocabulary=None)
        assert plan.provenance == PluginUsed(version=trial_plugin.__version__, modules=modules)
        with trial_plugin.served_plugin(plan, IMAGE, photo, "the session", record) as found:
            assert found == "the host"
        record.rmdir()

    served(("records", "evidence"))
    assert by == [("the session", 0, {"by": "plugin"})]
    off = ["initialisation", "measurement", "transactions", "looking"]
    begin = [sys.executable, "-m", "legoworld", "plugin", "serve", "--ledger", str(record)]
    begin += ["--blender", "127.0.0.1:4321"]
    words = [word for name in off for word in ("--without", name)]
    shown = ["--evidence", str(record / "evidence"), "--photo", str(photo)]
    assert started == [([*begin, *words, *shown], record / "server.log")]
    assert [into for _, into in evidence] == [record / "evidence"]
    served(("initialisation", "measurement", "transactions", "records", "looking"))
    assert started[1][0] == [*begin, "--without", "evidence"]
    assert len(evidence) == 1


def test_what_is_given_as_evidence_is_looked_at_before_the_first_trial(
    tmp_path, evidence, monkeypatch
):
    work = SimpleNamespace(track=SimpleNamespace(vocabulary="v", images=[]), photos=tmp_path)
    run, results = tmp_path / "run", tmp_path / "results.json"

    def planned(modules=("evidence", "records"), regions=(), depth=None):
        return plan_plugin(
            PluginOptions(modules=modules, regions=tuple(regions), depth=depth), work
        )

    monkeypatch.setattr(trial_plugin, "read_photo_hashes", lambda _: {"1"})
    inside = run / "predictions.json"
    inside.write_text("[]")
    plan = planned(regions=[inside, results], depth=run)
    assert plan.options.regions == (run, results)
    assert (plan.options.depth, plan.vocabulary) == (run, "v")
    assert plan.options.modules == ("evidence", "records")
    assert evidence == [("usable", run), ("usable", run)]
    assert planned(depth=tmp_path / "arrays").options.depth == tmp_path / "arrays"
    assert planned(("records",)).options.regions == ()
    with pytest.raises(EvidenceInvalidError, match=r"arrays holds no regions.*no run\.json"):
        planned(regions=[tmp_path / "arrays"])
    for how in ({"regions": [results]}, {"depth": run}):
        with pytest.raises(UsageError, match=r"module `evidence` is off.*--regions or --depth"):
            planned(("records",), **how)


@pytest.fixture
def campaign(tmp_path, monkeypatch):
    """Trials of two images that leave what they are told to: a function that makes them."""
    closed = []

    class Blender:
        def __init__(self, limits):
            closed.append(limits.memory_bytes)

        def abort(self):
            closed.append("aborted")

        def close(self):
            closed.append("closed")

    monkeypatch.setattr(reconstruct, "BlenderProcess", Blender)
    card = SimpleNamespace(name="own", sha256="c" * 64, about=SimpleNamespace(resume="restart"))
    plan = SimpleNamespace(
        card=card, plugin=None, programs=None, work=SimpleNamespace(prompt_sha256="p" * 64),
        limits=SimpleNamespace(time_s=60.0, memory_bytes=99), budget=UNLIMITED,
        record=False,
    )  # fmt: skip
    images = [SimpleNamespace(id=n, scene=f"deep/s{n}") for n in (2, 1)]

    def make(repeat, run_trial, plan=plan):
        said = []
        monkeypatch.setattr(reconstruct, "run_trial", run_trial)
        rows = reconstruct.make_trials(
            plan, tmp_path / "out", images=images, repeat=repeat, workers=1, engine="local",
            listener=Listener(total=said.append, trial=said.append),
        )  # fmt: skip
        return rows, said

    return SimpleNamespace(make=make, plan=plan, closed=closed, out=tmp_path / "out")


@pytest.mark.parametrize(
    ("error", "status", "reason"),
    [
        (NoPhotoError("it was not found", found="nothing"), "no_photo", "it was not found"),
        (LegoWorldError("it broke", found="this"), "failed", "it broke"),
        (OSError(28, "No space left on device"), "failed", "No space left on device"),
    ],
)
def test_why_a_trial_was_not_made_is_its_row(campaign, error, status, reason):
    def run_trial(*_):
        raise error

    rows, said = campaign.make(2, run_trial)
    assert [(row.run, row.image_id) for row in rows] == [(1, 1), (1, 2), (2, 1), (2, 2)]
    assert [row.scene for row in rows] == ["deep/s1", "deep/s2"] * 2
    assert {row.status for row in rows} == {status}
    assert all(row.reason.startswith(reason) for row in rows)
    assert said[0] == 4
    assert sorted(said[1:], key=lambda row: (row.run, row.image_id)) == rows
    assert (campaign.closed[0], campaign.closed[-1]) == (99, "closed")
    assert sorted(path.name for path in campaign.out.iterdir() if path.is_dir()) == [
        "run_1", "run_2",
    ]  # fmt: skip


def test_a_scene_folder_appears_whole_and_nothing_is_left_beside_it(campaign):
    asked = []

    def run_trial(plan, image, unfinished, blender, stop):
        assert plan is campaign.plan
        assert unfinished.folder.parent == campaign.out.resolve()
        asked.append((image.id, unfinished.stays))
        unfinished.clear()
        (unfinished.scene_folder / "scene.blend").write_text(str(image.id))
        return SimpleNamespace(
            image_id=image.id, scene=image.scene, status="ok", reason="why", seconds=1.5, calls=2,
            checkpoints=3, usage=Usage(prompt_tokens=4), content=None,
        )  # fmt: skip

    rows, _ = campaign.make(1, run_trial)
    assert asked == [(2, False), (1, False)]
    assert [(r.image_id, r.scene, r.run, r.kept) for r in rows] == [
        (1, "deep/s1", 1, False), (2, "deep/s2", 1, False),
    ]  # fmt: skip
    assert {(r.status, r.reason, r.seconds, r.calls, r.checkpoints) for r in rows} == {
        ("ok", "why", 1.5, 2, 3)
    }
    assert {r.usage.prompt_tokens for r in rows} == {4}
    assert (campaign.out / "deep" / "s1" / "scene.blend").read_text() == "1"
    assert [path.name for path in campaign.out.iterdir() if path.is_dir()] == ["deep"]


def test_a_folder_that_no_trial_made_and_another_campaign_s_are_refused(campaign):
    def run_trial(*_):
        raise AssertionError

    folder = campaign.out / "deep" / "s2"
    folder.mkdir(parents=True)
    with pytest.raises(UsageError, match=r"s2 exists and was not made by a trial.*pass another -o"):
        campaign.make(1, run_trial)
    (folder / "reconstruction.json").write_text("{}")
    with pytest.raises(UsageError, match="was not made by a trial"):
        campaign.make(1, run_trial)
    protected = {"bubblewrap": None, "why_not": None, "holds": [], "does_not_hold": []}
    about = {
        "schema_version": 1, "legoworld": "0", "image_id": 2, "file_name": "f", "scene": "deep/s2",
        "agent": "theirs", "agent_version": None, "card_sha256": "c" * 64, "model": None,
        "prompt_sha256": "p" * 64, "status": "ok", "reason": "", "ended": "itself", "exit_code": 0,
        "time_limit_s": 60.0, "seconds": 1.0, "agent_seconds": 1.0, "calls": 1, "failed_calls": 0,
        "checkpoints": 1, "usage": {}, "agent_sandbox": protected, "blender_sandbox": protected,
        "finalisation": {"source": "saved", "checkpoint": 1, "sha256": "s"},
    }  # fmt: skip
    used = {"version": "9", "modules": ["records", "evidence"]}
    for change, found in [
        ({"card_sha256": "d" * 64}, "theirs, 60 s, prompt pppppppp, plugin off"),
        ({"time_limit_s": 61.5}, "theirs, 61.5 s, prompt pppppppp, plugin off"),
        ({"prompt_sha256": "q" * 64}, "theirs, 60 s, prompt qqqqqqqq, plugin off"),
        ({"budget": {"calls": 5, "cost_usd": 1.5}}, "plugin off, budget calls 5, cost_usd 1.5"),
        ({"plugin": used}, r"theirs, 60 s, prompt pppppppp, plugin 9 \(records, evidence\)"),
    ]:
        (folder / "reconstruction.json").write_text(json.dumps(about | change))
        ours = "own, 60 s, prompt pppppppp, plugin off, budget none"
        with pytest.raises(UsageError, match=f"s2 is of another campaign.*{found}.*{ours}"):
            campaign.make(1, run_trial)


def test_a_half_built_trial_that_was_recorded_is_not_continued_without(campaign):
    folder = unfinished_folder(campaign.out, SimpleNamespace(id=2, scene="deep/s2"))
    folder.mkdir(parents=True)
    begun = {
        "scene": "deep/s2", "agent": "own", "card_sha256": "c" * 64, "prompt_sha256": "p" * 64,
        "time_limit_s": 60.0, "record": True, "parts": [0],
    }  # fmt: skip
    (folder / "begun.json").write_text(json.dumps(begun))
    with pytest.raises(UsageError, match=r"another campaign.* none, recorded; .*budget none; "):
        campaign.make(1, lambda *_: None)


def test_mcp_for_blender_is_installed_from_its_own_project(monkeypatch):
    environments = mcp_server.environments
    monkeypatch.setattr(environments, "install", lambda project, notice: (project, notice))
    monkeypatch.setattr(environments, "environment_folder", lambda project: Path(project.shelf))
    project, notice = mcp_server.install_server(print)
    assert notice is print
    assert (project.name, project.shelf) == ("mcp-for-blender", "agents")
    assert (project.folder / "play.py").is_file()
    assert (project.folder / "pyproject.toml").is_file()
    assert mcp_server.server_folder() == Path("agents")
    monkeypatch.setattr(environments, "problems", lambda *words: ["old", *words])
    monkeypatch.setattr(environments, "installed_python", lambda project: Path(project.name))
    assert mcp_server.server_problems() == ["old", project, Path("mcp-for-blender")]
    assert mcp_server.server_python() == Path("mcp-for-blender")
    monkeypatch.setattr(environments, "installed_python", lambda _: None)
    assert mcp_server.server_problems() == [
        "mcp-for-blender is not installed: legoworld agent install"
    ]
    with pytest.raises(
        UsageError, match=r"has no environment yet.*nothing in agents.*agent install"
    ):
        mcp_server.server_python()


def test_configurations_wait_for_a_render(tmp_path):
    def mcp(kind):
        return AgentMcp(format=kind, path="unused")

    server = mcp_server.McpServer(name="s", command="c", arguments=("a",), variables={"V": "1"})
    mcp_server.write_configuration(tmp_path / "deep" / "codex", mcp("codex"), [server, server])
    text = (tmp_path / "deep" / "codex").read_text()
    assert text.count("startup_timeout_sec = 60\ntool_timeout_sec = 180\n") == 2
    assert 'V = "1"\n\n[mcp_servers.s]' in text
    mcp_server.write_configuration(tmp_path / "opencode", mcp("opencode"), [server])
    assert json.loads((tmp_path / "opencode").read_text()) == {
        "$schema": "https://opencode.ai/config.json",
        "mcp": {
            "s": {
                "type": "local", "command": ["c", "a"], "environment": {"V": "1"},
                "enabled": True, "timeout": 180000,
            }
        },
    }  # fmt: skip
    mcp_server.write_configuration(tmp_path / "most", mcp("mcp_servers"), [server])
    started = {"command": "c", "args": ["a"], "env": {"V": "1"}}
    assert json.loads((tmp_path / "most").read_text()) == {"mcpServers": {"s": started}}


def test_mcp_is_served_over_an_endpoint_in_a_bare_environment(tmp_path, monkeypatch):
    work, ran = tmp_path / "work", []
    work.mkdir()

    @contextmanager
    def opened(serving, *, notice):
        assert (serving, notice) == ("the options", print)
        yield 4321

    server = mcp_server.McpServer(name="s", command="c", arguments=("a",), variables={"V": "2"})
    monkeypatch.setattr(mcp_endpoint, "open_endpoint", opened)
    monkeypatch.setattr(mcp_endpoint, "workspace_path", lambda _: work)
    monkeypatch.setattr(mcp_endpoint, "blender_server", lambda *words: ran.append(words) or server)
    monkeypatch.setattr(
        mcp_endpoint, "blender_environment", lambda **how: {"V": "1", "E": str(how)}
    )

    def run(words, *, env, check):
        ran.append((words, env, check))
        return SimpleNamespace(returncode=7)

    monkeypatch.setattr(mcp_endpoint.subprocess, "run", run)
    assert mcp_endpoint.serve_mcp("the options", notice=print) == 7
    tmp = work / "tmp"
    both = str({"home": tmp, "temporary": tmp})
    assert ran == [(4321, tmp), (["c", "a"], {"V": "2", "E": both}, False)]
    assert tmp.is_dir()
    assert mcp_endpoint.serve_mcp("the options", notice=print) == 7
