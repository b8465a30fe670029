"""The matrix of faults on one small family: perfect against itself, each fault seen where it is."""

from __future__ import annotations

import importlib
import sys

import numpy as np
import pytest
from bench.stage import PROGRAM
from checkout import CHECKOUT

REFERENCE = (
    PROGRAM
    + """
stage()
bpy.data.objects["Red"]["category"] = "chair"
box("Table", 1.2, 0.6, 0.0, 0.6, category="table")
box("Bottle", 0.1, 1.6, 0.0, 0.4, category="bottle")
box("Behind", -0.9, 1.6, 0.5, 0.4, category="couch")
box("Hidden foot", -0.9, 1.6, 0.0, 0.25).parent = bpy.data.objects["Behind"]
save("references/room")
"""
)
PLAN = [
    {"name": "itself", "changes": []},
    {"name": "scale", "changes": [["scale", 0.1]]},
    {"name": "relabel", "changes": [["relabel", 2]]},
    {"name": "hollow", "changes": [["hollow", 1]]},
    {"name": "again", "changes": [["scale", 0.1]]},
    {"name": "right", "changes": [["scale", 0.1], ["relabel", 2]], "oracles": ["labels", "scale"],
     "scale_by": {"room__view_00": 1 / 1.1}},
]  # fmt: skip


@pytest.fixture(scope="module")
def programs():
    """matrix, scores and consistency of benchmarks/matrix."""
    sys.path.insert(0, str(CHECKOUT / "benchmarks" / "matrix"))
    yield [importlib.import_module(name) for name in ("matrix", "scores", "consistency")]
    sys.path.pop(0)


@pytest.fixture(scope="module")
def study(programs, build_scenes, tmp_path_factory):
    """The folder of a study of PLAN, without A."""
    folder = tmp_path_factory.mktemp("matrix")
    build_scenes(REFERENCE, folder)
    matrix = programs[0]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(matrix, "SIZE_WH", (96, 64))
        patch.setattr(matrix, "SAMPLES", 1)
        made = matrix.Study(folder / "study", unrendered=None)
        made.make_truth(folder / "references", [])
        made.ask(PLAN)
    return made


@pytest.mark.blender
def test_itself_is_perfect_and_each_fault_is_seen_where_it_is(study, programs):
    _, scores, consistency = programs
    found = scores.read_scores(study.folder, [entry["name"] for entry in PLAN])
    names = [measure.name for measure in scores.MEASURES]
    best = np.array([0.0 if measure.error else 1.0 for measure in scores.MEASURES])
    asked = np.isfinite(found.values[0])
    left = {name for name, one in zip(names, asked, strict=True) if not one}
    assert left <= {"Cityscapes mIoU", "bench A", "bench S", "lengths"}
    for copy in ("itself", "right"):
        assert found.values[found.of(copy)][asked] == pytest.approx(best[asked], abs=1e-6), copy

    def blind(copy: str) -> set[str]:
        same = np.isclose(found.cases[found.of(copy)], found.cases[0], atol=1e-6)[:, 0]
        return {name for name, one in zip(names, same, strict=True) if one}

    assert {"masks AP", "panoptic PQ", "depth AbsRel", "normals deg"} <= blind("scale")
    assert not {"3D boxes AP", "bench R"} & blind("scale")
    assert {"depth AbsRel", "normals deg", "bench R"} <= blind("relabel")
    assert not {"boxes AP", "panoptic PQ", "VOC mIoU", "relations"} & blind("relabel")
    assert {"depth AbsRel", "masks AP", "bench R"} <= blind("hollow")
    assert "hidden IoU" not in blind("hollow")
    for copy in found.copies:
        for check, row in consistency.consistency(study.folder / "runs" / copy).items():
            assert row["contradict"] == 0, (copy, check)
            assert row["of"] or check == "what is in front is nearer"
    for task in ("boxes3d", "amodal"):
        files = [study.folder / "runs" / c / task / "predictions.json" for c in ("scale", "again")]
        assert files[0].read_bytes() == files[1].read_bytes()
