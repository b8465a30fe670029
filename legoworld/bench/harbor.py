"""`legoworld bench export --harbor`: each case as a task folder that Harbor runs."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from legoworld.errors import UsageError
from legoworld.evaluation.reconstruction.dataset import BenchCase, BenchDataset
from legoworld.files import sha256_of_text, write_text
from legoworld.records.base import readable
from legoworld.records.bench_dataset import BenchImage, BenchTrackFile, BenchTruthFile
from legoworld.version import __version__

#: Of task.toml; the version that Harbor reads today.
_SCHEMA: Final = "1.4"
#: Where the agent leaves its scene, inside the container.
_WORKSPACE: Final = "/workspace"
#: What the verifier finalises: the workspace, and the scenes that `blender mcp` has kept.
_ARTIFACTS: Final = (_WORKSPACE, f"{_WORKSPACE}.trajectory")


@dataclass(frozen=True, kw_only=True)
class HarborOptions:
    """Machine settings of every task. Both images have legoworld and bpy.

    prebuilt: an image that agent and verifier run as it is, in place of two that are built; it is
    one that can be pulled, and `legoworld agent install` ran in it.
    """

    prebuilt: str | None = None
    agent_image: str = "legoworld:latest"
    verifier_image: str = "legoworld:latest"
    agent_timeout_s: float = 3600
    verifier_timeout_s: float = 900
    cpus: int = 2
    memory_mb: int = 8192


def export_harbor(dataset: BenchDataset, output: Path, options: HarborOptions) -> list[Path]:
    """Write one task folder a case; their paths, sorted.

    What the agent's container is built from (environment/) holds the public half of the case
    alone. The private half of this one case lies in tests/, which a separate verifier gets.
    Raises UsageError where the output is not empty.
    """
    if output.is_dir() and any(output.iterdir()):
        raise UsageError(
            "the output folder is not empty",
            found=", ".join(sorted(p.name for p in output.iterdir())[:5]),
            expected="an empty folder",
            next_step="choose another -o",
        )
    tasks = []
    for case in sorted(dataset.cases.values(), key=lambda one: one.file_name):
        task = output / case.stem.replace("/", "-")
        _write_task(task, case, dataset, options)
        tasks.append(task)
    return tasks


def _write_task(task: Path, case: BenchCase, dataset: BenchDataset, options: HarborOptions) -> None:
    categories = [c.name for c in _track(dataset).categories]
    write_text(task / "instruction.md", instruction(case.image, categories))
    write_text(task / "task.toml", _task_toml(case.image, options))
    if options.prebuilt is None:
        write_text(task / "environment" / "Dockerfile", _agent_dockerfile(options))
        write_text(task / "tests" / "Dockerfile", _verifier_dockerfile(options))
    _copy(dataset.folders.reference(case), task / "environment" / "image.png")
    test = task / "tests" / "test.sh"
    write_text(test, _TEST.format(workspace=_WORKSPACE, stem=case.stem))
    test.chmod(0o755)
    _write_case(task / "tests" / "bench", case, dataset)


def instruction(image: BenchImage, categories: Sequence[str]) -> str:
    """The agent's instructions: picture, size, field of view and categories."""
    return _INSTRUCTION.format(
        width=image.width,
        height=image.height,
        hfov=image.hfov_deg,
        categories=", ".join(categories),
        workspace=_WORKSPACE,
    )


def _track(dataset: BenchDataset) -> BenchTrackFile:
    from legoworld.records.base import decode

    return decode(BenchTrackFile, dataset.folders.track.read_bytes())


def _write_case(folder: Path, case: BenchCase, dataset: BenchDataset) -> None:
    """Write a one-case dataset: both halves, with matching hashes."""
    whole = _track(dataset)
    track = BenchTrackFile(info=whole.info, images=(case.image,), categories=whole.categories)
    truth = dataset.truth
    one = BenchTruthFile(
        schema_version=truth.schema_version,
        task=truth.task,
        card_version=truth.card_version,
        track_sha256=sha256_of_text(readable(track)),
        point_cap=truth.point_cap,
        card=truth.card,
        images={str(case.image.id): case.truth},
    )
    write_text(folder / "public" / "track.json", readable(track))
    write_text(folder / "private" / "truth.json", readable(one))
    _copy(dataset.folders.reference(case), folder / "public" / "images" / case.file_name)
    for kind in ("depth", "instances", "raster"):
        source = dataset.folders.arrays(kind, case)
        if source.is_file():
            _copy(source, folder / "private" / kind / f"{case.stem}.npz")


def _copy(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(source, target)


def _task_toml(image: BenchImage, options: HarborOptions) -> str:
    tags = [image.family, image.tier, image.environment, image.theme, image.split]
    named = ", ".join(f'"{tag}"' for tag in tags if tag)
    artifacts = ", ".join(f'"{place}"' for place in _ARTIFACTS)
    machine = f"cpus = {options.cpus}\nmemory_mb = {options.memory_mb}\n"
    # Without a Dockerfile environment/ goes into workdir, and the verifier gets tests/ in a fresh
    # container of the same image.
    runs, verifier = "", f"\n[verifier.environment]\n{machine}"
    if options.prebuilt is not None:
        runs, verifier = f'docker_image = "{options.prebuilt}"\nworkdir = "{_WORKSPACE}"\n', ""
    return f"""schema_version = "{_SCHEMA}"
artifacts = [{artifacts}]

[task]
name = "legoworld/{Path(str(image.file_name)).stem.replace("/", "-")}"
description = "Rebuild the scene of one picture in Blender"
keywords = [{named}]

[metadata]
benchmark = "lego-bench"
legoworld = "{__version__}"

[agent]
timeout_sec = {options.agent_timeout_s:.1f}

[environment]
{runs}{machine}
[[environment.mcp_servers]]
name = "blender"
transport = "stdio"
command = "legoworld"
args = ["blender", "mcp", "--workspace", "{_WORKSPACE}"]

[verifier]
timeout_sec = {options.verifier_timeout_s:.1f}
environment_mode = "separate"
{verifier}"""


def _agent_dockerfile(options: HarborOptions) -> str:
    return f"""FROM {options.agent_image}
RUN legoworld agent install
WORKDIR {_WORKSPACE}
COPY image.png {_WORKSPACE}/image.png
"""


def _verifier_dockerfile(options: HarborOptions) -> str:
    return f"""FROM {options.verifier_image}
COPY . /tests
"""


_INSTRUCTION: Final = """# Rebuild the scene

`image.png` in {workspace} is a picture of {width} x {height} pixels. Its horizontal field of view
is {hfov:.6f} degrees, its pixels are square, and its principal point is in the middle.

Build the scene it shows in Blender, in metres, with real geometry, materials and lights, and one
active camera at the place the picture was taken from. The tools of the MCP server `blender` drive a
Blender without a display, which writes to {workspace} alone.

Save the scene as `{workspace}/scene.blend`; save early, and again. What is saved there when you
end, or your time is over, is exported and scored; without it, the open scene as your last call
left it.

The scene is compared with the one behind the picture: its visible surface point by point, in the
camera's frame and in metres, and a render of it pixel by pixel. Nothing is aligned before. Do not
show the picture itself on a surface, in the world or in the compositor.

Things that may be in the picture: {categories}.
"""

_TEST: Final = """#!/bin/sh
# Scores what the agent left and writes /logs/verifier/reward.json. Nothing left is a reward of 0;
# a scoring that failed is exit code 5 and no reward, which Harbor reports as the verifier's error.
set -u
mkdir -p /logs/verifier /tmp/submissions {workspace}
legoworld blender finalise {workspace} -o /tmp/submissions/{stem}
tests=$(cd "$(dirname "$0")" && pwd)
legoworld readout /tmp/submissions --task bench --track "$tests/bench/public/track.json" \\
  -o /tmp/run --no-cache -q
legoworld evaluate /tmp/run --truth "$tests/bench/private" -o /tmp/evaluation --draws 1
legoworld bench reward /tmp/evaluation --overwrite -o /logs/verifier/reward.json
"""
