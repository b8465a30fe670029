"""The Blender process: one request per line on standard input, one answer per line.

Answers go to what was standard output; everything Blender itself prints goes to standard error.
The process ends when its input does, so that it never outlives the command that started it.
"""

from __future__ import annotations

import errno
import json
import os
import sys
import traceback
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from legoworld.errors import LegoWorldError, NoCameraError, NoMeshError
from legoworld.scene.requests import Request
from legoworld.workers.process_privacy import die_with_parent

#: The disk that results go to is full or read-only: no scene's fault.
_DISK = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG)


def main() -> int:
    """Serve requests until the input ends."""
    die_with_parent()
    _leave_no_core()
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    import bpy  # noqa: F401  importing is the slow part: done before the first request arrives

    for line in sys.stdin:
        answers.write(json.dumps(_answer(json.loads(line))) + "\n")
        answers.flush()
    answers.flush()
    # Some add-ons and caches abort in Blender's own exit code; all results are written by now.
    os._exit(0)


def _leave_no_core() -> None:
    """No core dump: a crash over a damaged file is a result."""
    if sys.platform != "win32":
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _answer(request: Request) -> dict[str, Any]:
    try:
        return {"ok": True, **_REQUESTS[request["kind"]](request)}
    except LegoWorldError as error:
        return {"ok": False, "reason": error.reason()}
    except MemoryError:
        return {"ok": False, "reason": {"code": "worker_memory"}}
    except OSError as error:
        if error.errno in _DISK:
            return {"ok": False, "reason": {"code": "disk", "errno": error.errno}}
        return _surprise(error)
    except Exception as error:  # noqa: BLE001  reported with its place; the run continues
        return _surprise(error)


def _surprise(error: Exception) -> dict[str, Any]:
    traceback.print_exception(error)
    frame = traceback.extract_tb(error.__traceback__)[-1]
    surprise = LegoWorldError(
        "unexpected error while reading the scene",
        found=f"{type(error).__name__}: {error} ({Path(frame.filename).name}, line {frame.lineno})",
        expected="a snapshot or a named verdict",
        next_step="this is a bug in legoworld, please report it (-v prints the traceback)",
    )
    trace = "".join(traceback.format_exception(error))
    return {"ok": False, "reason": surprise.reason(), "trace": trace}


def _snapshot(request: Request) -> dict[str, Any]:
    from legoworld.scene.blender.dependencies import dependencies, watched_folders
    from legoworld.scene.blender.extract import read_blend_snapshot
    from legoworld.scene.snapshot import save

    blend = Path(request["blend"])
    snapshot = read_blend_snapshot(
        blend,
        any_camera=bool(request.get("any_camera")),
        corner_normals=bool(request.get("corner_normals")),
    )
    depends, watched = dependencies(blend), watched_folders(blend)
    passing = bool(request.get("passing"))
    content = save(snapshot, Path(request["output"]), passing=passing)
    return {"content_sha256": content, "dependencies": depends, "watched": watched}


def _state(request: Request) -> dict[str, Any]:
    """The states of all objects beside the snapshot: what a transaction compares.

    unseen: why there is no snapshot, of a scene without a camera or a surface; null with one.
    """
    from legoworld.records.base import as_json
    from legoworld.scene.blender.entities import scene_states
    from legoworld.scene.blender.extract import read_open_snapshot
    from legoworld.scene.blender.open_file import open_blend
    from legoworld.scene.snapshot import save

    opened = open_blend(Path(request["blend"]))
    camera = opened.scene.camera
    objects, hashes = scene_states(opened.scene)
    states = {
        "objects": as_json(objects),
        "camera": camera.name if camera else None,
        "hashes": hashes,
    }  # before the snapshot, which changes render settings
    try:
        snapshot = read_open_snapshot(opened)
    except (NoCameraError, NoMeshError) as error:
        return {"unseen": error.reason(), **states}
    save(snapshot, Path(request["output"]), passing=True)
    return {"unseen": None, **states}


def _check(request: Request) -> dict[str, Any]:
    """Open a .blend that a program left; refused where it does not open or shows nothing."""
    from legoworld.scene.blender.cameras import refuse_missing_camera
    from legoworld.scene.blender.open_file import open_blend

    refuse_missing_camera(open_blend(Path(request["blend"])).scene)
    return {}


def _picture(request: Request) -> dict[str, Any]:
    from legoworld.scene.blender.programs import render_picture

    return render_picture(Path(request["output"]))


def _card_render(request: Request) -> dict[str, Any]:
    """Render a .blend by a card; see `card_render`."""
    from legoworld.scene.blender.card_render import render_by_card

    render_by_card(Path(request["blend"]), Path(request["output"]), request["card"])
    return {}


def _card_depth(request: Request) -> dict[str, Any]:
    """What the first sample of a render by a card meets, written to the output."""
    from legoworld.files import write_npz
    from legoworld.scene.blender.card_depth import surface_by_card

    met = surface_by_card(Path(request["blend"]), request["card"])
    write_npz(Path(request["output"]), met, compressed=True)
    return {}


def _facts(request: Request) -> dict[str, Any]:
    """What a .blend holds besides geometry; its images' thumbnails go into the output."""
    from legoworld.files import write_npz
    from legoworld.scene.blender.integrity import scene_facts

    width, height = request["thumbnail_wh"]
    facts, thumbnails = scene_facts(Path(request["blend"]), (width, height))
    write_npz(Path(request["output"]), {"textures": thumbnails}, compressed=True)
    return {"facts": facts}


def _cases(request: Request) -> dict[str, Any]:
    """The cases of a reference scene."""
    from legoworld.scene.blender.dependencies import dependencies
    from legoworld.scene.blender.reference_cases import read_cases

    blend = Path(request["blend"])
    return {"cases": read_cases(blend), "dependencies": dependencies(blend)}


def _case(request: Request) -> dict[str, Any]:
    """The scene of one case, saved in the output folder."""
    from legoworld.scene.blender.reference_cases import write_case

    write_case(Path(request["blend"]), Path(request["output"]), request["case"])
    return {}


def _usd(request: Request) -> dict[str, Any]:
    """A .blend as USD, written to the output."""
    from legoworld.scene.blender.foreign_formats import export_usd

    export_usd(Path(request["blend"]), Path(request["output"]))
    return {}


def _import(request: Request) -> dict[str, Any]:
    """A USD file as a .blend, written to the output; what its labels are."""
    from legoworld.conventions import CATEGORY_KEY
    from legoworld.scene.blender.foreign_formats import import_usd
    from legoworld.scene.usd_labels import INSTANCE, write_label_layer

    layer, output = Path(request["layer"]), Path(request["output"])
    labels = write_label_layer(Path(request["usd"]), layer)
    import_usd(layer, output, (CATEGORY_KEY, INSTANCE), labels.metres_per_unit)
    return asdict(labels)


def _import_glb(request: Request) -> dict[str, Any]:
    """A .glb as a .blend, written to the output."""
    from legoworld.scene.blender.foreign_formats import import_glb

    import_glb(Path(request["glb"]), Path(request["output"]))
    return {}


def _version(_request: Request) -> dict[str, Any]:
    import bpy

    return {"blender": bpy.app.version_string}


_REQUESTS: dict[str, Callable[[Request], dict[str, Any]]] = {
    "version": _version,
    "snapshot": _snapshot,
    "state": _state,
    "check": _check,
    "picture": _picture,
    "card_render": _card_render,
    "card_depth": _card_depth,
    "facts": _facts,
    "cases": _cases,
    "case": _case,
    "usd": _usd,
    "import": _import,
    "import_glb": _import_glb,
}

if __name__ == "__main__":
    sys.exit(main())
