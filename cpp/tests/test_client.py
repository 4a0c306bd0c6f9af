"""What the C++ client does besides outages: the same map as Python's, refused items, the example."""

import os
import subprocess

import covis
import numpy as np
import pytest
from conftest import GUARD_S
from scene import K, POINTS, SIZE, keyframe, pose, view
from test_outages import digest, drive
from test_session import (  # noqa: F401
    test_a_frontend_that_starts_again_counts_on_from_the_ids_of_its_client,
    test_a_refused_item_is_told_by_whoever_waits_and_the_session_goes_on,
)


def test_a_map_from_cpp_is_the_map_from_python(server, client, connect):
    drive(covis.connect, server.url, "python")
    drive(connect, server.url, "cpp")
    assert digest(client, "cpp") == digest(client, "python")


def test_a_refused_item_of_which_nobody_was_told_is_an_error_at_the_end(linked):
    session = linked.ingest("room", "robot")
    session.closure(0, 1, 2, np.eye(4), covis.closure_information(1, 1))
    with pytest.raises(covis.Rejected, match="UNKNOWN_REFERENCE"):
        session.finish(GUARD_S)


def test_landmarks_are_declared_once_also_by_the_next_session(client, linked):
    for first in (0, 1):
        with linked.ingest("room", "robot") as session:
            session.camera(0, *SIZE, K)
            session.keyframe(**keyframe(first))
    counts = client.get_map("room").counts
    assert (counts.keyframe_count, counts.landmark_count) == (2, 60)


def test_a_pose_is_refined_over_known_points(linked):
    pixels, _ = view(1)
    assert np.allclose(linked.refine_pose(K, pose(1, 0.05), POINTS, pixels), pose(1), atol=1e-6)
    with pytest.raises(covis.InvalidArgument, match="observations"):
        linked.refine_pose(K, pose(1), POINTS[:2], pixels[:2])


def test_an_item_that_is_too_large_is_not_sent(linked):
    with linked.ingest("room", "robot") as session:
        with pytest.raises(covis.TooLarge, match="4194304"):
            session.landmarks(200_000)
        assert session.report.sent == 0


def test_a_wait_that_takes_too_long_says_so_and_an_abort_ends_it(linked, proxy):
    session = linked.ingest("room", "robot")
    proxy.hold(True)
    session.camera(0, *SIZE, K)
    with pytest.raises(TimeoutError, match="no answers within 1 ms"):
        session.flush(0.001)
    session.abort()
    with pytest.raises(covis.errors.Closed):
        session.flush(GUARD_S)
    proxy.hold(False)


def test_an_address_that_is_no_url_is_named(connect):
    with pytest.raises(covis.CovisError, match="invalid_url: 'ftp://127.0.0.1:1' is not the URL"):
        connect("ftp://127.0.0.1:1")


def test_watching_a_map_that_is_not_there_is_not_found(linked):
    with pytest.raises(covis.NotFound, match="room"):
        linked.watch("room")


@pytest.mark.parametrize("which", ["COVIS_CPP_EXAMPLE", "COVIS_CPP_INSTALLED_EXAMPLE"])
def test_the_example_ends_where_the_robot_is_although_its_odometry_drifts(server, which):
    """The one that was built with the library, and the one that `find_package(covis)` found."""
    done = subprocess.run(
        [os.environ[which], server.url], check=True, capture_output=True, text=True, timeout=GUARD_S
    )
    lines = done.stdout.splitlines()
    assert len(lines) == 24
    for line in lines:
        words = line.split()
        odometry, found, truth = (float(words[index]) for index in (3, 6, 9))
        assert abs(found - truth) < 0.04, line
    assert abs(odometry - truth) > 0.1, "odometry alone is far off at the end"
