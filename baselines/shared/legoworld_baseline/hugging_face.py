"""A model's files: a folder on disk, or a hub id resolved to one commit; nothing is guessed.

`resolve` needs huggingface_hub for an id, and nothing for a folder. What it returns is loaded from
its folder and from nowhere else: the files that were hashed are those that are used.
"""

from __future__ import annotations

import difflib
import json
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from legoworld_baseline.devices import check_dtype_on
from legoworld_baseline.protocol import Refused
from legoworld_baseline.provenance import hash_files

_HUB_ID = re.compile(r"[A-Za-z0-9][\w.-]*(/[A-Za-z0-9][\w.-]*)?(@[\w./-]+)?")
_COMMIT = re.compile(r"[0-9a-f]{40}")
# transformers prefers them in this order; an index lists the files of a model that is in parts.
_WEIGHTS = (
    "model.safetensors",
    "model.safetensors.index.json",
    "pytorch_model.bin",
    "pytorch_model.bin.index.json",
)
_TEXT = ("*.json", "*.txt", "*.model", "*.jinja")


@dataclass(frozen=True, kw_only=True)
class ModelFiles:
    """One model, at one revision, in one folder.

    model: the hub id, or the folder's own name; revision: the commit's 40 hex digits, None for a
    folder that is no snapshot of the hub; weights: the files that hold the parameters.
    """

    folder: Path
    model: str
    revision: str | None
    weights: tuple[Path, ...]

    def provenance(self) -> dict[str, Any]:
        """{"model", "revision", "weight_files", "config_files"}, files as `hash_files` lists them.

        config_files: every other JSON and text file of the folder itself; they decide the
        network, the preprocessing and the names of its classes.
        """
        texts = {p for pattern in _TEXT for p in self.folder.glob(pattern) if p.is_file()}
        return {
            "model": self.model,
            "revision": self.revision,
            "weight_files": hash_files(self.weights, self.folder),
            "config_files": hash_files(texts - set(self.weights), self.folder),
        }


def resolve(weights: str, *, offline: bool) -> ModelFiles:
    """The files of `weights`: a folder, or a hub id such as "org/name" or "org/name@revision".

    offline: only what is in the hub's cache already (huggingface_hub's local_files_only).
    Refused when there is no such folder or model, it may not be downloaded, it holds no weights.
    """
    folder = Path(weights)
    if folder.is_dir():
        model, revision = _name_and_commit(folder.absolute())
        return ModelFiles(
            folder=folder, model=model, revision=revision, weights=weight_files(folder)
        )
    if folder.exists():
        raise _single_file(folder)
    if not _HUB_ID.fullmatch(weights) or folder.is_absolute():
        raise Refused(
            "the weights are no folder and no model id",
            found=f"{weights}{_near_folders(folder)}",
            expected="a folder with config.json and its weights, or a hub id like org/name",
            next_step="check the path",
        )
    return _from_hub(weights, offline)


def read_config(folder: Path) -> Any:
    """The configuration of a model that transformers knows. Refused otherwise."""
    import transformers

    try:
        return transformers.AutoConfig.from_pretrained(folder, local_files_only=True)
    except (ValueError, OSError, KeyError) as error:
        raise Refused(
            "the model's config.json cannot be used",
            found=" ".join(f"{type(error).__name__}: {error}".split())[:280],
            expected="the config.json of a model that transformers knows",
            next_step="pass the folder that save_pretrained wrote, or a hub id",
        ) from error


def load_pretrained(auto: Any, folder: Path, *, device: str, dtype: str) -> Any:
    """A network of a class of transformers, Auto or not, whole, on `device`, ready to predict.

    The network's code is transformers' own: none that comes with a model is run. TF32 is off and
    cuDNN picks its algorithms by the same rule each time. Refused when the model is of another
    kind or needs a package that is not there, and when the files leave a parameter unset:
    transformers would draw it at random and only say so in its log.
    """
    import torch
    import transformers
    from safetensors import SafetensorError

    check_dtype_on(dtype, device)
    torch.backends.cudnn.allow_tf32 = False
    torch.backends.cudnn.deterministic = True
    if not sys.stderr.isatty():
        transformers.logging.disable_progress_bar()
    try:
        network, report = auto.from_pretrained(
            folder,
            dtype=getattr(torch, dtype),
            local_files_only=True,
            output_loading_info=True,
            ignore_mismatched_sizes=True,  # so that they are reported; then refused, below
        )
    except (ValueError, ImportError, OSError, KeyError, RuntimeError, SafetensorError) as error:
        raise Refused(
            f"the model cannot be loaded by transformers' {auto.__name__}",
            found=f"{type(error).__name__}: {' '.join(str(error).split())[:280]}",
            expected="a model of that kind that needs no package besides this baseline's own",
            next_step="see the baseline's README for the kinds that were run",
        ) from error
    unset = [*report["missing_keys"], *report["mismatched_keys"], *report["error_msgs"]]
    if unset:
        raise Refused(
            "the checkpoint does not fill the network: the rest would be random",
            found=f"{len(unset)} parameters, such as {', '.join(sorted(map(str, unset))[:3])}",
            expected="every parameter of the network",
            next_step="download the model again, or check that its config.json belongs to it",
        )
    return network.to(device).eval()


def weight_files(folder: Path) -> tuple[Path, ...]:
    """The files transformers would read parameters from. Refused when one is not there."""
    for name in _WEIGHTS:
        if not (folder / name).is_file():
            continue
        if not name.endswith(".index.json"):
            return (folder / name,)
        index = json.loads((folder / name).read_text(encoding="utf-8"))
        parts = tuple(folder / part for part in sorted(set(index["weight_map"].values())))
        missing = [part.name for part in parts if not part.is_file()]
        if missing:
            raise Refused(
                "weights are incomplete",
                found=f"{name} names {', '.join(missing[:4])}, which are not there",
                expected=f"all {len(parts)} parts",
                next_step="download the model again",
            )
        return parts
    raise Refused(
        "the model's folder holds no weights",
        found=", ".join(sorted(p.name for p in folder.iterdir())[:8]) or "an empty folder",
        expected=" or ".join(_WEIGHTS[::2]),
        next_step="pass the folder that save_pretrained wrote, or a hub id",
    )


def _single_file(path: Path) -> Refused:
    """What to say of a file where a folder is needed; Ultralytics' files are the usual ones."""
    next_step = "pass the folder that holds it, with config.json and preprocessor_config.json"
    if path.suffix == ".pt" and not (path.parent / "config.json").is_file():
        next_step = (
            "a .pt of Ultralytics (YOLO) is run by no baseline: predict with `yolo val"
            " save_json=True` and pass its predictions.json to `legoworld baseline import`;"
            " a checkpoint of another origin needs its folder in transformers' format"
        )
    return Refused(
        "the weights are a single file",
        found=path.name,
        expected="a folder with config.json and its weights, or a hub id like org/name",
        next_step=next_step,
    )


def _near_folders(folder: Path) -> str:
    """In parentheses what lies where the path points and has nearly its name; else nothing."""
    try:
        names = sorted(p.name for p in folder.parent.iterdir() if p.is_dir())
    except OSError:
        return ""
    near = [str(folder.with_name(n)) for n in difflib.get_close_matches(folder.name, names, n=3)]
    return f" (near: {', '.join(near)})" if near else ""


def _from_hub(weights: str, offline: bool) -> ModelFiles:
    from huggingface_hub import snapshot_download

    model, _, revision = weights.partition("@")
    wanted = {"revision": revision or None, "local_files_only": offline}
    try:
        found = Path(snapshot_download(model, allow_patterns=[*_TEXT, "*.safetensors"], **wanted))
        if not any(found.glob("*.safetensors")):
            found = Path(snapshot_download(model, allow_patterns=[*_TEXT, "*.bin"], **wanted))
    except Exception as error:  # the client has no common error; each is one line to the user
        raise _not_had(weights, offline, error) from error
    if not _COMMIT.fullmatch(found.name):
        raise Refused(
            "the hub's answer has no commit",
            found=found.name,
            expected="a snapshot named by 40 hex digits",
            next_step="update huggingface_hub",
        )
    return ModelFiles(folder=found, model=model, revision=found.name, weights=weight_files(found))


def _not_had(weights: str, offline: bool, error: Exception) -> Refused:
    text = " ".join(str(error).split())
    near = _near_folders(Path(weights))
    if near:
        next_step = f"check the path: there is no folder of that name{near}"
    elif offline:
        next_step = "run once without --offline, or copy the model's folder and pass its path"
    elif "gated" in type(error).__name__.lower():
        next_step = (
            "accept the model's licence on its page and set HF_TOKEN; the baseline's process does"
            " not see what `hf auth login` stored"
        )
    else:
        next_step = "check the id and the network, or pass a folder"
    return Refused(
        f"{weights!r} is no folder here, and no model that can be had"
        + (" offline" if offline else ""),
        found=f"{type(error).__name__}: {text[:240]}",
        expected="a model in the hub's cache" if offline else "a model that may be downloaded",
        next_step=next_step,
    )


def _name_and_commit(folder: Path) -> tuple[str, str | None]:
    """(model, commit) by the layout of the hub's cache: models--org--name/snapshots/<commit>."""
    repository = folder.parent.parent.name
    if (
        _COMMIT.fullmatch(folder.name)
        and folder.parent.name == "snapshots"
        and repository.startswith("models--")
    ):
        return repository.removeprefix("models--").replace("--", "/"), folder.name
    return folder.name, None
