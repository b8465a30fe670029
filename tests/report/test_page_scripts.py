"""The page's scripts: assembled in one order, typed by the records, three.js as published."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from checkout import CHECKOUT

from legoworld.errors import LegoWorldError
from legoworld.report import page_script as assembly
from legoworld.report.page_file import SCRIPTS, THREE
from legoworld.report.page_script import page_script

#: Where npm puts tsc and esbuild.
TOOLS = CHECKOUT / "tools" / "page"


def npm_tool(name: str) -> Path:
    """A program of tools/page, or a skip that says how to get it."""
    path = TOOLS / "node_modules" / ".bin" / name
    if not path.exists() or shutil.which("node") is None:
        pytest.skip(f"{name} is not installed: it needs node; run npm ci in tools/page")
    return path


def test_every_module_is_in_the_script_once() -> None:
    script = page_script()
    assert not re.search(r"^\s*(import|export)\b", script, re.MULTILINE)
    modules = {p for p in SCRIPTS.glob("*.js") if p.name != THREE}
    for path in modules:
        body = path.read_text(encoding="utf-8").splitlines()[-2]
        assert body in script, path.name
    names = re.findall(r"^(?:async )?(?:function|const|let|class) (\w+)", script, re.MULTILINE)
    assert len(names) == len(set(names)), "one scope, one thing to a name"


def test_a_circle_and_an_unknown_form_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(assembly, "SCRIPTS", tmp_path)
    (tmp_path / "main.js").write_text('import { a } from "./a.js";\na();\n')
    (tmp_path / "a.js").write_text('import { b } from "./main.js";\nexport function a() {}\n')
    page_script.cache_clear()
    with pytest.raises(LegoWorldError, match=r"main\.js -> a\.js -> main\.js"):
        page_script()
    (tmp_path / "a.js").write_text("export default function a() {}\n")
    with pytest.raises(LegoWorldError, match="not understood"):
        page_script()
    page_script.cache_clear()


def test_nothing_in_it_makes_code_of_text_or_asks_a_network() -> None:
    own = page_script()
    three = (SCRIPTS / THREE).read_text(encoding="utf-8")
    for text in (own, three):
        assert not re.search(r"\beval\s*\(|new Function\b|importScripts|</script|<!--", text)
    assert not re.search(r"\bfetch\s*\(|XMLHttpRequest|WebSocket|sendBeacon|innerHTML", own)


def test_the_scripts_fit_the_records(tmp_path: Path) -> None:
    tsc = npm_tool("tsc")
    types = tmp_path / "records.d.ts"
    subprocess.run(
        [sys.executable, str(CHECKOUT / "docs" / "page_types.py"), str(types)], check=True
    )
    project = {
        "extends": str(TOOLS / "tsconfig.json"),
        "files": [str(types)],
        "include": [str(SCRIPTS / "*.js")],
        "exclude": [str(SCRIPTS / THREE)],
    }
    (tmp_path / "tsconfig.json").write_text(json.dumps(project))
    done = subprocess.run([tsc, "-p", str(tmp_path)], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-3000:]
    types.write_text(types.read_text().replace("interface PageData {", "interface Unknown {"))
    done = subprocess.run([tsc, "-p", str(tmp_path)], capture_output=True, text=True)
    assert "PageData" in done.stdout


def test_three_js_is_what_npm_has_of_the_pinned_version(tmp_path: Path) -> None:
    npm_tool("esbuild")
    made = tmp_path / THREE
    subprocess.run(["node", str(TOOLS / "build.mjs"), str(made)], check=True)
    assert made.read_bytes() == (SCRIPTS / THREE).read_bytes(), "run make page-three"
    licence = TOOLS / "node_modules" / "three" / "LICENSE"
    assert licence.read_bytes() == (SCRIPTS / "three.LICENSE.txt").read_bytes()


def test_three_js_says_its_version_and_licence() -> None:
    pinned = re.search(r'"three": "([\d.]+)"', (TOOLS / "package.json").read_text())
    assert pinned is not None
    first = (SCRIPTS / THREE).read_text(encoding="utf-8").split("\n", 1)[0]
    assert first.startswith(f"/* three.js {pinned[1]}, MIT licence, Copyright")
    assert "The MIT License" in (SCRIPTS / "three.LICENSE.txt").read_text(encoding="utf-8")
