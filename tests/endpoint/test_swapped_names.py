"""A program exchanges names in its workspace for links while others read and write there."""

from __future__ import annotations

from pathlib import PurePath

import pytest
from swapping import OUTSIDE, SWAPS, swapping

from legoworld.agents.unfinished_trial import UnfinishedTrial
from legoworld.beneath import RefusedFileError
from legoworld.endpoint.screenshots import NotShownError, deliver_picture
from legoworld.endpoint.session import copy_into_workspace
from legoworld.endpoint.trial_record import TrialRecord
from legoworld.scene.folder import BLEND
from legoworld.trajectories.folder import TRIAL

#: 1 x 1, without an image: only its header is read.
PNG = b"\x89PNG\r\n\x1a\n" + (13).to_bytes(4, "big") + b"IHDR" + b"\0\0\0\1" * 2 + bytes(32)


@pytest.fixture
def workspace(tmp_path):
    (tmp_path / "workspace").mkdir()
    (tmp_path / "outside").mkdir()
    return tmp_path / "workspace"


def outcome(use) -> str:
    try:
        use()
    except RefusedFileError:
        return "refused"
    return "done"


def test_a_screenshot_never_leaves_the_workspace(workspace, tmp_path):
    """A path that is resolved and then opened wrote outside within tens of tries."""
    outside = tmp_path / "outside"
    with swapping(workspace / "d", outside):
        found = {
            outcome(lambda: deliver_picture(PNG, str(workspace / "d" / OUTSIDE), workspace))
            for _ in range(SWAPS)
        }
    assert found == {"done", "refused"}
    assert [path.read_text() for path in outside.iterdir()] == ["outside"]


@pytest.mark.parametrize("name", ["recovered.blend", ".finalised.blend"])
def test_a_scene_that_is_put_back_never_leaves_the_workspace(workspace, tmp_path, name):
    victim = tmp_path / "outside" / OUTSIDE
    victim.write_text("outside")
    (tmp_path / "stored.blend").write_text("BLENDER")
    with swapping(workspace / name, victim):
        for _ in range(SWAPS):
            assert (
                copy_into_workspace(tmp_path / "stored.blend", workspace, PurePath(name))
                == workspace / name
            )
            assert victim.read_text() == "outside"


def test_a_folder_in_the_place_of_the_scene_that_is_put_back_is_left_alone(workspace, tmp_path):
    (workspace / "recovered.blend").mkdir()
    (tmp_path / "stored.blend").write_text("BLENDER")
    put = copy_into_workspace(tmp_path / "stored.blend", workspace, PurePath("recovered.blend"))
    assert put.parent == workspace
    assert put.read_text() == "BLENDER"


def test_a_save_is_taken_from_the_workspace_alone(workspace, tmp_path):
    victim = tmp_path / "outside" / OUTSIDE
    victim.write_text("BLENDER of another")
    record = TrialRecord(tmp_path / "record")
    with swapping(workspace / BLEND, victim):
        # "inside" is no .blend, and a link is not followed.
        found = {outcome(lambda: record.copy_incoming(workspace, BLEND)) for _ in range(SWAPS)}
    assert found == {"refused"}


@pytest.mark.parametrize(
    ("data", "kept"),
    [
        (b"BLENDER-v500", True),
        (b"\x28\xb5\x2f\xfd more", True),
        (b"\x1f\x8b more", True),
        (b"not a blend", False),
        (b"", False),
    ],
)
def test_only_a_blend_becomes_a_checkpoint(workspace, tmp_path, data, kept):
    (workspace / BLEND).write_bytes(data)
    record = TrialRecord(tmp_path / "record")
    assert (record.keep_saved(workspace, call=1, at_s=0.0) is not None) is kept
    assert bool(record.spoilt) is not kept
    assert len(list((tmp_path / "record" / "checkpoints").iterdir())) == kept


@pytest.mark.parametrize("data", [None, b"", b"BM" + bytes(60), PNG[:16] + b"\xff" * 8 + bytes(40)])
def test_what_is_no_picture_that_can_be_shown_is_not_written(workspace, data):
    with pytest.raises(NotShownError, match="no picture"):
        deliver_picture(data, str(workspace / "a.png"), workspace)
    assert list(workspace.iterdir()) == []


def test_a_picture_among_temporary_files_is_written_once_and_nowhere_else(
    workspace, tmp_path, monkeypatch
):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "outside"))
    picture = tmp_path / "outside" / "look.png"
    deliver_picture(PNG, str(picture), workspace)
    assert picture.read_bytes() == PNG
    picture.write_text("another's")
    assert outcome(lambda: deliver_picture(PNG, str(picture), workspace)) == "refused"
    assert picture.read_text() == "another's"
    for name in ("look.jpg", "below/look.png", "../look.png"):
        with pytest.raises(NotShownError) as refused:
            deliver_picture(PNG, str(tmp_path / "outside" / name), workspace)
        assert refused.value.code == "endpoint_file"


def test_an_agent_s_linked_output_brings_nothing_from_outside(workspace, tmp_path):
    """What an agent leaves as its output may be a link to a folder of the user's."""
    outside = tmp_path / "outside"
    (outside / "session").mkdir()
    (outside / "session" / "mine").write_text("mine")
    (outside / "stdout.jsonl").write_text("mine")
    unfinished = UnfinishedTrial(folder=tmp_path / "trial", stays=True)
    (unfinished.scene_folder / TRIAL).mkdir(parents=True)
    (unfinished.agent / "sandbox").mkdir(parents=True)
    (unfinished.agent / "sandbox" / "output").symlink_to(outside)
    unfinished.take_transcript("stdout.jsonl")
    unfinished.put_part_aside("stdout.jsonl")
    assert list((unfinished.scene_folder / TRIAL).iterdir()) == []
    assert not unfinished.session.exists()
    assert sorted(path.name for path in outside.iterdir()) == ["session", "stdout.jsonl"]


def test_a_save_that_changed_nothing_is_no_checkpoint(workspace, tmp_path):
    record = TrialRecord(tmp_path / "record")
    kept = []
    for data in (b"BLENDER-v500 a", b"BLENDER-v500 a", b"BLENDER-v500 b", b"BLENDER-v500 a"):
        (workspace / BLEND).write_bytes(data)
        kept.append(record.keep_saved(workspace, call=len(kept) + 1, at_s=0.0) is not None)
    assert kept == [True, False, True, True]
    assert [c.call for c in record.checkpoints] == [1, 3, 4]
    assert not list((tmp_path / "record").rglob("incoming*"))
