"""BOP's pose errors and recall, on folders that are written here and by a view."""

import json
import math

import cv2
import numpy as np
import pytest
from evaluation.solids import about_y
from exports.made_views import made_view
from readouts.level_view import CUBE, FACES, about_z

from legoworld import cli
from legoworld.evaluation.pose.errors import (
    Model,
    Photo,
    drawn_depth,
    mspd,
    mssd,
    symmetries,
    vsd,
)
from legoworld.evaluation.pose.folder import BopFolder, PoseInputError, read_ply, read_results
from legoworld.evaluation.pose.score import TAUS, _count_hits, score_poses
from legoworld.exports.bop import write_views

K = np.array([[100.0, 0, 31.5], [0, 100, 23.5], [0, 0, 1]])
CUBE_MM = (CUBE * 100).astype(np.float32)


def model(**more):
    return Model(
        vertices=CUBE_MM,
        triangles=FACES,
        diameter=100 * math.sqrt(3),
        symmetries=symmetries(more),
    )


def pose(x=0.0, y=0.0, z=500.0, turn=None):
    return np.column_stack([np.eye(3) if turn is None else turn, [x, y, z]])


def photo(depth=None):
    return Photo(intrinsics=K, depth_mm=np.zeros((48, 64)) if depth is None else depth)


def test_a_moved_object_is_off_by_its_motion():
    assert mssd(model(), pose(), pose()) == 0
    assert mssd(model(), pose(x=3, z=504), pose()) == pytest.approx(5)
    # The nearest corners, 450 mm away, move most in the picture.
    assert mspd(model(), pose(x=9), pose(), photo()) == pytest.approx(100 * 9 / 450)


@pytest.mark.parametrize(
    "info",
    [
        {
            "symmetries_discrete": [
                [*r, 0, 0, 0, 0, 1] for r in [[0, 0, 1, 0, 0, 1, 0, 0, -1, 0, 0]]
            ]
        },
        {"symmetries_continuous": [{"axis": [0, 1, 0], "offset": [0, 0, 0]}]},
        {"symmetries_continuous": [{"axis": [0, -3, 0], "offset": [0, 7, 0]}]},
    ],
)
def test_a_symmetric_object_turned_into_itself_is_not_off(info):
    turned = pose(turn=about_y(90))
    assert mssd(model(), turned, pose()) == pytest.approx(100)
    assert mssd(model(**info), turned, pose()) == pytest.approx(0, abs=0.6)
    assert mspd(model(**info), turned, pose(), photo()) == pytest.approx(0, abs=0.2)


def plain_vsd(mine, theirs, measured, diameter, tau, delta=15.0):
    """Over all pixels, one at a time; distances from the camera's centre."""
    union = wrong = 0
    for v in range(48):
        for u in range(64):
            ray = math.sqrt(((u - 31.5) / 100) ** 2 + ((v - 23.5) / 100) ** 2 + 1)
            d, e, g = (float(a[v, u]) * ray for a in (measured, mine, theirs))
            in_g = g > 0 and (d == 0 or g - d <= delta)
            in_e = e > 0 and (d == 0 or e - d <= delta or in_g)
            union += in_g or in_e
            wrong += (in_g != in_e) or (in_g and in_e and abs(e - g) / diameter >= tau)
    return wrong / union if union else 1.0


@pytest.mark.parametrize(
    "estimate",
    [pose(), pose(x=30), pose(z=520), pose(x=-10, z=530, turn=about_y(40)), pose(x=4000)],
)
def test_visible_surface_discrepancy_is_that_of_plain_python(estimate):
    one = model()
    scene = drawn_depth(one, pose(), photo())
    scene[:, :28] = 300  # something in front of the left part
    scene[:4] = 0
    seen_by = photo(scene)
    found = vsd(one, estimate, pose(), seen_by, TAUS)
    drawn = [drawn_depth(one, p, seen_by) for p in (estimate, pose())]
    expected = [plain_vsd(*drawn, scene, one.diameter, tau) for tau in TAUS]
    assert found == pytest.approx(expected, abs=1e-12)
    assert found == sorted(found, reverse=True)


def test_nothing_visible_of_either_is_an_error_of_one():
    away = pose(x=9000)
    assert vsd(model(), away, away, photo(), TAUS) == [1.0] * len(TAUS)


@pytest.fixture
def dataset(tmp_path):
    """A view of three cubes, one of which hides most of another, as a BOP folder."""
    made = made_view(
        ("turned", "cup", about_z(20), (-1.5, 6, 0)),
        ("tall", "cup", np.diag([1.0, 1, 2]), (1.5, 6, 0)),
        ("small", "chair", 0.5, (1.4, 4, 0.2)),
        shape=(CUBE, FACES),
    )
    write_views([made], tmp_path / "bop")
    return tmp_path / "bop"


def results(path, folder, change=None, more=()):
    truths = json.loads((folder / "test/000001/scene_gt.json").read_text())["0"]
    lines = ["scene_id,im_id,obj_id,score,R,t,time"]
    for n, one in enumerate(truths):
        rotation, place = one["cam_R_m2c"], one["cam_t_m2c"]
        place = change(n, place) if change else place
        r, t = (" ".join(map(str, values)) for values in (rotation, place))
        lines.append(f"1,0,{one['obj_id']},0.9,{r},{t},-1")
    path.write_text("\n".join([*lines, *more]) + "\n")
    return path


def test_the_poses_of_a_view_score_one_against_themselves(dataset, tmp_path):
    made = score_poses(dataset, results(tmp_path / "own.csv", dataset))
    assert (made.ar, made.ar_vsd, made.ar_mssd, made.ar_mspd) == (1, 1, 1, 1)
    assert made.n_truths == made.n_estimates == 3


def test_the_command_writes_the_errors_and_refuses_what_poses_do_not_have(
    dataset, tmp_path, capsys
):
    own = results(tmp_path / "own.csv", dataset)
    words = ["evaluate", str(own), "--truth", str(dataset), "-o", str(tmp_path / "eval")]
    assert cli.run(words) == 0
    assert "3 poses of 3: ar 1.0000" in capsys.readouterr().out
    written = json.loads((tmp_path / "eval/poses.json").read_text())
    assert written["ar_mspd"] == 1
    assert written["errors"][0]["vsd"] == [0.0] * 10
    assert cli.run(words) == 2, "it is there already"
    assert cli.run([*words, "--overwrite", "--json"]) == 0
    capsys.readouterr()
    assert cli.run([*words, "--overwrite", "--draws", "5"]) == 2
    assert "--draws is not for poses" in capsys.readouterr().err


def test_recall_is_averaged_over_thresholds(dataset, tmp_path):
    """One of three moved by 12 % of its diameter: found from 15 % on."""
    info = json.loads((dataset / "models/models_info.json").read_text())
    step = 0.12 * info["1"]["diameter"]

    def moved(n, t):
        return [t[0], t[1] + step, t[2]] if n == 0 else t

    made = score_poses(dataset, results(tmp_path / "off.csv", dataset, moved))
    assert made.ar_mssd == pytest.approx((2 + 8 / 10) / 3)
    assert made.ar == pytest.approx((made.ar_vsd + made.ar_mssd + made.ar_mspd) / 3)


def test_of_too_many_estimates_the_most_confident_count(dataset, tmp_path):
    worse = ["1,0,1,0.1,1 0 0 0 1 0 0 0 1,0 0 900,-1", "1,0,7,0.1,1 0 0 0 1 0 0 0 1,0 0 900,-1"]
    made = score_poses(dataset, results(tmp_path / "r.csv", dataset, more=worse))
    assert made.ar == 1
    assert made.n_estimates == 3


def test_the_folder_holds_what_bop_s_tools_read(dataset):
    scene = dataset / "test/000001"
    truths = json.loads((scene / "scene_gt.json").read_text())["0"]
    assert truths[1]["cam_t_m2c"] == pytest.approx([1500, 0, 6000])
    camera = json.loads((scene / "scene_camera.json").read_text())["0"]
    assert camera["cam_K"][2] == camera["cam_K"][5] == 49.5  # of 100 columns: the middle
    depth = cv2.imread(str(scene / "depth/000000.png"), cv2.IMREAD_UNCHANGED)
    assert depth.dtype == np.uint16
    of_small = cv2.imread(str(scene / "mask_visib/000000_000002.png"), cv2.IMREAD_UNCHANGED) > 0
    assert depth[of_small].min() * camera["depth_scale"] == pytest.approx(3750, abs=0.2)
    infos = json.loads((scene / "scene_gt_info.json").read_text())["0"]
    shares = [info["exact"]["visible_of_in_frame"] for info in infos]
    assert infos[0]["visib_fract"] == shares[0] == 1
    assert infos[1]["visib_fract"] == pytest.approx(shares[1])
    assert shares[1] < 1
    vertices, triangles = read_ply(dataset / "models/obj_000002.ply")
    assert vertices.min(axis=0) == pytest.approx([-500, -500, -1000], abs=1e-3)
    assert triangles.shape == (12, 3)
    drawn = drawn_depth(BopFolder(dataset).model(3), np.column_stack(
        [np.reshape(truths[2]["cam_R_m2c"], (3, 3)), truths[2]["cam_t_m2c"]]),
        BopFolder(dataset).photo(1, 0))  # fmt: skip
    assert ((drawn > 0) == of_small).all()


def test_text_plys_are_read_and_others_refused(tmp_path):
    text = "\n".join(
        ["ply", "format ascii 1.0", "element vertex 3", *(f"property float {a}" for a in "xyz"),
         "element face 1", "property list uchar int vertex_indices", "end_header",
         "0 0 0", "1 0 0", "0 2 0", "3 0 1 2"]
    )  # fmt: skip
    (tmp_path / "a.ply").write_text(text + "\n")
    vertices, triangles = read_ply(tmp_path / "a.ply")
    assert vertices[2].tolist() == [0, 2, 0]
    assert triangles.tolist() == [[0, 1, 2]]
    (tmp_path / "b.ply").write_bytes(b"solid of another kind")
    with pytest.raises(PoseInputError, match=r"b\.ply cannot be read.*a PLY of triangles"):
        read_ply(tmp_path / "b.ply")


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("1,0,1,1,1 0 0 0 1 0 0 0,0 0 9,-1", "line 2 of r.csv cannot be scored"),
        ("1,0,1,1,2 0 0 0 1 0 0 0 1,0 0 9,-1", "R is no rotation"),
        ("1,0,1,x,1 0 0 0 1 0 0 0 1,0 0 9,-1", "could not convert"),
        ("1,5,1,1,1 0 0 0 1 0 0 0 1,0 0 9,-1", "scene 1, image 5"),
    ],
)
def test_results_that_cannot_be_scored_are_refused_by_their_line(line, said, dataset, tmp_path):
    path = tmp_path / "r.csv"
    path.write_text(f"scene_id,im_id,obj_id,score,R,t,time\n{line}\n")
    with pytest.raises(PoseInputError, match=said):
        score_poses(dataset, path)


def test_files_that_are_not_there_are_named(dataset, tmp_path):
    path = results(tmp_path / "r.csv", dataset)
    assert list(read_results(path))[1].obj_id == 2
    with pytest.raises(PoseInputError, match="is no BOP dataset"):
        score_poses(tmp_path, path)
    with pytest.raises(PoseInputError, match=r"none\.csv cannot be read"):
        score_poses(dataset, tmp_path / "none.csv")
    (dataset / "test/000001/scene_camera.json").write_text("{}")
    with pytest.raises(PoseInputError, match=r"scene_camera\.json.*image 0"):
        score_poses(dataset, path)
    (dataset / "test/000001/scene_gt_info.json").write_text("{")
    with pytest.raises(PoseInputError, match=r"scene_gt_info\.json cannot be read"):
        score_poses(dataset, path)


def test_a_continuous_symmetry_is_rotations_about_its_line():
    line = {"axis": [2, -1, 2], "offset": [10, 20, 30]}
    found = symmetries({"symmetries_continuous": [line]})
    assert len(found) > 60
    for one in found:
        turn = one[:, :3]
        assert turn @ turn.T == pytest.approx(np.eye(3))
        assert np.linalg.det(turn) == pytest.approx(1)
        assert turn @ line["axis"] == pytest.approx(line["axis"])
        assert turn @ line["offset"] + one[:, 3] == pytest.approx(line["offset"])


def test_what_lies_beside_the_camera_is_infinitely_far_off_without_a_warning():
    assert mspd(model(), pose(z=50), pose(z=50.0 + 1e-9), photo()) != 0  # four corners at z = 0
    assert not mspd(model(), pose(z=50), pose(), photo()) < 1e6


TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip


@pytest.mark.parametrize("name", TYPES)
def test_binary_plys_of_every_type_are_read(name, tmp_path):
    vertices = np.array([[0, 0, 0], [100, 0, 1], [0, 50, 2]])
    table = np.zeros(3, [("before", "<" + TYPES[name]), *((a, "<f4") for a in "xyz")])
    for axis, values in zip("xyz", vertices.T, strict=True):
        table[axis] = values
    if TYPES[name] != "f4":  # as a coordinate, too
        table = table.astype([("before", "<f4"), *((a, "<" + TYPES[name]) for a in "xyz")])
    kinds = ["float32" if kind[1] == "<f4" else name for kind in table.dtype.descr]
    lines = ["ply", "format binary_little_endian 1.0", "element vertex 3",
             *(f"property {k} {n}" for k, n in zip(kinds, table.dtype.names, strict=True)),
             "element face 2", "property list uchar int vertex_indices", "end_header",
             ""]  # fmt: skip
    faces = np.array([(3, (0, 1, 2)), (3, (2, 1, 0))], [("n", "u1"), ("v", "<i4", 3)])
    content = "\n".join(lines).encode() + table.tobytes() + faces.tobytes()
    (tmp_path / "a.ply").write_bytes(content)
    found, triangles = read_ply(tmp_path / "a.ply")
    assert found.tolist() == vertices.tolist()
    assert triangles.tolist() == [[0, 1, 2], [2, 1, 0]]
    (tmp_path / "a.ply").write_bytes(content[:-13])
    with pytest.raises(PoseInputError, match=r"a\.ply cannot be read"):
        read_ply(tmp_path / "a.ply")


def test_text_plys_with_more_than_places(tmp_path):
    (tmp_path / "a.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float nx\nproperty float z\n"
        "property float y\nproperty float x\nelement face 2\n"
        "property list uchar int vertex_indices\nend_header\n"
        "9 1 2 3\n9 4 5 6\n9 7 8 9\n9 0 0 1\n3 0 1 2\n3 3 2 1\n"
    )
    vertices, triangles = read_ply(tmp_path / "a.ply")
    assert vertices.tolist() == [[3, 2, 1], [6, 5, 4], [9, 8, 7], [1, 0, 0]]
    assert triangles.tolist() == [[0, 1, 2], [3, 2, 1]]


def test_a_photo_s_depth_is_scaled_to_millimetres(dataset):
    scene = dataset / "test/000001"
    stored = cv2.imread(str(scene / "depth/000000.png"), cv2.IMREAD_UNCHANGED)
    for scale in (0.5, None):
        camera = json.loads((scene / "scene_camera.json").read_text())
        camera["0"].pop("depth_scale", None)
        if scale:
            camera["0"]["depth_scale"] = scale
        (scene / "scene_camera.json").write_text(json.dumps(camera))
        assert (BopFolder(dataset).photo(1, 0).depth_mm == stored * (scale or 1)).all()
    (scene / "depth/000000.png").write_bytes(b"no picture")
    with pytest.raises(PoseInputError, match=r"000000\.png cannot be read.*16-bit PNG"):
        BopFolder(dataset).photo(1, 0)


def test_an_instance_of_which_a_tenth_is_visible_counts(dataset, tmp_path):
    path = dataset / "test/000001/scene_gt_info.json"
    for visible, n in ((0.1, 3), (0.0999, 2)):
        infos = json.loads(path.read_text())
        infos["0"][1]["visib_fract"] = visible
        path.write_text(json.dumps(infos))
        assert score_poses(dataset, results(tmp_path / "r.csv", dataset)).n_truths == n


def test_an_error_at_a_threshold_is_not_below_it_and_each_truth_is_taken_once():
    assert (_count_hits([[0.5]], 0.5), _count_hits([[0.4999]], 0.5)) == (0, 1)
    assert _count_hits([[0.1, 0.2], [0.1, 0.9]], 0.5) == 1
    assert _count_hits([[0.1, 0.2], [0.9, 0.2]], 0.5) == 2


def test_a_reflection_is_no_rotation(dataset, tmp_path):
    for turn, taken in (("-1 0 0 0 1 0 0 0 1", False), ("-1 0 0 0 -1 0 0 0 1", True)):
        path = tmp_path / "r.csv"
        path.write_text(f"scene_id,im_id,obj_id,score,R,t,time\n1,0,1,1,{turn},0 0 9,-1\n")
        if taken:
            assert len(list(read_results(path))) == 1
        else:
            with pytest.raises(PoseInputError, match="R is no rotation"):
                list(read_results(path))
