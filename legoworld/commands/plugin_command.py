"""`legoworld plugin`."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import click

from legoworld.commands import options
from legoworld.commands.options import F
from legoworld.commands.plugin_evidence import evidence
from legoworld.plugin.modules import MODULES

_CONTEXT = {"help_option_names": ["-h", "--help"]}
_DIALECTS = options.Choice(["claude", "codex", "cursor"])
_REQUIRE_TRANSACTION = click.option(
    "--require-transaction", is_flag=True,
    help="Refuse tools that change the scene while no transaction is open.",
)  # fmt: skip


def _ledger(help_text: str) -> Callable[[F], F]:
    return click.option(
        "--ledger", default=Path("legoworld-ledger"), show_default=True, type=options.FOLDER,
        help=help_text,
    )  # fmt: skip


@click.group("plugin", context_settings=_CONTEXT)
def command() -> None:
    """Measure a live scene against a photo, and guard edits to it.

    \b
    Examples:
      legoworld plugin evidence --photo room.jpg --regions outlines.json --fov 65 -o evidence
      legoworld plugin serve --photo room.jpg --evidence evidence --ledger case-1
    """


command.add_command(evidence)


@command.command("serve", context_settings=_CONTEXT)
@click.option(
    "--photo", type=options.EXISTING_FILE,
    help="The reference photo; evidence of another one is refused.",
)  # fmt: skip
@click.option(
    "--evidence", type=options.EXISTING_FOLDER, help="Folder of `legoworld plugin evidence`."
)
@click.option(
    "--blender", default="127.0.0.1:9876", show_default=True,
    help="Address of Blender MCP's socket: HOST:PORT.",
)  # fmt: skip
@_ledger("Folder for the record of all calls; an existing one is continued.")
@click.option(
    "--without", multiple=True, type=options.Choice(MODULES),
    help="Leave a module of the plugin out, for ablations; repeat.",
)  # fmt: skip
@click.option(
    "--require-transaction", is_flag=True,
    help="Refuse begin and export after edits without a transaction; rollback undoes them.",
)  # fmt: skip
@click.option(
    "--rounds", default=2, show_default=True, type=click.IntRange(min=0),
    help="Refused commits of a transaction that may be corrected.",
)  # fmt: skip
@click.option(
    "--rollbacks", default=2, show_default=True, type=click.IntRange(min=0),
    help="Rollbacks of a case; one that has no corrections left is always allowed.",
)  # fmt: skip
def serve(
    photo: Path | None,
    evidence: Path | None,
    blender: str,
    ledger: Path,
    without: tuple[str, ...],
    require_transaction: bool,
    rounds: int,
    rollbacks: int,
) -> int:
    """Serve the plugin's tools over MCP, on standard input and output.

    Needs the packages of the extra `plugin`; without them the command prints how to install
    them. The tools read saved copies of the live scene and run no code but saving, reopening it
    for a rollback, and installing a room when asked to.

    \b
    Examples:
      legoworld plugin serve --photo room.jpg --evidence evidence
      legoworld plugin serve --blender 127.0.0.1:9900 --ledger case-1
    """
    from legoworld.plugin.serving import serve_plugin
    from legoworld.records.plugin_ledger import TransactionLimits

    serve_plugin(
        photo=photo,
        evidence=evidence,
        address=blender,
        ledger=ledger,
        off=without,
        require_transaction=require_transaction,
        limits=TransactionLimits(rounds=rounds, rollbacks=rollbacks),
    )
    return 0


@command.command("replay", context_settings=_CONTEXT)
@click.argument("ledger", type=options.EXISTING_FOLDER)
def replay(ledger: Path) -> int:
    """Check a ledger's chain of hashes, and print its calls.

    \b
    Examples:
      legoworld plugin replay case-1
      legoworld plugin replay legoworld-ledger
    """
    from legoworld.plugin.ledger import check_ledger

    entries = check_ledger(ledger)
    rows = [
        (e.seq, e.tool, e.transaction or "", "failed" if e.error else e.phase,
         (e.scene_signature or "")[:12])
        for e in entries
    ]  # fmt: skip
    click.echo(options.table(("seq", "tool", "transaction", "then", "scene"), rows))
    click.echo(f"{len(entries)} entries, the chain is whole")
    return 0


@command.command("hook", context_settings=_CONTEXT)
@click.option(
    "--dialect", required=True, type=_DIALECTS,
    help="Whose events and answers: Claude Code's, Codex's or Cursor's.",
)  # fmt: skip
@_ledger("Folder of the case, as for `plugin serve`.")
@_REQUIRE_TRANSACTION
def hook(
    dialect: Literal["claude", "codex", "cursor"], ledger: Path, require_transaction: bool
) -> int:
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


@command.command("install", context_settings=_CONTEXT)
@click.option(
    "--for", "dialect", required=True, type=_DIALECTS,
    help="Claude Code, Codex or Cursor.",
)  # fmt: skip
@click.option(
    "--project", default=Path(), show_default=True, type=options.EXISTING_FOLDER,
    help="Folder whose settings are changed.",
)  # fmt: skip
@click.option("--photo", type=options.EXISTING_FILE, help="For `plugin serve`.")
@click.option("--evidence", type=options.EXISTING_FOLDER, help="For `plugin serve`.")
@click.option(
    "--blender", default="127.0.0.1:9876", show_default=True, help="For `plugin serve`: HOST:PORT."
)
@_ledger("Folder of the case.")
@_REQUIRE_TRANSACTION
@click.option("--write", is_flag=True, help="Write the settings; without it they are printed.")
@click.option("--undo", is_flag=True, help="Take out what was written, and nothing else.")
def install(
    dialect: Literal["claude", "codex", "cursor"],
    project: Path,
    photo: Path | None,
    evidence: Path | None,
    blender: str,
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
    from legoworld.plugin import installing

    if undo:
        changes = installing.uninstall(dialect, project)
        installing.write(project, changes)
        for change in changes:
            click.echo(f"{'removed' if change.after is None else 'restored'} {change.path}")
        if not changes:
            click.echo("nothing is installed here")
        return 0
    serve_words = ["--blender", blender, "--ledger", str(ledger.resolve())]
    for name, path in (("--photo", photo), ("--evidence", evidence)):
        serve_words += [] if path is None else [name, str(path.resolve())]
    serve_words += ["--require-transaction"] if require_transaction else []
    changes = installing.install(
        installing.Wanted(
            dialect=dialect,
            project=project,
            ledger=ledger.resolve(),
            serve=tuple(serve_words),
            require_transaction=require_transaction,
        )
    )
    if write:
        installing.write(project, changes)
    for change in changes:
        if write:
            click.echo(f"{'unchanged' if change.before == change.after else 'wrote'} {change.path}")
        elif not change.path.endswith((installing.RECORD, "SKILL.md")):
            click.echo(f"# {change.path}\n{change.after}")
    if dialect == "codex" and write:
        click.echo("open /hooks in Codex and trust them: untrusted hooks do not run")
    return 0
