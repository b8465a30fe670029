"""`legoworld plugin`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Unpack

import click

from legoworld.commands import model_options, options
from legoworld.commands.options import flag, option
from legoworld.commands.output import Output, table
from legoworld.commands.param_types import (
    EXISTING_FILE,
    EXISTING_FOLDER,
    FROM_ZERO,
    Choice,
    TaskChoice,
)
from legoworld.plugin.modules import MODULES

if TYPE_CHECKING:
    from legoworld.plugin.hooks import Dialect
    from legoworld.plugin.serve import PluginServing


_DIALECTS: Final = Choice(["claude", "codex", "cursor"])


@options.group("plugin")
def command() -> None:
    """Measure a live scene against a photo, and guard edits to it.

    \b
    Examples:
      legoworld plugin evidence --photo room.jpg --regions outlines.json --fov 65 -o evidence
      legoworld plugin serve --photo room.jpg --evidence evidence --ledger case-1
    """


@command.command("serve")
@option("--photo", "The reference photo; evidence of another one is refused.")
@option("--evidence")
@option("--blender")
@option("--ledger", "Folder for the record of all calls; an existing one is continued.")
@option("--without", kind=Choice(MODULES))
@flag(
    "--require-transaction",
    "Refuse begin and export after edits without a transaction; rollback undoes them.",
)
@options.together(
    "limits",
    "legoworld.records.plugin_ledger:TransactionLimits",
    option(
        "--rounds", "Refused commits of a transaction that may be corrected.", FROM_ZERO, default=2
    ),
    option(
        "--rollbacks",
        "Rollbacks of a case; one that has no corrections left is always allowed.",
        FROM_ZERO,
        default=2,
    ),
)
def serve(**given: Unpack[PluginServing]) -> int:
    """Serve the plugin's tools over MCP, on standard input and output.

    Needs the packages of the extra `plugin`; without them the command prints how to install
    them. The tools read saved copies of the live scene and run no code but saving, reopening it
    for a rollback, and installing a room when asked to.

    \b
    Examples:
      legoworld plugin serve --photo room.jpg --evidence evidence
      legoworld plugin serve --blender 127.0.0.1:9900 --ledger case-1
    """
    from legoworld.plugin.serve import serve_plugin

    serve_plugin(**given)
    return 0


@command.command("replay")
@click.argument("ledger", type=EXISTING_FOLDER)
def replay(ledger: Path) -> int:
    """Check a ledger's chain of hashes, and print its calls.

    \b
    Examples:
      legoworld plugin replay case-1
      legoworld plugin replay legoworld-ledger
    """
    from legoworld.plugin.ledger import plugin_replay

    entries = plugin_replay(ledger)
    rows = [
        (e.seq, e.tool, e.transaction or "", "failed" if e.error else e.phase,
         (e.scene_signature or "")[:12])
        for e in entries
    ]  # fmt: skip
    click.echo(table(("seq", "tool", "transaction", "then", "scene"), rows))
    click.echo(f"{len(entries)} entries, the chain is whole")
    return 0


@command.command("hook")
@option(
    "--dialect",
    "Whose events and answers: Claude Code's, Codex's or Cursor's.",
    _DIALECTS,
    required=True,
)
@option("--ledger", "Folder of the case, as for `plugin serve`.")
@option("--require-transaction")
def hook(dialect: Dialect, ledger: Path, require_transaction: bool) -> int:
    """Answer one event of a coding agent's hooks: JSON on standard input, JSON on standard output.

    A stop is blocked while a transaction is open, the last report is stale or does not pass, or no
    render of the scene was reviewed; at most 8 times in a row. Exit code 2 blocks, too.

    \b
    Examples:
      legoworld plugin hook --dialect claude --ledger case-1 < event.json
      legoworld plugin hook --dialect cursor --require-transaction < event.json
    """
    from legoworld.plugin.hooks import HookRules, hook_answer

    rules = HookRules(dialect=dialect, ledger=ledger, require_transaction=require_transaction)
    click.echo(hook_answer(rules, sys.stdin.buffer.read()))
    return 0


@command.command("install")
@option("--for dialect", "Claude Code, Codex or Cursor.", _DIALECTS, required=True)
@option("--project", "Folder whose settings are changed.", EXISTING_FOLDER, default=Path())
@option("--photo", "For `plugin serve`.")
@option("--evidence", "For `plugin serve`.")
@option("--blender")
@option("--ledger", "Folder of the case.")
@option("--require-transaction")
@flag("--write", "Write the settings; without it they are printed.")
@flag("--undo", "Take out what was written, and nothing else.")
def install(
    dialect: Dialect,
    project: Path,
    photo: Path | None,
    evidence: Path | None,
    address: str,
    ledger: Path,
    require_transaction: bool,
    write: bool,
    undo: bool,
) -> int:
    """Connect a coding agent: the MCP server, the hooks and the skill in a project's settings.

    Other settings keep every byte. Writing again replaces what was written.

    \b
    Examples:
      legoworld plugin install --for claude --photo room.jpg --evidence evidence
      legoworld plugin install --for codex --ledger case-1 --write
      legoworld plugin install --for cursor --undo
    """
    from legoworld.plugin import install

    if undo:
        changes = install.uninstall(dialect, project)
        install.write(project, changes)
        for change in changes:
            click.echo(f"{'removed' if change.after is None else 'restored'} {change.path}")
        if not changes:
            click.echo("nothing is installed here")
        return 0
    serve_words = ["--blender", address, "--ledger", str(ledger.resolve())]
    for name, path in (("--photo", photo), ("--evidence", evidence)):
        serve_words += [] if path is None else [name, str(path.resolve())]
    serve_words += ["--require-transaction"] if require_transaction else []
    changes = install.install(
        install.InstallPlan(
            dialect=dialect,
            project=project,
            ledger=ledger.resolve(),
            serve=tuple(serve_words),
            require_transaction=require_transaction,
        )
    )
    if write:
        install.write(project, changes)
    for change in changes:
        if write:
            click.echo(f"{'unchanged' if change.before == change.after else 'wrote'} {change.path}")
        elif not change.path.endswith((install.RECORD, "SKILL.md")):
            click.echo(f"# {change.path}\n{change.after}")
    if dialect == "codex" and write:
        click.echo("open /hooks in Codex and trust them: untrusted hooks do not run")
    return 0


@command.command("evidence")
@option("--photo", "The reference photo.", required=True)
@option(
    "--regions",
    "JSON of outlines ({regions: [{name, polygons}]}) or of COCO or LVIS results; repeatable.",
    EXISTING_FILE,
)
@option("--image-id photo_id", "The photo's id in a results file.", multiple=False)
@option(
    "--task",
    "Whose category ids a results file has.",
    TaskChoice(lambda t: t.family.labelled and t.name == t.dataset.name),
)
@option("--depth", "Relative depth: .npy, .npz or .png.", EXISTING_FILE)
@option(
    "--space depth_space",
    "depth: larger is farther; disparity: larger is nearer.",
    Choice(["depth", "disparity"]),
    default="depth",
)
@option(
    "--run runs",
    "Folder of `legoworld baseline run` over this photo: masks, boxes or depth; repeatable.",
    EXISTING_FOLDER,
    multiple=True,
)
@option(
    "--camera",
    "A provider's camera (format plugin-camera of `legoworld list schema`) instead of --fov.",
    EXISTING_FILE,
)
@option(
    "--fov hfov_deg",
    "Horizontal field of view in degrees; with it the camera's rotation is estimated.",
    click.FloatRange(min=1.0, max=170.0),
)
@option(
    "--provider",
    "Baseline that recovers the photo's camera, and depth with it: vggt, or a folder.",
    metavar="NAME",
)
@model_options.model_options(
    "Seconds the provider has to load its model, then for the photo [default: none].",
    required=False,
)
@flag("-v --verbose", "Show the provider's output.")
@option("--output", "Folder to write.")
def evidence(output: Path, verbose: bool, provider: str | None, **given: Any) -> int:
    """Gather what a photo says about its scene: regions, relative depth, camera rotation.

    Everything comes from the photo and from models that looked at it; never from ground truth. A
    provider gives the intrinsics; up is estimated from vanishing points, or unknown.

    \b
    Examples:
      legoworld plugin evidence --photo room.jpg --regions outlines.json -o evidence
      legoworld plugin evidence --photo 139.jpg --regions sam3/predictions.json --task lvis \\
        --image-id 139 --depth depth/139.npz --space disparity --fov 60 -o evidence
      legoworld plugin evidence --photo 139.jpg --run sam3-run --run da3-run --fov 60 -o evidence
      legoworld plugin evidence --photo room.jpg --provider vggt --weights facebook/VGGT-1B \\
        --device auto --regions outlines.json -o evidence
    """
    from legoworld.api.listener import Listener
    from legoworld.api.plugin_evidence import plugin_evidence

    if provider is None:
        options.refuse_given(model_options.NAMES, "needs a --provider")
    out = Output(verbose=verbose)
    made = plugin_evidence(
        output,
        provider=provider,
        listener=Listener(notice=click.echo, warn=out.warn, log=out.trace),
        **given,
    )
    source = made.camera.rotation_source
    rotation = f"rotation from {source}" if source else f"unknown: {made.camera.unknown}"
    click.echo(f"regions  {len(made.regions)}")
    click.echo(f"depth    {made.depth.source if made.depth else 'none'}")
    click.echo(f"camera   {rotation}")
    click.echo(f"evidence {output}")
    return 0
