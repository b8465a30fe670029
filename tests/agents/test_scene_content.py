"""What a trial's scene holds for its task, and the sentence that says so."""

from __future__ import annotations

from contextlib import closing

import pytest

from legoworld.agents.scene_content import content_sentence, scene_content
from legoworld.readouts.family import protocol
from legoworld.records.agents import SceneContent
from legoworld.scene.blender_process import BlenderProcess, Limits
from legoworld.scene.folder import SceneFolder

SCENES = """
def save(name):
    (OUT / name).mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(OUT / name / "scene.blend"))

fresh(); camera()
quad("Mug", category="Cup"); quad("Other mug", x=3, category="cup")
quad("Thing", y=3, category="gadget"); quad("Wall", z=-1)
save("some")
fresh(); camera().data.type = "ORTHO"
for place in range(3):
    quad(f"Part {place}", x=float(place))
save("none")
fresh(); quad("Mug", category="cup")
save("blind")
"""


@pytest.fixture(scope="module")
def scenes(build_scenes, tmp_path_factory):
    folder = tmp_path_factory.mktemp("contents")
    build_scenes(SCENES, folder)
    return folder


@pytest.fixture(scope="module")
def blender():
    with closing(BlenderProcess(Limits())) as process:
        yield process


@pytest.mark.blender
def test_what_a_readout_would_find_is_counted(scenes, blender):
    def content(name, task):
        return scene_content(
            SceneFolder(path=scenes / name, name=name), protocol(task, None), blender
        )

    assert content("some", "coco") == SceneContent(
        labelled=True,
        objects=4,
        categories={"cup": 2},
        outside_vocabulary={"gadget": 1},
        camera="perspective",
    )
    assert content_sentence(content("none", "coco")) == (
        "0 of 3 objects labelled; orthographic camera"
    )
    assert content_sentence(content("none", "eth3d")) == "3 objects; orthographic camera"
    assert "no camera" in content_sentence(content("blind", "coco"))


def test_long_lists_are_cut_and_counted():
    counts = dict.fromkeys("abcdefg", 1) | {"z": 3}
    content = SceneContent(
        labelled=True,
        objects=12,
        categories=counts,
        outside_vocabulary=counts,
        camera="perspective",
    )
    assert content_sentence(content) == (
        "10 of 12 objects labelled (3 z, 1 a, 1 b, 1 c, 1 d, 3 more kinds); outside the "
        "vocabulary: 'a', 'b', 'c', 'd', 'e' and 3 more; perspective camera"
    )
