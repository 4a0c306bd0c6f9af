"""Sessions over a real loopback port: acks, waiting, back-pressure, refused items."""

import threading

import covis
import numpy as np
import pytest
from conftest import GUARD_S, Server
from covis import v1
from scene import K, LANDMARKS, POINTS, SIZE, keyframe, pose, send, view


def test_a_session_sends_takes_acks_and_reports(client):
    seen = []
    with client.ingest("room", "robot", lock_step=True, on_ack=seen.append) as session:
        assert (session.opened.epoch, session.next_sequence) == (1, 1)
        assert session.camera(0, *SIZE, K) == 1
        assert send(session, 1, 2, 3) == [2, 3, 4]
        session.wait_optimized(4, GUARD_S)
        between = np.linalg.inv(pose(1)) @ pose(3)
        session.odometry(0, 1, 3, between, covis.closure_information(0.01, 0.01))
        session.flush(GUARD_S)
        assert session.report.acknowledged == 5
        session.wait_durable(timeout=GUARD_S)
        report = session.finish(GUARD_S)
    assert (report.sent, report.acknowledged, report.rejected) == (5, 5, 0)
    assert (report.optimized, report.optimized_through, report.durable_through) == (3, 4, 5)
    assert (report.duplicates, report.reconnects, report.unanswered) == (0, 0, 0)
    received = [ack.sequence for ack in seen if ack.status == v1.AckStatus.ACK_STATUS_RECEIVED]
    assert received == [1, 2, 3, 4, 5]
    assert report.revision == client.get_map("room").revision


def test_a_session_waits_until_every_place_is_searched(client):
    descriptors = np.random.default_rng(7).integers(0, 256, (len(LANDMARKS), 32), np.uint8)
    with client.ingest("room", "robot") as session:
        session.camera(0, *SIZE, K)
        for id in range(6):
            session.keyframe(**keyframe(id), descriptors=descriptors, descriptor_name="orb")
        session.wait_settled(GUARD_S)
        assert client.get_map("room").pending_work == v1.PendingWork()
        pages = client.answers(v1.ListPlaceSearchesRequest(map_id="room"))
        assert sum(len(page.searches) for page in pages) == 6
        with client.watch("room") as watched:
            assert watched.pending_work == v1.PendingWork()
    before = client.map_digests("room")
    assert len(before.state_hash) == 32
    client.wait_settled("room", GUARD_S)
    assert client.map_digests("room") == before
    with pytest.raises(covis.NotFound):
        client.wait_settled("hall", GUARD_S)


def test_landmarks_are_declared_once_also_by_the_next_session(client):
    with client.ingest("room", "robot") as session:
        send(session, 0, 1)
    counts = client.get_map("room").counts
    assert (counts.keyframe_count, counts.landmark_count, counts.observation_count) == (2, 60, 120)
    with client.ingest("room", "robot") as session:
        session.camera(0, *SIZE, K)
        some = LANDMARKS[:10]
        more = np.concatenate([some, [1000]])
        pixels, _ = view(2)
        session.keyframe(2, 200.0, pose(2), np.vstack([pixels[:10], [5, 5]]), more)
    counts = client.get_map("room").counts
    assert (counts.keyframe_count, counts.landmark_count, counts.camera_count) == (3, 61, 1)


def test_a_frontend_that_starts_again_counts_on_from_the_ids_of_its_client(client, linked):
    def free(session):
        return session.next_keyframe_id, session.next_landmark_id

    with linked.ingest("room", "robot") as session:
        assert free(session) == (0, 0)
        session.camera(0, *SIZE, K)
        for count in (1, 2):
            session.keyframe(**keyframe(session.next_keyframe_id))
            assert free(session) == (count, len(LANDMARKS))
    with linked.ingest("room", "robot") as session:
        assert free(session) == (2, len(LANDMARKS))
        session.camera(0, *SIZE, K)
        session.keyframe(**keyframe(session.next_keyframe_id))
    with linked.ingest("room", "other") as session:
        assert free(session) == (0, 0)
    counts = client.get_map("room").counts
    assert (counts.keyframe_count, counts.landmark_count) == (3, len(LANDMARKS))


def test_a_refused_item_is_told_by_whoever_waits_and_the_session_goes_on(client, linked):
    with linked.ingest("room", "robot") as session:
        session.camera(0, *SIZE, K)
        bad = keyframe(0)
        bad["pixels"] = np.array(bad["pixels"])
        bad["pixels"][3, 0] = np.nan
        sequence = session.keyframe(**bad)
        with pytest.raises(covis.Rejected, match=r"keyframe.observations\[3\].pixel.x") as refused:
            session.wait_optimized(sequence, GUARD_S)
        assert refused.value.violations[0].reason == "NOT_FINITE"
        # Its landmarks were not declared by it: the next keyframe brings them.
        send(session, 1)
        session.wait_durable(timeout=GUARD_S)
        report = session.finish(GUARD_S)
    assert (report.acknowledged, report.rejected) == (2, 1)
    assert client.get_map("room").counts.landmark_count == 60


def test_a_refused_item_of_which_nobody_was_told_is_an_error_at_the_end(client):
    with pytest.raises(covis.Rejected, match="UNKNOWN_REFERENCE"):
        with client.ingest("room", "robot") as session:
            session.closure(0, 1, 2, np.eye(4), covis.closure_information(1, 1))
    told = []
    with client.ingest("room", "robot", on_rejected=told.append) as session:
        session.closure(0, 1, 2, np.eye(4), covis.closure_information(1, 1))
    assert [item.violations[0].reason for item in told] == ["UNKNOWN_REFERENCE"]


def test_what_is_too_large_or_out_of_order_is_not_sent(client):
    with client.ingest("room", "robot") as session:
        session.send(covis.camera(0, *SIZE, K), sequence=7)
        with pytest.raises(covis.SequenceOrder, match="7 is not above 7"):
            session.send(covis.camera(1, *SIZE, K), sequence=7)
        count = 200_000
        with pytest.raises(covis.TooLarge) as refused:
            session.landmarks(np.arange(count), np.zeros((count, 3)))
        assert refused.value.limit == session.opened.max_message_bytes
        with pytest.raises(TypeError, match="covis.v1.Map is no item"):
            session.send(v1.Map())
        # Landmarks that were not sent are declared by the keyframe that sees them.
        send(session, 1)
        assert session.finish(GUARD_S).acknowledged == 2
    assert client.get_map("room").counts.landmark_count == 60


def test_the_error_that_ends_a_session_has_the_items_without_an_answer(client, linked, proxy):
    retry = covis.RetryPolicy(max_attempts=2, first_delay_s=0.0, longest_delay_s=0.0)
    with pytest.raises(covis.RetriesExhausted) as given_up:
        with linked.ingest("room", "robot", retry=retry) as session:
            send(session, 0)
            session.wait_durable(timeout=GUARD_S)
            proxy.hold(True)
            send(session, 1, 2)
            session.set_camera(covis.camera(0, *SIZE, K, [0.01, 0, 0, 0]))
            proxy.close()
            proxy.cut()
            session.flush(GUARD_S)
    kept = given_up.value.unanswered
    assert [request.WhichOneof("item") for request in kept] == ["keyframe", "keyframe", "set_camera"]
    assert session.unanswered == kept
    with client.ingest("room", "robot") as again:
        for request in kept:
            again.send(request, sequence=request.sequence)
        with pytest.raises(TypeError, match="without an item"):
            again.send(v1.IngestRequest())
        assert again.finish(GUARD_S).acknowledged == 3


def test_arguments_that_do_not_fit_send_nothing(client):
    with client.ingest("room", "robot") as session:
        with pytest.raises(ValueError, match="the session has no camera"):
            session.keyframe(**keyframe(0))
        session.camera(0, *SIZE, K)
        session.camera(1, *SIZE, K)
        with pytest.raises(ValueError, match=r"cameras \[0, 1\]: say which"):
            session.keyframe(**keyframe(0))
        with pytest.raises(ValueError, match="new_points must be N×3"):
            session.keyframe(**{**keyframe(0), "new_points": POINTS[:, :2]}, camera=1)
        session.keyframe(**keyframe(0), camera=1)
        assert session.finish(GUARD_S).sent == 3


def test_sending_waits_while_too_many_items_are_unanswered(linked, proxy):
    with linked.ingest("room", "robot", max_unanswered=2) as session:
        proxy.hold(True)
        send(session, 0)
        is_sent = threading.Event()

        def third():
            send(session, 1)
            is_sent.set()

        sender = threading.Thread(target=third)
        sender.start()
        assert session.report.sent == 2
        with pytest.raises(TimeoutError, match="no answers within 0.1 s"):
            session.flush(0.1)
        assert not is_sent.is_set(), "the outbox is full"
        proxy.hold(False)
        sender.join(GUARD_S)
        send(session, *range(2, 6))
        report = session.finish(GUARD_S)
    assert (report.sent, report.acknowledged) == (7, 7)


def test_priors_edits_and_observations_are_items_too(client):
    with client.ingest("room", "robot") as session:
        send(session, 0, 1)
        session.position_prior(0, 0, pose(0)[:3, 3], covis.position_information(0.01))
        session.pose_prior(1, ("robot", 1), pose(1), covis.closure_information(0.01, 0.01))
        session.landmarks([100, 101], [[0, 0, 4.0], [np.nan] * 3])
        session.observations(1, [[320, 240], [330, 240]], [100, 101])
        session.send(v1.RemoveLandmarks(landmarks=[v1.LandmarkRef(id=101)]))
        session.set_camera(covis.camera(0, *SIZE, K, [0.01, 0, 0, 0]))
        session.wait_optimized(timeout=GUARD_S)
        # A landmark that was removed is declared again.
        session.keyframe(2, 103.0, pose(2), [[5, 5]], [101])
        assert session.finish(GUARD_S).acknowledged == 10
    counts = client.get_map("room").counts
    assert (counts.constraint_count, counts.landmark_count) == (2, 62)


def test_a_keyframe_sent_again_is_recognized_and_waits_for_no_solve(client):
    with client.ingest("room", "robot") as session:
        send(session, 0, 1)
        session.wait_optimized(timeout=GUARD_S)
    with client.ingest("room", "robot") as session:
        session._twin._landmarks.clear()
        send(session, 0)
        session.wait_optimized(timeout=GUARD_S)
        report = session.finish(GUARD_S)
    assert (report.acknowledged, report.duplicates) == (2, 2)


def test_a_callback_that_fails_or_blocks_does_not_end_the_session(client):
    failures = []

    def blocks(ack):
        try:
            session.flush()
        except RuntimeError as error:
            failures.append(str(error))
        raise ValueError("the program's own mistake")

    with client.ingest("room", "robot", on_ack=blocks) as session:
        send(session, 0)
        assert session.finish(GUARD_S).acknowledged == 2
    assert failures and "must not call blocking methods" in failures[0]


def test_after_an_exception_the_session_ends_at_once(client):
    with pytest.raises(KeyError):
        with client.ingest("room", "robot") as session:
            raise KeyError("the program's own")
    with pytest.raises(covis.Closed):
        send(session, 0)


def test_nothing_becomes_durable_on_a_server_in_memory(tmp_path):
    server = Server(tmp_path, in_memory=True)
    with covis.connect(server.url) as client:
        with client.ingest("room", "robot") as session:
            send(session, 0)
            with pytest.raises(covis.NotDurable):
                session.wait_durable()
            session.wait_optimized(timeout=GUARD_S)
    server.stop()
