"""`initialize`: the recovered room and its camera enter the scene as one transaction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from legoworld.errors import LegoWorldError
from legoworld.files import atomic_path
from legoworld.plugin.artefacts import find_kind
from legoworld.plugin.case import Case
from legoworld.plugin.initialisation import Initialisation, shell_picture
from legoworld.plugin.room_install import (
    NotInstalledError,
    install_code,
    installation,
    refuse_another,
    refuse_taken_names,
)
from legoworld.records.base import as_json

INITIAL: Final = "initial"


def install_room(case: Case, initialisation: Initialisation) -> dict[str, str]:
    """Install a room and its camera; sha256 of what is kept, by name.

    Rolled back where the scene then shows another room or camera: NotInstalledError says what.
    """
    room = initialisation.room
    case.begin(installation(room))
    before = case.base().objects
    names = {o.name for o in before} | {c for o in before for c in o.collections}

    def call() -> dict[str, str]:
        refuse_taken_names(room, names)
        case.live.install(install_code(room))
        scene = case.read()
        refuse_another(room, scene)
        return _keep(case, initialisation.files(shell_picture(room, scene)))

    try:
        kept = case.record("initialize", as_json(room), call)
        judgement, _ = case.commit()
        if not judgement.accepted:
            changed = ", ".join(f"{v.change.entity} ({v.why})" for v in judgement.violations)
            raise NotInstalledError("the room was refused", found=changed or "it is not there")
    except LegoWorldError:
        case.rollback()
        raise
    return kept


def _keep(case: Case, files: Mapping[str, bytes]) -> dict[str, str]:
    """Write files for people into the case's folder, and keep them by hash."""
    kept = {}
    for name, data in files.items():
        with atomic_path(case.folder / INITIAL / name) as temporary:
            temporary.write_bytes(data)
        kept[name] = case.artefacts.keep(data, find_kind(name))
    return kept
