"""An agent's workspace: the photo, what is public about it, and the prompt. Never truth."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from legoworld.errors import UsageError
from legoworld.files import Json, readable_json, sha256_of_file, write_text
from legoworld.readouts.family import Protocol, protocol
from legoworld.readouts.instructions import instructions, instructions_text
from legoworld.records.base import decode
from legoworld.records.plugin_install import Module
from legoworld.records.track import PRIVATE_KEYS
from legoworld.tasks.registry import task_names
from legoworld.tasks.shipped import BENCH
from legoworld.track_making.make_track import find_photo
from legoworld.tracks.track import Track, TrackImage, load_track

_PLAIN: Final = Path(__file__).with_name("prompts") / "plain.md"
_PLUGIN: Final = _PLAIN.with_name("plugin.md")
#: What the prompt says of each module of the plugin that is on.
_OF_MODULES: Final[dict[Module, str]] = {
    "evidence": "reference_evidence tells what models saw in the image: regions, depth, camera.",
    "initialisation": "initialize and plan give a room, a camera and a construction plan.",
    "measurement": "measure says how far the scene is from what you require of it: pass, fail or"
    " unknown, with residuals. It is stale as soon as the scene changes.",
    "transactions": "begin declares an edit, commit judges it, rollback undoes it. Declare every"
    " edit of a scene that stands already.",
    "records": "history and review show what was done and measured.",
    "looking": "look shows the scene from any side, beside the image, or before and after an edit.",
}
REFERENCE: Final = "reference"
PUBLIC: Final = "task.json"
PROMPT: Final = "prompt.md"


@dataclass(frozen=True, kw_only=True)
class TrialSetup:
    """Settings shared by all trials of a run.

    entries: each image as the track has it, by id; schema: the task's public instructions;
    vocabulary_sha256: null where the task has none; template: the prompt's, with its fields.
    """

    track: Track
    entries: dict[int, dict[str, Any]]
    categories: list[str]
    task: str
    protocol: Protocol
    schema: str
    vocabulary_sha256: str | None
    template: str
    photos: Path

    @property
    def prompt_sha256(self) -> str:
        """Hash of what is the same in every prompt: its template and the schema."""
        return hashlib.sha256((self.template + "\n" + self.schema).encode()).hexdigest()


@dataclass(frozen=True, kw_only=True)
class Workspace:
    """A workspace on disk. image: copy of the photo; prompt: the agent's instructions."""

    folder: Path
    image: Path
    prompt: str


def load_trial_setup(
    track_path: Path, photos: Path, task: str | None, plugin: Sequence[Module] = ()
) -> TrialSetup:
    """Load a track for its trials. UsageError if its task cannot be determined.

    plugin: enabled modules, which the prompt then describes.
    """
    track = load_track(track_path)
    if any(image.probe is not None for image in track.images):
        raise UsageError(
            "the track is private: it says where submissions are looked at",
            found=track_path.name,
            expected="DATASET/public/track.json",
        )
    name = task or track.made_for
    if name is None:
        raise UsageError(
            "the track does not say what it is for",
            found=track_path.name,
            expected=f"--task {' or '.join(task_names())}",
            next_step="pass --task",
        )
    document = decode(dict[str, Any], track_path.read_bytes())
    entries = {int(entry["id"]): dict(entry) for entry in document["images"]}
    reading = protocol(name, track.vocabulary)
    schema, vocabulary = "", None
    if name != BENCH:
        schema = instructions_text(instructions(reading, "agent"))
        vocabulary = reading.vocabulary.sha256 if reading.vocabulary else None
    return TrialSetup(
        track=track,
        entries=entries,
        categories=[str(c["name"]) for c in document.get("categories", [])],
        task=name,
        protocol=reading,
        schema=schema,
        vocabulary_sha256=vocabulary,
        template=_template(plugin),
        photos=photos,
    )


def _template(plugin: Sequence[Module]) -> str:
    text = _PLAIN.read_text(encoding="utf-8")
    if not plugin:
        return text
    offered = [f"- {line}\n" for module, line in _OF_MODULES.items() if module in plugin]
    return text + "\n" + _PLUGIN.read_text(encoding="utf-8") + "".join(offered)


def make_workspace(
    work: TrialSetup, image: TrackImage, folder: Path, *, time_limit_s: float
) -> Workspace | None:
    """Fill an empty folder for one image; None where its photo is not there.

    Public metadata is the image's entry in the track, which holds no annotation.
    """
    made = plan_workspace(work, image, folder, time_limit_s=time_limit_s)
    photo = find_photo(work.photos, image)
    if made is None or photo is None:
        return None
    shutil.copyfile(photo, made.image)
    public: dict[str, Json] = {
        "image": {**_public(work, image), "file_name": made.image.name},
        "image_sha256": sha256_of_file(made.image),
        "task": work.task,
        "categories": work.categories,
    }
    write_text(folder / PUBLIC, readable_json(public))
    write_text(folder / PROMPT, made.prompt)
    (folder / "tmp").mkdir()
    return made


def plan_workspace(
    work: TrialSetup, image: TrackImage, folder: Path, *, time_limit_s: float
) -> Workspace | None:
    """The workspace of one image in a folder, made or not; None where its photo is not there."""
    photo = find_photo(work.photos, image)
    if photo is None:
        return None
    copy = folder / f"{REFERENCE}{photo.suffix.lower()}"
    entry = _public(work, image)
    fov = entry.get("hfov_deg")
    prompt = work.template.format(
        image_name=copy.name,
        width=entry["width"],
        height=entry["height"],
        view=f", taken with a horizontal field of view of {fov:g} degrees" if fov else "",
        workspace=folder,
        minutes=f"{time_limit_s / 60:g}",
    )
    prompt += _categories(work) if work.task == BENCH else f"\n{work.schema}"
    return Workspace(folder=folder, image=copy, prompt=prompt)


def _public(work: TrialSetup, image: TrackImage) -> dict[str, Any]:
    return {k: v for k, v in work.entries[image.id].items() if k not in PRIVATE_KEYS}


def _categories(work: TrialSetup) -> str:
    if not work.categories:
        return ""
    return f"\nThe categories of objects that may appear: {', '.join(work.categories)}.\n"
