"""Write the bill of materials of a wheel beside it: CycloneDX JSON without time or serial number.

    python tools/sbom.py --lock constraints/python-3.11.txt --wheel dist/legoworld-...whl

Components: the locked packages, by cyclonedx-bom; and three.js, which the report page carries.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
BUNDLE = ROOT / "legoworld" / "report" / "page" / "three.bundle.js"


def three_js() -> dict[str, object]:
    """The bundled three.js: its version from the page's lock, and the bundle's hash."""
    lock = json.loads((ROOT / "tools" / "page" / "package-lock.json").read_text(encoding="utf-8"))
    version = lock["packages"]["node_modules/three"]["version"]
    digest = hashlib.sha256(BUNDLE.read_bytes()).hexdigest()
    return {
        "bom-ref": f"three=={version}",
        "type": "library",
        "name": "three",
        "version": version,
        "purl": f"pkg:npm/three@{version}",
        "licenses": [{"license": {"id": "MIT"}}],
        "hashes": [{"alg": "SHA-256", "content": digest}],
        "description": "bundled in legoworld/report/page/three.bundle.js",
    }


def bill(lock: Path, wheel: Path) -> dict[str, object]:
    """The document; the wheel itself is its subject."""
    done = subprocess.run(
        [sys.executable, "-m", "cyclonedx_py", "requirements", "--output-reproducible", str(lock)],
        capture_output=True,
        text=True,
        check=True,
    )
    document = json.loads(done.stdout)
    (version,) = re.findall(r"legoworld-([^-]+)-", wheel.name)
    document["metadata"]["component"] = {
        "bom-ref": "legoworld",
        "type": "application",
        "name": "legoworld",
        "version": version,
        "hashes": [{"alg": "SHA-256", "content": hashlib.sha256(wheel.read_bytes()).hexdigest()}],
    }
    document["components"] = [*document["components"], three_js()]
    return document


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lock", type=Path, required=True)
    parser.add_argument("--wheel", type=Path, required=True)
    given = parser.parse_args()
    text = json.dumps(bill(given.lock, given.wheel), indent=1, sort_keys=True) + "\n"
    given.wheel.with_suffix(".cdx.json").write_text(text, encoding="utf-8")
