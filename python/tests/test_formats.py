"""Files that `covis convert` writes, as evo and pycolmap read them, and the other way round."""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

GOLDEN = Path(__file__).resolve().parents[2] / "tests" / "golden" / "twins"


def convert(*arguments: object) -> None:
    program = os.environ.get("COVIS_BIN") or shutil.which("covis")
    assert program, "set COVIS_BIN to a covis binary, or have one on the PATH"
    ran = subprocess.run(
        [program, "convert", *map(str, arguments)], capture_output=True, text=True
    )
    assert ran.returncode == 0, ran.stderr


def test_evo_reads_what_is_written_and_what_it_writes_is_read(tmp_path: Path) -> None:
    files = pytest.importorskip("evo.tools.file_interface")
    given = files.read_tum_trajectory_file(str(GOLDEN / "walk-truth.txt"))
    convert(GOLDEN / "walk-truth.txt", tmp_path / "a.csv")
    euroc = files.read_euroc_csv_trajectory(str(tmp_path / "a.csv"))
    assert np.allclose(euroc.timestamps, given.timestamps, rtol=0, atol=1e-6)
    convert(GOLDEN / "walk-truth.txt", tmp_path / "a.kitti")
    kitti = files.read_kitti_poses_file(str(tmp_path / "a.kitti"))
    for ours in (euroc, kitti):
        assert len(ours.poses_se3) == given.num_poses
        assert np.allclose(ours.poses_se3, given.poses_se3, rtol=0, atol=1e-12)
    # And back: KITTI's file of evo, with the times beside it.
    files.write_kitti_poses_file(str(tmp_path / "evo.txt"), given)
    np.savetxt(tmp_path / "times.txt", given.timestamps, fmt="%.9f")
    convert(tmp_path / "evo.txt", tmp_path / "back.txt", "--times", tmp_path / "times.txt")
    back = files.read_tum_trajectory_file(str(tmp_path / "back.txt"))
    assert np.allclose(back.poses_se3, given.poses_se3, rtol=0, atol=1e-9)
    assert np.allclose(back.timestamps, given.timestamps, rtol=0, atol=1e-6)


def reprojection_errors(model) -> np.ndarray:
    """By COLMAP's definition of RADIAL, pixels; in front of a camera as pycolmap itself projects."""
    errors = []
    for image in model.images.values():
        camera = model.cameras[image.camera_id]
        assert camera.model.name == "RADIAL" and camera.width > 0 and camera.height > 0
        focal, *center, k1, k2 = camera.params
        pose = image.cam_from_world() if callable(image.cam_from_world) else image.cam_from_world
        for seen in image.points2D:
            if seen.has_point3D():
                point = model.points3D[seen.point3D_id].xyz
                in_camera = pose * point
                plane = in_camera[:2] / in_camera[2]
                r2 = plane @ plane
                at = focal * (1 + k1 * r2 + k2 * r2**2) * plane + center
                theirs = image.project_point(point)
                assert theirs is None or np.allclose(at, theirs, rtol=0, atol=1e-9)
                assert (theirs is None) == (in_camera[2] <= 0)
                errors.append(at - seen.xy)
    return np.array(errors)


@pytest.mark.parametrize("encoding", ["colmap-text", "colmap-binary"])
def test_pycolmap_reads_a_converted_model_with_the_same_residuals(tmp_path: Path, encoding: str) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    convert(GOLDEN / "window-6-80.txt", tmp_path / "model", "--to", encoding)
    model = pycolmap.Reconstruction(tmp_path / "model")
    lines = (GOLDEN / "window-6-80.txt").read_text().split()
    cameras, points, observations = map(int, lines[:3])
    assert (len(model.images), len(model.points3D)) == (cameras, points)
    errors = reprojection_errors(model)
    assert len(errors) == observations
    rows = np.array(lines[3:], float)
    assert np.isclose(0.5 * (errors**2).sum(), bal_cost(rows, cameras, points, observations), rtol=1e-9)
    # What pycolmap writes is read, and goes to Bundler and back.
    (tmp_path / "again").mkdir()
    model.write(tmp_path / "again")
    convert(tmp_path / "again", tmp_path / "bundle.out")
    convert(tmp_path / "bundle.out", tmp_path / "third", "--to", encoding)
    third = pycolmap.Reconstruction(tmp_path / "third")
    assert sorted(image.name for image in third.images.values()) == sorted(
        image.name for image in model.images.values()
    )
    assert np.isclose((reprojection_errors(third) ** 2).sum(), (errors**2).sum(), rtol=1e-9)


def test_pycolmap_projects_a_model_of_openmvg_as_openmvg_does(tmp_path: Path) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    spec = importlib.util.spec_from_file_location("make_openmvg", GOLDEN / "make_openmvg.py")
    openmvg = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(openmvg)
    given = json.loads((GOLDEN / "room-openmvg.json").read_text())
    by_key = {
        name: {entry["key"]: entry["value"] for entry in given[name]}
        for name in ("views", "intrinsics", "extrinsics", "structure")
    }
    names: dict[int, str] = {}
    for value in by_key["intrinsics"].values():
        number = value["polymorphic_id"] % (1 << 31)
        value["name"] = names.setdefault(number, value.get("polymorphic_name"))
    convert(GOLDEN / "room-openmvg.json", tmp_path / "model")
    model = pycolmap.Reconstruction(tmp_path / "model")
    assert len(model.images) == len(by_key["extrinsics"]) and len(model.points3D) == len(by_key["structure"])
    points = dict(zip(sorted(model.points3D), sorted(by_key["structure"])))
    compared = 0
    for key, value in by_key["views"].items():
        view = value["ptr_wrapper"]["data"]
        if view["id_pose"] not in by_key["extrinsics"]:
            continue
        pose, camera = by_key["extrinsics"][view["id_pose"]], by_key["intrinsics"][view["id_intrinsic"]]
        (image,) = [i for i in model.images.values() if i.name == view["local_path"] + view["filename"]]
        for seen in image.points2D:
            point = by_key["structure"][points[seen.point3D_id]]
            in_camera = np.array(pose["rotation"]) @ (np.array(point["X"]) - pose["center"])
            at = openmvg.project(camera["name"], camera["ptr_wrapper"]["data"], in_camera)
            (pixel,) = [o["value"]["x"] for o in point["observations"] if o["key"] == key]
            # The center of COLMAP's first pixel is (0.5, 0.5).
            theirs = image.project_point(model.points3D[seen.point3D_id].xyz)
            assert np.allclose(theirs, at + 0.5, rtol=0, atol=1e-9)
            assert np.allclose(seen.xy, np.array(pixel) + 0.5, rtol=0, atol=1e-12)
            compared += 1
    assert compared == 180


def bal_cost(rows: np.ndarray, cameras: int, points: int, observations: int) -> float:
    """½ Σ ‖r‖² of a BAL file from its definition."""
    seen = rows[: 4 * observations].reshape(-1, 4)
    rest = rows[4 * observations :]
    intrinsics, xyz = rest[: 9 * cameras].reshape(-1, 9), rest[9 * cameras :].reshape(-1, 3)
    assert len(xyz) == points
    cost = 0.0
    for camera, point, u, v in seen:
        numbers = intrinsics[int(camera)]
        angle = np.linalg.norm(numbers[:3])
        axis = numbers[:3] / angle if angle > 0 else np.array([1.0, 0, 0])
        x = xyz[int(point)]
        turned = (
            x * np.cos(angle) + np.cross(axis, x) * np.sin(angle) + axis * (axis @ x) * (1 - np.cos(angle))
        )
        at = turned + numbers[3:6]
        plane = -at[:2] / at[2]
        r2 = plane @ plane
        scale = numbers[6] * (1 + numbers[7] * r2 + numbers[8] * r2**2)
        cost += 0.5 * ((scale * plane - (u, v)) ** 2).sum()
    return cost
