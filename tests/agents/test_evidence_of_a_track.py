"""Runs that are given as evidence are held to the track's photos before the first trial."""

from __future__ import annotations

import shutil

import pytest
from baselines.tracks import call, make_photos, make_track, run_arguments

from legoworld import cli
from legoworld.agents.trial_plugin import PluginOptions, plan_plugin
from legoworld.agents.workspaces import load_trial_setup
from legoworld.plugin.evidence import EvidenceInvalidError
from legoworld.plugin.modules import modules_without

NAMES = ["one.jpg", "two.jpg"]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Two photos, a run of the tests' own baseline over both, and a track of a third photo."""
    pytest.importorskip("mcp.server", reason="the plugin's server needs the extra `plugin`")
    folder = tmp_path_factory.mktemp("shared")
    photos = make_photos(folder / "photos", [*NAMES, "three.jpg"])
    track = make_track(folder / "track.json", NAMES)
    make_track(folder / "other.json", ["three.jpg"])
    make_track(folder / "some.json", ["two.jpg", "three.jpg"])
    (folder / "w.bin").write_bytes(b"w")
    for task in ("coco", "eth3d"):
        assert call(run_arguments(track, photos, folder / "w.bin", folder / task, task=task)) == 0
    return folder


def plan_evidence(made, track, *, photos="photos", regions=(), depth=None):
    options = PluginOptions(modules=modules_without([]), regions=tuple(regions), depth=depth)
    work = load_trial_setup(made / track, made / photos, "bench", options.modules)
    return plan_plugin(options, work)


@pytest.mark.parametrize("given", ["regions", "depth"])
def test_a_run_of_none_of_the_photos_is_refused(made, given):
    runs = {"regions": {"regions": [made / "coco"]}, "depth": {"depth": made / "eth3d"}}[given]
    with pytest.raises(EvidenceInvalidError) as refused:
        plan_evidence(made, "other.json", **runs)
    said = str(refused.value)
    assert "covers none of the track's photos" in said
    assert "2 photos in the run, none of the hashes of the track's 1" in said
    assert "run the baseline on this track" in said


def test_a_run_of_some_of_the_photos_is_used_for_them(made):
    plan = plan_evidence(made, "some.json", regions=[made / "coco"], depth=made / "eth3d")
    assert plan.options.regions == (made / "coco",)
    assert plan.options.depth == made / "eth3d"


def test_one_good_run_does_not_excuse_another(made, tmp_path):
    other = run_arguments(
        made / "other.json", made / "photos", made / "w.bin", tmp_path / "other", task="coco"
    )
    assert call(other) == 0
    with pytest.raises(EvidenceInvalidError, match="other covers none"):
        plan_evidence(made, "track.json", regions=[made / "coco", tmp_path / "other"])


def test_photos_that_are_not_there_are_each_trial_s_own_verdict(made):
    assert plan_evidence(made, "other.json", photos="nowhere", regions=[made / "coco"])


def test_the_command_says_it_in_one_line_and_begins_no_trial(made, tmp_path, capfd, monkeypatch):
    """The agent's own server may be missing here: it is not come to."""
    monkeypatch.setattr("legoworld.agents.run_plan.agent_problems", lambda _card: [])
    shutil.copytree(made / "coco", tmp_path / "coco")
    (tmp_path / "programs").mkdir()
    command = ["reconstruct", str(made / "other.json"), "--photos", str(made / "photos")]
    command += [
        "--agent",
        "program",
        "--programs",
        str(tmp_path / "programs"),
        "--plugin",
        "--task",
        "bench",
    ]
    command += ["--regions", str(tmp_path / "coco"), "-o", str(tmp_path / "scenes")]
    assert cli.run(command) == 2
    (line,) = capfd.readouterr().err.strip().splitlines()
    assert "coco covers none of the track's photos" in line
    assert not (tmp_path / "scenes").exists()
