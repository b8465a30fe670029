"""`legoworld import`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from legoworld.commands import options
from legoworld.commands.options import option
from legoworld.commands.output import Output
from legoworld.commands.param_types import EXISTING_FILE
from legoworld.pluralize import plural


@click.command("import")
@click.argument("usd", type=EXISTING_FILE)
@option("--output", "Scene folder, which gets scene.blend.")
@option("--overwrite", "Replace scene.blend.")
@options.limits
@options.printing_json
def command(usd: Path, output: Path, out: Output, **given: Any) -> int:
    """Import a USD file as a scene folder; its semantic labels become categories.

    Labels of UsdSemantics (SemanticsLabelsAPI:class) and of the older SemanticsAPI are read. Only
    the first camera is kept as the scene's; USD holds no picture size. Needs usd-core.

    \b
    Examples:
      legoworld import kitchen.usdc -o scenes/kitchen
      legoworld import desk.usda -o scenes/desk --overwrite
    """
    from legoworld.api.scene_folders import import_usd

    made = import_usd(usd, output, **given)
    for lost in made.losses:
        out.notice(lost)
    out.show(
        {"scene": str(output), "labelled": made.labelled, "left_out": list(made.losses)},
        f"{plural(made.labelled, 'labelled prim', 'labelled prims')} -> {output}",
    )
    return 0
