"""Rooms of boxes seen by a known camera, drawn by the readout's kernel."""

from __future__ import annotations

import math

import numpy as np

from legoworld.plugin.evidence import Evidence
from legoworld.plugin.room_fit import FACES, NORMALS
from legoworld.records.plugin_evidence import CameraEvidence, EvidenceFile, PhotoEvidence, Region
from legoworld.visibility.kernel import render
from legoworld.visibility.projection import Projection
from legoworld.visibility.surfaces import Surfaces

SIZE = (640, 480)
#: Lower and upper corner of every room, metres.
ROOM = ((-3, -4, 0), (3, 4, 2.8))


def box(low, high):
    """(12, 3, 3) triangles of a box, two for each of its six faces in a row."""
    low, high = np.array(low, float), np.array(high, float)
    quads = []
    for axis in range(3):
        for side in (low, high):
            corner = low.copy()
            corner[axis] = side[axis]
            u, v = np.zeros(3), np.zeros(3)
            a, b = [i for i in range(3) if i != axis]
            u[a], v[b] = high[a] - low[a], high[b] - low[b]
            quads += [[corner, corner + u, corner + u + v], [corner, corner + u + v, corner + v]]
    return np.array(quads)


def room(random):
    """A room of boxes: (T, 3, 3) triangles, each face of each box a shade of its own."""
    boxes = [box(*ROOM)]
    for _ in range(6):
        low = [random.uniform(-2.5, 1.5), random.uniform(-1, 3), 0]
        size = [random.uniform(0.4, 1.2), random.uniform(0.4, 1), random.uniform(0.4, 1.8)]
        boxes.append(box(low, np.add(low, size)))
    return np.concatenate(boxes)


def camera(random):
    """(3, 3) world_from_cam and a place: looking along +y, turned, tilted and rolled a little."""
    yaw, pitch, roll = np.radians(
        [random.uniform(-35, 35), random.uniform(-20, 10), random.uniform(-3, 3)]
    )
    forward = np.array(
        [math.sin(yaw) * math.cos(pitch), math.cos(yaw) * math.cos(pitch), math.sin(pitch)]
    )
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    rolled = right * math.cos(roll) + down * math.sin(roll)
    return np.stack([rolled, np.cross(forward, rolled), forward], axis=1), np.array(
        [random.uniform(-1, 1), -3.5, random.uniform(1.2, 1.8)]
    )


def seen_faces(triangles, world_from_cam, place, hfov_deg):
    """(H, W) which face the kernel sees: the room's six first, in the order of `box`."""
    focal = SIZE[0] / 2 / math.tan(math.radians(hfov_deg) / 2)
    in_cam = (triangles - place) @ world_from_cam
    vertices = in_cam.reshape(-1, 3).astype(np.float32)
    n_faces = len(triangles) // 2
    surfaces = Surfaces(
        vertices=vertices,
        triangles=np.tile(np.arange(6, dtype=np.int32).reshape(2, 3), (n_faces, 1)),
        vertex_start=np.arange(0, len(vertices) + 1, 6, dtype=np.int64),
        triangle_start=np.arange(0, 2 * n_faces + 1, 2, dtype=np.int64),
        placement_mesh=np.arange(n_faces, dtype=np.int32),
        cam_from_mesh=np.tile(np.eye(3, 4), (n_faces, 1, 1)),
        placement_id=np.arange(n_faces, dtype=np.int32),
        cutouts=None,
    )
    return render(
        surfaces,
        Projection(
            orthographic=False, fx=focal, fy=focal, cx=SIZE[0] / 2, cy=SIZE[1] / 2,
            z_near=0.01, z_far=100.0,
        ),
        SIZE,
    ).instance  # fmt: skip


def picture(triangles, world_from_cam, place, hfov_deg, random):
    """What the kernel sees, faces in random greys, with a little noise as a photo has."""
    seen = seen_faces(triangles, world_from_cam, place, hfov_deg)
    shades = random.uniform(30, 225, len(triangles) // 2 + 1)
    noisy = shades[seen] + random.normal(0, 2, seen.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8)


def region_of(name, mask, category=None):
    """A region with a mask, as a provider would have drawn it."""
    from pycocotools import mask as rle

    encoded = rle.encode(np.asfortranarray(mask, np.uint8))
    return Region(
        name=name,
        counts=encoded["counts"].decode(),
        area_px=int(mask.sum()),
        bbox_xywh_px=tuple(int(v) for v in rle.toBbox(encoded)),
        category=category,
        score=None,
        source="test",
    )


def evidence_with(regions, rotation=None, hfov_deg=None, disparity=None, photo=None, size=SIZE):
    """Evidence of given regions and camera."""
    camera = CameraEvidence(
        hfov_deg=hfov_deg,
        hfov_source=None if hfov_deg is None else "given",
        world_from_cam_rotation=None if rotation is None else tuple(map(tuple, rotation.tolist())),
        rotation_source=None if rotation is None else "test",
        unknown=None if rotation is not None else "not asked",
    )
    about = PhotoEvidence(file_name="p.png", sha256="0" * 64, width=size[0], height=size[1])
    regions = tuple(sorted(regions, key=lambda region: region.name))
    file = EvidenceFile(photo=about, regions=regions, depth=None, camera=camera)
    return Evidence(file=file, disparity=disparity, photo=photo)


def true_distances(estimate, world_from_cam, place):
    """By face of the estimated frame: the room's true distance, in camera heights."""
    low, high = np.array(ROOM)
    distances = {}
    for name, normal in zip(FACES, NORMALS, strict=True):
        there = np.rint((estimate @ world_from_cam.T).T @ normal)
        end = np.where(there > 0, high, low)
        distances[name] = float(np.abs((end - place) @ there)) / place[2]
    return distances
