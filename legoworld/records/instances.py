"""instances.json: every instance of one scene, seen or not."""

from __future__ import annotations

from legoworld.records.base import Record


class InstanceRow(Record, frozen=True, kw_only=True):
    """One instance. objects: the names of the Blender objects it is made of.

    category, category_id: in the vocabulary, None for one without a label; a label without a
    vocabulary has no id. bbox_xywh_px: extents of the
    visible mask, zeros where no pixel shows it; reason: then why not (`view.UNSEEN_REASONS`).
    nested_in: the id of the instance it is labelled inside of.
    """

    id: int
    name: str
    objects: tuple[str, ...]
    category: str | None
    category_id: int | None
    labelled: bool
    area_px: int
    bbox_xywh_px: tuple[int, int, int, int]
    nested_in: int | None
    reason: str | None


class InstancesFile(Record, frozen=True, kw_only=True):
    """instances.json; ids count from 0 and index the values of buffers.npz's `instance`."""

    schema_version: int
    instances: tuple[InstanceRow, ...]
