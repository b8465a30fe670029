"""Where a network runs: asked for before it is loaded, so that a wrong wish is one line."""

from __future__ import annotations

from legoworld_baseline.protocol import Refused


def check_device(device: str) -> None:
    """Refused when torch has no such device, "cpu", "cuda", "cuda:1" or "mps", on this machine."""
    import torch

    try:
        torch.empty(1, device=device)
    except (RuntimeError, AssertionError, NotImplementedError) as error:
        raise Refused(
            "there is no such device here",
            found=f"{device}: {' '.join(str(error).split())[:160]}",
            expected=f"cpu, or one of {torch.cuda.device_count()} CUDA devices",
            next_step="choose another --device, or install torch for your GPU",
        ) from error
