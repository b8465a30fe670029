"""A case over a Blender that holds the room."""

from __future__ import annotations

from legoworld.plugin.case import STATES, Case
from legoworld.plugin.live import LiveBlender
from legoworld.records.plugin_ledger import TransactionLimits


def reopened(folder, connection, blender, *, strict=False, evidence=None, **limits):
    """The case of a ledger's folder, as another server of it would continue it."""
    store = folder / STATES
    store.mkdir(exist_ok=True)
    live = LiveBlender(connection, blender, store)
    held = TransactionLimits(**limits)
    return Case(folder, live, evidence, held, require_transaction=strict)
