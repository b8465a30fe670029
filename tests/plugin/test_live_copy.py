"""The copy of the live scene, while code in Blender exchanges the folder that it is in."""

from __future__ import annotations

from pathlib import Path

import pytest
from swapping import SWAPS, swapping

from legoworld.plugin.connection import BlenderRefusedError
from legoworld.plugin.live_copy import COPY, LiveCopy


def attempt(use):
    try:
        return use()
    except BlenderRefusedError:
        return "refused"


def test_it_is_read_and_written_in_the_workspace_alone(tmp_path):
    for name in ("workspace", "outside", "store"):
        (tmp_path / name).mkdir()
    victim = tmp_path / "outside" / COPY
    victim.write_text("outside")
    (tmp_path / "stored.blend").write_text("chosen")
    copy = LiveCopy(tmp_path / "workspace" / "d" / COPY, tmp_path / "workspace")
    outcomes = []
    with swapping(tmp_path / "workspace" / "d", tmp_path / "outside"):
        for _ in range(SWAPS):
            outcomes += [
                attempt(lambda: copy.write(tmp_path / "stored.blend")),
                attempt(lambda: copy.keep(tmp_path / "store").read_text()),
                attempt(copy.remove),
            ]
    assert set(outcomes) == {None, "refused", "chosen"}
    assert victim.read_text() == "outside"


def test_a_blender_without_a_workspace_may_name_its_folder_by_a_link(tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "called").symlink_to(tmp_path / "real")
    (tmp_path / "real" / COPY).write_text("scene")
    assert LiveCopy(tmp_path / "called" / COPY, None).keep(tmp_path).read_text() == "scene"


@pytest.mark.parametrize("said", ["/etc/hostname", f"/etc/{COPY}", COPY, f"/w/../etc/{COPY}", "\0"])
def test_what_is_not_in_the_workspace_is_refused(said):
    with pytest.raises(BlenderRefusedError, match="cannot be read from here"):
        LiveCopy(Path(said), Path("/w"))
