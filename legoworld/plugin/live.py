"""The live scene: copied, read and restored over Blender MCP's socket."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from legoworld.errors import LegoWorldError
from legoworld.plugin.connection import BlenderConnection, BlenderRefusedError
from legoworld.plugin.live_copy import COPY, LiveCopy
from legoworld.plugin.small_render import render_small
from legoworld.plugin.state import LiveScene, read_live
from legoworld.records.plugin_state import SceneState
from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.cache import bpy_version

#: The user's file, while a rollback saves under its name.
_ASIDE: Final = ".legoworld-kept"
#: Part of what Blender runs: undo a rollback that ended between its two renames, and lose nothing.
_RECOVER: Final = f"""
import os

def recover(kept):
    aside, number = kept + {_ASIDE!r}, 1
    if not kept or not os.path.lexists(aside):
        return None
    while os.path.lexists(other := f"{{kept}}.legoworld-rollback-{{number}}"):
        number += 1
    if os.path.lexists(kept):
        os.rename(kept, other)
    os.rename(aside, kept)
    return kept
"""
_SAVE: Final = """
import bpy, json
recovered = recover(bpy.data.filepath)
folder = os.path.dirname(bpy.data.filepath) or os.getcwd()
path = os.path.join(folder, {name!r})
version = bpy.app.version[:2]
if version <= {newest!r}:
    bpy.ops.wm.save_as_mainfile(filepath=path, copy=True, compress=False, relative_remap=False)
said = {{"copy": path, "filepath": bpy.data.filepath, "version": version}}
print(json.dumps({{**said, "recovered": recovered}}))
"""
_RESTORE: Final = """
import bpy
kept = {filepath!r}
aside = kept + {aside!r}
recover(kept)
bpy.ops.wm.open_mainfile(filepath={copy!r}, load_ui=False, use_scripts=False)
if kept:
    # Saving is the only way to give the open file its name back; the user's file itself stays.
    held = os.path.exists(kept)
    if held:
        os.replace(kept, aside)
    try:
        bpy.ops.wm.save_as_mainfile(filepath=kept, check_existing=False, relative_remap=False)
    finally:
        if held:
            os.replace(aside, kept)
print("restored")
"""


def _newest() -> tuple[int, int]:
    """Blender's newest version whose files the reader opens: its own."""
    major, minor = bpy_version().split(".")[:2]
    return int(major), int(minor)


class NotRestoredError(LegoWorldError):
    """After a rollback the scene is not what it was: the signatures differ."""

    code = "not_restored"


class LiveBlender:
    """One Blender, seen by copies of its scene.

    store: a folder of copies named by their sha256, of the states that a rollback may return to.
    """

    def __init__(self, blender: BlenderConnection, reader: BlenderProcess, store: Path) -> None:
        self._blender = blender
        self.reader = reader
        self._store = store
        #: The file that an earlier rollback had left under a second name, once it was put back.
        self.recovered: str | None = None

    @contextmanager
    def save_copy(self) -> Iterator[LiveCopy]:
        """A saved copy of the scene as it is now, for as long as the block runs."""
        copy, _ = self._save()
        try:
            yield copy
        finally:
            copy.remove()

    def read(
        self, *, keep: bool = False, render_wh: tuple[int, int] | None = None
    ) -> tuple[LiveScene, str | None]:
        """The scene as it is now; with `keep` also the sha256 of the copy that `restore` takes.

        render_wh: the photo's size, to render the scene small; None to render nothing.
        BlenderRefusedError where its copy is changed meanwhile.
        """
        with self.save_copy() as copy:
            before = copy.sha256()
            scene = read_live(copy.path, self.reader)
            if render_wh is not None and not isinstance(scene.reading, LegoWorldError):
                render = render_small(copy.path, self.reader, render_wh)
                scene = dataclasses.replace(scene, render=render)
            kept = copy.keep(self._store).stem if keep else None
            if (kept or copy.sha256()) != before:
                raise BlenderRefusedError(
                    "the copy of the live scene was changed while it was read",
                    found="another sha256 than before",
                    expected="a file that only Blender's save writes",
                    next_step=f"leave {COPY} to the plugin, and call again",
                )
            return scene, kept

    def interrupt(self) -> None:
        """End what is waited for, from another thread: Blender's answer, or the reader's."""
        self._blender.interrupt()
        self.reader.interrupt()

    def install(self, code: str) -> None:
        """Run the plugin's own code in the live scene; only `initialize` does this."""
        self._blender.run(code)

    def restore(self, sha256: str, state: SceneState) -> None:
        """Make the scene again what it was in a kept copy, and prove it.

        The open file keeps its name, and the file of that name its bytes. NotRestoredError where
        the signature of the restored scene is another.
        """
        copy, filepath = self._save()  # where the open file is, and a place Blender can read
        try:
            copy.write(self._store / f"{sha256}.blend")
            code = _RESTORE.format(copy=str(copy.path), filepath=filepath, aside=_ASIDE)
            self._blender.run(_RECOVER + code)
        finally:
            copy.remove()
        now = self.read()[0].state
        if now.scene_signature != state.scene_signature:
            raise NotRestoredError(
                "the scene is not what it was before the transaction",
                found=now.scene_signature,
                expected=state.scene_signature,
                next_step=f"open {sha256}.blend of the ledger's folder by hand",
            )

    def _save(self) -> tuple[LiveCopy, str]:
        """A copy of the live scene that this process can read, and the open file's own path."""
        newest = _newest()
        said = self._blender.run(_RECOVER + _SAVE.format(name=COPY, newest=newest))
        try:
            answer = json.loads(said.strip().splitlines()[-1])
            copy, filepath = Path(answer["copy"]), str(answer["filepath"])
            major, minor = answer["version"]
            self.recovered = answer.get("recovered") or self.recovered
        except (ValueError, LookupError, TypeError) as error:
            raise BlenderRefusedError(
                "Blender did not report the path of the saved copy",
                found=said[-200:],
                expected="one line of JSON",
            ) from error
        if (major, minor) > newest:
            raise BlenderRefusedError(
                "this Blender is newer than the one that reads its scenes",
                found=f"Blender {major}.{minor}",
                expected=f"Blender {newest[0]}.{newest[1]} or older",
                next_step="drive the scene with that version, or `legoworld blender serve`",
            )
        return LiveCopy(copy, self._blender.workspace()), filepath
