"""Agents: their cards, the steps that `program` plays, what became of a trial, and prices."""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal

import msgspec
from msgspec import Meta, field

from legoworld.records.base import Record
from legoworld.records.plugin_install import PluginUsed
from legoworld.records.scene_folder import Protected

TranscriptFormat = Literal["atif", "codex", "claude", "gemini", "opencode"]
McpFormat = Literal["mcp_servers", "codex", "opencode"]
Wire = Literal["messages", "responses", "chat", "gemini"]
RequestEnd = Literal["whole", "cut", "unreachable"]


class AgentMcp(Record, frozen=True, kw_only=True):
    """[mcp]: the file that tells an agent of the Blender server, and how it is written.

    settings: what else that file holds, such as the agent's model provider and its base URL.
    """

    format: McpFormat
    path: str
    settings: dict[str, Any] = field(default_factory=dict)


class AgentTranscript(Record, frozen=True, kw_only=True):
    """[transcript]: how it is read, and the file it is in; without one it is standard output."""

    format: TranscriptFormat
    path: str | None = None


class AgentNeeds(Record, frozen=True, kw_only=True):
    """[needs]: what must be there before an agent can run.

    variables: of the caller's environment that it gets, any one of which is its login; credentials:
    files below the caller's home that it gets a copy of; install: how to get its command.
    """

    install: str
    variables: tuple[str, ...] = ()
    credentials: tuple[str, ...] = ()
    programs: bool = False


class Budget(Record, frozen=True, kw_only=True):
    """What a trial may spend besides its time; null for no limit.

    calls: to Blender; tokens: of all requests, cached ones included.
    """

    calls: Annotated[int, Meta(gt=0)] | None = None
    tokens: Annotated[int, Meta(gt=0)] | None = None
    cost_usd: Annotated[float, Meta(gt=0)] | None = None


UNLIMITED: Final = Budget()
OverBudget = Literal["calls", "tokens", "cost"]


class AgentRecord(Record, frozen=True, kw_only=True):
    """[record]: for `reconstruct --record`, where the agent's API is and how it is sent elsewhere.

    variables, settings: added to the card's and to those of [mcp], {api} being the recorder.
    """

    api: Annotated[str, Meta(pattern="^https?://[^/]")]
    variables: dict[str, str] = field(default_factory=dict)
    settings: dict[str, Any] = field(default_factory=dict)


class AgentCardFile(Record, frozen=True, kw_only=True):
    """A card of legoworld/agents/cards.

    command: with {image}, {prompt}, {prompt_file}, {workspace}, {home}, {mcp_config}, {steps},
    {transcript}, {mcp_python} and {player} replaced; version_command: prints the agent's version;
    network: whether the agent's own process has one; blender_network: whether the code in Blender
    has; run: whether it was ever run here; checked: against what its flags were checked; variables:
    set in its environment, with the same placeholders; model_arguments: the words, with {model},
    that stand for the word {model_arguments} of a command when a model is asked for, without which
    none can be.

    shown: files and folders that its sandbox shows besides its program, the npm package that is in
    and its interpreter; relative to the card, or to the home with ~.

    resume: what becomes of a trial that legoworld was killed in; continue_command: what continues
    it, without one `command`; session_folders: below the agent's home, where it keeps what it
    continues from.
    """

    name: Annotated[str, Meta(pattern="^[a-z][a-z0-9-]*$")]
    title: str
    version: str
    documentation: str
    run: bool
    checked: str
    command: Annotated[tuple[str, ...], Meta(min_length=1)]
    version_command: tuple[str, ...] = ()
    shown: tuple[str, ...] = ()
    network: bool
    blender_network: bool = False
    model_arguments: tuple[str, ...] = ()
    resume: Literal["restart", "continue"] = "restart"
    continue_command: tuple[str, ...] = ()
    session_folders: tuple[str, ...] = ()
    time_limit_s: Annotated[float, Meta(gt=0)]
    budget: Budget = Budget()
    mcp: AgentMcp
    transcript: AgentTranscript
    needs: AgentNeeds
    record: AgentRecord | None = None
    variables: dict[str, str] = msgspec.field(default_factory=dict)


class RecordedStep(Record, frozen=True, kw_only=True):
    """One call that `program` makes.

    server: the MCP server whose tool it is, `legoworld` being the plugin's; must_succeed: nothing
    is played after its failure.
    """

    server: Literal["blender", "legoworld"] = "blender"
    tool: str
    arguments: dict[str, Any]
    must_succeed: bool = False


class Usage(Record, frozen=True, kw_only=True):
    """What a trial used; null where its source does not say.

    tokens_source: null without tokens; cost_source: "transcript", or the price card that the cost
    is by, null without a cost. requests, uncounted: of a recorded trial, and how many of them were
    answered without tokens or cut before the end: the totals have only what those stated.
    """

    prompt_tokens: int | None = None
    completion_tokens: int | None = None
    cached_tokens: int | None = None
    cost_usd: float | None = None
    cost_source: str | None = None
    tokens_source: Literal["recorded", "transcript"] | None = None
    requests: int | None = None
    uncounted: int | None = None


class ApiRequest(Record, frozen=True, kw_only=True):
    """A line of trial/requests.jsonl: one request of the agent's program to its API.

    at_s: of the trial's time; wire: the API that was asked for a model's answer, null for another
    request; status: null without an answer; ended: `cut` by its client, the API or the trial's end.
    """

    number: int
    at_s: float
    seconds: float = 0.0
    wire: Wire | None
    model: str | None = None
    status: int | None = None
    ended: RequestEnd = "cut"
    prompt_tokens: int | None = None
    cached_tokens: int | None = None
    completion_tokens: int | None = None

    @property
    def spent(self) -> bool:
        """Whether it may have used tokens."""
        refused = self.status is not None and self.status >= 300
        return self.wire is not None and self.ended != "unreachable" and not refused

    @property
    def uncounted(self) -> bool:
        """Whether it may have used tokens that its answer did not state."""
        return self.spent and None in (self.prompt_tokens, self.completion_tokens)


Outcome = Literal["ok", "no_scene", "agent_failed", "no_photo", "failed"]


class Finalisation(Record, frozen=True, kw_only=True):
    """Which scene was made the submission, by the runtime, the same way for every agent.

    source: `saved` is the scene.blend that the agent saved last, `checkpoint` the open scene after
    the last call that changed it; refused: those that did not open, with the reason.
    """

    source: Literal["saved", "checkpoint", "none"]
    checkpoint: int | None
    sha256: str | None
    refused: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


class PluginCalls(Record, frozen=True, kw_only=True):
    """How a trial used its plugin. calls, failed: of its tools; left_open: a transaction was."""

    calls: int
    failed: int
    transactions: int
    committed: int
    rolled_back: int
    left_open: bool


class SceneContent(Record, frozen=True, kw_only=True):
    """What a readout would find in a trial's scene; all empty where it cannot be read.

    objects: instances with a surface, labelled or not; categories: how many of each, of those
    with a label of the vocabulary; outside_vocabulary: other label texts, with their owners;
    labelled: whether the task reads labels; problem: why the scene cannot be read.
    """

    objects: int = 0
    labelled: bool
    categories: dict[str, int] = field(default_factory=dict)
    outside_vocabulary: dict[str, int] = field(default_factory=dict)
    camera: Literal["perspective", "orthographic"] | None = None
    problem: str | None = None


class ReconstructionFile(Record, frozen=True, kw_only=True):
    """reconstruction.json of a scene folder: how its trial went.

    ended: how the agent's process did; seconds: wall time of the trial; agent_seconds: of its
    agent; calls, checkpoints: their numbers, the plugin's left out; plugin, plugin_calls: null
    without it; agent_sandbox, blender_sandbox: what each was kept from; continued: how often the
    trial was continued after legoworld had been killed; content: null without a scene.
    """

    schema_version: int
    legoworld: str
    image_id: int
    file_name: str
    scene: str
    agent: str
    agent_version: str | None
    card_sha256: str
    model: str | None
    prompt_sha256: str
    status: Outcome
    reason: str
    ended: Literal[
        "itself", "time", "memory", "disk", "output", "processes", "not_started", "calls", "tokens",
        "cost",
    ]  # fmt: skip
    exit_code: int | None
    time_limit_s: float
    budget: Budget = Budget()
    seconds: float
    agent_seconds: float
    calls: int
    failed_calls: int
    checkpoints: int
    usage: Usage
    finalisation: Finalisation
    plugin: PluginUsed | None = None
    plugin_calls: PluginCalls | None = None
    agent_sandbox: Protected
    blender_sandbox: Protected
    warnings: tuple[str, ...] = ()
    continued: int = 0
    content: SceneContent | None = None


class BegunTrial(Record, frozen=True, kw_only=True):
    """begun.json of an unfinished trial: whose it is.

    parts: for each start of its agent, how many calls had been answered before.
    """

    scene: str
    agent: str
    card_sha256: str
    prompt_sha256: str
    time_limit_s: float
    budget: Budget = Budget()
    record: bool = False
    parts: tuple[int, ...]


class EndedAgent(Record, frozen=True, kw_only=True):
    """ended.json of an unfinished trial: its agent has ended, and what is left is the runtime's.

    over: the limit it was ended for, null where it ended itself, with `code`.
    """

    code: int | None
    over: Literal["time", "memory", "disk", "output", "processes"] | OverBudget | None
    last_output: str
    seconds: float


class TrialRow(Record, frozen=True, kw_only=True):
    """One trial as the command reports it. run: from 1, of --repeat."""

    image_id: int
    scene: str
    run: int
    status: Outcome
    reason: str
    seconds: float = 0.0
    calls: int = 0
    checkpoints: int = 0
    usage: Usage = Usage()
    kept: bool = False
    content: SceneContent | None = None


_Price = Annotated[float, Meta(ge=0)]


class ModelPrice(Record, frozen=True, kw_only=True):
    """[[model]]: one price in US dollars a million tokens.

    names: as transcripts and --model have them; source: the page it is from. Only for models whose
    price does not depend on the length of a request: a trial's totals do not tell that.
    """

    names: Annotated[tuple[str, ...], Meta(min_length=1)]
    source: str
    input_usd: _Price
    cached_input_usd: _Price
    output_usd: _Price

    def cost_usd(self, prompt: int, cached: int, completion: int) -> float:
        """Of tokens: cached ones are part of the prompt's."""
        return (
            (prompt - cached) * self.input_usd
            + cached * self.cached_input_usd
            + completion * self.output_usd
        ) / 1_000_000


class PriceCardFile(Record, frozen=True, kw_only=True):
    """prices.toml. date: when the sources were read."""

    title: str
    date: Annotated[str, Meta(pattern=r"^\d{4}-\d{2}-\d{2}$")]
    model: tuple[ModelPrice, ...] = ()
