"""A shipped example through the real client: `tests/real/test_plugin.py` has the others."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from endpoint.clients import served
from plugin.guarded import check_scene

from legoworld.plugin.connection import Address, BlenderConnection

pytestmark = pytest.mark.blender

COFFEE = Path(__file__).parents[2] / "examples" / "coffee" / "scene.blend"


def test_the_coffee_example_is_measured_as_offline_and_guarded(tmp_path, blender):
    with served(tmp_path / "endpoint") as endpoint:
        blend = endpoint.workspace / "example.blend"
        shutil.copy(COFFEE, blend)
        (tmp_path / "case").mkdir()
        connection = BlenderConnection(Address(port=endpoint.server.port))
        check_scene(blend, tmp_path / "case", connection, blender)
