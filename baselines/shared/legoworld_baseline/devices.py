"""Where and in what a network runs: checked before it is loaded, so a wrong wish is one line."""

from __future__ import annotations

from legoworld_baseline.protocol import Refused

DTYPES = ("float32", "bfloat16", "float16")


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


def check_dtype(dtype: str) -> None:
    """Refused for anything but the types a network is run in, `DTYPES`."""
    if dtype not in DTYPES:
        raise Refused(
            "a dtype that is not offered",
            found=dtype,
            expected=", ".join(DTYPES),
            next_step="choose another --dtype",
        )


def device_type(device: str) -> str:
    """What provenance says of a device: "cuda" for "cuda:1"; which one it is changes nothing."""
    return device.partition(":")[0]
