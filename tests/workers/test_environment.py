"""What a child process sees of the caller's environment: what is named, and nothing else."""

from __future__ import annotations

import os
import sys
import sysconfig
from pathlib import Path

import pytest

import legoworld
from legoworld.baselines.cards import read_card
from legoworld.baselines.child import BaselineProcess
from legoworld.baselines.confinement import confine_baseline
from legoworld.errors import CatalogError
from legoworld.records.baseline_messages import ChildRequest
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.workers.environment import (
    ChildKind,
    blender_environment,
    child_environment,
    package_path,
    passed_names,
)

SECRETS = {
    "AWS_SECRET_ACCESS_KEY": "hidden-1",
    "HF_TOKEN": "hidden-2",
    "OPENAI_API_KEY": "hidden-3",
    "GITHUB_TOKEN": "hidden-4",
    "DATABASE_URL": "postgres://me:hidden-5@host/db",
    "https_proxy": "http://me:hidden-6@proxy:3128",
    "SSH_AUTH_SOCK": "/hidden-7",
    "LEGOWORLD_CACHE": "/hidden-8",
    "HF_HOME": "/models/hidden-token-lies-here",
}


@pytest.mark.parametrize("kind", ChildKind)
def test_no_credential_of_the_caller_reaches_a_child(kind, tmp_path):
    caller = {**SECRETS, "PATH": "/bin", "HOME": "/home/me", "LC_ALL": "C.UTF-8", "TZ": "UTC"}
    got = child_environment(kind, home=tmp_path / "h", temporary=tmp_path / "t", caller=caller)
    assert not set(got) & set(SECRETS)
    assert not any("hidden-" in v for n, v in got.items() if n != "HF_HUB_CACHE")
    assert (got["PATH"], got["LC_ALL"], got["TZ"]) == ("/bin", "C.UTF-8", "UTC")
    assert got["HOME"] == str(tmp_path / "h")
    assert got["TMPDIR"] == str(tmp_path / "t")


def test_a_model_finds_its_accelerator_and_the_caches_it_had(tmp_path):
    caller = {"HOME": "/home/me", "CUDA_VISIBLE_DEVICES": "1", "https_proxy": "http://proxy:3128"}
    folders = {"home": tmp_path, "temporary": tmp_path}
    got = child_environment(ChildKind.MODEL, **folders, caller=caller)
    assert got["CUDA_VISIBLE_DEVICES"] == "1"
    assert got["https_proxy"] == "http://proxy:3128"
    assert got["HF_HUB_CACHE"] == "/home/me/.cache/huggingface/hub"
    moved = {**caller, "HF_HOME": "/models", "TORCH_HOME": "/torch"}
    got = child_environment(ChildKind.MODEL, **folders, caller=moved)
    assert (got["HF_HUB_CACHE"], got["TORCH_HOME"]) == ("/models/hub", "/torch")
    assert "CUDA_VISIBLE_DEVICES" not in child_environment(
        ChildKind.BLENDER, **folders, caller=caller
    )


@pytest.mark.parametrize("address", ["http://me:x@p:1", "me:x@p:1", "http://me@p", "http://[x@p"])
def test_an_address_that_may_hold_a_password_stays_with_the_caller(address, tmp_path):
    caller = {"HTTP_PROXY": address, "HF_ENDPOINT": address}
    got = child_environment(ChildKind.MODEL, home=tmp_path, temporary=tmp_path, caller=caller)
    assert not {"HTTP_PROXY", "HF_ENDPOINT"} & set(got)


def test_what_is_declared_is_passed_and_recorded_by_name(tmp_path):
    caller = {**SECRETS, "HOME": "/home/me"}
    declared = ("HF_TOKEN", "NOT_SET")
    got = child_environment(
        ChildKind.MODEL, home=tmp_path, temporary=tmp_path, variables=declared, caller=caller
    )
    assert got["HF_TOKEN"] == "hidden-2"
    assert "OPENAI_API_KEY" not in got
    assert passed_names(declared, caller) == ["HF_TOKEN"]


def test_a_baselines_process_sees_only_what_its_card_declares(tmp_path, monkeypatch):
    for name, value in SECRETS.items():
        monkeypatch.setenv(name, value)
    folder = tmp_path / "curious"
    folder.mkdir()
    (folder / "run.py").write_text(
        "import json, os, sys\njson.loads(sys.stdin.readline())\n"
        "print(json.dumps({'provenance': dict(os.environ)}), flush=True)\n"
    )
    (folder / "card.toml").write_text(
        'name = "curious"\ntitle = "Looks around"\nversion = "1"\nlicence = "none"\n'
        'tasks = ["coco"]\nvariables = ["HF_TOKEN"]\n'
    )
    card = read_card(folder / "card.toml")
    request = ChildRequest(
        schema_version=1, task="coco", images=(), categories=(), label_map={}, weights="", dtype="",
        device="cpu", batch_size=1, offline=True, options={}, prompts=None, output=str(tmp_path),
    )  # fmt: skip
    with BaselineProcess(
        card, Path(sys.executable), request, print,
        output=tmp_path, confinement=confine_baseline(card, "", "limits", offline=True),
        variables=card.about.variables,
    ) as process:  # fmt: skip
        message = process.next_message(None)
    seen = message.provenance
    assert seen["HF_TOKEN"] == "hidden-2"
    assert not (set(SECRETS) - {"HF_TOKEN"}) & set(seen)
    assert seen["HOME"] != os.environ.get("HOME")
    assert not Path(seen["HOME"]).exists()  # it went with the process


@pytest.mark.blender
@pytest.mark.own_blender
def test_the_reading_worker_does_not_get_the_callers_environment(monkeypatch):
    for name, value in SECRETS.items():
        monkeypatch.setenv(name, value)
    with BlenderProcess(Limits()) as blender:
        blender.request({"kind": "version"})
        pid = blender._process.pid
        seen = Path(f"/proc/{pid}/environ").read_bytes()
    assert b"hidden-" not in seen
    assert b"PYTHONHASHSEED=0" in seen


def test_the_draco_decoder_does_not_get_the_callers_environment(monkeypatch):
    from legoworld.scene.gltf.draco import _environment

    for name, value in SECRETS.items():
        monkeypatch.setenv(name, value)
    assert not any("hidden-" in value for value in _environment().values())


def test_a_card_whose_variables_are_no_names_is_refused(tmp_path):
    folder = tmp_path / "odd"
    folder.mkdir()
    (folder / "run.py").touch()
    (folder / "card.toml").write_text(
        'name = "odd"\ntitle = "t"\nversion = "1"\nlicence = "none"\ntasks = ["coco"]\n'
        "variables = [1]\n"
    )
    with pytest.raises(CatalogError, match=r"expected str, got int at \$\.variables\[0\]"):
        read_card(folder / "card.toml")


def test_no_other_python_of_a_child_finds_the_packages_of_this_installation(tmp_path):
    """mcp-for-blender has an environment of its own, with another mcp than ours."""
    installed = {Path(sysconfig.get_path(name)).resolve() for name in ("purelib", "platlib")}
    there = Path(legoworld.__file__).resolve().parents[1]
    assert package_path() == (() if there in installed else (there,))
    environment = blender_environment(home=tmp_path, temporary=tmp_path)
    given = environment["PYTHONPATH"].split(os.pathsep)
    assert not installed & {Path(entry).resolve() for entry in given if entry}
