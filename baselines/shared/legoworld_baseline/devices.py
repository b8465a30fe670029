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


def check_dtype_on(dtype: str, device: str) -> None:
    """Refused for a type that is not offered, or that the device has no arithmetic of."""
    import torch

    check_dtype(dtype)
    check_device(device)
    if dtype != "bfloat16" or device_type(device) != "cuda":
        return
    with torch.cuda.device(device):
        supported = torch.cuda.is_bf16_supported(including_emulation=False)
    if not supported:
        raise Refused(
            "the GPU has no bfloat16",
            found=torch.cuda.get_device_name(device),
            expected="a GPU with it: NVIDIA's since Ampere",
            next_step="pass --dtype float32 or --dtype float16",
        )


def device_type(device: str) -> str:
    """What provenance says of a device: "cuda" for "cuda:1"; which one it is changes nothing."""
    return device.partition(":")[0]
