"""Baselines by their cards: what is found, what is refused, and whether a Python is ready."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import pytest
from baselines.tracks import FAKE, call

from legoworld.baselines import environments
from legoworld.baselines.cards import (
    baseline_cards,
    chosen_options,
    load_baseline,
    read_card,
)
from legoworld.errors import CatalogError, UsageError


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    shutil.copytree(FAKE, tmp_path / "fake")
    return tmp_path / "fake"


def test_every_shipped_card_can_be_used():
    cards = baseline_cards()
    assert [card.name for card in cards] == sorted(card.name for card in cards)
    for card in cards:
        assert card.program.is_file()
        assert chosen_options(card, ()) == {option.key: option.default for option in card.options}
        assert environments.requirements(card).dependencies


def test_list_and_doctor_find_the_same_baselines(capsys):
    call(["list", "baselines", "--json"])
    listed = [entry["name"] for entry in json.loads(capsys.readouterr().out)["baselines"]]
    call(["doctor", "--json"])
    findings = json.loads(capsys.readouterr().out)["findings"]
    named = [f["name"].split()[1] for f in findings if f["name"].startswith("baseline ")]
    assert listed == named == [card.name for card in baseline_cards()]


def test_an_unknown_name_comes_with_the_nearest(monkeypatch, copy):
    monkeypatch.setattr("legoworld.shipped.catalog.folder", lambda _kind: copy.parent)
    with pytest.raises(UsageError, match="'fakes'; expected: fake or a folder"):
        load_baseline("fakes")
    assert load_baseline("fake").name == "fake"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('name = "fake"', 'name = "other"', "its folder's name"),
        ('title = "', 'titel = "', "missing required field title"),
        ('title = "', 'title = ""\n_ = "', r"length >= 1 at \$\.title"),
        ('tasks = ["coco", "lvis", "eth3d"]', 'tasks = ["voc"]', r"'voc' at \$\.tasks\[0\]"),
        ("default = 0\n", "default = [1]\n", r"got array at \$\.options\[\.\.\.\]\.default"),
        ("default = 0\n", "default = 0\nchoices = [0.5]\n", "type 'int', default 0, choices"),
        ("default = 0\n", "", "type 'NoneType'"),
        ("default = 0\n", 'type = "list"\n', "'list'"),
        ('help = "seconds each image takes"', "", "missing required field help"),
        ("schema_version = 1", "schema_version = ", "Invalid value"),
    ],
)
def test_a_wrong_card_says_what_is_wrong(copy, old, new, words):
    path = copy / "card.toml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(CatalogError, match=words):
        read_card(path)


def test_options_take_the_type_of_their_default():
    card = load_baseline(str(FAKE))
    values = chosen_options(card, ["sleep_s=2", "at=7", "how=print"])
    assert values == {"sleep_s": 2.0, "at": 7, "how": "print"}
    assert isinstance(values["sleep_s"], float)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("slep_s=1", "sleep_s="),
        ("at", "at="),
        ("at=1.5", "at=<int>"),
        ("sleep_s=nan", "sleep_s=<float>"),
        ("how=badly", "how=well or how=refuse"),
    ],
)
def test_wrong_options_are_refused_with_the_right_ones(text, words):
    with pytest.raises(UsageError, match=words):
        chosen_options(load_baseline(str(FAKE)), [text])


def test_the_code_hash_follows_code_and_nothing_else(copy):
    before = read_card(copy / "card.toml").code_sha256()
    (copy / "README.md").write_text("words")
    (copy / ".venv").mkdir()
    (copy / ".venv" / "x.py").write_text("pass")
    assert read_card(copy / "card.toml").code_sha256() == before
    (copy / "network.py").write_text("pass")
    assert read_card(copy / "card.toml").code_sha256() != before


def project(folder: Path, *dependencies: str) -> None:
    (folder / "pyproject.toml").write_text(
        f"[project]\nname = 'x'\nversion = '1'\ndependencies = {json.dumps(dependencies)}\n"
    )


def test_what_a_python_lacks(copy):
    project(copy, "numpy>=1", "no-such-thing==1", "click==0.1", "numpy[dev]>=1; python_version>'3'")
    card = read_card(copy / "card.toml")
    lacking = environments.problems(card, Path(sys.executable))
    assert lacking[0] == "no-such-thing is not installed"
    assert lacking[1].startswith("click is ")
    assert lacking[1].endswith("not 0.1")
    assert len(lacking) == 2


def test_a_baseline_without_an_environment_says_how_to_get_one(copy, monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    card = read_card(copy / "card.toml")
    with pytest.raises(UsageError, match="legoworld baseline install fake"):
        environments.chosen_python(card, None)
    # A fresh environment of nothing but the standard library: no network is needed for that.
    assert call(["baseline", "install", f"{copy}"]) == 0
    python = environments.chosen_python(card, None)
    assert python.is_file()
    assert python.is_relative_to(tmp_path / "data")
    assert environments.problems(card, python) == []
    project(copy, "numpy>=1")
    assert environments.problems(card, python) == [
        "numpy is not installed", "installed for other requirements",
    ]  # fmt: skip
    capsys.readouterr()


def test_where_environments_lie_without_a_known_home(copy, monkeypatch, tmp_path):
    def no_home(_name):
        raise RuntimeError("no home")

    card = read_card(copy / "card.toml")
    monkeypatch.setattr("platformdirs.user_data_path", no_home)
    monkeypatch.setattr(environments, "home_folder", lambda: tmp_path)
    folder = tmp_path / ".local" / "share" / "legoworld" / card.shelf / card.name
    assert environments.environment_folder(card) == folder


def test_a_failed_install_is_no_environment(copy, monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    project(copy, "/no/such/wheel-1-py3-none-any.whl")
    assert call(["baseline", "install", f"{copy}"]) == 4
    assert "failed" in capsys.readouterr().err
    assert environments.installed_python(read_card(copy / "card.toml")) is None
