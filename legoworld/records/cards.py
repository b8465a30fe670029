"""The cards that ship as TOML: of tasks (readouts/), of datasets and of baselines."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, field

from legoworld.records.base import UNSET, Record, UnsetType

Text = Annotated[str, Meta(min_length=1)]
OptionType = Literal["str", "int", "float", "bool"]
OptionValue = str | int | float | bool
Dtype = Literal["float32", "float16", "bfloat16"]


class Head(Record, frozen=True, kw_only=True):
    """What every card says of what it describes."""

    name: Text
    version: Text
    title: Text


class ReadoutHead(Head, frozen=True, kw_only=True):
    """[readout] of a task's card."""

    task: str
    reads: Text


class LicensedHead(Head, frozen=True, kw_only=True):
    """What the card of a dataset or a baseline says besides."""

    licence: Text


class DatasetCardFile(LicensedHead, frozen=True, kw_only=True):
    """datasets/NAME/card.toml. serves: the datasets of tasks that it has tracks and truth for."""

    serves: Annotated[tuple[str, ...], Meta(min_length=1)]


class VocabularyRules(Record, frozen=True, kw_only=True):
    """[vocabulary] of a task's card. file: in datasets/; property: what makes an instance."""

    file: Text
    property: Text
    override_property: Text
    synonyms: Text
    qualifier: Text


class ReadoutCard(Record, frozen=True, kw_only=True):
    """What the code asks a task's card. Which words it may say is checked in legoworld/cards.py."""

    readout: ReadoutHead
    vocabulary: VocabularyRules | None = None


class BaselineOption(Record, frozen=True, kw_only=True):
    """[options.KEY] of a baseline's card. Without a default the baseline decides."""

    help: str
    type: OptionType | UnsetType = UNSET
    default: OptionValue | UnsetType = UNSET
    choices: tuple[OptionValue, ...] = ()


class BaselineCardFile(LicensedHead, frozen=True, kw_only=True):
    """A baseline's card.toml.

    prompts_from_truth: whether it can be given them; variables: names of the caller's environment
    variables that its process needs to see; label_map: whether it matches labels by name;
    dtype_on_cuda: what the original computes in on a GPU, `--dtype auto`; camera: whether it
    recovers a photo's camera, for `plugin evidence --provider`; network: whether it downloads
    weights that are no file or folder here.
    """

    tasks: Annotated[tuple[str, ...], Meta(min_length=1)]
    options: dict[str, BaselineOption] = field(default_factory=dict)
    prompts_from_truth: bool = False
    variables: tuple[Text, ...] = ()
    label_map: bool = True
    dtype_on_cuda: Dtype = "float32"
    camera: bool = False
    network: bool = False
