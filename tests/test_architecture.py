"""Imports point one way, and only one corner imports bpy."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import legoworld
from legoworld.tasks.shipped import TASKS

ROOT = Path(__file__).parents[1]
PACKAGE = Path(legoworld.__file__).parent

#: From the ground up: a room may import rooms before it, and itself.
ROOMS = [
    (
        "errors",
        "exit_codes",
        "conventions",
        "files",
        "locks",
        "beneath",
        "system_libraries",
        "remote",
        "pluralize",
        "escaping",
        "extras",
        "version",
    ),
    ("shipped",),
    ("tasks",),
    ("tables",),
    ("records",),
    ("cards", "tracks", "depth_files"),
    ("workers",),
    ("scene",),
    ("endpoint", "solids"),
    ("visibility",),
    ("camera_files",),
    ("readouts",),
    ("exports",),
    ("running",),
    ("plugin",),
    ("evaluation",),
    ("track_making",),
    ("bench",),
    ("baselines", "comparison"),
    ("report",),
    ("api",),
    ("trajectories",),
    ("agents",),
    ("viewing",),
    ("commands",),
    ("cli", "__main__"),
]
LEVEL = {name: level for level, names in enumerate(ROOMS) for name in names}
#: A wheel carries the baselines' programs, too: they are no room, and import torch.
FILES = sorted(p for p in PACKAGE.rglob("*.py") if "_catalog" not in p.parts)


@cache
def imported_names(path: Path) -> set[str]:
    """Full names of everything a file imports, inside functions, too."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return found


def room(module: str) -> str:
    return module.split(".")[1]


def test_imports_point_one_way():
    wrong = []
    for path in FILES:
        own = path.relative_to(PACKAGE).with_suffix("").parts[0]
        if own == "__init__":
            continue
        assert own in LEVEL, f"{own} has no place in ROOMS"
        for module in imported_names(path):
            above = LEVEL.get(room(module), 0) if module.startswith("legoworld.") else 0
            if above > LEVEL[own]:
                wrong.append(f"{path.relative_to(PACKAGE)} imports {module}")
    assert wrong == []


#: Lines of Python a room may have: its ceiling, which only falls. Smaller rooms have the last.
MOST_LINES = {
    "agents": 3400,
    "api": 5480,
    "baselines": 5000,
    "bench": 2750,
    "commands": 4700,
    "comparison": 2850,
    "depth_files": 700,
    "endpoint": 1450,
    "evaluation": 17600,
    "exports": 950,
    "plugin": 6950,
    "readouts": 3150,
    "records": 8080,
    "report": 6815,
    "running": 2800,
    "scene": 12250,
    "solids": 550,
    "tasks": 570,
    "track_making": 1050,
    "tracks": 800,
    "trajectories": 2300,
    "viewing": 620,
    "visibility": 2250,
    "workers": 2250,
}
MOST_LINES_OF_SMALL = 450


def test_no_room_outgrows_its_ceiling():
    """What is added to a full room pays by what is taken away in it."""
    lines = dict.fromkeys(LEVEL, 0)
    for path in FILES:
        own = path.relative_to(PACKAGE).with_suffix("").parts[0]
        if own in LEVEL:
            lines[own] += len(path.read_text(encoding="utf-8").splitlines())
    most = {name: MOST_LINES.get(name, MOST_LINES_OF_SMALL) for name in LEVEL}
    assert {name: n for name, n in lines.items() if n > most[name]} == {}
    slack = sum(most[name] - lines[name] for name in MOST_LINES)
    assert slack < 6000, "lower the ceilings of the rooms that became smaller"


def test_no_room_imports_the_package_itself():
    """Its names are those of the API, which stands above: the version is on the ground."""
    found = []
    for path in FILES:
        inside = path.relative_to(PACKAGE)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = {a.name for a in node.names} if isinstance(node, ast.ImportFrom) else set()
            if getattr(node, "module", None) == "legoworld" and names - LEVEL.keys():
                found.append(f"{inside}: {sorted(names - LEVEL.keys())}")
    assert found == []


def test_every_room_is_a_folder_or_module_and_each_of_those_a_room():
    there = {path.relative_to(PACKAGE).with_suffix("").parts[0] for path in FILES}
    assert there - {"__init__"} == set(LEVEL)


def test_the_page_lists_the_rooms_as_they_are():
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    cells = re.findall(r"^\| (`.*?) \| .*\|$", page[: page.index("## The walk")], re.MULTILINE)
    assert [tuple(re.findall(r"`(\w+)`", cell)) for cell in cells] == ROOMS
    below = {
        f"{p.parent.name}/{p.name}" for p in PACKAGE.glob("*/*/") if (p / "__init__.py").is_file()
    }
    named = set(re.findall(r"`(\w+/\w+)`", page))
    assert below - named == set()


def test_only_the_blender_corner_imports_bpy_and_only_targets_torch():
    for path in FILES:
        tops = {name.split(".")[0] for name in imported_names(path)}
        if path.relative_to(PACKAGE).as_posix() != "api/targets.py":  # where tensors are asked for
            assert "torch" not in tops, path
        if "blender" not in path.relative_to(PACKAGE).parts:
            assert not tops & {"bpy", "mathutils", "bmesh"}, path


def test_the_blender_corner_is_only_named_across_the_process_border():
    for path in FILES:
        if "blender" not in path.relative_to(PACKAGE).parts:
            named = [n for n in imported_names(path) if n.startswith("legoworld.scene.blender.")]
            assert named == [], path


#: Rooms of one line or of values alone, and the tests that hold them.
TESTED_WITH = {
    "exit_codes": "test_cli.py",
    "__main__": "test_cli.py",
    "conventions": "running/test_run_contents.py",
    "system_libraries": "packaging/test_requirements.py",
    "extras": "test_docs.py",
}
#: Folders of tests that are about no room: what they are about is in tests/README.md.
OF_NO_ROOM = {
    "agent_programs", "agreement", "baseline_programs", "cases", "cluster", "outside", "packaging",
    "real",
}  # fmt: skip


def test_every_room_is_tested_under_its_name():
    """legoworld/ROOM in tests/ROOM/ or tests/test_ROOM.py, and no folder has another name."""
    tests = Path(__file__).parent
    folders = {path.parent.relative_to(tests).parts[0] for path in tests.glob("*/**/test_*.py")}
    files = {path.stem.removeprefix("test_") for path in tests.glob("test_*.py")}
    assert folders - set(LEVEL) == OF_NO_ROOM
    assert set(LEVEL) - folders - files == set(TESTED_WITH)
    for name, file in TESTED_WITH.items():
        assert name in (tests / file).read_text(encoding="utf-8"), file
    readme = (tests / "README.md").read_text(encoding="utf-8")
    assert [name for name in OF_NO_ROOM if f"`{name}`" not in readme] == []


#: Also in the programs that tests hold as text.
IMPORT_OF_TESTS = re.compile(r"^\s*(?:from (?:\w+\.)*test_\w+ import|import .*\btest_\w+)", re.M)


def test_tests_import_helpers_and_no_other_test_module():
    """What two test files need has a file of its own, so that either may move or go."""
    folder = Path(__file__).parent
    found = {
        str(path.relative_to(folder)): line.strip()
        for path in folder.rglob("*.py")
        for line in IMPORT_OF_TESTS.findall(path.read_text(encoding="utf-8"))
    }
    assert found == {}


#: What the `cluster` extra brings; `make test` leaves its tests out, and must pass without it.
OF_THE_CLUSTER = re.compile(
    r"^\s*(?:import|from) (?:ray|s3fs|moto)\b|importorskip\(.(?:ray|s3fs|moto)\b", re.M
)


def test_what_only_a_cluster_s_environment_has_is_used_by_its_tests_alone():
    folder = Path(__file__).parent
    users = {p for p in folder.rglob("*.py") if OF_THE_CLUSTER.search(p.read_text("utf-8"))}
    assert len(users) > 3
    for path in users - {folder / "cluster" / "conftest.py"}:
        assert "mark.cluster" in path.read_text(encoding="utf-8"), path


#: Where the name of a task or a family stands as a text all the same, how often and why: a number
#: here only falls.
AT_HOME = {
    "api/coco_export.py": (3, "a file format"),
    "bench": (2, "folders of that name"),
    "cli.py": (1, "the command of that name"),
    "commands/bench_command.py": (1, "the command of that name"),
    "commands/export_command.py": (1, "a file format"),
    "evaluation/detection/lvis_package.py": (1, "the package of that name"),
    "exports/formats.py": (4, "a file format"),
    "records/bench_dataset.py": (2, "a file's own word for what it is"),
    "records/bench_results.py": (1, "a judge's word for what is judged"),
    "records/folders/evaluation_folder.py": (1, "packages"),
    "records/formats.py": (1, "a name of a file format"),
    "records/second_card.py": (1, "a file's own word for what it is"),
    "report/page_file.py": (1, "a key of the page"),
    "report/provenance.py": (1, "packages"),
}


#: Words of the field as well: quantities of arrays, kinds of masks, and folders that hold them.
A_WORD = {"amodal", "depth", "normals"}


def test_no_room_but_its_own_names_a_task_or_a_family():
    """A task is asked of the registry, and a family of its task."""
    names = {task.name for task in TASKS} | {task.dataset.name for task in TASKS}
    names |= {task.family.name for task in TASKS}
    names -= A_WORD
    found: dict[str, list[str]] = {}
    for path in FILES:
        inside = path.relative_to(PACKAGE)
        home = inside.parts[0] if inside.parts[0] in AT_HOME else str(inside)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and node.value in names:
                found.setdefault(home, []).append(f"{inside}:{node.lineno}: {node.value!r}")
    del found["tasks/shipped.py"]  # the table itself
    allowed = {home: n for home, (n, _) in AT_HOME.items()}
    assert {home: len(places) for home, places in found.items()} == allowed, found


#: Modules that are about a dataset or a file format, not about a family.
OF_A_DATASET = {
    "evaluation/depth/eth3d.py": "its layout",
    "track_making/eth3d.py": "its layout",
    "api/bench.py": "of the bench's own room",
    "api/coco_export.py": "a file format",
    "records/coco_file.py": "a file format",
    "evaluation/detection/lvis_package.py": "the package of that name",
    "records/bench_dataset.py": "the dataset's files",
    "records/bench_results.py": "of the bench's own room",
}


def test_modules_about_a_family_have_its_name_and_not_a_dataset_s():
    datasets = {task.dataset.name for task in TASKS}
    found = {
        str(inside)
        for inside in (path.relative_to(PACKAGE) for path in FILES)
        if inside.parts[0] not in ("bench", "commands")  # a room, and commands, of that name
        and datasets & {word for part in inside.with_suffix("").parts for word in part.split("_")}
    }
    assert found == OF_A_DATASET.keys()


def test_scoring_boxes_loads_nothing_of_other_families():
    program = (
        "import sys\n"
        "from legoworld.tasks.registry import find_family\n"
        "for storey in ('records', 'evaluation', 'comparison'):\n"
        "    find_family('coco').load(storey, object)\n"
        "print(*sorted(m for m in sys.modules if m.startswith('legoworld.')))\n"
    )
    ran = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    loaded = {name for name in ran.stdout.split() if re.search("depth|reconstruction", name)}
    assert loaded == set()
