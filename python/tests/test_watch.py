"""Live mirrors: what they hold, how they follow, and that a bad delta changes nothing."""

import covis
import numpy as np
import pytest
from conftest import GUARD_S
from covis import v1
from covis._mirror import Mirror
from scene import LANDMARKS, POINTS, pose, send


def test_a_watch_returns_once_the_full_state_is_there(client):
    # What exact views say is compared.
    policy = v1.MapPolicy(odometry=False)
    with client.ingest("room", "robot", policy=policy) as session:
        send(session, 0, 1, 2)
        between = np.linalg.inv(pose(0)) @ pose(2)
        session.closure(7, 0, 2, between, covis.closure_information(0.1, 0.2))
    watched = client.watch("room")
    assert sorted(watched.poses) == [0, 1, 2]
    assert np.allclose(watched.poses[2], pose(2), atol=1e-6)
    assert watched.times[2] == 102.5
    assert sorted(watched.landmarks) == LANDMARKS.tolist()
    assert np.allclose(watched.landmarks[7], POINTS[7], atol=1e-5)
    assert watched.cameras[0].pinhole_radial_tangential.fx == 500
    offset = watched.map_from_odom("robot")
    assert np.allclose(offset @ pose(2, 0.01), watched.poses[2], atol=1e-9)
    assert watched.map_from_odom("nobody") is None
    assert watched.scale("robot") == watched.scale("nobody") == 1.0
    (closure,) = watched.closures
    assert (closure.keyframe_i, closure.keyframe_j) == (("robot", 0), ("robot", 2))
    assert np.allclose(closure.i_from_j, between)
    assert np.allclose(np.diag(closure.information), [100] * 3 + [25] * 3)
    assert closure.counts and closure.chi2 is None
    assert (watched.clients, watched.state) == (["robot"], "open")
    # What is handed out cannot change the mirror.
    with pytest.raises(ValueError):
        watched.poses[0][0, 0] = 2.0
    watched.poses.clear()
    assert len(watched.poses) == 3


def test_with_several_clients_the_names_are_pairs(client):
    for name in ("a", "b"):
        with client.ingest("room", name) as session:
            send(session, 0)
    with client.watch("room") as watched:
        assert sorted(watched.poses) == [("a", 0), ("b", 0)]
        assert ("b", 59) in watched.landmarks
        assert watched.trajectory("b").ids.tolist() == [0]
        with pytest.raises(ValueError, match=r"clients \['a', 'b'\]: say which"):
            watched.trajectory()
    with pytest.raises(ValueError, match="say which"):
        client.trajectory("room")


def test_changes_are_told_as_they_come(client):
    client.create_map("room")
    changes = []
    with client.watch("room", on_change=changes.append) as watched:
        with client.ingest("room", "robot") as session:
            send(session, 0)
            session.wait_optimized(timeout=GUARD_S)
            # A slow reader would get one delta for both, in which the landmark never was.
            watched.wait(session.report.revision, GUARD_S)
            session.send(v1.RemoveLandmarks(landmarks=[v1.LandmarkRef(id=5)]))
            session.wait_optimized(timeout=GUARD_S)
            watched.wait(session.report.revision, GUARD_S)
        assert 5 not in watched.landmarks and len(watched.landmarks) == 59
    assert changes[0].reset
    told = {key for change in changes for key in change.landmarks}
    assert told == {("robot", id) for id in LANDMARKS.tolist()}
    assert {key for change in changes for key in change.keyframes} == {("robot", 0)}
    assert [change.revision for change in changes] == sorted(change.revision for change in changes)


def test_a_watch_that_was_closed_says_so(client):
    client.create_map("room")
    watched = client.watch("room")
    watched.close()
    with pytest.raises(covis.Closed):
        watched.wait(99)
    with pytest.raises(covis.NotFound):
        client.watch("attic")


def part(base, revision, index, last, **fields):
    return v1.MapDelta(
        base_revision=base, revision=revision, part_index=index, last_part=last, map_uid="u", **fields
    )


def test_deltas_overwrite_remove_and_reset():
    mirror = Mirror()

    def mark(id):
        return v1.Landmark(client_id="a", id=id, point_in_world=v1.Vector3(x=id))

    parts = [part(0, 3, index, index == 1, reset=True, landmarks=[mark(index)]) for index in (0, 1)]
    assert mirror.apply(parts).reset
    assert (mirror.revision, len(mirror.landmarks), mirror.uid) == (3, 2, "u")
    gone = [v1.LandmarkRef(client_id="a", id=0)]
    changes = mirror.apply([part(3, 5, 0, True, landmarks=[mark(1)], removed_landmarks=gone)])
    assert changes.landmarks == [("a", 1), ("a", 0)]
    assert list(mirror.landmarks) == [("a", 1)]
    mirror.apply([part(0, 9, 0, True, reset=True)])
    assert (mirror.revision, mirror.landmarks, mirror.clients) == (9, {}, set())


@pytest.mark.parametrize(
    "parts",
    [
        [part(4, 5, 0, True)],
        [part(3, 5, 0, False)],
        [part(3, 5, 0, False), part(3, 6, 1, True)],
        [part(3, 5, 1, True)],
        [],
    ],
)
def test_a_gap_or_a_missing_part_is_refused_and_changes_nothing(parts):
    mirror = Mirror()
    mark = v1.Landmark(client_id="a", id=1)
    mirror.apply([part(0, 3, 0, True, reset=True, landmarks=[mark])])
    with pytest.raises(covis.Protocol):
        mirror.apply(parts)
    assert (mirror.revision, list(mirror.landmarks)) == (3, [("a", 1)])
