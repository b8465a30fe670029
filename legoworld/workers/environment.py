"""The allow-list of environment variables that child processes inherit.

A child starts with an empty environment: variables that are not named here do not reach it, so
credentials of the caller (AWS_*, HF_TOKEN, *_KEY, a proxy's password) are not passed on.
"""

from __future__ import annotations

import os
import site
import sysconfig
from collections.abc import Iterable, Mapping
from enum import Enum
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit

from legoworld.files import home_folder

#: Paths of programs and libraries, the locale, the time zone, and numbers of threads.
_EVERY_CHILD: Final = (
    "PATH",
    "LD_LIBRARY_PATH",
    "DYLD_LIBRARY_PATH",
    "DYLD_FALLBACK_LIBRARY_PATH",
    "LANG",
    "LANGUAGE",
    "TZ",
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMEXPR_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "MALLOC_ARENA_MAX",
)
_EVERY_CHILD_PREFIXES: Final = ("LC_",)
#: Selection and settings of accelerators.
_ACCELERATOR: Final = (
    "CUDA_VISIBLE_DEVICES",
    "CUDA_DEVICE_ORDER",
    "CUDA_HOME",
    "CUDA_PATH",
    "CUDA_CACHE_DISABLE",
    "CUDA_LAUNCH_BLOCKING",
    "CUDA_MODULE_LOADING",
    "CUBLAS_WORKSPACE_CONFIG",
    "NVIDIA_VISIBLE_DEVICES",
    "NVIDIA_DRIVER_CAPABILITIES",
    "NVIDIA_TF32_OVERRIDE",
    "ROCR_VISIBLE_DEVICES",
    "HIP_VISIBLE_DEVICES",
    "HSA_OVERRIDE_GFX_VERSION",
    "PYTORCH_ALLOC_CONF",
    "PYTORCH_CUDA_ALLOC_CONF",
    "TOKENIZERS_PARALLELISM",
)
#: Trusted certificates, and settings of weight downloads.
_DOWNLOAD: Final = (
    "SSL_CERT_FILE",
    "SSL_CERT_DIR",
    "REQUESTS_CA_BUNDLE",
    "CURL_CA_BUNDLE",
    "HF_HUB_OFFLINE",
    "TRANSFORMERS_OFFLINE",
    "HF_HUB_DOWNLOAD_TIMEOUT",
    "HF_HUB_DISABLE_PROGRESS_BARS",
    "HF_HUB_DISABLE_SYMLINKS_WARNING",
    "HF_HUB_DISABLE_XET",
    "NO_PROXY",
    "no_proxy",
)
#: Addresses that may contain a user and a password; passed only if they contain neither.
_ADDRESSES: Final = (
    "HTTP_PROXY",
    "HTTPS_PROXY",
    "ALL_PROXY",
    "http_proxy",
    "https_proxy",
    "all_proxy",
    "HF_ENDPOINT",
)


class ChildKind(Enum):
    """The purpose of a child. BLENDER: scenes and scene programs; MODEL: a baseline's process."""

    BLENDER = "blender"
    MODEL = "model"


def child_environment(
    kind: ChildKind,
    *,
    home: Path,
    temporary: Path,
    variables: Iterable[str] = (),
    caller: Mapping[str, str] | None = None,
) -> dict[str, str]:
    """The complete environment of a child, from the allow-list of its kind.

    home, temporary: private folders of the child. declared: names of further variables requested
    from the caller's environment; they override the private folders. caller: os.environ.
    """
    caller = os.environ if caller is None else caller
    environment = {
        "HOME": str(home),
        "XDG_CACHE_HOME": str(home),
        "XDG_CONFIG_HOME": str(home),
        "XDG_DATA_HOME": str(home),
        "TMPDIR": str(temporary),
        "TEMP": str(temporary),
        "TMP": str(temporary),
        "PYTHONFAULTHANDLER": "1",  # a crash in native code names its place
        # Packages installed with `pip --user` lie below the caller's home.
        "PYTHONUSERBASE": _user_base(caller),
    }
    environment |= {name: value for name, value in caller.items() if _is_allowed(kind, name, value)}
    if kind is ChildKind.MODEL:
        environment |= _model_caches(caller)
    environment |= {name: caller[name] for name in variables if name in caller}
    return environment


def blender_environment(*, home: Path, temporary: Path) -> dict[str, str]:
    """The environment of a Python that imports bpy: no user preferences or start-up files."""
    return child_environment(ChildKind.BLENDER, home=home, temporary=temporary) | {
        "PYTHONPATH": python_path(*package_path()),
        "PYTHONHASHSEED": "0",
        "BLENDER_USER_RESOURCES": str(home),
        "BLENDER_USER_CONFIG": str(home),
    }


def passed_names(variables: Iterable[str], caller: Mapping[str, str] | None = None) -> list[str]:
    """Declared names that are set for the caller; a run records the names, never the values."""
    caller = os.environ if caller is None else caller
    return sorted({name for name in variables if name in caller})


def _is_allowed(kind: ChildKind, name: str, value: str) -> bool:
    if name in _EVERY_CHILD or name.startswith(_EVERY_CHILD_PREFIXES):
        return True
    if kind is not ChildKind.MODEL:
        return False
    return name in _ACCELERATOR or name in _DOWNLOAD or (name in _ADDRESSES and _bare(value))


def _bare(address: str) -> bool:
    """Whether an address has neither user nor password; False if it cannot be parsed."""
    try:
        parts = urlsplit(address if "//" in address else f"//{address}")
        return parts.username is None and parts.password is None and not parts.query
    except ValueError:
        return False


def _model_caches(caller: Mapping[str, str]) -> dict[str, str]:
    """The caller's caches of weights and compiled kernels, which the private home lacks.

    The hub's cache folder is passed, not its parent, which also holds the hub's token.
    """
    user = Path(caller.get("HOME") or home_folder())
    cache = Path(caller.get("XDG_CACHE_HOME") or user / ".cache")
    hub_home = Path(caller.get("HF_HOME") or cache / "huggingface")
    kept = {
        "HF_HUB_CACHE": caller.get("HF_HUB_CACHE")
        or caller.get("HUGGINGFACE_HUB_CACHE")
        or str(hub_home / "hub"),
        "TORCH_HOME": caller.get("TORCH_HOME") or str(cache / "torch"),
        "CUDA_CACHE_PATH": caller.get("CUDA_CACHE_PATH") or str(user / ".nv" / "ComputeCache"),
        "TRITON_CACHE_DIR": caller.get("TRITON_CACHE_DIR") or str(user / ".triton" / "cache"),
    }
    return {name: os.path.expanduser(path) for name, path in kept.items()}  # noqa: PTH111


def _user_base(caller: Mapping[str, str]) -> str:
    return caller.get("PYTHONUSERBASE") or site.getuserbase()


def package_path() -> tuple[Path, ...]:
    """The checkout's folder, which a child needs to find legoworld; none where it is installed.

    An installation's site-packages in PYTHONPATH would reach every Python that the child starts: an
    environment of its own then imports our packages instead of its own.
    """
    root = Path(__file__).resolve().parents[2]
    installed = {Path(sysconfig.get_path(name)).resolve() for name in ("purelib", "platlib")}
    return () if root in installed else (root,)


def python_path(*first: Path) -> str:
    """A PYTHONPATH of these folders, then the caller's own entries: bpy may be on them."""
    old = os.environ.get("PYTHONPATH")
    return os.pathsep.join([*map(str, first), *([old] if old else [])])
