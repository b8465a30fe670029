"""A trial's Blender as its clients see it: every command gets an answer, successful or not."""

from __future__ import annotations

import secrets
import stat
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path, PurePath
from typing import Final, Literal

from legoworld.beneath import Beneath, RefusedFileError, name_beneath
from legoworld.endpoint.blender import BlenderEndedError, LiveBlender, again_if_killed
from legoworld.endpoint.screenshots import MOST_BYTES, NotShownError, deliver_picture
from legoworld.endpoint.trial_record import TrialRecord
from legoworld.errors import LegoWorldError, one_line
from legoworld.files import Json
from legoworld.records.endpoint import (
    Answer,
    BlenderReply,
    Call,
    Caller,
    Checkpoint,
    Command,
    Failure,
    Success,
)
from legoworld.scene.folder import BLEND
from legoworld.workers.protections import Protections
from legoworld.workers.sandbox import SandboxLimits

#: mcp-for-blender waits 180 s for an answer.
CALL_TIME_S: Final = 165.0
_SAVE_WITHIN_S: Final = 120.0
_PICTURE: Final = "screenshot.png"
_COPY: Final = "checkpoint.blend"
_RECOVERED: Final = PurePath("recovered.blend")
#: What needs a network or an account, and is off: the add-on's words for its libraries.
_OFF: Final = ("polyhaven", "hyper3d", "sketchfab", "polypizza", "hunyuan3d", "tripo", "meshy")
_BY_BLENDER: Final = (
    "execute_code", "export_scene", "get_addon_info", "get_object_info", "get_scene_info",
    "get_viewport_screenshot", "list_scene_items",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Trial:
    """The settings of a session.

    workspace: the folder Blender can write to; record: where calls and checkpoints are kept, which
    it cannot write to; limits: of the whole trial; inputs: what Blender can read besides; blend:
    the scene to begin with; lease: a descriptor that Blender's keeper holds until all has ended;
    calls: so many of the agent's are answered, None for all.
    """

    workspace: Path
    record: Path
    limits: SandboxLimits
    protections: Protections
    inputs: Sequence[Path] = ()
    blend: Path | None = None
    call_time_s: float = CALL_TIME_S
    lease: int | None = None
    calls: int | None = None


class ScenePassedOverError(LegoWorldError):
    """The last scene did not open; an earlier one is open."""

    code = "scene_passed_over"


class Session:
    """Answers commands one after the other, from any thread.

    Blender is started with the first command, and again after it has crashed, was ended at a limit
    or did not stop: with the scene as the last call that came back had left it.
    """

    def __init__(self, trial: Trial) -> None:
        self._trial = trial
        self._record = TrialRecord(trial.record)
        self._live: LiveBlender | None = None
        self._busy = threading.Lock()
        rows = self._record.calls
        self._start_s = time.monotonic() - (rows[-1].at_s + rows[-1].seconds if rows else 0.0)
        #: Of the open scene's file: a save of an unchanged scene has the same bytes.
        self._live_sha256 = ""
        #: Why the open scene is not the last one; cleared once reported to a client.
        self._passed_over = ""
        #: Whether a call above the trial's was asked for.
        self.over_calls = False
        #: Of the file that was looked at last; a continued trial looks at what is there once more.
        self._last_stamp: tuple[int, ...] | None = None if rows else self._saved_stamp()

    @property
    def record(self) -> TrialRecord:
        """The calls and checkpoints so far."""
        return self._record

    def start(self) -> None:
        """Start Blender now; raises BlenderEndedError where it does not start."""
        with self._busy:
            self._blender()

    def restart_clock(self, used_s: float = 0.0) -> None:
        """Count times from now on: those of calls, and the trial's own, of which some is used."""
        self._start_s = time.monotonic() - used_s

    def answer(self, command: Command, by: Caller = "agent") -> Answer:
        """The answer to a command; a failure is an answer, too. by: who sent it."""
        if command.type == "get_workspace":
            return Success(result={"workspace": str(self._trial.workspace.resolve())})
        known = _without_blender(command)
        if known is not None:
            return known
        if command.type not in _BY_BLENDER:
            return Failure(message=f"Unknown command type: {command.type}")
        with self._busy:
            if self._left_s() <= 0:
                over = f"the trial's {self._trial.limits.time_s:g} s are over"
                return Failure(message=f"{over}; no further call is possible")
            most = self._trial.calls
            if most and by == "agent" and sum(c.by == by for c in self._record.calls) >= most:
                self.over_calls = True
                return Failure(message=f"all {most} calls are made; no further call is possible")
            return self._answer_command(command, by)

    def keep_last_save(self) -> None:
        """Keep what the agent saved in the workspace after its last call, by other means."""
        with self._busy:
            self._keep_saved(len(self._record.calls))

    def close(self) -> None:
        """End Blender. What was recorded stays."""
        live, self._live = self._live, None
        if live is not None:
            live.close()

    def _answer_command(self, command: Command, by: Caller) -> Answer:
        number, at_s = len(self._record.calls) + 1, self._at_s()
        params = command.params or {}
        seconds, left = 0.0, None
        status: Literal["success", "error", "crashed", "timeout"] = "error"
        try:
            reply = self._ask_blender(command.type, params)
            seconds = reply.seconds
            answer = _make_answer(reply)
            if isinstance(answer, Success):
                status = "success"
            elif reply.stopped:
                status = "timeout"
            if command.type in ("execute_code", "get_viewport_screenshot"):
                left = self._checkpoint(number, keep=command.type == "execute_code")
        except BlenderEndedError as error:
            self._live = None
            status = "timeout" if error.limit == "time" else "crashed"
            answer = Failure(message=self._describe_end(error))
            seconds = self._at_s() - at_s
        except (LegoWorldError, OSError) as error:
            answer = Failure(message=str(error))
        code = params.get("code")
        self._record.note(
            Call(
                number=number,
                command=command.type,
                code=code if isinstance(code, str) else None,
                at_s=round(at_s, 4),
                seconds=round(seconds, 6),
                status=status,
                said=one_line(_answer_text(answer), 400),
                checkpoint=None if left is None else left.ordinal,
                by=by,
            )
        )
        return answer

    def _ask_blender(self, kind: str, params: Mapping[str, Json]) -> BlenderReply:
        limit = min(self._trial.call_time_s, max(self._left_s(), 0.1))
        self._blender()
        if self._passed_over:
            said, self._passed_over = self._passed_over, ""
            raise ScenePassedOverError(said, next_step="look at the scene, and go on from there")
        if kind == "get_viewport_screenshot":
            return self._screenshot(params, limit)
        if kind == "export_scene":
            path = params.get("filepath")
            if not isinstance(path, str) or name_beneath(path, self._trial.workspace) is None:
                raise NotShownError(
                    "export_scene writes only to the workspace",
                    found=str(path),
                    expected=f"a path below {self._trial.workspace.resolve()}",
                )
        return self._blender().ask(kind, params, limit)

    def _screenshot(self, params: Mapping[str, Json], limit: float) -> BlenderReply:
        """Render inside, and put the picture where the client will look for it."""
        wanted = str(params.get("filepath") or "")
        live = self._blender()
        inside = {**params, "filepath": live.path_inside(_PICTURE)}
        reply = live.ask("get_viewport_screenshot", inside, limit)
        if isinstance(reply.result, dict) and reply.result.get("success"):
            with Beneath(live.files) as files:
                picture = files.read(live.output_name(_PICTURE), most_bytes=MOST_BYTES)
            deliver_picture(picture, wanted, self._trial.workspace)
            reply.result["filepath"] = wanted
        return reply

    def _blender(self) -> LiveBlender:
        if self._live is None:
            self._live = self._start_blender()
            if (copy := self._saved_copy()) is not None:
                copy[0].unlink()
                self._live_sha256 = copy[1]
        return self._live

    def _start_blender(self) -> LiveBlender:
        """A new Blender with the last live checkpoint that opens; as it began where none does.

        A skipped checkpoint is reported with the next answer.
        """
        first: BlenderEndedError | None = None
        for last in (*self._record.newest("live"), None):
            try:
                started = again_if_killed(partial(self._open_checkpoint, last))
            except BlenderEndedError as error:
                first = first or error
                if last is None or error.limit == "time":
                    raise first from error
                continue
            if first is not None:
                state = "as it began" if last is None else f"as call {last.call} left it"
                self._passed_over = f"the scene does not open any more ({first}); it is {state}"
            return started
        raise AssertionError  # the last one is returned or raised

    def _open_checkpoint(self, last: Checkpoint | None) -> LiveBlender:
        limits = self._trial.limits
        return LiveBlender(
            self._trial.workspace,
            replace(limits, time_s=max(self._left_s(), 0.1)),
            self._trial.protections,
            blend=self._trial.blend if last is None else self._copy_for_recovery(last),
            inputs=self._trial.inputs,
            lease=self._trial.lease,
        )

    def _copy_for_recovery(self, last: Checkpoint) -> Path:
        """A checkpoint in the workspace: what the agent saves next must not go into the store."""
        return copy_into_workspace(self._record.blend(last), self._trial.workspace, _RECOVERED)

    def _checkpoint(self, call: int, *, keep: bool) -> Checkpoint | None:
        """Keep the open scene, and what the agent has saved, where they changed.

        keep: whether the call may have changed the scene. A render's settings are put back, yet
        Blender marks what it looked at: the scene after it is the one before.
        """
        left = None
        if (saved := self._saved_copy()) is not None:
            copy, sha256 = saved
            if keep and sha256 != self._live_sha256:
                at_s = self._at_s()
                left = self._record.take(copy, sha256, kind="live", call=call, at_s=at_s)
            else:
                copy.unlink()
            self._live_sha256 = sha256
        return self._keep_saved(call) or left

    def _saved_copy(self) -> tuple[Path, str] | None:
        """A copy of the open scene beside the store and its hash; None where it cannot be saved."""
        live = self._blender()
        reply = live.ask("save_copy", {"output": live.path_inside(_COPY)}, _SAVE_WITHIN_S)
        try:
            return (
                None
                if reply.error
                else self._record.copy_incoming(live.files, live.output_name(_COPY))
            )
        except RefusedFileError:
            return None

    def _keep_saved(self, call: int) -> Checkpoint | None:
        """Keep the scene.blend that the agent saved, before a later call can spoil it."""
        stamp = self._saved_stamp()
        if stamp is None or stamp == self._last_stamp:
            return None
        self._last_stamp = stamp
        return self._record.keep_saved(self._trial.workspace, call=call, at_s=self._at_s())

    def _saved_stamp(self) -> tuple[int, ...] | None:
        try:
            with Beneath(self._trial.workspace.resolve()) as inside:
                status = inside.status(BLEND)
        except RefusedFileError:
            return None
        return status and (status.st_ino, status.st_size, status.st_mtime_ns)

    def _describe_end(self, error: BlenderEndedError) -> str:
        if self._left_s() <= 0:
            return f"{error}; no further call is possible"
        last = self._record.last("live")
        where = "as it began" if last is None else f"as call {last.call} left it"
        return f"{error}; the next call finds Blender started anew, with the scene {where}"

    def _at_s(self) -> float:
        return time.monotonic() - self._start_s

    def _left_s(self) -> float:
        return self._trial.limits.time_s - self._at_s()


def copy_into_workspace(blend: Path, workspace: Path, name: PurePath) -> Path:
    """Copy a .blend into a workspace; under another name if a folder has this name."""
    with Beneath(workspace.resolve()) as inside:
        there = inside.status(name)
        if there is not None and stat.S_ISDIR(there.st_mode):
            name = name.with_name(f".{secrets.token_hex(8)}.blend")
        inside.copy_in(blend, name)
    return workspace / name


def _without_blender(command: Command) -> Answer | None:
    """The answers that need no Blender."""
    if command.type == "ping":
        return Success(result={"pong": True})
    if command.type == "get_telemetry_consent":
        return Success(result={"consent": False})
    if command.type == "set_telemetry_consent":
        return Success(result={"error": "this endpoint collects nothing, and that stays so"})
    name = command.type.removeprefix("get_").removesuffix("_status")
    if name in _OFF and command.type == f"get_{name}_status":
        off = "This endpoint has no asset libraries and no generators: build with bpy."
        return Success(result={"enabled": False, "message": off})
    return None


def _make_answer(reply: BlenderReply) -> Answer:
    return Success(result=reply.result) if reply.error is None else Failure(message=reply.error)


def _answer_text(answer: Answer) -> str:
    if isinstance(answer, Failure):
        return answer.message
    result = answer.result
    return str(result.get("result", "")) if isinstance(result, dict) else ""
