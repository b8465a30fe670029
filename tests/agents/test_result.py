"""What a trial that has ended is in its scene folder's files; nothing of it is run here."""

from __future__ import annotations

import json
from types import SimpleNamespace

import pytest
from msgspec.structs import replace

from legoworld import __version__
from legoworld.agents import trial_result
from legoworld.agents.prices import read_prices
from legoworld.agents.trial_result import REQUESTS, TrialOutcome, write_result
from legoworld.endpoint.trial_record import write_rows
from legoworld.records.agents import (
    ApiRequest,
    Budget,
    EndedAgent,
    Finalisation,
    PluginCalls,
    ReconstructionFile,
    SceneContent,
)
from legoworld.records.atif import AtifAgent, AtifFinalMetrics, AtifStep, AtifTrajectory
from legoworld.records.base import UNSET, decode
from legoworld.records.plugin_install import PluginUsed
from legoworld.scene.folder import PROVENANCE
from legoworld.trajectories.folder import RECONSTRUCTION, TRAJECTORY, TRIAL
from legoworld.workers.protections import Protections

AGENT_HELD = Protections(bubblewrap="0.8", why_not=None, network=True)
BLENDER_HELD = Protections(bubblewrap=None, why_not="not there")
IMAGE = SimpleNamespace(id=7, file_name="a/one.jpg", scene="a_one")
SAVED = Finalisation(source="saved", checkpoint=2, sha256="s" * 64)
NONE = Finalisation(source="none", checkpoint=None, sha256=None, refused=("cut", "no camera"))

CONTENT = SceneContent(labelled=True, objects=2, categories={"cup": 1}, camera="perspective")


def plan(**said):
    known = {
        "card": SimpleNamespace(name="codex", sha256="c" * 64),
        "agent_version": "0.9",
        "work": SimpleNamespace(
            prompt_sha256="p" * 64, task="coco", vocabulary_sha256="v" * 64,
            entries={7: {"hfov_deg": 61.5}, 8: {}}, protocol="the protocol",
        ),
        "limits": SimpleNamespace(time_s=90.0, memory_bytes=123),
        "model": "m-asked",
        "prices": read_prices(None),
        "agent_held": AGENT_HELD,
        "blender_held": BLENDER_HELD,
        "plugin": None,
        "budget": Budget(calls=9),
        "record": False,
    }  # fmt: skip
    return SimpleNamespace(**(known | said))


def call(by="agent", status="success"):
    return SimpleNamespace(by=by, status=status)


CALLS = [call(), call(status="error"), call(by="plugin", status="error"), call()]


ANSWER = AtifStep(step_id=1, source="agent", message="Done.")


def outcome(
    *, over=None, code=0, last="", calls=CALLS, checkpoints=(1, 2), made=SAVED, model=None,
    steps=(ANSWER,), tokens=UNSET,
):  # fmt: skip
    agent = AtifAgent(name="codex", version="1", model_name=model)
    return TrialOutcome(
        ended_agent=EndedAgent(code=code, over=over, last_output=last, seconds=12.34567),
        record=SimpleNamespace(calls=list(calls), checkpoints=list(checkpoints)),
        finalisation=made,
        trajectory=AtifTrajectory(
            schema_version="ATIF-v1.6",
            agent=agent,
            steps=list(steps),
            final_metrics=AtifFinalMetrics(total_completion_tokens=tokens),
        ),
        seconds=45.67891,
        continued=3,
    )


@pytest.fixture
def written(tmp_path, monkeypatch):
    """What write_result returns, and the files that it leaves, with what was frozen."""
    frozen = []
    monkeypatch.setattr(
        trial_result, "freeze_scene", lambda folder, **how: frozen.append((folder, how))
    )
    monkeypatch.setattr(trial_result, "scene_content", lambda *asked: held(*asked))

    def held(folder, protocol, blender):
        assert (folder, protocol, blender) == (frozen[-1][0], "the protocol", "the blender")
        return CONTENT

    def write(made, result, image=IMAGE):
        row = write_result(made, image, tmp_path, result, "the blender")
        provenance = json.loads((tmp_path / PROVENANCE).read_text())
        assert decode(ReconstructionFile, (tmp_path / RECONSTRUCTION).read_bytes()) == row
        kept = decode(AtifTrajectory, (tmp_path / TRAJECTORY).read_bytes())
        assert kept.steps == result.trajectory.steps
        return row, provenance, frozen

    return write


def test_a_scene_that_came_of_it_is_frozen_and_all_is_said_of_it(written, tmp_path):
    row, provenance, frozen = written(plan(), outcome())
    ((folder, how),) = frozen
    assert (folder.path, folder.name) == (tmp_path, "a_one")
    assert how == {"blender": "the blender", "cache": None}
    assert (row.legoworld, row.image_id, row.file_name, row.scene) == (
        __version__, 7, "a/one.jpg", "a_one",
    )  # fmt: skip
    assert (row.agent, row.agent_version, row.model) == ("codex", "0.9", "m-asked")
    assert (row.card_sha256, row.prompt_sha256) == ("c" * 64, "p" * 64)
    assert (row.status, row.reason, row.ended, row.exit_code) == ("ok", "", "itself", 0)
    assert (row.time_limit_s, row.seconds, row.agent_seconds) == (90.0, 45.679, 12.346)
    assert (row.calls, row.failed_calls, row.checkpoints, row.continued) == (3, 1, 2, 3)
    assert (row.finalisation, row.plugin, row.plugin_calls) == (SAVED, None, None)
    assert row.content == CONTENT
    assert (row.agent_sandbox, row.blender_sandbox) == (AGENT_HELD.record(), BLENDER_HELD.record())
    usage = provenance.pop("usage")
    assert usage["cost_usd"] is None
    assert provenance == {
        "agent": "codex", "agent_version": "0.9", "model": "m-asked", "plugin": None,
        "prompt_sha256": "p" * 64, "task": "coco", "vocabulary_sha256": "v" * 64,
        "camera_given": {"hfov_deg": 61.5}, "metric_feedback": False,
        "limits": {"time_s": 90.0, "memory_bytes": 123}, "ended": "itself",
        "finalisation": "saved", "continued": 3,
    }  # fmt: skip


def test_the_model_that_a_transcript_names_is_the_trial_s(written):
    row, provenance, _ = written(plan(), outcome(model="m-used"))
    assert (row.model, provenance["model"]) == ("m-used", "m-used")
    assert written(plan(model=None), outcome())[0].model is None


def test_a_record_tells_the_model_the_tokens_and_whether_it_answered(written, tmp_path):
    row = ApiRequest(
        number=1, at_s=0.0, seconds=1.0, wire="chat", model="m-seen", status=200, ended="whole",
        prompt_tokens=7, cached_tokens=0, completion_tokens=3,
    )  # fmt: skip
    down = replace(row, model=None, status=529, prompt_tokens=None, completion_tokens=None)
    (tmp_path / TRIAL).mkdir()
    path = tmp_path / TRIAL / REQUESTS
    write_rows(path, [row, down])
    made, provenance, _ = written(plan(model=None, record=True), outcome())
    assert (made.model, provenance["usage"]["tokens_source"]) == ("m-seen", "recorded")
    assert (made.usage.prompt_tokens, made.usage.requests, made.usage.uncounted) == (7, 2, 0)
    nothing = outcome(code=None, over="time", checkpoints=(), made=NONE)
    assert written(plan(record=True), nothing)[0].status == "no_scene"
    write_rows(path, [down])
    assert written(plan(record=True), nothing)[0].status == "agent_failed"


def test_a_photo_without_a_field_of_view_has_no_camera_given(written):
    image = SimpleNamespace(id=8, file_name="two.jpg", scene="two")
    assert written(plan(), outcome(), image)[1]["camera_given"] is None


def test_the_plugin_and_its_calls_are_told(written, tmp_path, monkeypatch):
    calls = PluginCalls(
        calls=5, failed=1, transactions=2, committed=1, rolled_back=1, left_open=False
    )
    counted = []
    monkeypatch.setattr(
        trial_result, "read_plugin_calls", lambda path: counted.append(path) or calls
    )
    used = PluginUsed(version="1", modules=("records",))
    row, provenance, _ = written(plan(plugin=SimpleNamespace(provenance=used)), outcome())
    assert counted == [tmp_path / TRIAL / "plugin"]
    assert (row.plugin, row.plugin_calls) == (used, calls)
    assert provenance["plugin"] == {"name": "legoworld", "version": "1", "modules": ["records"]}


@pytest.mark.parametrize(
    ("said", "status", "reason"),
    [
        ({"code": 2}, "ok", "the agent: exit code 2"),
        ({"code": None, "over": "time"}, "ok", "the agent: ended at its time limit"),
        ({"calls": (), "code": 3, "last": "x" * 99 + "\nno login" + "y" * 192, "made": NONE},
         "agent_failed",
         "it called Blender never and ended with exit code 3; no login" + "y" * 192),
        ({"calls": (), "code": None, "over": "disk", "checkpoints": (), "made": NONE},
         "no_scene", "no call changed the scene; the agent: ended at its disk limit"),
        ({"calls": (), "checkpoints": (), "made": NONE},
         "no_scene", "no call changed the scene; the agent: exit code 0"),
        ({"code": 1, "checkpoints": (), "made": NONE},
         "no_scene", "no call changed the scene; the agent: exit code 1"),
        ({"code": 1, "made": NONE}, "no_scene", "no scene could be exported: cut; no camera"),
        ({"code": None, "over": "time", "last": "status 529", "checkpoints": (), "made": NONE,
          "steps": ()},
         "agent_failed", "its model never answered: ended at its time limit; status 529"),
        ({"code": 1, "checkpoints": (), "made": NONE, "tokens": 0},
         "agent_failed", "its model never answered: exit code 1; "),
        ({"checkpoints": (), "made": NONE, "steps": ()},
         "no_scene", "no call changed the scene; the agent: exit code 0"),
    ],
)  # fmt: skip
def test_a_scene_counts_however_its_agent_ended(written, said, status, reason):
    row, provenance, frozen = written(plan(), outcome(**said))
    assert (row.status, row.reason) == (status, reason)
    assert row.ended == provenance["ended"] == (said.get("over") or "itself")
    assert bool(frozen) is (status == "ok")
