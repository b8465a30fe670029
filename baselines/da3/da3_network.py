"""DA3MONO-LARGE's network out of the package depth-anything-3, with nothing else of it."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from da3_sky import Policy, without_sky
from legoworld_baseline import Refused
from numpy.typing import NDArray

MODEL_NAME = "da3mono-large"
#: Only used in training: a checkpoint may hold it and the network may not, or the other way round.
_TRAINING_ONLY = "backbone.pretrained.mask_token"
_PREFIX = "model."


def build(name: str = MODEL_NAME) -> Any:
    """The network with random weights, without its own unseeded treatment of the sky."""
    from depth_anything_3.cfg import create_object, load_config
    from depth_anything_3.registry import MODEL_REGISTRY

    network = create_object(load_config(MODEL_REGISTRY[name]))
    network._process_mono_sky_estimation = lambda output: output
    return network.eval()


def load_weights(network: Any, weights: Mapping[str, torch.Tensor]) -> None:
    """Put a checkpoint into the network: every key of one is a key of the other, or Refused."""
    foreign = [key for key in weights if not key.startswith(_PREFIX)]
    if foreign:
        raise _wrong(f"key {foreign[0]!r}", f'keys that begin with "{_PREFIX}"')
    own = {key.removeprefix(_PREFIX): value for key, value in weights.items()}
    own.pop(_TRAINING_ONLY, None)
    expected = network.state_dict()
    missing = sorted(expected.keys() - own.keys() - {_TRAINING_ONLY})
    unknown = sorted(own.keys() - expected.keys())
    if missing or unknown:
        found = f"{len(missing)} keys are missing ({', '.join(missing[:3]) or 'none'}), "
        found += f"{len(unknown)} unknown ({', '.join(unknown[:3]) or 'none'})"
        raise _wrong(found, "exactly the keys of this network")
    for key, value in own.items():
        if value.shape != expected[key].shape:
            found = f"{key} of shape {tuple(value.shape)}"
            raise _wrong(found, f"shape {tuple(expected[key].shape)}")
    network.load_state_dict(own, strict=False)


def _wrong(found: str, expected: str) -> Refused:
    return Refused(
        "this is not a DA3MONO-LARGE checkpoint",
        found=found,
        expected=expected,
        next_step="pass the model.safetensors of depth-anything/DA3MONO-LARGE",
    )


@torch.inference_mode()
def predict_depth(
    network: Any, photo: NDArray[np.float32], dtype: torch.dtype, sky: Policy, seed: int
) -> tuple[NDArray[np.float32], int]:
    """Relative depth (h, w) float32 of a prepared photo (3, h, w), and how many pixels are sky.

    dtype: float32 runs everything in it; another one runs the backbone under autocast, as the
    official interface does, and the head in float32. ValueError when the depth is not finite.
    """
    parameter = next(network.parameters())
    views = torch.from_numpy(photo)[None, None].to(parameter.device)
    context: Any = contextlib.nullcontext()
    if dtype != torch.float32:
        context = torch.autocast(device_type=parameter.device.type, dtype=dtype)
    with context:
        output = network(views)
    depth = output["depth"][0, 0].float().cpu()
    if not torch.isfinite(depth).all():
        raise ValueError("the network's depth is not finite (with float16, try float32)")
    depth, n_sky = without_sky(depth, output["sky"][0, 0].float().cpu(), sky, seed)
    return depth.numpy(), n_sky
