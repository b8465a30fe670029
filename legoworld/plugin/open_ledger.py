"""Where a case stands, read off its ledger, and every call of it as a line there."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeVar

from legoworld.errors import LegoWorldError, cause
from legoworld.files import Json
from legoworld.plugin.interruption import Interruption, cancelled_error
from legoworld.plugin.ledger import Ledger, LedgerBrokenError
from legoworld.plugin.state import LiveScene, compute_signature
from legoworld.records.base import RecordError, Storable, as_json, decode, readable
from legoworld.records.plugin_ledger import Entry, Phase
from legoworld.records.plugin_state import SceneState

_T = TypeVar("_T", bound=Storable)


class TransactionError(LegoWorldError):
    """A call that does not fit where the case stands, or is beyond its limits."""

    code = "transaction"


class OpenLedger:
    """A reopened ledger. states: folder of the state that each transaction began from."""

    def __init__(self, folder: Path, states: Path) -> None:
        self.ledger = Ledger(folder)
        self.interruption = Interruption()
        self._states = states
        states.mkdir(exist_ok=True)
        #: The last state that was read by this process.
        self.scene: LiveScene | None = None
        self._signatures: tuple[str | None, str | None] = (None, None)
        self._base: str | None = None
        if self.ledger.entries:
            last = self.ledger.entries[-1]
            self._signatures = (last.geometry_signature, last.scene_signature)
            self._base = last.base_sha256

    @property
    def phase(self) -> Phase:
        """Whether a transaction is open."""
        return self.ledger.entries[-1].phase if self.ledger.entries else "idle"

    @property
    def transaction(self) -> int:
        """The number of the last transaction that began; 0 before any."""
        return max((e.transaction or 0 for e in self.ledger.entries), default=0)

    def last_settled(self) -> Entry | None:
        """The entry that began the open transaction, or whose state the last one left.

        That is its commit, or its begin where it was rolled back. None before any transaction.
        """
        good = (e for e in reversed(self.ledger.entries) if e.error is None)
        return next(
            (e for e in good if e.tool == "begin" or (e.tool == "commit" and e.phase == "idle")),
            None,
        )

    def begun_entry(self, number: int | None = None) -> Entry:
        """The entry that began the open transaction. TransactionError without one.

        number: the transaction that the caller means, None for the open one.
        """
        begun = self.last_settled()
        if self.phase != "open" or begun is None:
            raise TransactionError(
                "no transaction is open",
                found=f"{self.transaction} so far, all of them ended",
                expected="a transaction that was begun",
                next_step="call begin with a declaration first",
            )
        if number is not None and number != self.transaction:
            raise TransactionError(
                f"transaction {number} is not open",
                found=f"transaction {self.transaction} is",
                expected="the number that begin gave",
                next_step="call status, and end the transaction that is open",
            )
        return begun

    def base(self) -> SceneState:
        """The state of `settled`, as it was read then. LedgerBrokenError where it was changed."""
        settled = self.last_settled()
        assert settled is not None
        path = self._states / f"{settled.scene_signature}.json"
        try:
            state = decode(SceneState, path.read_bytes())
        except (OSError, RecordError) as error:
            raise _changed_error(path, cause(error)) from error
        if compute_signature(state) != settled.scene_signature:
            raise _changed_error(path, "a state of another signature")
        return state

    def keep_base(self, state: SceneState, copy_sha256: str | None) -> None:
        """Make a state the rollback target, starting with this call's entry."""
        path = self._states / f"{state.scene_signature}.json"
        path.write_text(readable(state), encoding="utf-8")
        self._base = copy_sha256

    def count(self, tool: str, since: int = 0) -> int:
        """Number of successful calls of a tool after the first `since` entries."""
        return sum(e.tool == tool and e.error is None for e in self.ledger.entries[since:])

    def note(self, scene: LiveScene) -> None:
        """Add the signatures of a state to this call's entry."""
        self.scene = scene
        self.note_state(scene.state)

    def note_state(self, state: SceneState) -> None:
        """`note` for a state that is known to be the scene's again."""
        self._signatures = (state.geometry_signature, state.scene_signature)

    def record(
        self,
        tool: str,
        request: Mapping[str, Json],
        call: Callable[[], _T],
        *,
        opens: bool = False,
        closes: Callable[[_T], bool] | None = None,
    ) -> _T:
        """Make a call and append it, an error included, before its outcome is returned."""
        phase = self.phase
        open_now, base = self.transaction if phase == "open" else None, self._base
        try:
            made = call()
            if self.interruption.is_requested:  # as it ended: its client has no answer to it
                raise cancelled_error()
            answer = as_json(made)
        except Exception as given:
            error = cancelled_error() if self.interruption.is_requested else given
            told = isinstance(error, LegoWorldError)
            text = str(error) if told else f"{type(error).__name__}: {error}"
            self._base = base
            self._append(tool, request, None, text, phase, open_now)
            if error is given:
                raise
            raise error from given
        number, after = open_now, phase
        if opens:
            number, after = self.transaction + 1, "open"
        elif closes is not None and closes(made):
            after = "idle"
        self._append(tool, request, answer, None, after, number)
        return made

    def _append(
        self,
        tool: str,
        request: Mapping[str, Json],
        answer: Json,
        error: str | None,
        phase: Phase,
        transaction: int | None,
    ) -> None:
        self.ledger.append(
            tool=tool,
            request=request,
            answer=answer,
            error=error,
            phase=phase,
            transaction=transaction,
            signatures=self._signatures,
            base_sha256=self._base,
        )


def _changed_error(path: Path, found: str) -> LedgerBrokenError:
    return LedgerBrokenError(
        f"the stored state {path.name[:12]}... cannot be trusted",
        found=found,
        expected="the state that the ledger names",
        next_step="keep the folder as it is, and begin another case with another --ledger",
    )
