"""The cases of a reference scene: its views, its tiers, and the scene of one of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import bpy

from legoworld.errors import NoCameraError, TiersNotNestedError
from legoworld.scene.blender.joints import joint_facts
from legoworld.scene.blender.objects import ancestors
from legoworld.scene.blender.open_file import open_blend
from legoworld.scene.blender.programs import export_glb, pack_images
from legoworld.scene.requests import CaseRequest

_TIERS: Final = ("easy", "medium", "hard")
#: Light and camera stay as they are in every tier.
_FIXED: Final = ("LIGHT", "LIGHT_PROBE", "CAMERA", "SPEAKER")


def read_cases(blend: Path) -> dict[str, Any]:
    """The declared cases of a reference scene, as JSON values.

    views: names of cameras; tiers: those it has, or [None]; unscored: names of owners with a false
    `scored`; joints: as `joint_facts` has them; environment, theme, split: of the scene's own
    properties. Raises what `open_blend` does, NoCameraError and TiersNotNestedError.
    """
    scene = open_blend(blend).scene
    words = {key: _text(scene.get(key)) for key in ("environment", "theme", "split")}
    owners = [*scene.objects, *scene.collection.children_recursive]
    return {
        **words,
        "views": _views(scene),
        "tiers": _Tiers(scene).names(),
        "unscored": sorted({o.name for o in owners if _is_false(o.get("scored"))}),
        "joints": joint_facts(scene),
    }


def write_case(blend: Path, output: Path, request: CaseRequest) -> None:
    """Save the scene of one case as scene.blend in `output`; with "glb" scene.glb beside it.

    request: "tier", "view" (a camera's name), "size_wh" and "glb". Objects of later tiers are
    hidden from rendering and not deleted: what refers to them stays as it is.
    """
    scene = open_blend(blend).scene
    if request["tier"] is not None:
        last = _TIERS.index(request["tier"])
        tiers = _Tiers(scene)
        for thing in tiers.objects:
            if tiers.of(thing) > last:
                thing.hide_render = True
    for marker in scene.timeline_markers:
        marker.camera = None
    scene.camera = scene.objects[request["view"]]
    scene.render.resolution_x, scene.render.resolution_y = request["size_wh"]
    scene.render.resolution_percentage = 100
    show_scene(scene)
    pack_images()
    bpy.ops.wm.save_as_mainfile(
        filepath=str(output / "scene.blend"), compress=True, relative_remap=True,
        check_existing=False,
    )  # fmt: skip
    if request["glb"]:
        export_glb(output / "scene.glb")


def show_scene(scene: bpy.types.Scene) -> None:
    """Have the file's own scene in the window again: it is what a saved file opens with."""
    other = bpy.context.scene
    if other != scene:
        bpy.context.window.scene = scene
        bpy.data.scenes.remove(other)


def _scene_objects(scene: bpy.types.Scene) -> list[Any]:
    """The objects of a scene and those of collections that it instances."""
    objects = {o.name_full: o for o in scene.objects}
    todo = list(objects.values())
    while todo:
        collection = todo.pop().instance_collection
        for member in collection.all_objects if collection is not None else ():
            if member.name_full not in objects:
                objects[member.name_full] = member
                todo.append(member)
    return [objects[name] for name in sorted(objects)]


def _views(scene: bpy.types.Scene) -> list[str]:
    cameras = [o for o in scene.objects if o.type == "CAMERA" and "view" in o]
    if cameras:
        return [o.name for o in sorted(cameras, key=lambda o: (_number(o["view"]), o.name))]
    if scene.camera is None:
        raise NoCameraError(
            "the reference scene has no view",
            found="no camera with a property `view`, and no active camera",
            expected="cameras with a custom property `view` (0, 1, ...), or an active one",
            next_step="add a camera in Blender and save the scene",
        )
    return [scene.camera.name]


class _Tiers:
    """The tier of every object that a render of a scene may show."""

    def __init__(self, scene: bpy.types.Scene) -> None:
        self.objects = [o for o in _scene_objects(scene) if o.type not in _FIXED]
        self._holding: dict[str, list[Any]] = {}
        for collection in bpy.data.collections:
            for member in collection.all_objects:
                self._holding.setdefault(member.name_full, []).append(collection)

    def names(self) -> list[str | None]:
        """None alone, or all three, each with an object that the one before lacks."""
        counts = [0, 0, 0]
        for thing in self.objects:
            counts[self.of(thing)] += 1
        if not any(
            _declared_tier(o) is not None for thing in self.objects for o in self._owners(thing)
        ):
            return [None]
        for number in (1, 2):
            if not counts[number]:
                raise _not_nested(
                    f"{_TIERS[number]} has the objects of {_TIERS[number - 1]} and no other",
                    f"an object with the property tier = {_TIERS[number]!r}",
                )
        return list(_TIERS)

    def of(self, thing: bpy.types.Object) -> int:
        """An object's tier: the latest of its own, its ancestors' and its collections'."""
        own = _declared_tier(thing)
        outer = [(_declared_tier(owner), owner.name) for owner in self._owners(thing)[1:]]
        latest = max((tier for tier, _ in outer if tier is not None), default=0)
        if own is not None and own < latest:
            holder = next(name for tier, name in outer if tier == latest)
            raise _not_nested(
                f"{thing.name!r} is of tier {_TIERS[own]}, and {holder!r}, which holds it, of "
                f"{_TIERS[latest]}",
                "parts whose tier is not earlier than that of what holds them",
            )
        return latest if own is None else own

    def _owners(self, thing: bpy.types.Object) -> list[bpy.types.ID]:
        """The object, its ancestors, and all collections that hold one of them."""
        owners = [thing, *ancestors(thing)]
        holding = {c.name_full: c for o in owners for c in self._holding.get(o.name_full, ())}
        return [*owners, *holding.values()]


def _declared_tier(owner: bpy.types.ID) -> int | None:
    value = owner.get("tier")
    if value is None:
        return None
    if value not in _TIERS:
        raise _not_nested(
            f"{owner.name!r} is of tier {str(value)[:40]!r}", "easy, medium or hard"
        )  # fmt: skip
    return _TIERS.index(value)


def _not_nested(found: str, expected: str) -> TiersNotNestedError:
    return TiersNotNestedError(
        "the tiers of the reference scene are not nested",
        found=found,
        expected=expected,
        next_step="correct the custom properties `tier` in Blender and save the scene",
    )


def _number(value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        return 0.0


def _text(value: Any) -> str | None:
    return value if isinstance(value, str) and value.strip() else None


def _is_false(value: Any) -> bool:
    return value is not None and str(value).strip().lower() in ("false", "0", "no")
