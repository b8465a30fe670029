"""VGGT's network out of its own package, with the heads that are used and nothing else."""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import torch
from legoworld_baseline import Refused
from numpy.typing import NDArray
from vggt_input import PATCH_PX, SIDE_PX

#: The sizes of VGGT-1B, which its class has as defaults; config.json of the weights may say others.
SIZES = {"img_size": SIDE_PX, "patch_size": PATCH_PX, "embed_dim": 1024}
#: Heads for point maps and for tracks: of no use for one photo, so neither built nor loaded.
_UNUSED = ("point_head.", "track_head.")
_INSTALL = (
    "`legoworld baseline install vggt`, or in the environment of --python: pip install --no-deps"
    " vggt @ git+https://github.com/facebookresearch/vggt.git@<commit>, or -e of your checkout"
)


def build(sizes: Mapping[str, int], *, depth: bool) -> Any:
    """The network with random weights. Refused where the package is missing or is another one."""
    try:
        from vggt.models.vggt import VGGT

        # Only to find a wrong package before gigabytes are loaded.
        from vggt.utils.pose_enc import pose_encoding_to_extri_intri  # noqa: F401
    except ModuleNotFoundError as error:
        raise _missing(error) from error
    except ImportError as error:
        raise _another_package(error) from error
    try:
        network = VGGT(**sizes, enable_point=False, enable_track=False, enable_depth=depth)
    except TypeError as error:
        raise _another_package(error) from error
    return network.eval()


def sizes_of(folder: Path | None) -> dict[str, int]:
    """The network's sizes: config.json's, else VGGT-1B's. Refused for those it is not fed."""
    path = None if folder is None else folder / "config.json"
    said = json.loads(path.read_text(encoding="utf-8")) if path and path.is_file() else {}
    sizes = {name: said.get(name, default) for name, default in SIZES.items()}
    if sizes["img_size"] != SIDE_PX or sizes["patch_size"] != PATCH_PX:
        raise Refused(
            "the weights are of a network of another input",
            found=f"img_size {sizes['img_size']}, patch_size {sizes['patch_size']} in config.json",
            expected=f"img_size {SIDE_PX}, patch_size {PATCH_PX}",
            next_step="give the weights of facebook/VGGT-1B",
        )
    return sizes


def read_weights(paths: tuple[Path, ...]) -> dict[str, torch.Tensor]:
    """All parameters of the files: .safetensors, or PyTorch's of which only tensors are read."""
    from safetensors.torch import load_file

    tensors: dict[str, torch.Tensor] = {}
    for path in paths:
        try:
            if path.suffix == ".safetensors":
                tensors |= load_file(path)
            else:
                tensors |= _tensors(torch.load(path, map_location="cpu", weights_only=True))
        except Exception as error:  # the formats' errors have no common class
            if is_out_of_memory(error):
                raise
            raise Refused(
                "the weights cannot be read",
                found=f"{path.name}: {' '.join(f'{type(error).__name__}: {error}'.split())[:200]}",
                expected="a .safetensors file, or a .pt of tensors by their names",
                next_step="download the file again",
            ) from error
    return tensors


def _tensors(found: Any) -> dict[str, torch.Tensor]:
    if not isinstance(found, Mapping) or not all(torch.is_tensor(v) for v in found.values()):
        raise ValueError(f"{type(found).__name__} that is not of tensors alone")
    return dict(found)


def load_weights(network: Any, weights: Mapping[str, torch.Tensor], *, depth: bool) -> None:
    """Put a checkpoint into the network: every key of one is a key of the other, or Refused."""
    unused = _UNUSED if depth else (*_UNUSED, "depth_head.")
    own = {key: value for key, value in weights.items() if not key.startswith(unused)}
    expected = network.state_dict()
    missing, unknown = sorted(expected.keys() - own.keys()), sorted(own.keys() - expected.keys())
    if missing or unknown:
        found = f"{len(missing)} keys are missing ({', '.join(missing[:3]) or 'none'}), "
        found += f"{len(unknown)} unknown ({', '.join(unknown[:3]) or 'none'})"
        raise _wrong(found, "exactly the keys of this network")
    for key, value in own.items():
        if value.shape != expected[key].shape:
            found = f"{key} of shape {tuple(value.shape)}"
            raise _wrong(found, f"shape {tuple(expected[key].shape)}")
    network.load_state_dict(own)


@torch.inference_mode()
def predict(
    network: Any, photo: NDArray[np.float32], dtype: torch.dtype
) -> tuple[NDArray[np.float64], NDArray[np.float32] | None, NDArray[np.float32] | None]:
    """(3, 3) intrinsics in pixels of the network's picture; depth and confidence (h, w), or None.

    photo: (3, h, w) in [0, 1]. dtype: float32, or another under autocast, where the package itself
    keeps its heads in float32. The pose is left out: the first view's is the origin by definition.
    """
    from vggt.utils.pose_enc import pose_encoding_to_extri_intri

    parameter = next(network.parameters())
    views = torch.from_numpy(photo)[None, None].to(parameter.device)
    context: Any = contextlib.nullcontext()
    if dtype != torch.float32:
        context = torch.autocast(device_type=parameter.device.type, dtype=dtype)
    with context:
        answer = network(views)
    _, intrinsics = pose_encoding_to_extri_intri(answer["pose_enc"].float(), views.shape[-2:])
    matrix = intrinsics[0, 0].double().cpu().numpy()
    if "depth" not in answer:
        return matrix, None, None
    depth = answer["depth"][0, 0, ..., 0].float().cpu().numpy()
    confidence = answer["depth_conf"][0, 0].float().cpu().numpy()
    if not np.isfinite(depth).all():
        raise ValueError("the network's depth is not finite (with float16, try float32)")
    return matrix, depth, confidence


def package_provenance() -> dict[str, str | None]:
    """{"version", "commit", "sha256"} of the package: the commit where pip installed one by git.

    sha256: of all its Python files by their names, so that an edited checkout is another package.
    """
    import vggt

    found: dict[str, str | None] = {"version": None, "commit": None, "sha256": _sources(vggt)}
    with contextlib.suppress(metadata.PackageNotFoundError):
        installed = metadata.distribution("vggt")
        found["version"] = installed.version
        told = json.loads(installed.read_text("direct_url.json") or "{}")
        found["commit"] = told.get("vcs_info", {}).get("commit_id")
    return found


def is_out_of_memory(error: BaseException) -> bool:
    """Whether an error is a device's or the machine's memory running out, as torch words it."""
    text = str(error).lower()
    return isinstance(error, (MemoryError, torch.OutOfMemoryError)) or (
        isinstance(error, RuntimeError)
        and any(words in text for words in ("out of memory", "can't allocate memory"))
    )


def _sources(package: ModuleType) -> str:
    top = Path(next(iter(package.__path__)))
    digest = hashlib.sha256()
    for path in sorted(top.rglob("*.py"), key=lambda p: p.relative_to(top).as_posix()):
        digest.update(path.relative_to(top).as_posix().encode() + b"\0")
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def _missing(error: ModuleNotFoundError) -> Refused:
    name = (error.name or "").partition(".")[0]
    if name == "vggt" and error.name != "vggt":
        return _another_package(error)
    return Refused(
        f"the package {name} is not installed" + (", which vggt needs" if name != "vggt" else ""),
        found=str(error),
        expected="facebookresearch/vggt, which is on no package index" if name == "vggt" else name,
        next_step=_INSTALL if name == "vggt" else f"pip install {name}",
    )


def _another_package(error: BaseException) -> Refused:
    return Refused(
        "the package vggt is not facebookresearch's, or another version of it",
        found=" ".join(f"{type(error).__name__}: {error}".split())[:240],
        expected="vggt.models.vggt.VGGT(enable_point=...) and vggt.utils.pose_enc",
        next_step=_INSTALL,
    )


def _wrong(found: str, expected: str) -> Refused:
    return Refused(
        "this is no checkpoint of VGGT",
        found=found,
        expected=expected,
        next_step="give facebook/VGGT-1B, its folder, or its model.pt",
    )
