"""The four agents' own programs against a model that follows a script: `make test-agents`.

Each reads the configuration that its card names, starts mcp-for-blender, sees the photo, calls the
Blender tools as its model asks (behind a tool search in Claude Code, inside JavaScript in Codex),
and leaves a scene. No network and no account.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from agent_programs.model_server import ModelServer, Turn
from agent_programs.programs import AGENTS, KEY, KEYS, Program, code, write_card
from agents.tracks import SMALL, make_track
from trajectories.harbor import refusal_of_harbor

from legoworld.agents.agent_cards import load_agent
from legoworld.agents.campaign import reconstruct
from legoworld.endpoint.trial_record import read_rows
from legoworld.files import sha256_of_file
from legoworld.records.agents import ApiRequest, ReconstructionFile, TrialRow, Usage
from legoworld.records.atif import AtifTrajectory
from legoworld.records.base import decode
from legoworld.trajectories.transcripts import read_transcript, total_usage

PROGRAMS = os.environ.get("LEGOWORLD_AGENT_PROGRAMS")
pytestmark = [
    pytest.mark.agent_programs,
    pytest.mark.skipif(not PROGRAMS, reason="LEGOWORLD_AGENT_PROGRAMS names no folder of agents"),
]


LABELLED = f"{SMALL}\nbpy.data.objects['Cube']['category'] = 'chair'"
SAVE = "import os\nbpy.ops.wm.save_as_mainfile(filepath=os.getcwd() + '/scene.blend')"


def script(program: Program, truth: Path) -> list[Turn]:
    """Look at the photo, build, fail twice (once at the truth), ask, save."""
    photo = [
        Turn(
            says="I look.", tool=program.reads, arguments={"file_path": "{workspace}/reference.png"}
        )
    ]
    return [
        *(photo if program.reads else []),
        code("I build.", LABELLED),
        code("This fails.", "bpy.data.objects['nothing here'].location.x = 1"),
        code("So does this.", f"print(open({str(truth)!r}).read())"),
        Turn(says="What is there?", tool="get_scene_info", arguments={"user_prompt": "Rebuild."}),
        code("I save.", SAVE),
        Turn(says="Done."),
    ]


def tokens(used: Usage) -> tuple[int | None, int | None, int | None]:
    """Prompt, cached and completion tokens."""
    return used.prompt_tokens, used.cached_tokens, used.completion_tokens


@dataclass(frozen=True, kw_only=True)
class Trial:
    """A finished trial and what its model was asked."""

    name: str
    row: TrialRow
    folder: Path
    server: ModelServer
    photo: Path

    @property
    def about(self) -> ReconstructionFile:
        return decode(ReconstructionFile, (self.folder / "reconstruction.json").read_bytes())

    @property
    def trajectory(self) -> AtifTrajectory:
        return decode(AtifTrajectory, (self.folder / "trajectory.json").read_bytes())


def trial(name: str, folder: Path, *, failing: int = 0, time_limit_s: float = 400.0) -> Trial:
    """One trial of an agent's program; failing: requests that the API refuses first."""
    program = AGENTS[name]
    make_track(folder, ["one"])
    truth = folder / "truth.json"
    truth.write_text('{"annotations": "a secret of 7351"}')
    server = ModelServer(script(program, truth))
    server.failing = failing
    with server.serving(), pytest.MonkeyPatch.context() as patch:
        card = write_card(name, server.url, folder)
        patch.setenv("PATH", f"{PROGRAMS}/bin:{os.environ['PATH']}")
        for key in KEYS:
            patch.setenv(key, KEY)
        (row,) = reconstruct(
            folder / "track.json", folder / "scenes", photos=folder / "photos",
            agent=str(card), trial_limit_s=time_limit_s,
            record=True,
        )  # fmt: skip
    photo = folder / "photos" / "one.png"
    scene = folder / "scenes" / "one"
    return Trial(name=name, row=row, folder=scene, server=server, photo=photo)


@pytest.fixture(scope="module", params=AGENTS)
def done(request, tmp_path_factory) -> Iterator[Trial]:
    return trial(request.param, tmp_path_factory.mktemp(request.param))


def test_a_scene_is_frozen_and_says_what_it_holds(done):
    assert (done.row.status, done.row.reason) == ("ok", "")
    assert done.about.finalisation.source == "saved"
    assert json.loads((done.folder / "frozen.json").read_text())["status"] == "ok"
    assert done.row.content.categories == {"chair": 1}


def test_its_model_sees_the_photo(done):
    assert sha256_of_file(done.photo) in set().union(*(a.pictures for a in done.server.asked))


def test_its_calls_are_recorded_with_those_that_failed_and_the_truth_is_not_there(done):
    said = (done.folder / "trial" / "calls.jsonl").read_text()
    assert "a secret of 7351" not in said
    assert all("a secret of 7351" not in asked.text for asked in done.server.asked)
    assert done.about.failed_calls == 2
    assert done.about.calls >= 5


def test_its_tokens_are_those_that_the_api_counted(done):
    asked = [(a.prompt_tokens, a.cached_tokens, a.completion_tokens) for a in done.server.asked]
    rows = read_rows(done.folder / "trial" / "requests.jsonl", ApiRequest)
    counted = [r for r in rows if r.wire is not None]
    assert sorted((r.prompt_tokens, r.cached_tokens, r.completion_tokens) for r in counted) == asked
    used = done.row.usage
    assert tokens(used) == done.server.tokens
    assert (used.tokens_source, used.requests, used.uncounted) == ("recorded", len(rows), 0)
    totals = done.trajectory.final_metrics
    assert totals.total_prompt_tokens == used.prompt_tokens
    assert totals.extra["legoworld"]["tokens_source"] == "recorded"


def test_its_transcript_counts_what_it_sees(done):
    kind = load_agent(done.name).about.transcript.format
    said = read_transcript(
        done.folder / "trial" / "transcript", kind, agent="", version="", prompt=""
    )
    asked = done.server.asked
    if not AGENTS[done.name].counted:
        asked = [a for a in asked if a.turn is not None]
    assert tokens(total_usage(said)) == (
        sum(a.prompt_tokens for a in asked),
        sum(a.cached_tokens for a in asked),
        sum(a.completion_tokens for a in asked),
    )


def test_its_key_is_in_no_file(done):
    files = [path for path in done.folder.parents[1].rglob("*") if path.is_file()]
    assert len(files) > 10
    assert [path for path in files if KEY.encode() in path.read_bytes()] == []


def test_its_trajectory_is_valid_by_harbor_s_validator(done):
    assert refusal_of_harbor(done.folder / "trajectory.json") == ""


def test_its_steps_are_the_script_s(done):
    steps = [step for step in done.trajectory.steps if step.source == "agent"]
    said = [str(step.message) for step in steps]
    wanted = [turn.says for turn in done.server.script]
    assert [text for text in wanted if not any(text in one for one in said)] == []


@pytest.mark.parametrize("name", AGENTS)
def test_an_api_that_is_down_until_the_limit_is_a_trial_to_make_again(name, tmp_path):
    down = trial(name, tmp_path, failing=10**6, time_limit_s=30.0)
    assert down.row.status == "agent_failed"
    assert "its model never answered" in down.row.reason
    assert (tokens(down.row.usage), down.row.usage.uncounted) == ((0, 0, 0), 0)
    rows = read_rows(down.folder / "trial" / "requests.jsonl", ApiRequest)
    assert {r.status for r in rows if r.wire} <= {529}  # none where it started late
