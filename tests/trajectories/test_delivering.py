"""What is picked and what is scored of a trial, file by file; Blender is stood in for."""

from __future__ import annotations

import json
import re
from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace

import pytest
from msgspec.structs import replace as with_fields
from trajectories.pages import record_trial, score_trial
from trajectories.requirement_reports import WANTED, report

from legoworld.errors import LegoWorldError, SceneInvalidError, UsageError
from legoworld.files import write_text
from legoworld.records.base import canonical, decode
from legoworld.trajectories import pick as picking
from legoworld.trajectories import score_checkpoints
from legoworld.trajectories.folder import read_trial
from legoworld.trajectories.page import final_scores, write_page
from legoworld.trajectories.pick import Pick, PickPlan, pick, saved_regret
from legoworld.trajectories.score_checkpoints import Group, ScoringPlan, tokens_until
from legoworld.workers.protections import protections
from legoworld.workers.sandbox import SandboxLimits

LIMITS = SandboxLimits(time_s=9.0, memory_bytes=77)
HELD = protections("limits")


class Blenders:
    """A stand-in for Blender: its memory, what it was told to export, and what it froze."""

    def __init__(self, monkeypatch, module):
        self.memory, self.exported, self.frozen, self.bad = [], [], [], {}
        monkeypatch.setattr(module, "BlenderProcess", self.opened)
        monkeypatch.setattr(module, "export_submission", self.export)
        if hasattr(module, "freeze_scene"):
            monkeypatch.setattr(module, "freeze_scene", self.freeze)

    @contextmanager
    def opened(self, limits):
        self.memory.append(limits.memory_bytes)
        yield "the blender"

    def export(self, blend, target, *, workspace, **how):
        assert workspace.is_dir()
        assert not list(workspace.iterdir())
        assert how == {"limits": LIMITS, "protections": HELD, "blender": "the blender"}
        if blend.stem in self.bad:
            raise self.bad[blend.stem]
        self.exported.append(blend)
        (target / "scene.blend").write_text(blend.stem)

    def freeze(self, folder, *, blender, cache):
        assert (blender, cache) == ("the blender", None)
        self.frozen.append((folder.name, sorted(path.name for path in folder.path.iterdir())))


@pytest.fixture
def scenes(tmp_path):
    trial = record_trial(tmp_path / "scenes")
    (trial.folder / "provenance.json").write_text("{}")
    return tmp_path / "scenes"


@pytest.fixture
def blenders(monkeypatch):
    return Blenders(monkeypatch, picking)


def plan(by="last", evidence=None):
    said = []
    made = PickPlan(by=by, evidence=evidence, limits=LIMITS, protections=HELD, notice=said.append)
    return made, said


def test_the_last_checkpoint_is_exported_with_the_trial_s_records(scenes, tmp_path, blenders):
    made, said = plan()
    (picked,) = pick(scenes, tmp_path / "out" / "deep", made)
    trial = read_trial(scenes / "room")
    last = trial.live[-1]
    assert picked == Pick(
        by="last", scene="room", ordinal=last.ordinal, sha256=last.sha256, submitted=6, passed={}
    )
    assert blenders.memory == [77]
    assert blenders.exported == [trial.blend(last)]
    assert blenders.exported[0] == (
        scenes / "room" / "trial" / "checkpoints" / f"{last.sha256}.blend"
    )
    names = [
        *("picked.json", "provenance.json", "reconstruction.json", "scene.blend"),
        "trajectory.json",
    ]
    assert blenders.frozen == [("room", names)]
    folder = tmp_path / "out" / "deep" / "room"
    assert decode(Pick, (folder / "picked.json").read_bytes()) == picked
    for name in ("provenance.json", "reconstruction.json", "trajectory.json"):
        assert (folder / name).read_bytes() == (scenes / "room" / name).read_bytes()
    assert [path.name for path in folder.parent.iterdir()] == ["room"]
    assert said == [f"room: checkpoint {last.ordinal}"]
    with pytest.raises(UsageError, match="is there already"):
        pick(scenes, tmp_path / "out" / "deep", made)


def test_what_cannot_be_exported_is_said_and_its_records_are_kept(scenes, tmp_path, blenders):
    last = read_trial(scenes / "room").live[-1]
    blenders.bad[last.sha256] = SceneInvalidError("no camera", found="none")
    made, said = plan()
    (picked,) = pick(scenes, tmp_path / "out", made)
    assert picked.ordinal == last.ordinal
    assert said[0].startswith(f"room: checkpoint {last.ordinal} is not exported: no camera")
    assert (tmp_path / "out" / "room" / "picked.json").is_file()


def test_a_trial_without_a_checkpoint_has_its_records_alone(scenes, tmp_path, blenders):
    (scenes / "room" / "trial" / "checkpoints.jsonl").write_text("")
    made, said = plan("residuals", tmp_path)
    (picked,) = pick(scenes, tmp_path / "out", made)
    assert (picked.ordinal, picked.sha256, picked.passed) == (None, None, {})
    assert (blenders.exported, blenders.frozen) == ([], [])
    assert said == ["room: checkpoint None"]


@pytest.fixture
def measured(scenes, tmp_path, monkeypatch, blenders):
    """Pick by residuals, given those of each checkpoint; an error is the scene's."""
    evidence = tmp_path / "evidence" / "room"
    write_text(evidence / "requirements.json", f"[{', '.join(map(canonical, WANTED))}]")

    def run(by_ordinal, evidence_of=None):
        trial = read_trial(scenes / "room")
        known = {trial.blend(c): by_ordinal[c.ordinal] for c in trial.live}

        def read_live(blend, blender):
            assert blender == "the blender"
            if isinstance(known[blend], LegoWorldError):
                raise known[blend]
            return known[blend]

        def measure(scene, requirements, found):
            assert list(requirements) == WANTED
            assert found == evidence_of
            return report(scene)

        monkeypatch.setattr(picking, "read_live", read_live)
        monkeypatch.setattr(picking, "measure", measure)
        made, said = plan("residuals", tmp_path / "evidence")
        (picked,) = pick(scenes, tmp_path / "out", made)
        return picked, said

    return run


def test_a_clearly_better_checkpoint_is_taken_and_its_verdicts_told(measured, monkeypatch, scenes):
    good, bad = [0.1] * 20, [4.0] * 18 + [None, 0.5]
    evidence = scenes.parent / "evidence" / "room"
    (evidence / "evidence.json").write_text("{}")
    monkeypatch.setattr(picking, "read_evidence", lambda folder: ("evidence", folder))
    picked, said = measured({1: bad, 2: good, 3: bad, 4: bad, 5: bad}, ("evidence", evidence))
    assert picked.ordinal == 2
    assert picked.passed == {str(n): (20, 0, 0) if n == 2 else (1, 18, 1) for n in range(1, 6)}
    assert said == ["room: checkpoint 2"]


def test_a_checkpoint_that_cannot_be_read_is_passed_over(measured):
    broken = LegoWorldError("it does not open", found="nothing")
    picked, said = measured({n: broken if n in (2, 5) else [1.0] * 20 for n in range(1, 6)})
    assert picked.ordinal == 4
    assert [*picked.passed] == ["1", "3", "4"]
    assert [text.partition(": it does not open")[0] for text in said] == [
        "room, checkpoint 2", "room, checkpoint 5", "room: checkpoint 4",
    ]  # fmt: skip


def test_where_none_can_be_read_the_last_is_taken(measured):
    broken = LegoWorldError("it does not open", found="nothing")
    picked, said = measured(dict.fromkeys(range(1, 6), broken))
    assert (picked.ordinal, picked.passed, len(said)) == (5, {}, 6)


def test_residuals_need_evidence_and_readable_requirements(scenes, tmp_path, blenders):
    with pytest.raises(UsageError, match=r"no --evidence.*plugin evidence"):
        pick(scenes, tmp_path / "out", plan("residuals")[0])
    with pytest.raises(UsageError, match="requirements of room cannot be read"):
        pick(scenes, tmp_path / "out", plan("residuals", tmp_path)[0])
    assert not (tmp_path / "out").exists()


def test_regret_is_saved_over_the_scenes_that_were_scored_on_both_sides():
    def picked(scene, ordinal):
        return Pick(
            by="last", scene=scene, ordinal=ordinal, sha256=None, submitted=None, passed={}
        )  # fmt: skip

    q = {("a", 2): 0.75, ("a", None): 0.5, ("b", 1): 0.25, ("b", None): 0.75, ("c", None): 0.5,
         ("d", 4): 0.5, ("e", None): 0.1}  # fmt: skip
    q_of = lambda scene, ordinal: q.get((scene, ordinal))  # noqa: E731
    picks = [picked("a", 2), picked("b", 1), picked("c", 3), picked("d", 4), picked("e", None)]
    assert saved_regret(picks, q_of) == (-0.125, 2)
    assert saved_regret(picks[2:], q_of) is None


def test_q_is_a_checkpoint_s_or_its_submission_s_and_zero_without(tmp_path):
    document = score_trial(tmp_path / "scores", record_trial(tmp_path / "scenes"))
    q_of = final_scores(document)
    assert [q_of("room", n) for n in (1, 2, 4, None)] == pytest.approx([0.4, 0.65, 0.0, 0.55])
    assert q_of("room", 9) is None
    assert q_of("hall", 1) is None


def test_the_page_has_a_table_of_all_images_and_one_of_the_common(tmp_path):
    trial = record_trial(tmp_path / "scenes")
    document = score_trial(tmp_path / "scores", trial)
    page = tmp_path / "page.html"
    write_page([trial], page, photos=None, scores=tmp_path / "scores")
    text = page.read_text()
    assert "All images" in text
    assert "common images" not in text
    for name in document.agents[0].means:
        assert name in text
    both = with_fields(document, common=document.agents, common_images=(1, 2, 3))
    write_text(tmp_path / "scores" / "trajectories.json", canonical(both))
    write_page([trial], page, photos=None, scores=tmp_path / "scores")
    assert "The 3 common images" in page.read_text()
    write_page([trial], page, photos=None, scores=None)
    assert "<table" not in re.sub(r"<script.*?</script>", "", page.read_text(), flags=re.DOTALL)


def scoring_plan(tmp_path):
    said = []
    return ScoringPlan(
        private=tmp_path / "private", output=tmp_path / "scores", limits=LIMITS, protections=HELD,
        workers=2, draws=10, seed=3, notice=said.append,
    )  # fmt: skip


def test_each_checkpoint_is_exported_and_the_submission_copied(scenes, tmp_path, monkeypatch):
    trial, blenders = read_trial(scenes / "room"), Blenders(monkeypatch, score_checkpoints)
    plan, target = scoring_plan(tmp_path), tmp_path / "scores" / "slot"
    plan.output.mkdir()
    assert score_checkpoints._deliver(target, [trial], 1, plan) == {}
    assert blenders.exported == [trial.blend(trial.live[1])]
    assert (target / "room" / "scene.blend").read_text() == trial.live[1].sha256
    blenders.bad[trial.live[2].sha256] = SceneInvalidError("no camera", found="none")
    refused = score_checkpoints._deliver(target, [trial], 2, plan)
    assert [*refused] == ["room"]
    assert "no camera" in refused["room"]
    final = tmp_path / "scores" / "last"
    (trial.folder / "scene.glb").write_text("glb")
    assert score_checkpoints._deliver(final, [trial], None, plan) == {}
    assert {path.name for path in (final / "room").iterdir()} == {"scene.glb", "final.png"}
    assert blenders.memory == [77] * 3
    assert sorted(path.name for path in plan.output.iterdir()) == ["last", "slot"]


def test_a_slot_is_read_out_and_evaluated_once_exported(scenes, tmp_path, monkeypatch):
    trial, plan, asked = read_trial(scenes / "room"), scoring_plan(tmp_path), []
    dataset = SimpleNamespace(folders=SimpleNamespace(track="the track"))
    group = Group(name="g", agent="codex", run=1, trials=(trial,))
    top = plan.output / "g" / "002"
    for folder in ("run", "eval"):
        write_text(top / folder / "per_image.jsonl", folder)
    monkeypatch.setattr(
        score_checkpoints, "_deliver", lambda *words: asked.append(words) or {"room": "no"}
    )

    def readout(*words, **how):
        asked.append((words, how))
        return SimpleNamespace(folder="the run")

    def evaluate(*words, **how):
        asked.append((words, how))
        return SimpleNamespace(folder=str(top / "eval"))

    def lines(kind, data):
        return [SimpleNamespace(image_id=1, kind=kind.__name__, data=data)]

    monkeypatch.setattr(score_checkpoints, "readout", readout)
    monkeypatch.setattr(score_checkpoints, "evaluate", evaluate)
    monkeypatch.setattr(score_checkpoints, "decode_lines", lines)
    monkeypatch.setattr(score_checkpoints, "_scored_scene", lambda *words: words)
    (found,) = score_checkpoints._slot(group, "002", [trial], 1, dataset, plan).items()
    image, (checkpoint, when, read, row) = found
    assert (image, checkpoint) == (1, trial.live[1])
    assert (when.at_s, when.wall_share, when.calls_share) == (17.0, 17 / 60, 2 / 6)
    assert (read.kind, read.data) == ("BenchRow", b"run")
    assert (row.kind, row.data) == ("ReconstructionRow", b"eval")
    delivered, readings, evaluations = asked
    assert delivered == (top / "scenes", [trial], 1, plan)
    assert readings == (
        (top / "scenes", top / "run"),
        {"task": "bench", "track": "the track", "image_ids": [1], "workers": 2},
    )
    assert evaluations == (
        ("the run", top / "eval"),
        {"truth": plan.private, "diagnostics": False, "draws": 1, "overwrite": True},
    )
    assert json.loads((top / "refused.json").read_text()) == {"room": "no"}
    del asked[:]
    score_checkpoints._slot(group, "002", [trial], 1, dataset, plan)
    assert len(asked) == 2, "what was exported before is not exported again"
    (submitted,) = score_checkpoints._slot(group, "002", [trial], None, dataset, plan).values()
    assert submitted[0] is None
    assert (submitted[1].at_s, submitted[1].wall_share, submitted[1].calls_share) == (60.0, 1, 1)


def test_a_group_is_scored_slot_by_slot(scenes, tmp_path, monkeypatch):
    trial = read_trial(scenes / "room")
    about = with_fields(trial.about, image_id=2, file_name="hall.png", scene="hall")
    short = replace(trial, about=about, checkpoints=trial.checkpoints[:2])
    group = Group(name="g", agent="codex", run=3, trials=(trial, short))
    said, slots = [], []
    plan = replace(scoring_plan(tmp_path), notice=said.append)
    case = SimpleNamespace(file_name="room.png", image=SimpleNamespace(family="f"))
    dataset = SimpleNamespace(cases={1: case, 2: case})

    def slot(_group, name, taking, number, *_rest):
        slots.append((name, len(taking), number))
        return {t.about.image_id: (name, t.about.image_id) for t in taking}

    monkeypatch.setattr(score_checkpoints, "_slot", slot)
    monkeypatch.setattr(score_checkpoints, "score_trajectory", lambda trajectory: trajectory)
    first, second = score_checkpoints._score_group(group, dataset, plan)
    assert slots == [
        ("001", 2, 0), ("002", 2, 1), ("003", 1, 2), ("004", 1, 3), ("005", 1, 4),
        ("final", 2, None),
    ]  # fmt: skip
    assert said == [f"codex, run 3: checkpoint {n} of 5" for n in range(1, 6)]
    assert (first.image_id, first.scene, first.family, first.agent) == (1, "room", "f", "codex")
    assert (first.run, first.seconds, first.final) == (3, 60.0, ("final", 1))
    assert first.checkpoints == [(f"00{n}", 1) for n in range(1, 6)]
    assert (second.image_id, second.scene, second.checkpoints) == (
        2, "hall", [("001", 2), ("002", 2)],
    )  # fmt: skip
    score_checkpoints._refuse_strangers(replace(group, trials=(trial,)), dataset)
    for strange in (SimpleNamespace(cases={}), dataset):
        with pytest.raises(UsageError, match=r"hall is not of this bench.*image 2, hall\.png"):
            score_checkpoints._refuse_strangers(replace(group, trials=(short,)), strange)


def test_tokens_count_up_to_each_call_and_the_rest_at_the_end():
    def step(tokens, *calls):
        metrics = None if tokens is None else SimpleNamespace(completion_tokens=tokens)
        extra = {"legoworld": {"calls": list(calls)}} if calls else None
        return SimpleNamespace(metrics=metrics, extra=extra)

    steps = [step(5), step(7, 1, 2), step(None, 3), step(11, 4), step(13)]
    found = tokens_until(SimpleNamespace(steps=steps))
    assert found == [(2, 12), (3, 12), (4, 23), (5, 36)]
    assert tokens_until(SimpleNamespace(steps=[step(None, 1), step(None, 2)])) == []


@pytest.fixture
def three_runs(tmp_path, monkeypatch, blenders):
    """Three runs of one photo; the second fits best, the third shows nothing."""
    for number in (1, 2, 3):
        folder = record_trial(tmp_path / "scenes" / f"run_{number}").folder
        (folder / "scene.blend").write_text(f"run {number}")
    fits = {"run 1": {"a": 0.5, "b": 0.25}, "run 2": {"a": 0.25, "b": 0.75}}

    def read(blend, blender):
        assert blender == "the blender"
        if blend.read_text() not in fits:
            raise SceneInvalidError("it shows nothing", found="no camera")
        return blend.read_text()

    regions = ["a", "b"]
    asked = []
    known = SimpleNamespace(file=SimpleNamespace(regions=regions))
    monkeypatch.setattr(picking, "read_live", read)
    monkeypatch.setattr(picking, "read_evidence", lambda path: asked.append(path) or known)
    monkeypatch.setattr(picking, "region_fit", lambda scene, _: fits[scene])
    return SimpleNamespace(scenes=tmp_path / "scenes", fits=fits, regions=regions, asked=asked)


def plan_by_regions(said, evidence=None):
    return PickPlan(
        by="regions", evidence=evidence, limits=LIMITS, protections=HELD, notice=said.append
    )


def test_of_several_runs_the_one_that_fits_its_regions_is_copied(three_runs, tmp_path):
    said = []
    (record,) = pick(three_runs.scenes, tmp_path / "out", plan_by_regions(said))
    folder = tmp_path / "out" / record.scene
    assert (folder / "scene.blend").read_text() == "run 2"
    assert decode(Pick, (folder / "picked.json").read_bytes()) == record
    assert record.run == f"run_2/{record.scene}"
    assert [*record.fits] == [f"run_{n}/{record.scene}" for n in (1, 2, 3)]
    assert [*record.fits.values()] == [*three_runs.fits.values(), {}]
    assert three_runs.asked == [
        three_runs.scenes / "run_1" / record.scene / "trial" / "plugin" / "evidence"
    ]
    assert "it shows nothing" in said[0]
    with pytest.raises(UsageError, match="there already"):
        pick(three_runs.scenes, tmp_path / "out", plan_by_regions(said))


def test_equal_runs_leave_the_first_and_no_regions_choose_nothing(three_runs, tmp_path):
    three_runs.fits["run 2"] = three_runs.fits["run 1"]
    by = plan_by_regions([], tmp_path / "evidence")
    (record,) = pick(three_runs.scenes, tmp_path / "out", by)
    assert record.run == f"run_1/{record.scene}"
    assert three_runs.asked == [tmp_path / "evidence" / record.scene]
    three_runs.regions.clear()
    with pytest.raises(UsageError, match=r"can be chosen by its residuals.*no regions"):
        pick(three_runs.scenes, tmp_path / "more", by)
