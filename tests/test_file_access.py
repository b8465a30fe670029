"""Modules that handle a folder which a sandboxed program can write to reach it by `Beneath` alone.

Every other file access of theirs is listed here with whose folder it is in: a new one fails until
somebody has thought of that.
"""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import legoworld

PACKAGE = Path(legoworld.__file__).parent

#: Functions and methods that take a path. `resolve` of a root of ours is free.
METHODS = frozenset(
    {
        "open", "read_bytes", "read_text", "write_bytes", "write_text", "unlink", "rename", "mkdir",
        "rmdir", "symlink_to", "touch", "hardlink_to", "iterdir", "glob", "rglob", "walk",
        "is_file", "is_dir", "is_symlink", "exists", "stat", "lstat", "chmod",
    }
)  # fmt: skip
FUNCTIONS = frozenset({"open", "atomic_path", "write_text", "sha256_of_file", "remove_folder"})
MODULES_OF_FILES = frozenset({"os", "shutil"})

BEFORE = "before the program starts"
OURS = "a folder that no program can write to"
#: Opened through no link, and emptied by descriptors.
REMOVED = "remove_folder"

ALLOWED: dict[str, dict[str, str]] = {
    "endpoint/screenshots.py": {},
    "endpoint/session.py": {"copy.unlink": OURS, "copy[0].unlink": OURS},
    "endpoint/workspace_finalisation.py": {
        "output.is_dir": OURS, "output.iterdir": OURS, "output.mkdir": OURS,
    },
    "endpoint/finalisation.py": {
        "(scratch / BLEND).is_file": OURS, "(scratch / name).is_file": OURS,
        "glb.is_file": OURS, "glb.unlink": OURS,
    },
    "endpoint/blender.py": {"os.open": BEFORE, "os.close": BEFORE, "scratch.mkdir": BEFORE},
    "agents/agent_process.py": {
        "(home / name).parent.mkdir": BEFORE, "(home / name).symlink_to": BEFORE,
        "(home_folder() / name).is_file": OURS, "(scratch / 'sandbox').mkdir": BEFORE,
        "order.trial.session.is_dir": BEFORE, "order.trial.session.rename": BEFORE,
        "shutil.copyfile": BEFORE, "shutil.which": OURS, "steps.write_text": BEFORE,
    },
    "agents/unfinished_trial.py": {
        "(folder / _LOCK).open": OURS, "(trial.folder / BEGUN).unlink": OURS,
        "folder.mkdir": OURS, "path.is_dir": OURS, "path.is_symlink": OURS, "path.mkdir": OURS,
        "path.read_bytes": OURS, "path.unlink": OURS, "remove_folder": REMOVED,
        "scenes.mkdir": OURS, "self.folder.iterdir": OURS, "self.scene_folder.iterdir": OURS,
        "trial.mkdir": OURS, "unfinished_folder(scenes, image).is_dir": OURS, "write_text": OURS,
    },
    "agents/handshake.py": {"(output / name).write_text": BEFORE},
    "agents/trial_plugin.py": {
        "path.is_file": OURS, "record.mkdir": OURS, "sha256_of_file": OURS,
    },
    "baselines/child.py": {"target.parent.mkdir": OURS},
    "plugin/live.py": {},
    "plugin/live_copy.py": {"sha256_of_file": OURS},
    "scene/programs/execution.py": {
        "(made / PICTURE).unlink": OURS, "(made / name).is_file": OURS, "made.mkdir": OURS,
        "(output / FROZEN).is_file": OURS, "(output / name).unlink": OURS, "atomic_path": OURS,
        "glb.is_file": OURS, "glb.unlink": OURS, "os.path.exists": "of a name in an error",
        "output.mkdir": OURS, "path.is_file": OURS, "path.read_bytes": OURS,
        "picture.read_bytes": OURS, "picture.write_bytes": OURS, "program.read_bytes": BEFORE,
        "sha256_of_file": OURS, "temporary.write_bytes": OURS, "workspace.mkdir": BEFORE,
        "write_text": OURS, "output.is_dir": OURS, "output.parent.mkdir": OURS,
        "made.is_file": OURS,
    },
    "viewing/app.py": {
        "resources.files('legoworld.viewing').joinpath('page', name).read_text": OURS,
    },
    "viewing/watched.py": {
        "(folder / PICTURE).is_file": OURS,
        "(folder / ROWS).read_bytes": OURS, "(folder / RUN).read_bytes": OURS,
        "os.walk": "follows no link; a workspace is not entered", "path.exists": OURS,
        "path.open": OURS, "path.read_bytes": OURS, "path.stat": OURS,
    },
}  # fmt: skip


def accesses(path: Path) -> set[str]:
    """Every call in a module that opens, makes, moves, removes or looks at a file by its path."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.Call):
            continue
        called = node.func
        if isinstance(called, ast.Name) and called.id in FUNCTIONS:
            found.add(called.id)
        elif isinstance(called, ast.Attribute):
            text = ast.unparse(called)
            of_module = text.split(".")[0] in MODULES_OF_FILES
            if of_module or called.attr in METHODS:
                found.add(text)
    return found


#: Methods of `Beneath`, under the names that modules give it.
BENEATH = ("inside.", "files.", "copy.remove")


@pytest.mark.parametrize("module", ALLOWED)
def test_only_beneath_reaches_a_program_s_folder(module):
    found = {text for text in accesses(PACKAGE / module) if not text.startswith(BENEATH)}
    assert found - set(ALLOWED[module]) - {"os.environ.get"} == set()


def test_every_module_that_has_a_sandbox_is_listed_or_named_here():
    """What starts a sandbox or opens a folder beneath handles such a folder."""
    starts = {
        str(path.relative_to(PACKAGE))
        for path in PACKAGE.rglob("*.py")
        if any(word in path.read_text(encoding="utf-8") for word in (" Sandbox(", "Beneath("))
    }
    # They make an empty folder, or hand over a name alone.
    known = {
        "agents/exposed_paths.py",
        "endpoint/trial_record.py",
        "beneath.py",
        "workers/sandbox.py",
    }
    assert starts - set(ALLOWED) - known == set()
