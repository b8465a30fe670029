"""Hair that particle systems grow, as Cycles draws it."""

from __future__ import annotations

from typing import Any

import bpy
from agreement.traps.stage import (
    Expect,
    Triple,
    camera,
    collection,
    instance_of,
    layer_of,
    material,
    principled,
    solid,
    unlinked_collection,
    wall,
)


def hairy(name: str, at: Triple = (0, 0, 1), collection: Any = None, **settings: Any) -> Any:
    """A ball with particle hair; the radii are thick enough to be seen."""
    ball = solid("uv_sphere", name, at, collection=collection)
    ball.modifiers.new("hair", "PARTICLE_SYSTEM")
    hair = ball.particle_systems[-1].settings
    hair.type, hair.count, hair.hair_length = "HAIR", 60, 0.8
    hair.radius_scale, hair.root_radius, hair.tip_radius = 0.06, 1.0, 0.4
    for key, value in settings.items():
        setattr(hair, key, value)
    return ball


def particle_hair() -> Expect:
    """Hair of balls: plain, with a closed tip, shaped radii, more steps, b-splines."""
    wall()
    hairy("plain", (-3.5, 0, 1))
    hairy("closed", (-1.2, 0, 1), use_close_tip=True, shape=-0.6, render_step=5)
    hairy("open", (1.2, 0, 1), use_close_tip=False, shape=0.7, tip_radius=0.0, render_step=2)
    hairy("soft", (3.5, 0, 1), use_hair_bspline=True, brownian_factor=0.2, hair_step=6)
    camera()
    return Expect(seen=("plain", "closed", "open", "soft"))


def particle_children() -> Expect:
    """Children of both kinds in place of their parents; kinks, clumps, roughness, lengths."""
    wall()
    few = {"count": 12, "display_percentage": 20}
    hairy("simple", (-3.6, 0, 1), child_type="SIMPLE", child_percent=2, rendered_child_count=6,
          clump_factor=-0.5, roughness_2=0.1, **few)  # fmt: skip
    hairy("between", (-1.2, 0, 1), child_type="INTERPOLATED", child_percent=3,
          rendered_child_count=9, child_length=0.6, child_length_threshold=0.4, **few)  # fmt: skip
    hairy("spiral", (1.2, 0, 1), child_type="SIMPLE", rendered_child_count=4, kink="SPIRAL",
          kink_extra_steps=5, kink_amplitude=0.2, **few)  # fmt: skip
    hairy("curly", (3.6, 0, 1), child_type="SIMPLE", rendered_child_count=4, kink="CURL",
          kink_amplitude=0.2, child_length=0.5, use_parent_particles=True, **few)  # fmt: skip
    camera()
    return Expect(seen=("simple", "between", "spiral", "curly"))


def hair_switches() -> Expect:
    """The emitter hidden, the modifier off in renders, other render types, two systems."""
    wall()
    hairy("bald", (-4, 0, 1)).show_instancer_for_render = False
    hairy("off", (-2, 2, 1)).modifiers[0].show_render = False
    hairy("viewport off", (-2, -1, 1)).modifiers[0].show_viewport = False
    hairy("none", (0, 2, 1), render_type="NONE")
    two = hairy("two", (0.5, -1, 1))
    for name in ("red", "glass"):
        two.data.materials.append(principled(name, Alpha=1.0 if name == "red" else 0.2))
    two.modifiers.new("more", "PARTICLE_SYSTEM")
    two.particle_systems[-1].seed = 5  # else its strands begin where the others do
    more = two.particle_systems[-1].settings
    more.type, more.count, more.radius_scale, more.material = "HAIR", 40, 0.1, 2
    for kind, x in (("HALO", 2.0), ("LINE", 3.2), ("PATH", 3.9)):
        emitter = solid("uv_sphere", kind, (x, 0, 1), scale=(0.5, 0.5, 0.5))
        emitter.modifiers.new("emit", "PARTICLE_SYSTEM")
        settings = emitter.particle_systems[0].settings
        settings.frame_start, settings.frame_end, settings.render_type = -50, 0, kind
    camera()
    return Expect(seen=("bald", "off", "viewport off", "none", "two", "HALO", "LINE", "PATH"))


def hair_moved() -> Expect:
    """Hair of instanced, scaled, parented and deformed objects."""
    wall()
    pool = unlinked_collection("pool")
    hairy("tuft", (0, 0, 0.5), collection=pool, count=25)
    instance_of(pool, "left", (-3.5, 0, 0.5))
    instance_of(pool, "small", (-1, 0, 0), scale=(0.5, 0.5, 0.8), rotation_euler=(0, 0.5, 0))
    instance_of(pool, "mirrored", (1, 0, 0.5), scale=(-0.7, 0.7, 0.7))
    bent = hairy("bent", (3.8, 0, 1), count=30)
    bent.scale = (0.6, 1, 1.3)
    bent.modifiers.new("bend", "SIMPLE_DEFORM").deform_method = "BEND"
    bent.modifiers.move(1, 0)
    camera()
    return Expect(seen=("tuft", "bent"))


def hair_held_out() -> Expect:
    """Hair under a holdout collection, an invisible one, and hair of a holdout material."""
    wall()
    for name, x in (("held", -3), ("unseen", 0)):
        collection(name)
        hairy(f"{name} ball", (x, 0, 1), collection=bpy.data.collections[name])
    layer_of("held").holdout = True
    bpy.data.objects["unseen ball"].visible_camera = False
    shiny = hairy("partly", (3, 0, 1))
    shiny.data.materials.append(principled("skin"))
    shiny.data.materials.append(
        material("hole", lambda tree: tree.nodes.new("ShaderNodeHoldout").outputs[0])
    )
    shiny.particle_systems[0].settings.material = 2
    camera()
    return Expect(seen=("partly", "Wall"), unseen=("held ball", "unseen ball"))


TRAPS = (particle_hair, particle_children, hair_switches, hair_moved, hair_held_out)
