"""Each call against a real server: maps, files, solves, places, errors."""

from pathlib import Path

import covis
import numpy as np
import pytest
from covis import v1
from scene import CENTER_PX, FOCAL_PX, LANDMARKS, POINTS, K, SIZE, pose, send, view

ROOT = Path(__file__).resolve().parents[2]
RNG = np.random.default_rng(5)


def test_maps_are_made_listed_and_deleted(client):
    made = client.create_map("b", v1.MapPolicy(window_keyframe_count=7))
    assert made.policy.window_keyframe_count == 7
    with pytest.raises(covis.AlreadyExists):
        client.create_map("b")
    client.create_map("a")
    assert [found.map_id for found in client.list_maps()] == ["a", "b"]
    client.delete_map("b")
    with pytest.raises(covis.NotFound) as missing:
        client.get_map("b")
    assert (missing.value.reason, missing.value.rpc) == ("MAP_NOT_FOUND", "GetMap")
    assert missing.value.metadata["map_id"] == "b"
    with pytest.raises(covis.NotFound):
        client.ingest("b", "robot", create=False)
    assert client.server_info().instance_id


def test_a_bad_field_is_named_by_the_exception(client):
    with pytest.raises(covis.InvalidArgument) as refused:
        client.create_map("Not a name", v1.MapPolicy(window_keyframe_count=1))
    fields = {violation.field: violation.reason for violation in refused.value.violations}
    assert fields["map_id"] == "OUT_OF_RANGE"
    assert isinstance(refused.value, ValueError)
    assert "map_id" in str(refused.value)


@pytest.fixture
def room(client):
    # What exact views say is compared.
    policy = v1.MapPolicy(odometry=False)
    with client.ingest("room", "robot", policy=policy) as session:
        send(session, *range(5))
    return client


def test_a_trajectory_leaves_as_tum_and_to_evo(room, tmp_path):
    evo = pytest.importorskip("evo.core.trajectory")
    found = room.trajectory("room")
    assert found.ids.tolist() == [0, 1, 2, 3, 4]
    assert np.allclose(found.world_from_camera[4], pose(4), atol=1e-6)
    path = found.to_evo()
    assert isinstance(path, evo.PoseTrajectory3D) and path.check()[0]
    from evo.tools import file_interface

    found.write_tum(tmp_path / "room.tum")
    read = file_interface.read_tum_trajectory_file(tmp_path / "room.tum")
    assert np.allclose(read.positions_xyz, path.positions_xyz)
    assert np.allclose(read.poses_se3, path.poses_se3)
    assert np.array_equal(read.timestamps, found.times)
    found.times[:2] = 1305031102.175304, 1000.0
    found.write_tum(tmp_path / "room.tum")
    times = [row.split()[0] for row in (tmp_path / "room.tum").read_text().splitlines()]
    assert times[:2] == ["1305031102.175304", "1000.0"]
    with room.watch("room") as watched:
        assert np.array_equal(watched.trajectory().world_from_camera, found.world_from_camera)


def test_a_map_leaves_as_files_and_to_pycolmap(room, tmp_path, caplog):
    pycolmap = pytest.importorskip("pycolmap")
    paths = room.export_map("room", tmp_path, "colmap-text")
    assert [path.name for path in paths] == ["cameras.txt", "images.txt", "points3D.txt"]
    assert not list(tmp_path.glob("*.part"))
    again = room.import_map("again", tmp_path, "colmap-text")
    assert (again.counts.keyframe_count, again.counts.landmark_count) == (5, 60)
    room.export_map("room", tmp_path, "covis")
    copy = room.import_map("copy", tmp_path / "map.covis", "covis")
    assert copy.counts == room.get_map("room").counts
    model = room.to_pycolmap("room")
    assert isinstance(model, pycolmap.Reconstruction)
    assert (model.num_images(), model.num_points3D()) == (5, 60)
    told = model.compute_mean_reprojection_error()
    assert told < 1e-3
    model.update_point_3d_errors()
    assert abs(model.compute_mean_reprojection_error() - told) < 1e-6
    unit = " ".join("1" if row == column else "0" for row in range(6) for column in range(row, 6))
    (tmp_path / "walk.g2o").write_text(
        f"VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\nVERTEX_SE3:QUAT 1 1 0 0 0 0 0 2\nLASER 0\n"
        f"EDGE_SE3:QUAT 0 1 1 0 0 0 0 0 1 {unit}\n"
    )
    with pytest.raises(covis.InvalidArgument, match="line 3"):
        room.import_map("walk", tmp_path / "walk.g2o", "g2o")
    warnings = []
    room.import_map(
        "walk", tmp_path / "walk.g2o", "g2o", skip_unknown=True, on_warning=warnings.append
    )
    assert [(warning.count, warning.first_line) for warning in warnings] == [(1, 2), (1, 3)]
    room.import_map("walk2", tmp_path / "walk.g2o", "g2o", skip_unknown=True)
    assert "walk.g2o: lines with the tag LASER are left out: 1" in caplog.text
    with pytest.raises(FileNotFoundError, match="images.bin is missing"):
        (tmp_path / "cameras.bin").touch()
        room.import_map("none", tmp_path, "colmap-binary")
    with pytest.raises(ValueError, match="format must be one of"):
        room.export_map("room", tmp_path, "obj")


def test_pycolmap_adjusts_the_export_of_a_map_at_once(client, tmp_path):
    """Landmark 1000 has one view, 1001 is behind its cameras: the error is then what COLMAP counts."""
    pycolmap = pytest.importorskip("pycolmap")
    policy = v1.MapPolicy(odometry=False, local_bundle_adjustment=False)
    noise = np.random.default_rng(7)
    with client.ingest("room", "robot", policy=policy) as session:
        send(session, *range(5))
        for id, more in ((5, [1000, 1001]), (6, [1001])):
            pixels = view(id)[0] + 0.3 * noise.standard_normal((len(LANDMARKS), 2))
            extra = np.array([[0.0, 0, 5], [0, 0, -30]])[: len(more)]
            session.keyframe(
                id,
                100.5 + id,
                pose(id),
                np.vstack([pixels, np.full_like(extra[:, :2], 200.0)]),
                [*LANDMARKS, *more],
                new_points=np.vstack([POINTS, extra]) if id == 5 else None,
            )
    everything = client.export_map("room", tmp_path, all_points=True)
    assert len(everything) == 3
    read = pycolmap.Reconstruction(tmp_path)
    assert sorted(p.track.length() for p in read.points3D.values())[0] == 1
    model = client.to_pycolmap("room")
    assert model.num_points3D() == read.num_points3D() - 1
    told = {id: point.error for id, point in model.points3D.items()}
    mean = model.compute_mean_reprojection_error()
    model.update_point_3d_errors()
    for id, point in model.points3D.items():
        assert point.error == pytest.approx(told[id], rel=1e-12, abs=1e-6)
    assert mean == pytest.approx(model.compute_mean_reprojection_error(), rel=1e-12)
    pycolmap.bundle_adjustment(model)


def test_a_whole_map_is_optimized_and_its_iterations_are_told(room):
    costs = []
    result = room.optimize("room", on_iteration=lambda row: costs.append(row.cost))
    assert costs[0] == result.summary.initial_cost and costs[-1] == result.summary.final_cost
    assert result.keyframe_count == 5
    with pytest.raises(ValueError, match='problem must be one of full, pose-graph'):
        room.optimize("room", problem="all")
    with pytest.raises(covis.NotFound):
        room.optimize("attic")


def test_a_bundle_of_arrays_is_solved(client):
    count = 4
    truth = np.array([pose(id) for id in range(count)])
    start = truth.copy()
    start[2:, :3, 3] += 0.02
    pixels, depths = zip(*(view(id) for id in range(count)))
    found = client.solve_bundle(
        [covis.camera(0, *SIZE, K)],
        start,
        POINTS + 0.01 * np.sin(LANDMARKS)[:, None],
        np.repeat(np.arange(count), 60),
        np.tile(LANDMARKS, count),
        np.concatenate(pixels),
        depths=np.concatenate(depths),
        fixed_poses=np.arange(count) < 2,
        loss="huber:2",
        include_iterations=True,
    )
    assert np.allclose(found.world_from_camera, truth, atol=1e-6)
    assert np.allclose(found.points, POINTS, atol=1e-5)
    assert found.summary.final_cost < 1e-6 * found.summary.initial_cost
    assert len(found.iterations) == found.summary.iteration_count + 1
    with pytest.raises(covis.InvalidArgument) as refused:
        client.solve_bundle(
            [covis.camera(0, *SIZE, K)], start, POINTS, [0], [99], [[1.0, 2.0]]
        )
    assert refused.value.violations[0].field == "problem.observations[0].point_index"


def ring(count, size):
    """Vertices on a ring, their edges to the next and a closing one."""
    turn = 2 * np.pi / count
    step = np.eye(size)
    step[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    step[0, -1] = 1.0
    poses = [np.eye(size)]
    for _ in range(count - 1):
        poses.append(poses[-1] @ step)
    pairs = [(i, (i + 1) % count) for i in range(count)]
    return np.array(poses), np.array(pairs), np.array([step] * count)


@pytest.mark.parametrize("size", [3, 4])
def test_a_pose_graph_in_the_plane_and_in_space_is_solved(client, size):
    truth, pairs, steps = ring(12, size)
    information = np.diag([100.0] * (size - 1 if size == 4 else 2) + [1000.0] * (3 if size == 4 else 1))
    start = truth.copy()
    start[1:, 0, -1] += 0.1 * RNG.normal(size=11)
    false_pair, false_step = np.array([[2, 8]]), np.eye(size)[None]
    found = client.solve_pose_graph(
        np.arange(12), start, np.vstack([pairs, false_pair]), np.vstack([steps, false_step]),
        information, robust="gnc-tls",
    )  # fmt: skip
    assert found.ids.tolist() == list(range(12))
    assert np.allclose(found.world_from_vertex, truth, atol=1e-6)
    assert [edge.edge_index for edge in found.switched_off] == [12]
    assert found.certificate is None
    alone = client.solve_pose_graph(
        np.arange(12), None, pairs, steps, information, start="chordal", certify=True
    )
    assert np.allclose(alone.world_from_vertex, truth, atol=1e-6)
    assert alone.certificate.certified
    with pytest.raises(ValueError, match="information must be 12×"):
        client.solve_pose_graph(np.arange(12), None, pairs, steps, np.ones((2, size, size)))


def test_a_pose_is_refined_over_known_points(client):
    pixels, depths = view(1)
    camera = covis.camera(0, *SIZE, K)
    found = client.refine_pose(camera, pose(1, 0.05), POINTS, pixels, depths, include_information=True)
    assert np.allclose(found.world_from_camera, pose(1), atol=1e-6)
    assert found.information.shape == (6, 6) and (np.linalg.eigvalsh(found.information) > 0).all()
    assert found.summary.final_cost < found.summary.initial_cost
    alone = client.refine_pose(camera, pose(1, 0.05), POINTS, pixels, loss="cauchy:2", max_iterations=30)
    assert np.allclose(alone.world_from_camera, pose(1), atol=1e-6) and alone.information is None
    with pytest.raises(ValueError, match="points must be one a pixel, 60, not 2"):
        client.refine_pose(camera, pose(1), POINTS[:2], pixels)
    with pytest.raises(covis.InvalidArgument, match="observations"):
        client.refine_pose(camera, pose(1), POINTS[:2], pixels[:2])


def place(seed, count=400):
    """A wall that is nowhere flat, each point with a descriptor of its own."""
    random = np.random.default_rng(seed)
    points = random.uniform([-4, -1.2, 3], [6, 1.2, 6], (count, 3))
    return points, random.integers(0, 256, (count, 32), np.uint8)


def test_a_lost_camera_is_found_by_what_it_sees(client):
    points, words = place(3)

    def seen_from(at):
        seen = points - at[:3, 3]
        pixels = FOCAL_PX * seen[:, :2] / seen[:, 2:] + CENTER_PX
        inside = ((pixels > 0) & (pixels < SIZE)).all(axis=1)
        return np.flatnonzero(inside), pixels[inside], seen[inside, 2]

    with client.ingest("room", "robot") as session:
        session.camera(0, *SIZE, K)
        for id in range(4):
            ids, pixels, depths = seen_from(pose(id))
            session.keyframe(
                id, id, pose(id), pixels, ids, depths, descriptors=words[ids], new_points=points[ids]
            )
        session.wait_optimized()
    at = pose(1) @ np.array([[1, 0, 0, 0.1], [0, 1, 0, -0.05], [0, 0, 1, 0.2], [0, 0, 0, 1.0]])
    ids, pixels, depths = seen_from(at)
    camera = covis.camera(0, *SIZE, K)
    found = client.localize("room", camera, pixels, words[ids], depths)
    assert found is not None
    assert np.allclose(found.world_from_camera, at, atol=1e-3)
    assert found.covariance.shape == (6, 6) and (np.linalg.eigvalsh(found.covariance) > 0).all()
    assert all(ids[feature] == landmark for feature, (_, landmark) in found.landmarks.items())
    assert len(found.landmarks) > 50
    _, others = place(4)
    assert client.localize("room", camera, pixels, others[: len(pixels)], depths) is None


def test_answers_of_many_messages_are_iterated(room):
    request = v1.ListKeyframesRequest(map_id="room", page_size=2)
    pages = [[entry.id for entry in page.keyframes] for page in room.answers(request)]
    assert pages == [[0, 1], [2, 3], [4]]
    for page in room.answers(request):
        assert page.keyframes
        break


def test_a_job_optimizes_a_map_while_nobody_waits(room):
    spec = v1.JobSpec(optimize_map=v1.OptimizeMapRequest(map_id="room"))
    assert room.create_job("nightly", spec, priority=5).priority == 5
    seen = [job.state for job in room.watch_job("nightly")]
    assert seen[-1] == v1.JobState.JOB_STATE_SUCCEEDED and seen == sorted(seen)
    ended = room.wait_job("nightly")
    assert ended.result.optimize_map.keyframe_count == 5
    assert [job.job_id for job in room.list_jobs("room")] == ["nightly"]
    assert room.list_jobs(states=[v1.JobState.JOB_STATE_RUNNING]) == []
    assert room.create_job("nightly", spec).job_id == "nightly"
    with pytest.raises(covis.FailedPrecondition):
        room.cancel_job("nightly")
    room.delete_job("nightly")
    with pytest.raises(covis.NotFound):
        room.get_job("nightly")
    with pytest.raises(covis.NotFound):
        room.wait_job("nightly")


def test_a_job_takes_files_and_gives_files(room, tmp_path):
    upload_id = room.upload_job_files(ROOT / "tests" / "golden" / "twins" / "window-6-80.txt")
    solve = v1.SolveFilesSpec(upload_id=upload_id, keep_solutions=True)
    room.create_job("solve", v1.JobSpec(solve_files=solve))
    job = room.wait_job("solve")
    assert job.cost_after < 0.1 * job.cost_before
    paths = room.download_job_files("solve", tmp_path)
    assert [path.relative_to(tmp_path).as_posix() for path in paths] == [file.path for file in job.files]
    assert [path.stat().st_size for path in paths] == [file.size_bytes for file in job.files]
    one = room.download_job_files("solve", tmp_path / "one", job.files[0].path)
    assert one[0].read_bytes() == paths[0].read_bytes()
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileNotFoundError, match="holds no file"):
        room.upload_job_files(tmp_path / "empty")


def test_a_job_rebuilds_a_file_from_its_observations(room):
    file = ROOT / "tests" / "golden" / "twins" / "window-6-80.txt"
    spec = v1.ReconstructSpec(upload_id=room.upload_job_files(file))
    room.create_job("anew", v1.JobSpec(reconstruct=spec))
    [problem] = room.wait_job("anew").result.reconstruct.problems
    assert problem.reconstruction.placed_keyframe_count == 6
    # A solve from the values that the file has ends at the same cost.
    solve = v1.SolveFilesSpec(upload_id=room.upload_job_files(file))
    room.create_job("from-values", v1.JobSpec(solve_files=solve))
    assert problem.summary.final_cost == pytest.approx(room.wait_job("from-values").cost_after, rel=1e-6)


def test_a_job_that_fails_says_why(room, tmp_path):
    (tmp_path / "bad.g2o").write_text("nonsense")
    solve = v1.SolveFilesSpec(upload_id=room.upload_job_files(tmp_path / "bad.g2o"))
    room.create_job("bad", v1.JobSpec(solve_files=solve))
    with pytest.raises(covis.JobFailed, match="job bad failed: .*line 1") as failed:
        room.wait_job("bad")
    assert failed.value.job.state == v1.JobState.JOB_STATE_FAILED
