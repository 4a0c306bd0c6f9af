"""Bytes that numpy writes are the messages that protobuf would write, point by point."""

import datetime

import covis
import numpy as np
import pytest
from covis import _items, _poses, _problems, _rows, v1
from covis.noise import kinect_sigma_m

RNG = np.random.default_rng(1)


@pytest.mark.parametrize("highest", [1, 127, 128, 16_383, 16_384, 2**31, 2**62])
def test_varints_of_any_width_are_those_of_protobuf(highest):
    values = np.unique(RNG.integers(1, highest, 200, endpoint=True))
    written = _rows.join(_rows.nested(1, _rows.integers(2, values)))
    batch = v1.RemoveLandmarks(landmarks=[v1.LandmarkRef(id=int(i)) for i in values])
    assert written == batch.SerializeToString()


@pytest.mark.parametrize("count", [0, 1, 300])
def test_observations_are_those_that_protobuf_makes_one_by_one(count):
    ids = RNG.integers(0, 100_000, count)
    pixels = RNG.uniform(0, 640, (count, 2))
    depths = np.where(RNG.random(count) < 0.3, np.nan, RNG.uniform(0.5, 5, count))
    sigma_px = RNG.uniform(0.5, 2, count)
    words = RNG.integers(0, 256, (count, 32), np.uint8)
    measured = _items.measurements(pixels, depths, None, sigma_px, 3)
    described = _items.descriptor(7, words, count, "orb", None)
    found = v1.Keyframe.FromString(_items.observations(9, ids, measured, described))
    expected = v1.Keyframe()
    for row in range(count):
        entry = expected.observations.add(sigma_px=sigma_px[row])
        entry.landmark.id = ids[row]
        entry.landmark.SetInParent()
        entry.pixel.x, entry.pixel.y = pixels[row]
        if not np.isnan(depths[row]):
            entry.depth_m = depths[row]
            entry.sigma_depth_m = kinect_sigma_m(depths[row])
        entry.descriptor.kind = v1.DescriptorKind.DESCRIPTOR_KIND_BINARY
        entry.descriptor.name = "orb"
        entry.descriptor.data = words[row].tobytes()
    assert found == expected


def test_landmarks_without_a_position_are_left_to_the_server():
    points = np.array([[1.0, 2.0, 3.0], [np.nan] * 3])
    found = v1.Keyframe.FromString(_items.landmarks(10, np.array([3, 500]), points)).landmarks
    assert [mark.id for mark in found] == [3, 500]
    assert found[0].point_in_world == v1.Vector3(x=1, y=2, z=3)
    assert not found[1].HasField("point_in_world")


def test_sigmas_that_are_missing_take_the_model_of_the_sensor():
    depths = np.array([1.0, 2.0, 0.0])
    measured = _items.measurements(np.zeros((3, 2)), depths, [0.1, np.nan, np.nan], None, 3)
    raw = _items.observations(9, np.arange(3), measured, [])
    found = v1.Keyframe.FromString(raw).observations
    assert [entry.sigma_depth_m for entry in found[:2]] == [0.1, 1.425e-3 * 4]
    assert not found[2].HasField("depth_m") and not found[2].HasField("sigma_depth_m")


def test_a_request_is_the_bytes_of_its_message():
    camera = _items.camera(7, 640, 480, [[500, 0, 320], [0, 501, 240], [0, 0, 1]], [0.1, 0.2, 0, 0], "pinhole")
    raw = _items.request(300, _items.field_of(camera), camera.SerializeToString())
    assert raw == v1.IngestRequest(sequence=300, camera=camera).SerializeToString()
    assert camera.pinhole_radial_tangential.k2 == 0.2


@pytest.mark.parametrize(
    "t",
    [
        1_700_000_000.25,
        np.datetime64(1_700_000_000_250_000_000, "ns"),
        datetime.datetime(2023, 11, 14, 22, 13, 20, 250_000, datetime.timezone.utc),
    ],
)
def test_times_of_all_kinds_are_the_same(t):
    stamp = _items.timestamp(t)
    assert (stamp.seconds, stamp.nanos) == (1_700_000_000, 250_000_000)


def test_a_time_just_below_a_second_carries_over():
    stamp = _items.timestamp(0.9999999999)
    assert (stamp.seconds, stamp.nanos) == (1, 0)


def rotations(count):
    quaternions = RNG.normal(size=(count, 4))
    # Half turns about each axis, where the scalar part is 0.
    quaternions[:3] = np.eye(4)[:3]
    return _poses.rotations(quaternions)


def test_quaternions_and_matrices_are_each_other():
    matrices = rotations(500)
    quaternions = _poses.quaternions(matrices)
    assert np.allclose(np.linalg.norm(quaternions, axis=1), 1.0)
    assert np.allclose(_poses.rotations(quaternions), matrices, atol=1e-12)
    quarter = _poses.quaternions(np.array([[[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]]))
    assert np.allclose(np.abs(quarter), [[0, 0, np.sqrt(0.5), np.sqrt(0.5)]])


def test_a_pose_is_split_and_joined():
    for rotation in rotations(20):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation, RNG.normal(size=3)
        assert np.allclose(covis.join_pose(*covis.split_pose(pose)), pose)


def test_a_bundle_of_arrays_is_the_message_made_one_by_one():
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[:, :3, :3] = rotations(5)[3:]
    poses[:, :3, 3] = RNG.normal(size=(2, 3))
    points = RNG.normal(size=(3, 3))
    pixels = RNG.uniform(0, 100, (4, 2))
    camera = v1.Camera(snavely=v1.Snavely(focal=500))
    found = _problems.bundle(
        [camera], poses, points, [0, 0, 1, 1], [0, 1, 1, 2], pixels, None, None, 0.5, None,
        np.array([True, False]), None,
    )  # fmt: skip
    assert [pose.fixed for pose in found.poses] == [True, False]
    assert np.allclose(_poses.from_messages([p.world_from_camera for p in found.poses]), poses)
    assert [(p.point_in_world.x, p.point_in_world.z) for p in found.points] == [(p[0], p[2]) for p in points]
    named = [(o.pose_index, o.point_index, o.pixel.y, o.sigma_px) for o in found.observations]
    assert named == [(0, 0, pixels[0, 1], 0.5), (0, 1, pixels[1, 1], 0.5),
                     (1, 1, pixels[2, 1], 0.5), (1, 2, pixels[3, 1], 0.5)]  # fmt: skip
    assert list(found.cameras) == [camera]


@pytest.mark.parametrize(
    "call, text",
    [
        (lambda: _poses.rigid("pose", np.eye(3)), r"pose must be 4×4, not of shape \(3, 3\)"),
        (lambda: _poses.rigid("pose", 2 * np.eye(4)), "pose is no rigid transform"),
        (lambda: _poses.rigid("pose", np.full((4, 4), np.nan)), "pose is no rigid transform"),
        (lambda: _poses.rigid("pose", np.full((4, 4), np.inf)), "pose is no rigid transform"),
        (lambda: _poses.rigid("pose", np.diag([1.0, 1, -1, 1])), "pose is no rigid transform"),
        (lambda: _items.ids("landmark_ids", [0.5]), "landmark_ids must be N integers, not float64"),
        (lambda: _items.ids("landmark_ids", [-1]), "landmark_ids must be at least 0, not -1"),
        (lambda: _items.measurements([[1, 2]], [1, 2], None, None, 3), "depths must be one a pixel, 1, not 2"),
        (lambda: _items.measurements([[1, 2]], None, 0.1, None, 3), "sigmas are those of depths"),
        (lambda: _items.descriptor(7, np.zeros((2, 32)), 1, "", None), "descriptors must be 1×D"),
        (lambda: _items.camera(0, 1, 1, np.ones((3, 3)), None, "pinhole"), "skew is not supported"),
        (lambda: _items.camera(0, 1, 1, np.eye(3), [1, 2], "pinhole"), "4 or 5 coefficients"),
        (lambda: _problems.loss("hubert:2"), "loss must be one of trivial, huber"),
        (lambda: _items.timestamp(float("nan")), "t must be a finite number"),
    ],
)
def test_what_has_the_wrong_shape_is_named(call, text):
    with pytest.raises(ValueError, match=text):
        call()
