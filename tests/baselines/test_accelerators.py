"""Which device and dtype a baseline runs on, and where its torch comes from."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from baselines.tracks import FAKE, call, run_arguments, run_document

from legoworld.baselines import accelerators, environments
from legoworld.baselines.accelerators import Torch, chosen_device, chosen_dtype, inspect_torch
from legoworld.baselines.cards import load_baseline
from legoworld.baselines.environments import Requirements, install_steps
from legoworld.commands.doctor_command import _baseline

#: As much of torch as is asked about.
TORCH = """
__version__ = "9.9.0+cu999"
def __getattr__(name):
    raise AttributeError(name)
class version:
    cuda = "99.9"
class cuda:
    is_available = staticmethod(lambda: {gpus} > 0)
    device_count = staticmethod(lambda: {gpus})
    get_device_name = staticmethod(lambda n: f"GPU {{n}}")
class backends:
    class mps:
        is_available = staticmethod(lambda: False)
"""


@pytest.fixture
def with_torch(tmp_path, monkeypatch):
    """Make this Python see a torch with so many GPUs."""

    def make(gpus: int) -> Path:
        folder = tmp_path / f"{gpus}"  # bytecode of a file that changes within a second is stale
        folder.mkdir()
        (folder / "torch.py").write_text(TORCH.format(gpus=gpus))
        monkeypatch.setenv("PYTHONPATH", str(folder))
        inspect_torch.cache_clear()
        return Path(sys.executable)

    yield make
    inspect_torch.cache_clear()


def test_torch_is_described(with_torch):
    found = inspect_torch(with_torch(2))
    assert found == Torch(
        version="9.9.0+cu999", cuda="99.9", devices=("GPU 0", "GPU 1"), mps=False, error=None
    )
    assert str(found) == "torch 9.9.0+cu999 built for CUDA 99.9, GPU 0, GPU 1"
    assert "no GPU seen" in str(inspect_torch(with_torch(0)))


def test_a_python_without_torch_says_so():
    inspect_torch.cache_clear()
    found = inspect_torch(Path(sys.executable))
    assert found.version is None
    assert "No module named" in str(found)
    assert found.best_device == "cpu"


@pytest.mark.parametrize(("gpus", "device"), [(0, "cpu"), (1, "cuda")])
def test_auto_is_what_torch_sees(with_torch, gpus, device):
    python = with_torch(gpus)
    assert chosen_device("auto", python) == device
    assert chosen_device("cuda:1", python) == "cuda:1"


@pytest.mark.parametrize(
    ("given", "device", "name", "dtype"),
    [
        ("auto", "cuda", "sam3", "bfloat16"),
        ("auto", "cuda:1", "da3", "bfloat16"),
        ("auto", "cuda", "dino", "float32"),
        ("auto", "cpu", "sam3", "float32"),
        ("float16", "cuda", "sam3", "float16"),
    ],
)
def test_auto_is_what_the_original_computes_in(given, device, name, dtype):
    assert chosen_dtype(given, device, load_baseline(name)) == dtype


def test_what_auto_became_is_on_record(with_torch, track, photos, weights, tmp_path):
    with_torch(1)
    arguments = run_arguments(
        track, photos, weights, tmp_path / "run", "--device", "auto", "--dtype", "auto"
    )
    assert call(arguments) == 0
    configuration = run_document(tmp_path / "run")["configuration"]
    assert (configuration["device"], configuration["dtype"]) == ("cuda", "float32")


def test_doctor_names_the_build(with_torch, monkeypatch):
    python = with_torch(1)
    monkeypatch.setattr(environments, "problems", lambda _card, _python: [])
    found = _baseline(load_baseline("dino"), python).found
    assert "ready" in found
    assert "torch 9.9.0+cu999 built for CUDA 99.9, GPU 0" in found
    assert "torch" not in _baseline(load_baseline(str(FAKE)), python).found


def test_torch_comes_from_its_own_index_and_the_rest_does_not():
    needed = Requirements(dependencies=("torch==2.13.0", "numpy>=1"), no_deps=("alone==1",))
    steps = install_steps(needed, torch_index="https://index", extra=["torchvision==0.28.0"])
    assert steps == [
        (["--no-deps", "--index-url", "https://index"], ["torch==2.13.0", "torchvision==0.28.0"]),
        ([], ["torch==2.13.0", "numpy>=1", "torchvision==0.28.0"]),
        (["--no-deps"], ["alone==1"]),
    ]
    assert install_steps(needed, torch_index=None, extra=[]) == [
        ([], ["torch==2.13.0", "numpy>=1"]),
        (["--no-deps"], ["alone==1"]),
    ]


def test_uv_compiles_what_it_installs(monkeypatch, tmp_path):
    """Without it every start of a baseline compiles torch and transformers anew."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    commands: list[list[str]] = []
    monkeypatch.setattr(environments.shutil, "which", lambda _name: "/bin/uv")
    monkeypatch.setattr(environments, "_run", lambda command: commands.append(command) or "")
    environments.install(load_baseline("dino"), lambda _text: None)
    assert [c[1] for c in commands] == ["venv", "pip"]
    assert "--compile-bytecode" in commands[1]


@pytest.mark.parametrize("uv", ["/bin/uv", None])
def test_what_is_installed_into_a_new_environment(monkeypatch, tmp_path, uv):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    commands: list[list[str]] = []
    monkeypatch.setattr(environments.shutil, "which", lambda _name: uv)
    monkeypatch.setattr(environments, "_run", lambda command: commands.append(command) or "")
    card = load_baseline("dino")
    folder = environments.environment_folder(card)
    folder.mkdir(parents=True)
    (folder / "stale").touch()
    said: list[str] = []
    python = environments.install(card, said.append, torch_index="https://index", extra=["more==1"])
    assert python == folder / "bin" / "python"
    assert sorted(p.name for p in folder.iterdir()) == [environments._STAMP]
    needed = environments.requirements(card)
    assert (folder / environments._STAMP).read_text() == needed.sha256 + "\n"
    make, *installs = commands
    if uv:
        assert make == [uv, "venv", "--quiet", "--python", sys.executable, str(folder)]
        pip = [uv, "pip", "install", "--quiet", "--compile-bytecode", "--python", str(python)]
    else:
        assert make == [sys.executable, "-m", "venv", str(folder)]
        pip = [str(python), "-m", "pip", "install", "--quiet"]
    steps = install_steps(needed, torch_index="https://index", extra=["more==1"])
    assert installs == [[*pip, *arguments, *packages] for arguments, packages in steps]
    assert said == [
        f"making {folder} with {'uv' if uv else 'venv and pip'}",
        *("installing " + ", ".join(packages) for _, packages in steps),
    ]


def test_a_label_map_that_would_change_nothing_is_refused(track, photos, weights, tmp_path, capsys):
    (tmp_path / "map.json").write_text(json.dumps({"hound": "dog"}))
    arguments = run_arguments(
        track, photos, weights, tmp_path / "run", "--label-map", str(tmp_path / "map.json")
    )
    arguments[2] = "dino"
    assert call(arguments) == 2
    assert "matches no labels by name" in capsys.readouterr().err
    arguments[2] = str(FAKE)
    assert call(arguments) == 0


def test_sam3_needs_torch():
    assert accelerators.needs_torch(load_baseline("sam3"))
