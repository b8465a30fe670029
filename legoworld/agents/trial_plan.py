"""What all trials of a run share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from legoworld.agents.agent_cards import AgentCard
from legoworld.agents.prices import PriceCard
from legoworld.agents.trial_plugin import PluginPlan
from legoworld.agents.workspaces import TrialSetup
from legoworld.records.agents import UNLIMITED, Budget
from legoworld.workers.protections import Protections
from legoworld.workers.sandbox import SandboxLimits


@dataclass(frozen=True, kw_only=True)
class TrialPlan:
    """The plan of a run.

    limits: of a trial's Blender and of its agent each; agent_held, blender_held: their sandboxes;
    programs: the folder `program` finds its programs in, else None; model: None for the agent's
    own; prices: what tokens cost; budget: of each trial; plugin: None for trials without it;
    record: count the tokens of each request.
    """

    card: AgentCard
    agent_version: str | None
    work: TrialSetup
    limits: SandboxLimits
    agent_held: Protections
    blender_held: Protections
    programs: Path | None
    model: str | None
    prices: PriceCard
    budget: Budget = UNLIMITED
    plugin: PluginPlan | None = None
    record: bool = False
