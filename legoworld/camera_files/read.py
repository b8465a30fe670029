"""Which kind of camera file a path is, and its cameras."""

from __future__ import annotations

from pathlib import Path

from legoworld.camera_files.blenderproc import SUFFIX, read_hdf5
from legoworld.camera_files.bop import read_bop
from legoworld.camera_files.colmap import read_colmap
from legoworld.camera_files.nerfstudio import read_transforms
from legoworld.tracks.colmap import CalibrationError, calibration_files
from legoworld.visibility.posed_camera import Camera


def read_camera_file(path: Path) -> list[Camera]:
    """The cameras of a file or folder. Raises CalibrationError."""
    if path.suffix.lower() == ".json" and path.is_file():
        return read_bop(path) if path.name == "scene_camera.json" else read_transforms(path)
    if path.suffix == SUFFIX and path.is_file():
        return read_hdf5([path])
    folder = path.parent if path.is_file() else path
    if folder.is_dir():
        if calibration_files(folder):
            return read_colmap(folder)
        for name in ("transforms.json", "scene_camera.json"):
            if (folder / name).is_file():
                return read_camera_file(folder / name)
        if frames := sorted(folder.glob(f"*{SUFFIX}"), key=lambda p: (len(p.stem), p.stem)):
            return read_hdf5(frames)
    raise CalibrationError(
        f"{path.name or path} holds no cameras",
        found="no such file or folder" if not path.exists() else "no file of a known name",
        expected="COLMAP's cameras.txt and images.txt (or .bin), a transforms.json, "
        "scene_camera.json, or .hdf5 of BlenderProc",
    )
