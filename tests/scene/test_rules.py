"""Rules about untrusted scene files at their limits; nothing starts Blender."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scene.by_hand import RENDER
from scipy.spatial.transform import Rotation

from legoworld.records.scene_folder import ProgramError, ProgramReport
from legoworld.scene import freeze, pictures, urdf
from legoworld.scene.blender import truncated_output
from legoworld.scene.folder import (
    SceneFolder,
    file_source,
    is_scene_file,
    leaves_scenes,
    outside_name,
    recorded_name,
    scene_at,
)
from legoworld.scene.freeze import FileHash, FrozenFiles
from legoworld.scene.hair import tubes
from legoworld.scene.hair.strands import Strands
from legoworld.scene.pictures import PictureTooLargeError, claimed_size_wh, decoded_picture
from legoworld.scene.programs import report as program_report
from legoworld.scene.programs.verdicts import ended_early, over_limit, signal_name
from legoworld.scene.read_scene import read_scene
from legoworld.scene.snapshot import LARGEST_COORDINATE
from legoworld.workers.protections import SandboxUnavailableError
from legoworld.workers.sandbox import Ending, SandboxLimits

ROBOT = "<robot name='r'>{}</robot>"
LINKS = "".join(f"<link name='{name}'/>" for name in ("base", "door", "knob"))


def joint(name: str, parent: str, child: str, more: str = "", kind: str = "revolute") -> str:
    return (f"<joint name='{name}' type='{kind}'><parent link='{parent}'/>"
            f"<child link='{child}'/>{more}</joint>")  # fmt: skip


def robot(*parts: str) -> urdf.UrdfRobot:
    return urdf.parse_urdf(ROBOT.format("".join(parts)).encode())


def test_joints_stand_one_after_another():
    """The door turns a quarter about z at (1, 0, 0); the knob lies 2 m along the door's own x."""
    quarter = f"<origin xyz='1 0 0' rpy='0 0 {math.pi / 2}'/><limit lower='-1' upper='2'/>"
    found = robot(LINKS, joint("knob", "door", "knob", "<origin xyz='2 0 0'/>", "continuous"),
                  joint("hinge", "base", "door", quarter + "<axis xyz='0 0 1'/>"))  # fmt: skip
    assert found.root == "base"
    knob, hinge = found.joints
    assert (hinge.name, hinge.child, hinge.axis, hinge.lower, hinge.upper) == (
        "hinge", "door", (0, 0, 1), -1, 2,
    )  # fmt: skip
    assert (knob.type, knob.axis, knob.lower, knob.upper) == ("continuous", (1, 0, 0), None, None)
    assert np.array(hinge.root_from_joint) == pytest.approx(
        np.array([[0, -1, 0, 1], [1, 0, 0, 0], [0, 0, 1, 0]]), abs=1e-15
    )
    assert np.array(knob.root_from_joint)[:, 3] == pytest.approx([1, 2, 0])
    fixed = robot(LINKS, joint("weld", "base", "door", kind="fixed"), joint("k", "door", "knob"))
    assert [one.name for one in fixed.joints] == ["k"]


@given(st.tuples(*[st.floats(-7, 7)] * 3))
def test_a_frame_s_roll_pitch_and_yaw_are_about_fixed_axes(rpy):
    turned = f"<origin xyz='1 2 3' rpy='{' '.join(map(repr, rpy))}'/>"
    (found,) = robot("<link name='base'/><link name='door'/>",
                     joint("hinge", "base", "door", turned)).joints  # fmt: skip
    rows = np.array(found.root_from_joint)
    assert rows[:, :3] == pytest.approx(Rotation.from_euler("xyz", rpy).as_matrix(), abs=1e-12)
    assert rows[:, 3].tolist() == [1, 2, 3]


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        (["<link name='a'/>" * 99_999], None),
        (["<link name='a'/>" * 100_000], "more than 100,000 elements or 32 levels"),
        (["<link name='a'/>", "<x>" * 31, "</x>" * 31], None),
        (["<link name='a'/>", "<x>" * 32, "</x>" * 32], "more than 100,000 elements or 32 levels"),
        (["<link name='a'/><link/>"], "a link without name"),
        ([LINKS, joint("j", "base", "sofa")], "joint 'j' without two links"),
        ([LINKS, joint("j", "sofa", "base")], "joint 'j' without two links"),
        ([LINKS, joint("j", "base", "door"), joint("k", "knob", "door")], "moved by two joints"),
        ([LINKS, joint("j", "base", "door")], "2 links that no joint moves"),
        ([LINKS, joint("j", "door", "knob"), joint("k", "knob", "door")], "round in a ring"),
        ([LINKS, joint("j", "base", "door", kind="ball"), joint("k", "door", "knob")], "'ball'"),
        ([LINKS, joint("j", "base", "door", "<axis xyz='0 0 0'/>"), joint("k", "door", "knob")],
         "axis of length 0"),
        ([LINKS, joint("j", "base", "door", "<axis xyz='0 0'/>")], "'0 0' as three numbers"),
        ([LINKS, joint("j", "base", "door", "<limit lower='inf'/>")], "'inf' as a number in limit"),
        ([LINKS, joint("j", "base", "door", "<origin rpy='0 x 0'/>")], "'x' as a number in origin"),
    ],
)  # fmt: skip
def test_what_a_urdf_file_may_hold(parts, said):
    if said is None:
        assert robot(*parts).joints == ()
        return
    with pytest.raises(urdf.UrdfInvalidError) as caught:
        robot(*parts)
    assert said in (caught.value.found or "")


def test_a_urdf_file_of_the_most_bytes_is_read(monkeypatch):
    data = ROBOT.format("<link name='a'/>").encode()
    monkeypatch.setattr(urdf, "LARGEST_BYTES", len(data))
    assert urdf.parse_urdf(data).root == "a"
    with pytest.raises(urdf.UrdfInvalidError, match=f"more than {len(data)} bytes"):
        urdf.parse_urdf(data + b" ")


@pytest.mark.parametrize(
    ("name", "folder", "lone", "leaves"),
    [
        ("wood.png", "den", None, False), ("../wood.png", "den", None, False),
        ("../../wood.png", "den", None, True), ("../../wood.png", "a/den", None, False),
        ("a/../../x", "den", None, True), ("/x", "den", None, True), ("C:\\x", "den", None, True),
        ("outside://ab/x", "den", None, True), ("../x", "den.blend", "den.blend", True),
        ("x", "den.blend", "den.blend", False), ("../x", ".", None, True),
    ],
)  # fmt: skip
def test_what_lies_outside_of_scenes_has_a_name_without_its_path(name, folder, lone, leaves):
    scene = SceneFolder(path=Path("/s") / folder, name=folder, lone=lone)
    assert leaves_scenes(name, scene) is leaves
    found = recorded_name(name, scene)
    if not leaves or name.startswith("outside:"):
        assert found == name
    else:
        assert found == outside_name(name)
        start, digest, own = found.rsplit("/", 2)
        assert (start, len(digest), own) == (
            "outside:/",
            16,
            name.replace("\\", "/").split("/")[-1],
        )


def file_hash(letter: str) -> FileHash:
    return FileHash(sha256=letter * 64, bytes=3)


@pytest.mark.parametrize(
    ("recorded", "now", "said"),
    [
        ("a", "a", None), ("a", "b", ("sha256 " + "b" * 16, "sha256 " + "a" * 16)),
        ("a", None, ("no file", "sha256 " + "a" * 16)),
        (None, "b", ("sha256 " + "b" * 16, "no file")), (None, None, None),
    ],
)  # fmt: skip
def test_a_frozen_file_is_told_with_both_hashes(recorded, now, said):
    files = [{"x.png": file_hash(letter) if letter else None} for letter in (recorded, now)]
    if said is None:
        freeze._refuse_changes(*files)
        return
    with pytest.raises(freeze.SceneChangedError) as caught:
        freeze._refuse_changes(*files)
    assert (caught.value.found, caught.value.expected) == said


def frozen(scene: SceneFolder, listed: dict[str, Any], **more: Any) -> FrozenFiles:
    known = {"artefacts": {}, "frozen": "frozen.json", "warnings": ("w",)} | more
    return FrozenFiles(dependencies=listed, **known)  # type: ignore[arg-type]


def test_files_that_a_frozen_scene_reads_are_those_on_record(tmp_path):
    scene = SceneFolder(path=tmp_path, name="den")
    (tmp_path / "wood.png").write_bytes(b"wood")
    (wood,) = freeze.hash_files(tmp_path, ["wood.png"]).values()
    made = freeze.hashed_dependencies(
        scene, ["wood.png"], frozen(scene, {"wood.png": wood}), read_by="scene.blend"
    )
    assert (made.dependencies, made.warnings) == ({"wood.png": wood}, ("w",))
    with pytest.raises(Exception, match=r"scene\.glb reads files that .*found: wood\.png"):
        freeze.hashed_dependencies(scene, ["wood.png"], frozen(scene, {}), read_by="scene.glb")
    unfrozen = frozen(scene, {}, frozen="at_readout")
    found = freeze.hashed_dependencies(scene, ["wood.png"], unfrozen, read_by="scene.glb")
    assert found.dependencies == {"wood.png": wood}
    far = {"/far/a.png": file_hash("a"), "wood.png": wood}
    for read_by, said in (("scene.blend", 1), ("scene.glb", 0)):
        found = freeze.hashed_dependencies(scene, ["wood.png"], frozen(scene, far), read_by=read_by)
        assert len(found.warnings) == 1 + said
    assert "frozen.json lists a.png, which scene.blend does not read" in str(
        freeze.hashed_dependencies(scene, [], frozen(scene, far), read_by="scene.blend").warnings
    )
    with pytest.raises(freeze.SceneChangedError, match=r"/far/a\.png is not the file"):
        freeze.hashed_dependencies(scene, ["/far/a.png"], frozen(scene, far), read_by="scene.blend")


@pytest.mark.parametrize(
    ("source", "there", "said"),
    [
        ("blend", ["scene.glb"], "holds no scene.blend; found: scene.glb.*--source glb"),
        ("blend", [], "holds no scene.blend; found: nothing.*legoworld execute"),
        ("glb", ["scene.blend"], "holds no scene.glb; found: scene.blend.*--source blend"),
    ],
)
def test_a_scene_without_the_file_that_is_read_says_what_to_do(source, there, said):
    files = FrozenFiles(
        artefacts={name: file_hash("a") for name in there}, dependencies={}, frozen="at_readout",
        warnings=(),
    )  # fmt: skip
    with pytest.raises(Exception, match=said):
        read_scene(SceneFolder(path=Path("x"), name="x"), source=source, blender=None,  # type: ignore[arg-type]
                   cache=None, files=files)  # fmt: skip


@pytest.mark.parametrize(
    ("resolution", "percentage", "size_wh"),
    [((101, 33), 100, (101, 33)), ((101, 33), 50, (50, 16)), ((10, 1), 9, (1, 1)),
     ((1000, 1000), 33, (330, 330))],
)  # fmt: skip
def test_a_picture_s_size_is_rounded_down_and_never_0(resolution, percentage, size_wh):
    settings = replace(RENDER, resolution_x=resolution[0], resolution_y=resolution[1],
                       resolution_percentage=percentage)  # fmt: skip
    assert settings.size_wh == size_wh
    assert float(np.finfo(np.float64).max) > LARGEST_COORDINATE**2


def bmp(width: int, height: int) -> bytes:
    import cv2

    return bytes(cv2.imencode(".bmp", np.zeros((height, width, 3), np.uint8))[1])


def test_a_picture_of_the_most_pixels_is_decoded():
    data = bmp(6, 4)
    assert claimed_size_wh(data) == (6, 4)
    assert decoded_picture(data, most_px=24).shape == (4, 6, 3)  # type: ignore[union-attr]
    with pytest.raises(PictureTooLargeError) as caught:
        decoded_picture(data, most_px=23, name="the photo a")
    assert caught.value.what == "the photo a is too large to be decoded"
    assert caught.value.found == f"6x4 pixels in {len(data)} bytes"
    assert caught.value.expected == "at most 23 pixels"
    assert decoded_picture(b"") is None
    assert decoded_picture(data[:30]) is None
    assert (pictures.MOST_PX, pictures.MOST_PHOTO_PX) == (1 << 25, 1 << 26)


@pytest.mark.parametrize("cut", [0, 1])
@pytest.mark.parametrize(
    ("data", "size_wh"),
    [
        (b"\x89PNG\r\n\x1a\n" + bytes(8) + b"\0\0\0\7\0\0\0\5" + bytes(9), (7, 5)),
        (b"BM" + bytes(12) + (12).to_bytes(4, "little") + b"\7\0\5\0" + bytes(4), (7, 5)),
        (b"BM" + bytes(12) + (40).to_bytes(4, "little") + b"\7\0\0\0\xfb\xff\xff\xff", (7, 5)),
        (b"P5 7 5\n", (7, 5)),
        (b"P6#a\n7#b\n5#c\n"[:-3] + b"\n", (7, 5)),
    ],
)
def test_a_header_that_is_cut_off_claims_nothing(data, size_wh, cut):
    assert claimed_size_wh(data[: len(data) - cut]) == ((0, 0) if cut else size_wh)


@given(st.lists(st.text("ab", max_size=30), max_size=12))
def test_long_output_keeps_both_ends_and_counts_the_middle(texts):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(truncated_output, "_KEPT", 10)
        stream, whole = truncated_output.TruncatedOutput(), "".join(texts)
        assert [stream.write(text) for text in texts] == [len(text) for text in texts]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(truncated_output, "_KEPT", 10)
        found = stream.text()
    assert stream.writable()
    if len(whole) <= 20:
        assert found == whole
        return
    head, said, tail = found.split("\n")
    assert (head, tail) == (whole[:10], whole[-10:])
    assert said == f"... {len(whole) - 20} characters are left out ..."


LIMITS = SandboxLimits(time_s=2.5, memory_bytes=3 << 29, disk_bytes=1 << 31, output_bytes=5 << 20,
                       processes=7)  # fmt: skip
PROGRAM = Path("/p/scene.py")


def ending(code: int | None = None, last: str = "", first: str = "") -> Ending:
    return Ending(code=code, over=None, first_output=first, last_output=last)


@pytest.mark.parametrize(
    ("over", "found"),
    [
        ("memory", "more than 1.5 GiB with the processes it started"),
        ("output", "more than 5 MiB; its last line: built"),
        ("processes", "more than 7 at once"),
        ("disk", "more than 2 GiB, or more files than are counted"),
        ("time", "still running after 2.5 s"),
    ],
)
def test_a_limit_is_told_with_its_figure(over, found):
    for at, first in (("program", ""), (None, f"x\n{program_report.BEGUN}\n")):
        error = over_limit(ending(last="built\n", first=first), over, at, LIMITS, PROGRAM)
        assert error.found == found
        assert all((error.what, error.expected, error.next_step))
    started = over_limit(ending(), over, None, LIMITS, PROGRAM)
    assert (started.what == "the program did not begin") is (over == "time")


@pytest.mark.parametrize(
    ("code", "at", "last", "what", "found"),
    [
        (3, "program", "a\nb", "ended its process", "exit code 3; its last line: b"),
        (0, "export", "", "ended its process", "exit code 0; its last line: no message"),
        (-9, "program", "2 x\n/a/b\nok\n", "crashed in Blender", "SIGKILL; its last line: ok"),
        (-9, "export", "ok", "crashed while its scene was", "SIGKILL; its last line: ok"),
        (1, None, "bwrap: no", "bubblewrap did not start", "bwrap: no"),
        (127, None, "lost", "Blender did not start", "exit code 127; lost"),
    ],
)  # fmt: skip
def test_an_early_end_is_told_by_its_code_and_last_line(code, at, last, what, found):
    error = ended_early(ending(code, last), at, PROGRAM)
    assert what in error.what
    assert error.found == found
    assert all((error.expected, error.next_step))
    assert isinstance(error, SandboxUnavailableError) is (what[0] == "b")
    begun = ended_early(ending(4, "x", f"{program_report.BEGUN}\n"), None, PROGRAM)
    assert begun.found == "exit code 4, and its report is gone; its last line: x"
    assert signal_name(11) == "SIGSEGV"
    assert signal_name(250) == "signal 250"


def test_a_report_has_so_many_warnings_of_one_line_each(tmp_path):
    from legoworld.records.base import canonical

    most = program_report.MOST_WARNINGS
    path = tmp_path / "report.json"
    given = ProgramReport(at="export", ok=True, warnings=tuple(f"a\n{n}" for n in range(most + 1)),
                          skipped=("b\nc",))  # fmt: skip
    path.write_text(canonical(given))
    found = program_report.read_report(path)
    assert (len(found.warnings), found.warnings[-1]) == (most, f"a {most - 1}")
    assert (found.at, found.ok, found.reason, found.error) == ("export", True, None, None)
    assert found.skipped == ("b c",)
    path.write_text(canonical(ProgramReport(at=None)))
    assert program_report.read_report(path) == ProgramReport(at="program")
    path.write_text("{")
    assert program_report.read_report(path) == ProgramReport(at="program")
    assert program_report.read_report(None) == ProgramReport()
    path.write_text(canonical(ProgramReport(at="export", ok=False)))
    assert program_report.read_report(path).reason is not None
    long = ProgramError(type="t" * 400, message="a\n" + "m" * 400, line=3)
    path.write_text(canonical(ProgramReport(at="export", ok=True, error=long)))
    error = program_report.read_report(path).error
    assert (len(error.type), len(error.message), error.line) == (100, 300, 3)
    assert error.message.startswith("a mm")


@pytest.mark.parametrize("radii", [(0.5, 0.5, 0.2), (0.1, 0.4, 0.4), (0.3, 0.3, 0.0)])
def test_a_tube_touches_the_spheres_of_its_points(radii):
    """A cone ends in the circles along which it is tangent to both spheres, each as an octagon
    whose corners lie as far outside of it as its sides lie inside."""
    points = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 1.0], [2.0, 3.0, 1.0]])
    strands = Strands(points=points, radius=np.array(radii), start=np.array([0, 3]))
    vertices, triangles = tubes._cones(strands, 8)
    assert (len(vertices), len(triangles)) == (2 * 2 * 8, 2 * 2 * 8)
    for part, (first, second) in enumerate(((0, 1), (1, 2))):
        way = points[second] - points[first]
        size = np.linalg.norm(way)
        sine = (radii[first] - radii[second]) / size
        for ring, point in zip(
            vertices[16 * part :][:16].reshape(2, 8, 3), (first, second), strict=True
        ):
            away = ring - points[point]
            along = away @ way / size
            assert along == pytest.approx(radii[point] * sine, abs=1e-6)
            corner = np.sqrt(np.einsum("ij,ij->i", away, away) - along**2)
            circle = radii[point] * math.sqrt(1 - sine**2)
            assert corner * (1 + math.cos(math.pi / 8)) / 2 == pytest.approx(circle, abs=1e-6)


def test_a_file_that_is_a_scene_has_its_own_source(tmp_path: Path) -> None:
    """And scene.blend or scene.glb stands for its folder, another name for itself."""
    for name in ("a.BLEND", "b.GLB", "scene.glb", "notes.txt"):
        (tmp_path / name).write_bytes(b"BLENDER")
    assert is_scene_file(tmp_path / "a.BLEND")
    assert not is_scene_file(tmp_path / "notes.txt")
    assert not is_scene_file(tmp_path / "absent.blend")
    assert file_source(tmp_path / "a.BLEND", "glb") == "blend"
    assert file_source(tmp_path / "b.GLB", "blend") == "glb"
    assert file_source(tmp_path, "glb") == "glb"
    folder, source = scene_at(tmp_path / "scene.glb", "blend")
    assert (folder.path, folder.lone, source) == (tmp_path.resolve(), None, "glb")
    folder, source = scene_at(tmp_path / "b.GLB", "blend")
    assert (folder.lone, source) == ("b.GLB", "glb")
