"""Blenders that cannot be measured: newer than the reader, or saying what is not so."""

from __future__ import annotations

import json

import pytest

from legoworld.plugin.connection import Address, BlenderConnection, BlenderRefusedError
from legoworld.plugin.live import LiveBlender
from legoworld.scene.blender_process import BlenderProcess, Limits


class Answering(BlenderConnection):
    """A Blender that prints one text, whatever it is asked."""

    def __init__(self, printed: str) -> None:
        super().__init__(Address())
        self._printed = printed

    def run(self, code: str) -> str:
        assert "save_as_mainfile" in code
        return self._printed

    def workspace(self) -> None:
        return None


NEWER = {"copy": "/work/.legoworld-live.blend", "filepath": "", "version": [99, 1]}
LIES = {
    "a newer version": (json.dumps(NEWER), "Blender 99.1"),
    "a copy that is not there": (json.dumps({**NEWER, "version": [4, 2]}), "cannot be read"),
    "another file": (
        json.dumps({**NEWER, "copy": "/etc/hostname", "version": [4, 2]}), "cannot be read",
    ),
    "no version": (json.dumps({"copy": "x", "filepath": ""}), "did not report the path"),
    "nothing": ("", "did not report the path"),
}  # fmt: skip


@pytest.mark.parametrize("name", LIES)
def test_it_is_refused_in_one_line(name, tmp_path):
    printed, why = LIES[name]
    with (
        BlenderProcess(Limits()) as reader,  # never asked, so never started
        pytest.raises(BlenderRefusedError, match=why) as refused,
    ):
        LiveBlender(Answering(printed), reader, tmp_path).read()
    assert "\n" not in str(refused.value)
