"""The published checkpoint into the network: every name accounted for, every difference refused.

Kept: checkpoint["model"] of IDEA-Research/DINO's main.py. Dropped, and nothing else:
`label_enc.*` (denoising, training only), `*.num_batches_tracked` (the frozen norm has none), and
`transformer.decoder.{bbox,class}_embed.*`, second names of `{bbox,class}_embed.*`, after a check
that both hold the same numbers.
"""

from __future__ import annotations

import argparse
import pickle
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

import torch
from dino_network import Dino
from dino_transformer import DinoSize
from legoworld_baseline import Refused
from torch import Tensor

_ALIASES = ("transformer.decoder.bbox_embed.", "transformer.decoder.class_embed.")
_ALIAS_OF = "transformer.decoder."
# Settings that change the function and leave no trace in names and shapes.
_SETTINGS = {
    "pe_temperatureH": 20,
    "pe_temperatureW": 20,
    "nheads": 8,
    "transformer_activation": "relu",
    "decoder_module_seq": ["sa", "ca", "ffn"],
    "dilation": False,
}
#: Training wrote its arguments as a Namespace of plain values; some paths are pathlib's, under the
#: module's name of the Python that wrote them. A path opens nothing.
_ALLOWED: tuple[Any, ...] = (
    argparse.Namespace,
    *(
        (made, f"{module}.{name}")
        for module in ("pathlib", "pathlib._local")
        for made, name in (
            (PurePosixPath, "PosixPath"),
            (PurePosixPath, "PurePosixPath"),
            (PureWindowsPath, "WindowsPath"),
            (PureWindowsPath, "PureWindowsPath"),
        )
    ),
)
_ULTRALYTICS = (
    "a model of Ultralytics (YOLO) is run by no baseline: predict with `yolo val save_json=True`"
    " and pass its predictions.json to `legoworld baseline import`"
)
_GET_IT = "download checkpoint0023_4scale.pth of IDEA-Research/DINO's model zoo; see the README"


@dataclass(frozen=True, kw_only=True)
class Checkpoint:
    """parameters: by the network's names; epochs: how many were trained, None when not recorded.

    settings: those of `_SETTINGS` that the file records.
    """

    parameters: Mapping[str, Tensor]
    epochs: int | None
    settings: Mapping[str, Any]


def read_checkpoint(path: Path) -> Checkpoint:
    """A .pth file as training wrote it. Only tensors and plain values are unpickled.

    Refused for anything that is not the original's layout, or was trained with settings that
    this network does not have.
    """
    content = _unpickle(path)
    _recognise(content)
    settings = {name: value for name, value in _recorded(content).items() if name in _SETTINGS}
    for name, value in settings.items():
        if value != _SETTINGS[name]:
            raise Refused(
                "the checkpoint was trained with another network",
                found=f"{name} = {value!r}",
                expected=f"{name} = {_SETTINGS[name]!r}",
                next_step=_GET_IT,
            )
    epoch = content.get("epoch")
    return Checkpoint(
        parameters=_without_aliases(content["model"]),
        epochs=epoch + 1 if isinstance(epoch, int) else None,
        settings=settings,
    )


def build(checkpoint: Checkpoint, size: DinoSize) -> Dino:
    """The network with the checkpoint's parameters, in eval mode.

    Refused unless the names and shapes are exactly the network's and every number is finite.
    """
    with torch.device("meta"):
        network = Dino(size)
    wanted = {name: tuple(tensor.shape) for name, tensor in network.state_dict().items()}
    found = {name: tuple(tensor.shape) for name, tensor in checkpoint.parameters.items()}
    differences = [
        *(f"{name} is missing" for name in sorted(wanted.keys() - found.keys())),
        *(f"{name} is not known" for name in sorted(found.keys() - wanted.keys())),
        *(
            f"{name} is {list(found[name])}, not {list(wanted[name])}"
            for name in sorted(wanted.keys() & found.keys())
            if found[name] != wanted[name]
        ),
        *(
            f"{name} holds NaN or infinity"
            for name, tensor in sorted(checkpoint.parameters.items())
            if not tensor.isfinite().all()
        ),
    ]
    if differences:
        raise Refused(
            f"the checkpoint is not DINO-R50-4scale: {len(differences)} differences",
            found="; ".join(differences[:4]),
            expected=f"the {len(wanted)} tensors of DINO-R50-4scale with {size.classes} classes",
            next_step=_GET_IT,
        )
    network.load_state_dict(checkpoint.parameters, strict=True, assign=True)
    return network.eval().requires_grad_(False)


def _unpickle(path: Path) -> dict[str, Any]:
    if not path.is_file():
        raise Refused(
            "the weight file does not exist",
            found=str(path),
            expected="a .pth file",
            next_step=_GET_IT,
        )
    try:
        with torch.serialization.safe_globals(list(_ALLOWED)):
            content = torch.load(path, map_location="cpu", weights_only=True)
    except (pickle.UnpicklingError, RuntimeError, EOFError, ValueError, KeyError) as error:
        found = _what_it_asks_for(error)
        raise Refused(
            "the weight file cannot be read safely, and nothing in it was executed",
            found=found,
            expected="tensors, plain values and one argparse.Namespace, as torch.save writes them",
            next_step=_ULTRALYTICS if "wants ultralytics." in found else _next_for(error),
        ) from error
    if not isinstance(content, dict):
        raise Refused(
            "the weight file does not contain a checkpoint",
            found=type(content).__name__,
            expected='a dict with the key "model"',
            next_step=_GET_IT,
        )
    return content


def _next_for(error: Exception) -> str:
    """A file that asks for an object is whole: downloading it again would change nothing."""
    if "GLOBAL" in str(error):
        return (
            "save it again with tensors and plain values only: {'model': state_dict, 'args':"
            " argparse.Namespace(...)}; or " + _GET_IT
        )
    return "download it again"


def _what_it_asks_for(error: Exception) -> str:
    """The object an unsafe file wants made, or the error's beginning; not torch's advice."""
    asked = re.search(r"GLOBAL (\S+)", str(error))
    if asked:
        return f"it wants {asked[1]} to be called"
    text = " ".join(str(error).split())[:120]
    if not text or text.startswith("Weights only load failed"):
        text = "not what torch.save writes"
    return f"{type(error).__name__}: {text}"


def _recognise(content: Mapping[str, Any]) -> None:
    """Refuse a known relative by its name; see the README for how they differ."""
    model = content.get("model", content.get("state_dict", content))
    names = [name for name in model if isinstance(name, str)] if isinstance(model, Mapping) else []
    relative = None
    if any(name.startswith(("neck.", "transformer.level_embeds")) for name in names):
        relative = (
            "detrex's DINO: 80 contiguous classes, position temperature 10000 and offset -0.5,"
            " other parameter names"
        )
    if any(name.startswith("bbox_head.") for name in names):
        relative = "MMDetection's DINO: 80 contiguous classes, other parameter names"
    if any(name.startswith("backbone.0.patch_embed.") for name in names):
        relative = "DINO with a Swin backbone"
    if any(name.startswith("input_proj.4.") for name in names):
        relative = "DINO-5scale"
    if relative or not isinstance(content.get("model"), Mapping):
        raise Refused(
            "the checkpoint belongs to another model",
            found=relative or f"the keys {', '.join(sorted(map(str, content))[:6])}",
            expected='the original DINO-R50-4scale: parameters under "model", 91 class logits',
            next_step=_GET_IT,
        )


def _recorded(content: Mapping[str, Any]) -> dict[str, Any]:
    arguments = content.get("args")
    return vars(arguments) if isinstance(arguments, argparse.Namespace) else {}


def _without_aliases(model: Mapping[str, Tensor]) -> dict[str, Tensor]:
    kept = {}
    for name, tensor in model.items():
        if name.startswith("label_enc.") or name.endswith(".num_batches_tracked"):
            continue
        if name.startswith(_ALIASES):
            first = model.get(name.removeprefix(_ALIAS_OF))
            if first is None or not torch.equal(first, tensor):
                raise Refused(
                    "the checkpoint contradicts itself",
                    found=f"{name} is not {name.removeprefix(_ALIAS_OF)}",
                    expected="the same numbers under both names",
                    next_step=_GET_IT,
                )
            continue
        kept[name] = tensor
    return kept
