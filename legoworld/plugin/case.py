"""One photo, one live scene, one ledger: what each tool of the plugin does.

A case outlives the process: it is read back from its ledger. Every call is an entry there, failed
ones with their error, and a failed call never counts as an edit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final, TypeVar

from legoworld.errors import LegoWorldError
from legoworld.plugin.artefacts import ARTEFACTS, Artefacts
from legoworld.plugin.diff import changes
from legoworld.plugin.evidence import Evidence
from legoworld.plugin.ledger import Ledger
from legoworld.plugin.live import LiveBlender
from legoworld.plugin.measure import measure
from legoworld.plugin.state import LiveScene
from legoworld.plugin.transactions import judge, unknown_names
from legoworld.records.base import as_json, decode, readable, to_record
from legoworld.records.plugin_ledger import (
    Declaration,
    Entry,
    Judgement,
    Phase,
    TransactionLimits,
)
from legoworld.records.plugin_requirements import Luminance, Report, Requirement
from legoworld.records.plugin_state import Change, SceneState

STATES: Final = "states"
_T = TypeVar("_T")


class TransactionError(LegoWorldError):
    """A call that does not fit where the case stands, or is beyond its limits."""

    code = "transaction"


class Case:
    """The tools over one ledger. live: the scene; evidence: of the photo, None without any."""

    def __init__(
        self,
        folder: Path,
        live: LiveBlender,
        evidence: Evidence | None,
        limits: TransactionLimits,
    ) -> None:
        self.ledger = Ledger(folder)
        self.folder, self._states = folder, folder / STATES
        self._states.mkdir(exist_ok=True)
        self.artefacts = Artefacts(folder / ARTEFACTS)
        self.live, self.evidence, self._limits = live, evidence, limits
        #: The last state that was read by this process.
        self.scene: LiveScene | None = None
        self._signatures: tuple[str | None, str | None] = (None, None)
        if self.ledger.entries:
            last = self.ledger.entries[-1]
            self._signatures = (last.geometry_signature, last.scene_signature)

    # Where the case stands, read off the ledger.

    @property
    def phase(self) -> Phase:
        """Whether a transaction is open."""
        return self.ledger.entries[-1].phase if self.ledger.entries else "idle"

    @property
    def transaction(self) -> int:
        """The number of the last transaction that began; 0 before any."""
        return max((e.transaction or 0 for e in self.ledger.entries), default=0)

    def _count(self, tool: str, since: int = 0) -> int:
        """How many calls of a tool went well, after the first `since` entries."""
        return sum(e.tool == tool and e.error is None for e in self.ledger.entries[since:])

    def _begun(self) -> Entry:
        """The entry that began the open transaction. TransactionError without one."""
        if self.phase != "open":
            raise TransactionError(
                "no transaction is open",
                found=f"{self.transaction} so far, all of them ended",
                expected="a transaction that was begun",
                next_step="call begin with a declaration first",
            )
        return next(e for e in reversed(self.ledger.entries) if e.tool == "begin" and not e.error)

    # Tools.

    def measure(self, requirements: Sequence[Requirement]) -> Report:
        """Measure requirements on the scene as it is now."""
        request = {"requirements": as_json(tuple(requirements))}

        def call() -> Report:
            return measure(self.read(requirements), requirements, self.evidence)

        return self.record("measure", request, call)

    def resume(self) -> int | None:
        """Record that a transaction of an earlier process is open still; its number, else None.

        What it may be: edited on, committed, or rolled back to the copy that `begin` kept.
        """
        if self.phase != "open":
            return None
        number = self.transaction
        self.record("resume", {}, lambda: {"transaction": number})
        return number

    def begin(self, declaration: Declaration) -> Entry:
        """Open a transaction: the scene as it is now is what a rollback returns to."""
        request = as_json(declaration)
        self.record("begin", request, lambda: self._begin(declaration), opens=True)
        return self.ledger.entries[-1]

    def _begin(self, declaration: Declaration) -> dict[str, Any]:
        if self.phase == "open":
            raise TransactionError(
                f"transaction {self.transaction} is open",
                found="a second begin",
                expected="one transaction at a time",
                next_step="commit it or roll it back first",
            )
        if self.transaction >= self._limits.transactions:
            raise TransactionError(
                "the case has no transactions left",
                found=f"{self.transaction} were begun",
                expected=f"at most {self._limits.transactions}",
                next_step="export the scene as it is",
            )
        scene, base = self.live.read(keep=True)
        self.note(scene)
        if unknown := unknown_names(declaration, scene.state):
            raise TransactionError(
                "the declaration protects what the scene does not have",
                found=", ".join(unknown),
                expected="names of objects or collections",
            )
        (self._states / f"{scene.state.scene_signature}.json").write_text(
            readable(scene.state), encoding="utf-8"
        )
        return {"base_sha256": base, "scene_signature": scene.state.scene_signature}

    def diff(self) -> tuple[Change, ...]:
        """Every change since the open transaction began."""
        return self.record("diff", {}, lambda: changes(self.base(), self.read().state))

    def commit(self) -> tuple[Judgement, Report]:
        """Judge the scene as it is now, and close the transaction if it is accepted.

        A transaction that is not accepted stays open for `rounds` corrections.
        """

        def call() -> tuple[Judgement, Report]:
            begun = self._begun()
            declaration = to_record(Declaration, begun.request)
            refused = self._count("commit", since=begun.seq)
            if refused > self._limits.rounds:
                raise TransactionError(
                    "the transaction has no corrections left",
                    found=f"{refused} commits were refused",
                    expected=f"at most {self._limits.rounds} corrections",
                    next_step="roll it back",
                )
            before = self.base()
            scene = self.read(declaration.requirements)
            report = measure(scene, declaration.requirements, self.evidence)
            return judge(before, scene.state, declaration, report), report

        return self.record("commit", {}, call, closes=lambda made: made[0].accepted)

    def rollback(self) -> SceneState:
        """Return to the scene as it was when the transaction began, proven by its signature."""

        def call() -> SceneState:
            begun = self._begun()
            if self._count("rollback") >= self._limits.rollbacks:
                raise TransactionError(
                    "the case has no rollbacks left",
                    found=f"{self._limits.rollbacks} were made",
                    expected=f"at most {self._limits.rollbacks}",
                    next_step="correct the scene by hand until commit accepts it",
                )
            base = self.base()
            assert begun.base_sha256 is not None
            self.live.restore(begun.base_sha256, base)
            self._signatures = (base.geometry_signature, base.scene_signature)
            return base

        return self.record("rollback", {}, call, closes=lambda _: True)

    # Reading and recording.

    def base(self) -> SceneState:
        """The state in which the open transaction began."""
        signature = self._begun().answer["scene_signature"]
        stored = (self._states / f"{signature}.json").read_bytes()
        return decode(SceneState, stored)

    def read(self, requirements: Sequence[Requirement] = ()) -> LiveScene:
        """The scene as it is now, rendered only where a requirement needs it."""
        rendered = any(isinstance(r, Luminance) for r in requirements)
        photo = self.evidence.size_wh if self.evidence and rendered else None
        scene, _ = self.live.read(luma_wh=photo)
        self.note(scene)
        return scene

    def note(self, scene: LiveScene) -> None:
        """Have the signatures of a state that was read in the entry of this call."""
        self.scene = scene
        self._signatures = (scene.state.geometry_signature, scene.state.scene_signature)

    def record(
        self,
        tool: str,
        request: dict[str, Any],
        call: Callable[[], _T],
        *,
        opens: bool = False,
        closes: Callable[[_T], bool] | None = None,
    ) -> _T:
        """Make a call and append it, an error included, before anybody is told how it ended."""
        phase = self.phase
        open_now = self.transaction if phase == "open" else None
        base = self._begun().base_sha256 if phase == "open" else None
        try:
            made = call()
        except LegoWorldError as error:
            self._append(tool, request, None, str(error), phase, open_now, base)
            raise
        number, after = open_now, phase
        if opens:
            number, after = self.transaction + 1, "open"
            base = made["base_sha256"] if isinstance(made, dict) else None
        elif closes is not None and closes(made):
            after = "idle"
        self._append(tool, request, as_json(made), None, after, number, base)
        return made

    def _append(
        self,
        tool: str,
        request: dict[str, Any],
        answer: Any,
        error: str | None,
        phase: Phase,
        transaction: int | None,
        base: str | None,
    ) -> None:
        self.ledger.append(
            tool=tool,
            request=request,
            answer=answer,
            error=error,
            phase=phase,
            transaction=transaction,
            signatures=self._signatures,
            base_sha256=base,
        )
