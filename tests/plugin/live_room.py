"""A case over a Blender that holds the room, and scenes of it with an object elsewhere."""

from __future__ import annotations

import dataclasses

from legoworld.plugin.case import STATES, Case
from legoworld.plugin.entities import Entities
from legoworld.plugin.live import LiveBlender
from legoworld.records.plugin_ledger import TransactionLimits


def reopen_case(folder, connection, blender, *, strict=False, evidence=None, **limits):
    """The case of a ledger's folder, as another server of it would continue it."""
    store = folder / STATES
    store.mkdir(exist_ok=True)
    live = LiveBlender(connection, blender, store)
    held = TransactionLimits(**limits)
    return Case(folder, live, evidence, held, require_transaction=strict)


def shift(scene, name, by_m):
    """The scene with one object somewhere else."""
    shot = scene.snapshot
    placed = shot.world_from_mesh.copy()
    placed[Entities(shot).surfaces(name), :, 3] += by_m
    return dataclasses.replace(scene, reading=dataclasses.replace(shot, world_from_mesh=placed))
