"""What a run of trials is made with, checked before the first begins."""

from __future__ import annotations

from pathlib import Path

from legoworld.agents.agent_cards import agent_problems, load_agent
from legoworld.agents.budget import plan_budget
from legoworld.agents.exposed_paths import refuse_exposed, version_in_sandbox
from legoworld.agents.prices import read_prices
from legoworld.agents.recorded_card import check_recordable
from legoworld.agents.trial_plan import TrialPlan
from legoworld.agents.trial_plugin import PluginOptions, plan_plugin
from legoworld.agents.workspaces import load_trial_setup
from legoworld.errors import UsageError
from legoworld.records.agents import UNLIMITED, Budget
from legoworld.workers.protections import Confinement, protections
from legoworld.workers.sandbox import SandboxLimits


def plan_run(
    track: Path,
    *,
    photos: Path,
    agent: str,
    task: str | None,
    programs: Path | None,
    model: str | None,
    time_limit_s: float | None,
    memory_bytes: int,
    sandbox: Confinement,
    budget: Budget = UNLIMITED,
    plugin: PluginOptions | None = None,
    prices: Path | None = None,
    output: Path | None = None,
    record: bool = False,
) -> TrialPlan:
    """The plan of a run. UsageError for an agent that cannot run here, and what it lacks.

    output: the scenes' folder, of which the agent is shown nothing but its workspace.
    """
    card = load_agent(agent)
    if problems := agent_problems(card):
        raise UsageError(
            f"the agent {card.name} cannot run here",
            found="; ".join(problems),
            expected="an installed and logged in agent",
            next_step=f"`legoworld agent check {agent}`",
        )
    if (programs is None) is card.about.needs.programs:
        raise UsageError(
            f"the agent {card.name} {'needs' if programs is None else 'takes no'} --programs",
            found="none" if programs is None else str(programs),
            expected="DIR/<scene>/scene.py for each image" if programs is None else "nothing",
        )
    about = card.about
    if model is not None and not about.model_arguments:
        raise UsageError(
            f"the agent {card.name} takes no --model",
            found=model,
            expected="none, or an agent whose card has model_arguments",
        )
    if record:
        check_recordable(card)
    refuse_exposed(card, [path for path in (track, photos, output) if path is not None])
    agent_held = protections(sandbox, network=about.network)
    work = load_trial_setup(track, photos, task, plugin.modules if plugin else ())
    return TrialPlan(
        card=card,
        agent_version=version_in_sandbox(card, agent_held),
        work=work,
        limits=SandboxLimits(
            time_s=time_limit_s or about.time_limit_s,
            memory_bytes=memory_bytes,
            output_bytes=256 << 20,
        ),
        agent_held=agent_held,
        blender_held=protections(sandbox, network=about.blender_network),
        programs=None if programs is None else programs.resolve(),
        model=model,
        prices=read_prices(prices),
        budget=plan_budget(card, budget, record=record),
        plugin=plan_plugin(plugin, work) if plugin else None,
        record=record,
    )
