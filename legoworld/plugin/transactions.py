"""Whether an edit is what was declared: a pure judgement of two states and a report."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

from legoworld.plugin.diff import changes
from legoworld.records.plugin_ledger import Declaration, Judgement, Violation, Why, Worse
from legoworld.records.plugin_requirements import Report
from legoworld.records.plugin_state import SceneState

#: Names of the scene's own entities, as in `Change.entity`; a declaration may name them too.
SCENE_ENTITIES: Final = ("camera", "render", "world", "collections")


def judge(
    before: SceneState,
    after: SceneState,
    declaration: Declaration,
    report: Report,
    worse: tuple[Worse, ...] = (),
) -> Judgement:
    """Judge every change between two states, and whether the edit may be committed.

    report: the declaration's requirements measured on `after`; worse: requirements it made worse.
    Raises ValueError for a stale report, of another state.
    """
    if report.scene_signature != after.scene_signature:
        raise ValueError("the report is of another state of the scene")
    protected = members(declaration.protected, (before, after))
    editable = _editable(declaration, before, after) - protected
    allowed, violations = [], []
    for change in changes(before, after):
        why: Why | None = None
        if change.entity in protected:
            why = "protected"
        elif change.entity not in editable:
            why = "undeclared"
        elif change.kind not in declaration.kinds:
            why = "kind not declared"
        if why is None:
            allowed.append(change)
        else:
            violations.append(Violation(change=change, why=why))
    return Judgement(
        allowed=tuple(allowed),
        violations=tuple(violations),
        worse=worse,
        blocked=report.blocked or bool(worse),
        accepted=bool(allowed) and not violations and not report.blocked and not worse,
    )


def _editable(declaration: Declaration, before: SceneState, after: SceneState) -> set[str]:
    """What may change: as the scene was when it was declared, and what is new under these names.

    What was there before does not become editable by being parented to, or collected with, what is.
    """
    then, now = (members(declaration.editable, (state,)) for state in (before, after))
    there = {o.key for o in before.objects}
    if before.camera is not None:
        there.add("camera")
    return then | (now - there)


def members(names: Iterable[str], states: Iterable[SceneState]) -> set[str]:
    """Keys of the objects that names stand for in any of some states, and names of the scene's own.

    A name stands for an object with all below it in the object tree, for the objects directly in a
    collection of that name with all below them, or for one of `SCENE_ENTITIES`. The active camera
    object moving changes both the object and "camera": naming the object covers both.
    """
    wanted = set(names)
    keys = wanted & set(SCENE_ENTITIES)
    for state in states:
        keys |= set(_below(wanted, state))
        if state.camera is not None and state.camera in keys:
            keys.add("camera")
    return keys


def _below(wanted: set[str], state: SceneState) -> Iterator[str]:
    parent = {o.name: o.parent for o in state.objects}
    collections = {o.name: o.collections for o in state.objects}
    for entity in state.objects:
        name: str | None = entity.name
        met: set[str] = set()
        while name is not None and name not in met:
            if name in wanted or wanted & set(collections.get(name, ())):
                yield entity.key
                break
            met.add(name)
            name = parent.get(name)


def unknown_names(declaration: Declaration, state: SceneState) -> list[str]:
    """Protected names that the scene does not have: what they were meant to guard is unguarded.

    Editable ones may be new.
    """
    known = {o.name for o in state.objects} | set(SCENE_ENTITIES)
    known |= {c for o in state.objects for c in o.collections}
    return sorted(set(declaration.protected) - known)
