"""The plugin's tools, as a table: what each is told, does and answers."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import msgspec

from legoworld.errors import UsageError
from legoworld.plugin.case import Case
from legoworld.plugin.evidence import Evidence
from legoworld.plugin.final_steps import export, note_review, render_for_review, validate
from legoworld.plugin.initial_room import install_room
from legoworld.plugin.initialisation import recover
from legoworld.plugin.plan import construction_plan
from legoworld.plugin.result_pictures import result_pictures
from legoworld.plugin.room import assign_structures
from legoworld.plugin.server_looks import Looking, look
from legoworld.plugin.tool_answers import answer_page, answer_report, answer_state, page_start
from legoworld.readouts.pictures import png_bytes
from legoworld.records import plugin_calls as calls
from legoworld.records.base import as_json, to_record
from legoworld.records.plugin_install import Module
from legoworld.records.plugin_ledger import Declaration
from legoworld.records.plugin_requirements import Report


@dataclass(frozen=True, kw_only=True)
class Session:
    """What a server serves: a case, the photo's evidence, the modules that are on."""

    case: Case
    evidence: Evidence | None
    modules: Sequence[Module]

    def require_evidence(self) -> Evidence:
        """The evidence. UsageError without any."""
        if self.evidence is None:
            raise UsageError(
                "there is no evidence of the photo",
                found="a server without --evidence",
                expected="regions and the camera of the photo",
                next_step="run `legoworld plugin evidence`, then serve with --evidence",
            )
        return self.evidence


@dataclass(frozen=True)
class Tool:
    """A row of the table. says: for the model; arguments, answer: types of records.

    answer: None for content beside which a client would leave out the picture. hints: words of
    `reads` (it changes nothing but the ledger), `undoes` (it takes edits back), `again` (a second
    call changes nothing more), `to its end` (cancelled, it runs on unheard).
    """

    name: str
    title: str
    says: str
    arguments: type[msgspec.Struct]
    answer: type[msgspec.Struct] | None
    call: Callable[[Session, Any], msgspec.Struct | tuple[msgspec.Struct, bytes]]
    hints: tuple[str, ...] = ()


def _reference_evidence(session: Session, _: calls.NoArguments) -> calls.EvidenceAnswer:
    known = session.evidence
    shown = None if known is None else to_record(calls.ShownEvidence, as_json(known.file))
    return calls.EvidenceAnswer(evidence=shown, **answer_state(session.case))


def _measure(session: Session, call: calls.MeasureArguments) -> calls.ReportAnswer:
    return _report_answer(session, session.case.measure(call.requirements), call.pictures)


def _validate(session: Session, call: calls.ValidateArguments) -> calls.ReportAnswer:
    return _report_answer(session, validate(session.case, call.requirements), call.pictures)


def _report_answer(session: Session, report: Report, pictures: bool) -> calls.ReportAnswer:
    case = session.case
    drawn = None
    if pictures:
        assert case.scene is not None  # the report is of it
        drawn = tuple(
            None if p is None else case.artefacts.keep(png_bytes(p), "png")
            for p in result_pictures(case.scene, case.evidence, report)
        )
    return calls.ReportAnswer(pictures=drawn, **answer_report(case, report), **answer_state(case))


def _begin(session: Session, declaration: Declaration) -> calls.BeginAnswer:
    if declaration.requirements and "measurement" not in session.modules:
        raise UsageError(
            "requirements cannot be measured in this run",
            found=f"{len(declaration.requirements)} requirements; the module `measurement` is off",
            expected="a declaration without requirements",
        )
    begun = session.case.begin(declaration)
    assert begun.transaction is not None
    said = {"transaction": begun.transaction, "unguarded": begun.answer["unguarded"]}
    return to_record(calls.BeginAnswer, {**said, **answer_state(session.case)})


def _status(session: Session, _: calls.NoArguments) -> calls.StatusAnswer:
    case = session.case
    entries = case.ledger.entries
    since = max((e.seq for e in entries if e.tool == "begin" and not e.error), default=0)
    resumed = case.phase == "open" and any(e.tool == "resume" for e in entries[since:])
    return calls.StatusAnswer(
        phase=case.phase, transaction=case.transaction, resumed=resumed, **answer_state(case)
    )


def _diff(session: Session, _: calls.NoArguments) -> calls.DiffAnswer:
    return calls.DiffAnswer(changes=session.case.diff(), **answer_state(session.case))


def _commit(session: Session, call: calls.TransactionArguments) -> calls.CommitAnswer:
    judgement, report = session.case.commit(call.transaction)
    return calls.CommitAnswer(
        judgement=judgement,
        **answer_report(session.case, report),
        **answer_state(session.case),
    )


def _rollback(session: Session, call: calls.TransactionArguments) -> calls.RollbackAnswer:
    restored = session.case.rollback(call.transaction).scene_signature
    return calls.RollbackAnswer(restored=restored, **answer_state(session.case))


def _history(session: Session, call: calls.HistoryArguments) -> calls.HistoryAnswer:
    shown = tuple(
        calls.ShownEntry(
            seq=e.seq, tool=e.tool, error=e.error, phase=e.phase, transaction=e.transaction,
            scene_signature=e.scene_signature,
        )
        for e in session.case.ledger.entries[-call.last :]
    )  # fmt: skip
    return calls.HistoryAnswer(entries=shown, **answer_state(session.case))


def _initialize(session: Session, call: calls.InitializeArguments) -> calls.InitializeAnswer:
    made = recover(session.require_evidence(), call.structures, call.camera_height_m)
    kept = install_room(session.case, made)
    return calls.InitializeAnswer(
        room=made.room, plan=made.plan, kept=kept, **answer_state(session.case)
    )


def _plan(session: Session, call: calls.PlanArguments) -> calls.PlanAnswer:
    known = session.require_evidence()
    made = construction_plan(known, assign_structures(known, call.structures))
    return calls.PlanAnswer(plan=made, **answer_state(session.case))


def _review(
    session: Session, call: calls.ReviewArguments
) -> calls.ReviewAnswer | tuple[calls.ReviewAnswer, bytes]:
    if call.render_sha256 is not None:
        noted = note_review(session.case, call.render_sha256, call.findings or ())
        return calls.ReviewAnswer(**as_json(noted), **answer_state(session.case))
    made, png = render_for_review(session.case)
    return calls.ReviewAnswer(**as_json(made), **answer_state(session.case)), png


def _look(session: Session, call: Looking) -> tuple[calls.LookAnswer, bytes]:
    made, png = look(session.case, call)
    return to_record(calls.LookAnswer, {**as_json(made), **answer_state(session.case)}), png


def _export(session: Session, _: calls.NoArguments) -> calls.ExportAnswer:
    made = export(session.case)
    return calls.ExportAnswer(
        files=made.files, warnings=made.warnings, **answer_state(session.case)
    )


def _next_page(session: Session, call: calls.MoreArguments) -> calls.MoreAnswer:
    sha256, _, start = call.cursor.partition(".")
    begins = page_start(start, "cursor")
    kept = json.loads(session.case.artefacts.read(sha256, "json"))
    if not {"place", "items"} <= kept.keys():
        raise UsageError(
            "cursor names no page", found="a report", expected="next_cursor of an answer"
        )
    page = answer_page(kept, sha256, begins)
    return calls.MoreAnswer(**page, **answer_state(session.case))


_READS: Final = ("reads", "again")
#: In the order of a case.
TOOLS: Final = (
    Tool("reference_evidence", "What the photo says", "Regions, depth and camera of the photo.",
         calls.NoArguments, calls.EvidenceAnswer, _reference_evidence, _READS),
    Tool("initialize", "Install room and camera", "Install room and camera, recovered from the "
         "photo. structures: by region, what it shows.",
         calls.InitializeArguments, calls.InitializeAnswer, _initialize, ("to its end",)),
    Tool("plan", "Construction plan", "Place, extent, relative depth of each object in the photo.",
         calls.PlanArguments, calls.PlanAnswer, _plan, _READS),
    Tool("measure", "Measure requirements", "Pass, fail or unknown of each requirement, with "
         "residual and correction. entity: object with children, or collection. "
         "legoworld://requirements explains the kinds.",
         calls.MeasureArguments, calls.ReportAnswer, _measure, _READS),
    Tool("begin", "Begin an edit", "Before an edit: what may change, what has to hold after.",
         Declaration, calls.BeginAnswer, _begin),
    Tool("status", "Where the case stands", "Whether a transaction is open.",
         calls.NoArguments, calls.StatusAnswer, _status, _READS),
    Tool("diff", "Changes so far", "Changes since begin.",
         calls.NoArguments, calls.DiffAnswer, _diff, _READS),
    Tool("commit", "Judge the edit", "Accept the edit if it was declared and nothing got worse; "
         "else it stays open.", calls.TransactionArguments, calls.CommitAnswer, _commit),
    Tool("rollback", "Take the edit back", "Return to the scene at begin.",
         calls.TransactionArguments, calls.RollbackAnswer, _rollback, ("undoes", "to its end")),
    Tool("validate", "Measure all that was required", "Measure all that commits required, and "
         "more.", calls.ValidateArguments, calls.ReportAnswer, _validate, _READS),
    Tool("look", "Look from any side", "A picture of the scene. around: an entity fills it. "
         "beside: the photo, or the scene at begin, and the difference (red brighter, blue "
         "darker). geometry needs no light.", Looking, None, _look, _READS),
    Tool("review", "Look at the scene", "A render beside the photo; then again with its "
         "render_sha256 and findings, [] for none.",
         calls.ReviewArguments, None, _review),
    Tool("export", "Write the result", "Write scene.blend, scene.glb and renders.",
         calls.NoArguments, calls.ExportAnswer, _export, ("again",)),
    Tool("history", "What was called", "The last calls.",
         calls.HistoryArguments, calls.HistoryAnswer, _history, _READS),
    Tool("more", "The next page", "The rest of an answer with next_cursor.",
         calls.MoreArguments, calls.MoreAnswer, _next_page, _READS),
)  # fmt: skip
