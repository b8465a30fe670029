"""`reconstruct`: an agent rebuilds the photos of a track."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from legoworld.agents.reconstruct import make_trials
from legoworld.agents.run_plan import plan_run
from legoworld.agents.trial_plugin import PluginOptions
from legoworld.api.arguments import check_arguments, optional_path
from legoworld.api.listener import SILENT, Listener
from legoworld.api.settings import MEMORY_LIMIT_GIB
from legoworld.errors import UsageError
from legoworld.plugin.modules import modules_without
from legoworld.records.agents import Budget, TrialRow
from legoworld.workers.engines import EngineName
from legoworld.workers.protections import Confinement


@check_arguments
def reconstruct(
    track: str | Path,
    output: str | Path,
    *,
    photos: str | Path,
    agent: str,
    task: str | None = None,
    programs: str | Path | None = None,
    model: str | None = None,
    prices: str | Path | None = None,
    record: bool = False,
    limit: int | None = None,
    repeat: int = 1,
    plugin: bool = False,
    without: Sequence[str] = (),
    regions: Sequence[str | Path] = (),
    depth: str | Path | None = None,
    workers: int = 1,
    engine: EngineName = "local",
    sandbox: Confinement = "auto",
    trial_limit_s: float | None = None,
    max_calls: int | None = None,
    max_tokens: int | None = None,
    max_cost: float | None = None,
    memory_limit_gib: float = MEMORY_LIMIT_GIB,
    listener: Listener = SILENT,
) -> list[TrialRow]:
    """Have an agent rebuild every photo of a track in Blender; a row for each trial.

    agent: a name, or the path of a card. programs: what the agent `program` plays. repeat: number
    of independent runs, above 1 each in output/run_K. record: count tokens by a proxy between each
    agent and its API. plugin: give agents the plugin's server, too: `without` leaves modules out,
    regions and depth are its evidence. trial_limit_s, max_calls, max_tokens and max_cost (US
    dollars): of one trial, None for the card's. `listener.trial` gets each row as its trial ends.
    Repeat the call to resume. Raises UsageError for an option of the plugin without `plugin`.
    """
    if not plugin and (without or regions or depth):
        raise UsageError(
            "an option of the plugin is given without it",
            found="--without, --regions or --depth",
            expected="--plugin",
            next_step="pass --plugin, or leave them out",
        )
    plan = plan_run(
        Path(track),
        photos=Path(photos),
        agent=agent,
        task=task,
        programs=optional_path(programs),
        model=model,
        time_limit_s=trial_limit_s,
        budget=Budget(calls=max_calls, tokens=max_tokens, cost_usd=max_cost),
        memory_bytes=int(memory_limit_gib * 2**30),
        sandbox=sandbox,
        plugin=PluginOptions(
            modules=modules_without(without),
            regions=tuple(Path(path) for path in regions),
            depth=optional_path(depth),
        )
        if plugin
        else None,
        prices=optional_path(prices),
        output=Path(output),
        record=record,
    )
    for held, who in ((plan.agent_held, plan.card.name), (plan.blender_held, "Blender")):
        if held.does_not_hold:
            listener.notice(f"not kept from {who}: {', '.join(held.does_not_hold)}")
    images = plan.work.track.images[:limit]
    return make_trials(
        plan, Path(output), images=images, repeat=repeat, workers=workers, engine=engine,
        listener=listener,
    )  # fmt: skip
