"""What the documents tell a user to run, run."""

import os
import re
import runpy
import shutil
import subprocess
import sys
import types
from pathlib import Path

import numpy as np
import pytest
import scene
from covis import v1

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples" / "python"


def test_the_shortest_frontend_finds_the_true_poses(capsys, monkeypatch, server):
    monkeypatch.setattr(sys, "argv", ["stream_keyframes.py", server.url])
    runpy.run_path(str(EXAMPLES / "stream_keyframes.py"), run_name="__main__")
    rows = [[float(word) for word in line.split()] for line in capsys.readouterr().out.splitlines()[1:]]
    assert len(rows) == 6
    assert all(abs(optimized - truth) < 4e-3 for _, _, optimized, truth in rows)


def test_the_code_in_the_readme_runs_as_it_stands(capsys):
    blocks = re.findall(r"^```python\n(.*?)^```", (ROOT / "python/README.md").read_text(), re.M | re.S)
    assert blocks
    for block in blocks:
        exec(compile(block, "python/README.md", "exec"), {})
    assert abs(float(capsys.readouterr().out.split()[0]) - 0.4) < 2e-3


def synthetic(folder, frames):
    program = os.environ.get("COVIS_BIN") or shutil.which("covis")
    command = [program, "synth", "rgbd", "--scene", "static", "--frames", str(frames), str(folder)]
    subprocess.run(command, check=True, capture_output=True)


def test_the_odometry_of_opencv_maps_through_covis(tmp_path, monkeypatch, server):
    cv2 = pytest.importorskip("cv2")
    file_interface = pytest.importorskip("evo.tools.file_interface")
    if not hasattr(cv2, "Odometry"):
        pytest.skip("OpenCV before 5 has no odometry outside of its contributed modules")
    from evo.core import metrics, sync

    synthetic(tmp_path / "room", 36)
    arguments = ["opencv_odometry.py", str(tmp_path / "room"), server.url, "--out", str(tmp_path)]
    monkeypatch.setattr(sys, "argv", arguments)
    monkeypatch.syspath_prepend(str(EXAMPLES))
    runpy.run_path(str(EXAMPLES / "opencv_odometry.py"), run_name="__main__")
    errors = []
    for name in ("alone", "covis"):
        truth = file_interface.read_tum_trajectory_file(str(tmp_path / "room" / "groundtruth.txt"))
        found = file_interface.read_tum_trajectory_file(str(tmp_path / f"{name}.tum"))
        truth, found = sync.associate_trajectories(truth, found, max_diff=0.01)
        assert found.num_poses == 36
        found.align(truth)
        error = metrics.APE(metrics.PoseRelation.translation_part)
        error.process_data((truth, found))
        errors.append(error.get_statistic(metrics.StatisticsType.rmse))
    # Too short for a loop: what is left is the noise of both.
    assert max(errors) < 0.01, errors


def test_the_rgbd_frontend_tracks_a_sequence_to_within_centimeters(tmp_path, monkeypatch, server):
    pytest.importorskip("cv2")
    file_interface = pytest.importorskip("evo.tools.file_interface")
    from evo.core import metrics, sync

    synthetic(tmp_path / "room", 36)
    out = str(tmp_path / "room.tum")
    monkeypatch.setattr(sys, "argv", ["rgbd_frontend.py", str(tmp_path / "room"), server.url, "--out", out])
    runpy.run_path(str(EXAMPLES / "rgbd_frontend.py"), run_name="__main__")
    truth = file_interface.read_tum_trajectory_file(str(tmp_path / "room" / "groundtruth.txt"))
    found = file_interface.read_tum_trajectory_file(out)
    truth, found = sync.associate_trajectories(truth, found, max_diff=0.01)
    assert found.num_poses >= 3
    found.align(truth)
    error = metrics.APE(metrics.PoseRelation.translation_part)
    error.process_data((truth, found))
    assert error.get_statistic(metrics.StatisticsType.rmse) < 0.03


def test_the_notebook_optimizes_a_model_and_plots_it(tmp_path, client, monkeypatch):
    nbformat = pytest.importorskip("nbformat")
    nbclient = pytest.importorskip("nbclient")
    pytest.importorskip("matplotlib")
    pytest.importorskip("pycolmap")
    policy = v1.MapPolicy(local_bundle_adjustment=False)
    with client.ingest("room", "robot", policy=policy) as session:
        scene.send(session, *range(4))
    client.export_map("room", tmp_path / "model", "colmap-text")
    monkeypatch.setenv("COLMAP_MODEL", str(tmp_path / "model"))
    monkeypatch.setenv("MPLBACKEND", "agg")
    notebook = nbformat.read(EXAMPLES / "optimize_colmap.ipynb", 4)
    assert not any(cell.get("outputs") for cell in notebook.cells), "it is kept without outputs"
    where = {"metadata": {"path": str(tmp_path)}}
    nbclient.NotebookClient(notebook, timeout=120, kernel_name="python3", resources=where).execute()
    told = "".join(o.get("text", "") for cell in notebook.cells for o in cell.get("outputs", []))
    before, after = map(float, re.search(r"reprojection: (\S+) px before, (\S+) px after", told).groups())
    assert after < 0.1 * before
    assert (tmp_path / "optimized.png").stat().st_size > 10_000
    assert (tmp_path / "optimized" / "points3D.bin").is_file()


class Message(types.SimpleNamespace):
    """A ROS message as far as the bridge reads it."""


def cloud(t, **columns):
    """A sensor_msgs/PointCloud2 of these columns, with a gap as padding makes it."""
    kinds = {np.dtype(name): number for name, number in
             (("u4", 6), ("f4", 7), ("f8", 8))}  # fmt: skip
    names = list(columns)
    layout = np.dtype({
        "names": names,
        "formats": [columns[name].dtype for name in names],
        "offsets": [4 + 8 * k for k in range(len(names))],
        "itemsize": 8 + 8 * len(names),
    })  # fmt: skip
    rows = np.zeros(len(columns[names[0]]), layout)
    for name in names:
        rows[name] = columns[name]
    fields = [Message(name=name, offset=layout.fields[name][1], datatype=kinds[layout[name]]) for name in names]
    stamp = Message(sec=int(t), nanosec=round((t - int(t)) * 1e9))
    return Message(header=Message(stamp=stamp, frame_id="camera"), height=1, width=len(rows), fields=fields,
                   is_bigendian=False, point_step=layout.itemsize, data=rows.tobytes())  # fmt: skip


def test_the_ros_bridge_takes_keyframes_and_tells_where_odom_lies(client):
    bridge_module = runpy.run_path(str(EXAMPLES / "ros2_bridge.py"))
    info = Message(distortion_model="plumb_bob", width=640, height=480, k=scene.K.ravel(), d=[0.0] * 5)
    drift = np.eye(4)
    drift[:3, 3] = [0.5, -0.2, 0.1]

    def send(bridge, id):
        pixels, depths = scene.view(id)
        message = cloud(
            100.25 + id, u=pixels[:, 0].astype("f4"), v=pixels[:, 1].astype("f4"),
            id=scene.LANDMARKS.astype("u4"), depth=depths,
        )  # fmt: skip
        # Odometry is off by more with each keyframe.
        odom_from_camera = drift @ scene.pose(id, 0.01 * id)
        return bridge.keyframe(message, odom_from_camera), odom_from_camera

    # What exact views say is compared.
    client.create_map("room", policy=v1.MapPolicy(odometry=False))
    bridge = bridge_module["Bridge"](client, "room", "robot_1")
    assert np.array_equal(bridge.map_from_odom(), np.eye(4))
    assert send(bridge, 0)[0] is False, "the camera is not known yet"
    bridge.camera_info(info)
    bridge.camera_info(info)
    for id in range(3):
        is_sent, odom_from_camera = send(bridge, id)
        assert is_sent
    bridge.close()
    with client.watch("room") as watched:
        # The map begins where odometry did; its last keyframe is where odometry would be without drift.
        expected = drift @ scene.pose(2)
        assert np.allclose(watched.poses[2], expected, atol=1e-3)
        assert watched.times[2] == 102.25
        found = watched.map_from_odom("robot_1")
        assert np.allclose(found @ odom_from_camera, watched.poses[2], atol=1e-9)
    transform = Message(translation=Message(), rotation=Message())
    bridge_module["fill_transform"](transform, found)
    assert np.allclose(bridge_module["from_transform"](transform), found)
    # The bridge is started again: ids go on, and the map is where it was.
    again = bridge_module["Bridge"](client, "room", "robot_1")
    assert np.allclose(again.map_from_odom(), found)
    again.camera_info(info)
    assert send(again, 3)[0]
    again.close()
    assert client.get_map("room").counts.keyframe_count == 4
    with pytest.raises(ValueError, match="rational_polynomial is not supported"):
        bridge_module["Bridge"](client, "room", "other").camera_info(
            Message(distortion_model="rational_polynomial")
        )
