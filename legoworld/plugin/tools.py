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
from legoworld.plugin.tool_answers import judgement_of, page_of, report_of, state_of
from legoworld.readouts.pictures import png_bytes
from legoworld.records import plugin_calls as calls
from legoworld.records.base import as_json, to_record
from legoworld.records.plugin_install import Module
from legoworld.records.plugin_ledger import Declaration
from legoworld.records.plugin_requirements import Report


@dataclass(frozen=True, kw_only=True)
class Served:
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


@dataclass(frozen=True, kw_only=True)
class Tool:
    """A row of the table. says: for the model; reads: changes nothing but the ledger.

    undoes: it takes edits back; again: a second call changes nothing more; ends: a cancelled call
    ends early, otherwise it runs to its end unheard; union: shows all kinds of requirements.
    arguments, answer: types of records; None for content beside which a client would leave out the picture.
    """

    name: str
    title: str
    says: str
    arguments: Any
    answer: Any
    call: Callable[[Served, Any], msgspec.Struct | tuple[msgspec.Struct, bytes]]
    reads: bool = False
    undoes: bool = False
    again: bool = False
    ends: bool = True
    union: bool = False


def _reference_evidence(served: Served, _: calls.NoArguments) -> calls.EvidenceAnswer:
    known = served.evidence
    shown = None if known is None else to_record(calls.ShownEvidence, as_json(known.file))
    return calls.EvidenceAnswer(evidence=shown, **state_of(served.case))


def _measure(served: Served, asked: calls.MeasureArguments) -> calls.ReportAnswer:
    return _report_answer(served, served.case.measure(asked.requirements), asked.pictures)


def _validate(served: Served, asked: calls.ValidateArguments) -> calls.ReportAnswer:
    return _report_answer(served, validate(served.case, asked.requirements), asked.pictures)


def _report_answer(served: Served, report: Report, pictures: bool) -> calls.ReportAnswer:
    case = served.case
    drawn = None
    if pictures:
        assert case.scene is not None  # the report is of it
        drawn = tuple(
            None if p is None else case.artefacts.keep(png_bytes(p), "png")
            for p in result_pictures(case.scene, case.evidence, report)
        )
    return calls.ReportAnswer(pictures=drawn, **report_of(case, report), **state_of(case))


def _begin(served: Served, declaration: Declaration) -> calls.BeginAnswer:
    if declaration.requirements and "measurement" not in served.modules:
        raise UsageError(
            "requirements cannot be measured in this run",
            found=f"{len(declaration.requirements)} requirements; the module `measurement` is off",
            expected="a declaration without requirements",
        )
    begun = served.case.begin(declaration)
    assert begun.transaction is not None
    said = {"transaction": begun.transaction, "unguarded": begun.answer["unguarded"]}
    return to_record(calls.BeginAnswer, {**said, **state_of(served.case)})


def _status(served: Served, _: calls.NoArguments) -> calls.StatusAnswer:
    case = served.case
    entries = case.ledger.entries
    since = max((e.seq for e in entries if e.tool == "begin" and not e.error), default=0)
    resumed = case.phase == "open" and any(e.tool == "resume" for e in entries[since:])
    return calls.StatusAnswer(
        phase=case.phase, transaction=case.transaction, resumed=resumed, **state_of(case)
    )


def _diff(served: Served, _: calls.NoArguments) -> calls.DiffAnswer:
    return calls.DiffAnswer(changes=served.case.diff(), **state_of(served.case))


def _commit(served: Served, asked: calls.TransactionArguments) -> calls.CommitAnswer:
    judgement, report = served.case.commit(asked.transaction)
    return calls.CommitAnswer(
        judgement=judgement_of(judgement),
        **report_of(served.case, report),
        **state_of(served.case),
    )


def _rollback(served: Served, asked: calls.TransactionArguments) -> calls.RollbackAnswer:
    restored = served.case.rollback(asked.transaction).scene_signature
    return calls.RollbackAnswer(restored=restored, **state_of(served.case))


def _history(served: Served, asked: calls.HistoryArguments) -> calls.HistoryAnswer:
    shown = tuple(
        calls.ShownEntry(
            seq=e.seq, tool=e.tool, error=e.error, phase=e.phase, transaction=e.transaction,
            scene_signature=e.scene_signature,
        )
        for e in served.case.ledger.entries[-asked.last :]
    )  # fmt: skip
    return calls.HistoryAnswer(entries=shown, **state_of(served.case))


def _initialize(served: Served, asked: calls.InitializeArguments) -> calls.InitializeAnswer:
    made = recover(served.require_evidence(), asked.structures, asked.camera_height_m)
    kept = install_room(served.case, made)
    return calls.InitializeAnswer(
        room=made.room, plan=made.plan, kept=kept, **state_of(served.case)
    )


def _plan(served: Served, asked: calls.PlanArguments) -> calls.PlanAnswer:
    known = served.require_evidence()
    made = construction_plan(known, assign_structures(known, asked.structures))
    return calls.PlanAnswer(plan=made, **state_of(served.case))


def _review(
    served: Served, asked: calls.ReviewArguments
) -> calls.ReviewAnswer | tuple[calls.ReviewAnswer, bytes]:
    if asked.render_sha256 is not None:
        noted = note_review(served.case, asked.render_sha256, asked.findings or ())
        return calls.ReviewAnswer(**as_json(noted), **state_of(served.case))
    made, png = render_for_review(served.case)
    return calls.ReviewAnswer(**as_json(made), **state_of(served.case)), png


def _export(served: Served, _: calls.NoArguments) -> calls.ExportAnswer:
    made = export(served.case)
    return calls.ExportAnswer(files=made.files, warnings=made.warnings, **state_of(served.case))


def _more(served: Served, asked: calls.MoreArguments) -> calls.MoreAnswer:
    sha256, _, start = asked.cursor.partition(".")
    if not (start.isdecimal() and start.isascii()):
        raise UsageError(
            "there is no such page", found=repr(asked.cursor), expected="next_cursor of an answer"
        )
    kept = json.loads(served.case.artefacts.read(sha256, "json"))
    if not {"place", "items"} <= kept.keys():
        raise UsageError(
            "there is no such page", found="a report", expected="next_cursor of an answer"
        )
    page = page_of(kept, sha256, int(start))
    return calls.MoreAnswer(**page, **state_of(served.case))


#: In the order of a case.
TOOLS: Final = (
    Tool(
        name="reference_evidence",
        title="What the photo says",
        says="Regions of the photo, its depth and camera.",
        arguments=calls.NoArguments,
        answer=calls.EvidenceAnswer,
        call=_reference_evidence,
        reads=True,
        again=True,
    ),
    Tool(
        name="initialize",
        title="Install room and camera",
        says="Recover room and camera from the photo; install both as one transaction. "
        "structures: by region, what it shows.",
        arguments=calls.InitializeArguments,
        answer=calls.InitializeAnswer,
        call=_initialize,
        ends=False,
    ),
    Tool(
        name="plan",
        title="Construction plan",
        says="Place, extent and relative depth of each object in the photo.",
        arguments=calls.PlanArguments,
        answer=calls.PlanAnswer,
        call=_plan,
        reads=True,
        again=True,
    ),
    Tool(
        name="measure",
        title="Measure requirements",
        says="Pass, fail or unknown of each requirement on the scene as it is, with residual and "
        "correction. entity: an object with its children, or a collection. "
        "legoworld://requirements explains the kinds.",
        arguments=calls.MeasureArguments,
        answer=calls.ReportAnswer,
        call=_measure,
        reads=True,
        again=True,
        union=True,
    ),
    Tool(
        name="begin",
        title="Begin an edit",
        says="Before an edit: what may change and how, what may not, what has to hold after.",
        arguments=Declaration,
        answer=calls.BeginAnswer,
        call=_begin,
    ),
    Tool(
        name="status",
        title="Where the case stands",
        says="Whether a transaction is open, and its number.",
        arguments=calls.NoArguments,
        answer=calls.StatusAnswer,
        call=_status,
        reads=True,
        again=True,
    ),
    Tool(
        name="diff",
        title="Changes so far",
        says="Every change since the transaction began.",
        arguments=calls.NoArguments,
        answer=calls.DiffAnswer,
        call=_diff,
        reads=True,
        again=True,
    ),
    Tool(
        name="commit",
        title="Judge the edit",
        says="Accept the edit if it was declared and nothing got worse; else it stays open.",
        arguments=calls.TransactionArguments,
        answer=calls.CommitAnswer,
        call=_commit,
    ),
    Tool(
        name="rollback",
        title="Take the edit back",
        says="Return to the scene as it was when the transaction began.",
        arguments=calls.TransactionArguments,
        answer=calls.RollbackAnswer,
        call=_rollback,
        undoes=True,
        ends=False,
    ),
    Tool(
        name="validate",
        title="Measure all that was required",
        says="Measure all that committed transactions required, and more.",
        arguments=calls.ValidateArguments,
        answer=calls.ReportAnswer,
        call=_validate,
        reads=True,
        again=True,
    ),
    Tool(
        name="review",
        title="Look at the scene",
        says="Without arguments a render beside the photo; then call it with its render_sha256 and "
        "your findings, [] for none.",
        arguments=calls.ReviewArguments,
        answer=None,
        call=_review,
    ),
    Tool(
        name="export",
        title="Write the result",
        says="Write scene.blend, scene.glb and renders into the case's folder.",
        arguments=calls.NoArguments,
        answer=calls.ExportAnswer,
        call=_export,
        again=True,
    ),
    Tool(
        name="history",
        title="What was called",
        says="The last calls.",
        arguments=calls.HistoryArguments,
        answer=calls.HistoryAnswer,
        call=_history,
        reads=True,
        again=True,
    ),
    Tool(
        name="more",
        title="The next page",
        says="The rest of an answer with next_cursor.",
        arguments=calls.MoreArguments,
        answer=calls.MoreAnswer,
        call=_more,
        reads=True,
        again=True,
    ),
)
