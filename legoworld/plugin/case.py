"""One photo, one live scene, one ledger: what each tool of the plugin does.

A case outlives the process: it is read back from its ledger. Every call is an entry there, failed
ones with their error, and a failed call never counts as an edit.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from legoworld.files import sha256_of_text
from legoworld.plugin.acceptance import list_worse
from legoworld.plugin.artefacts import ARTEFACTS, Artefacts
from legoworld.plugin.diff import changes
from legoworld.plugin.evidence import Evidence
from legoworld.plugin.live import LiveBlender
from legoworld.plugin.measure import measure, only
from legoworld.plugin.open_ledger import OpenLedger, TransactionError
from legoworld.plugin.remaining_work import standing_requirements
from legoworld.plugin.state import LiveScene
from legoworld.plugin.transactions import judge, unknown_names
from legoworld.pluralize import first_few
from legoworld.records.base import as_json, canonical, to_record
from legoworld.records.plugin_ledger import Declaration, Entry, Judgement, TransactionLimits
from legoworld.records.plugin_requirements import Colour, Luminance, Report, Requirement
from legoworld.records.plugin_state import Change, SceneState

STATES: Final = "states"


class Case(OpenLedger):
    """The tools over one ledger. live: the scene; evidence: of the photo, None without any.

    require_transaction: refuse edits made outside a transaction; otherwise report them.
    """

    def __init__(
        self,
        folder: Path,
        live: LiveBlender,
        evidence: Evidence | None,
        limits: TransactionLimits,
        *,
        require_transaction: bool = False,
    ) -> None:
        super().__init__(folder, folder / STATES)
        self.folder = folder
        self.artefacts = Artefacts(folder / ARTEFACTS)
        self.live, self.evidence, self._limits = live, evidence, limits
        self._strict = require_transaction
        if live is not None:
            self.interruption.ends.append(lambda: live.interrupt())

    def serve(self) -> None:
        """Begin or continue the case: what it is measured against is on record, and stays.

        TransactionError where the ledger is of other evidence. An open transaction is resumed.
        """
        about = None if self.evidence is None else sha256_of_text(canonical(self.evidence.file))
        known = [e.request["evidence_sha256"] for e in self.ledger.entries if e.tool == "serve"]
        if known and about != known[0]:
            raise TransactionError(
                "the ledger is a case of other evidence",
                found=f"evidence {(about or 'none')[:12]}",
                expected=f"evidence {(known[0] or 'none')[:12]}, as when the case began",
                next_step="pass that --photo and --evidence, or another --ledger",
            )
        if not known:
            self.record("serve", {"evidence_sha256": about}, lambda: None)
        self.resume()

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
        """Open a transaction: the scene as it is now is what a rollback returns to.

        The entry's answer has `unguarded`: what changed since the last transaction ended. Where a
        transaction is required for every edit, such changes are refused.
        """
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
        wanted = (*declaration.requirements, *self._protected_requirements(declaration))
        scene, base = self.live.read(keep=True, render_wh=self._render_wh(wanted))
        self.note(scene)
        unguarded = self.unguarded_changes(scene.state)
        if unknown := unknown_names(declaration, scene.state):
            raise TransactionError(
                "the declaration protects what the scene does not have",
                found=", ".join(unknown),
                expected="names of objects or collections",
            )
        self.keep_base(scene.state, base)
        return {
            "base_sha256": base,
            "scene_signature": scene.state.scene_signature,
            "unguarded": list(as_json(unguarded)),
            "report": as_json(measure(scene, wanted, self.evidence)) if wanted else None,
        }

    def _protected_requirements(self, declaration: Declaration) -> tuple[Requirement, ...]:
        """What earlier transactions required of other entities: this one must not break it."""
        own = {*declaration.editable}
        return tuple(
            r
            for r in standing_requirements(self.ledger.entries)
            if r not in declaration.requirements and getattr(r, "entity", None) not in own
        )

    def unguarded_changes(self, now: SceneState) -> tuple[Change, ...]:
        """Edits outside transactions: changes since the last one ended. Empty before the first.

        TransactionError for any where edits without a transaction are refused.
        """
        if self.last_settled() is None or self.phase == "open":
            return ()
        edits = changes(self.base(), now)
        if edits and self._strict:
            raise TransactionError(
                "the scene was edited while no transaction was open",
                found=told_changes(edits),
                expected="edits between begin and commit",
                next_step="undo them, or call rollback: it returns to the last committed scene",
            )
        return edits

    def diff(self) -> tuple[Change, ...]:
        """Every change since the open transaction began."""

        def call() -> tuple[Change, ...]:
            self.begun_entry()
            return changes(self.base(), self.read().state)

        return self.record("diff", {}, call)

    def commit(self, number: int | None = None) -> tuple[Judgement, Report]:
        """Judge the scene as it is now, and close the transaction if it is accepted.

        A transaction that is not accepted stays open for `rounds` corrections. number: the
        transaction that is meant, None for the open one.
        """

        def call() -> tuple[Judgement, Report]:
            begun = self.begun_entry(number)
            declaration = to_record(Declaration, begun.request)
            refused = self.count("commit", since=begun.seq)
            if refused > self._limits.rounds:
                raise TransactionError(
                    "the transaction has no corrections left",
                    found=f"{refused} commits were refused",
                    expected=f"at most {self._limits.rounds} corrections",
                    next_step="roll it back",
                )
            measured = begun.answer.get("report")
            then = to_record(Report, measured).results if measured else ()
            before, own = self.base(), declaration.requirements
            wanted = tuple(result.requirement for result in then) or own
            scene, copy = self.live.read(keep=True, render_wh=self._render_wh(wanted))
            self.note(scene)
            now = measure(scene, wanted, self.evidence)
            worse = list_worse(then, now.results, len(own)) if then else ()
            report = only(now, len(own))
            judgement = judge(before, scene.state, declaration, report, worse)
            if judgement.accepted:
                self.keep_base(scene.state, copy)
            return judgement, report

        request = {} if number is None else {"transaction": number}
        return self.record("commit", request, call, closes=lambda made: made[0].accepted)

    def rollback(self, number: int | None = None) -> SceneState:
        """Return to the scene as it was when the transaction began, proven by its signature.

        Where every edit needs a transaction, also from edits without one to the last committed
        scene. number: the transaction that is meant, None for the open one.
        """

        def call() -> SceneState:
            # Where nothing else is left to do, the way back is free.
            free = self._strict and self.phase == "idle" and self._is_edited()
            if not free:
                refused = self.count("commit", since=self.begun_entry(number).seq)
                free = refused > self._limits.rounds
            if not free and self.count("rollback") >= self._limits.rollbacks:
                raise TransactionError(
                    "the case has no rollbacks left",
                    found=f"{self._limits.rollbacks} were made",
                    expected=f"at most {self._limits.rollbacks}",
                    next_step="correct the scene and commit; once its corrections are used up, "
                    "rollback is free",
                )
            base = self.base()
            assert self._base is not None
            self.live.restore(self._base, base)
            self.note_state(base)
            return base

        request = {} if number is None else {"transaction": number}
        return self.record("rollback", request, call, closes=lambda _: True)

    def _is_edited(self) -> bool:
        """Whether the scene is another than the last transaction left."""
        settled = self.last_settled()
        now = self.read().state.scene_signature
        return settled is not None and settled.scene_signature != now

    def read(self, requirements: Sequence[Requirement] = ()) -> LiveScene:
        """The scene as it is now, rendered only where a requirement needs it."""
        scene, _ = self.live.read(render_wh=self._render_wh(requirements))
        self.note(scene)
        return scene

    def _render_wh(self, requirements: Sequence[Requirement]) -> tuple[int, int] | None:
        rendered = any(isinstance(r, Colour | Luminance) for r in requirements)
        return self.evidence.size_wh if self.evidence and rendered else None


def told_changes(edits: Sequence[Change]) -> str:
    """Changes in words, at most five."""
    return first_few([f"{change.entity} ({change.kind})" for change in edits], 5)
