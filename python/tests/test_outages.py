"""The Rust client's outage scenarios: links cut anywhere, servers that are killed, fenced epochs.

`linked` and `connect` are the client that is tested, `client` looks at the server past it: cpp/tests runs
the same scenarios with the client in C++.
"""

import covis
import numpy as np
import pytest
from conftest import GUARD_S, Server
from covis import v1
from proxy import ANSWERS, REQUESTS, Proxy
from scene import AT_ONCE, K, SIZE, keyframe, pose, send

PROBING = covis.LinkOptions(keep_alive_s=0.3, keep_alive_timeout_s=0.3)
"""A link that is probed often."""


def holds(client, count):
    """Waits until the server's map holds so many keyframes."""
    with client.watch("room") as watched:
        watched.wait_until(lambda: len(watched.poses) >= count, GUARD_S)


def test_a_broken_link_is_resumed_and_lost_acks_do_no_harm(client, linked, proxy):
    with linked.ingest("room", "robot", retry=AT_ONCE) as session:
        send(session, 0)
        session.flush(GUARD_S)
        # The server takes three keyframes whose acks are lost with the link.
        proxy.hold(True)
        send(session, 1, 2, 3)
        holds(client, 4)
        proxy.cut()
        proxy.hold(False)
        send(session, 4, 5, 6, 7)
        session.wait_durable(timeout=GUARD_S)
        report = session.finish(GUARD_S)
    assert (report.sent, report.acknowledged, report.rejected) == (9, 9, 0)
    assert report.duplicates == 3, "sent again and recognized"
    assert report.reconnects >= 1
    found = client.get_map("room")
    assert found.counts.keyframe_count == 8
    assert found.clients[0].epoch >= 2
    assert found.clients[0].next_sequence == 10


def drive(connect, url, map_id):
    """Six keyframes and a closure through a link; the session's report."""
    with connect(url) as client:
        with client.ingest(map_id, "robot", retry=AT_ONCE, lock_step=True) as session:
            send(session, *range(6))
            between = np.linalg.inv(pose(0)) @ pose(5)
            session.closure(0, 0, 5, between, covis.closure_information(0.01, 0.01))
            session.wait_durable(timeout=GUARD_S)
            session.wait_optimized(timeout=GUARD_S)
            return session.finish(GUARD_S)


def digest(client, map_id):
    return client.call(v1.GetMapRequest(map_id=map_id, include_digests=True)).state_hash


def test_a_link_that_is_cut_at_any_byte_loses_and_doubles_nothing(server, client, connect, proxy):
    report = drive(connect, proxy.url, "whole")
    assert (report.acknowledged, report.duplicates, report.reconnects) == (8, 0, 0)
    whole = digest(client, "whole")
    reconnects = 0
    # Connections begin with the same bytes, so that a count names the same place in each run. A cut
    # before the session is open is the caller's; those begin after it.
    with covis.connect(server.url) as direct:
        for direction, start, pieces in ((REQUESTS, 1_000, 24), (ANSWERS, 1_500, 12)):
            for count in np.linspace(start, proxy.passed[direction], pieces, endpoint=False).astype(int):
                map_id = f"{direction}-{count}"
                with Proxy(server.port) as link:
                    link.cut_after(direction, int(count))
                    report = drive(connect, link.url, map_id)
                assert (report.sent, report.acknowledged, report.rejected) == (8, 8, 0), map_id
                assert report.optimized_through == 8
                reconnects += report.reconnects
                assert digest(direct, map_id) == whole, map_id
    assert reconnects >= 18, "most of the cuts come before the end"


def test_a_server_that_is_killed_and_started_again_loses_nothing(server, client, proxy, linked):
    with linked.ingest("room", "robot", retry=AT_ONCE) as session:
        send(session, 0, 1)
        session.wait_durable(timeout=GUARD_S)
        for first in (2, 5, 8):
            send(session, first)
            server.kill()
            send(session, first + 1, first + 2)
            server.start()
            proxy.lead_to(server.port)
            session.flush(GUARD_S)
        session.wait_durable(timeout=GUARD_S)
        session.wait_optimized(timeout=GUARD_S)
        report = session.finish(GUARD_S)
    assert (report.sent, report.acknowledged, report.rejected) == (12, 12, 0)
    assert report.reconnects == 3
    with covis.connect(server.url) as fresh:
        assert fresh.get_map("room").counts.keyframe_count == 11


def test_the_next_session_goes_on_where_a_killed_program_was(client, linked):
    first = linked.ingest("room", "robot")
    send(first, 0, 1, 2)
    first.wait_durable(timeout=GUARD_S)
    first.abort()
    with linked.ingest("room", "robot") as session:
        assert session.next_sequence == 5
        session.camera(0, *SIZE, K)
        send(session, 3)
        assert session.finish(GUARD_S).duplicates == 1
    assert client.get_map("room").counts.keyframe_count == 4


def test_the_retries_are_bounded(linked, proxy):
    retry = covis.RetryPolicy(max_attempts=3, first_delay_s=0.0, longest_delay_s=0.0)
    session = linked.ingest("room", "robot", retry=retry)
    session.camera(0, *SIZE, K)
    session.flush(GUARD_S)
    proxy.close()
    proxy.cut()
    # The session may have given up before the item or after it.
    with pytest.raises(covis.RetriesExhausted) as given_up:
        session.keyframe(**keyframe(0))
        session.flush(GUARD_S)
    assert given_up.value.attempts == 3
    assert isinstance(given_up.value.__cause__, covis.CovisError)
    with pytest.raises(covis.RetriesExhausted):
        send(session, 1)


def test_a_newer_session_takes_over_and_the_older_one_does_not_fight_back(linked):
    old = linked.ingest("room", "robot")
    old.camera(0, *SIZE, K)
    old.flush(GUARD_S)
    with linked.ingest("room", "robot") as new:
        assert (new.opened.epoch, new.next_sequence) == (2, 2)
        with pytest.raises(covis.Fenced):
            old.finish(GUARD_S)
        new.camera(0, *SIZE, K)
        send(new, 1)
        assert new.finish(GUARD_S).acknowledged == 2


@pytest.mark.parametrize("is_made_again", [False, True])
def test_a_server_that_lost_the_map_is_a_clear_error(tmp_path, connect, is_made_again):
    (tmp_path / "old").mkdir()
    (tmp_path / "new").mkdir()
    old = Server(tmp_path / "old", in_memory=True)
    new = Server(tmp_path / "new", in_memory=True)
    with Proxy(old.port) as proxy, connect(proxy.url) as client:
        session = client.ingest("room", "robot", retry=AT_ONCE)
        session.camera(0, *SIZE, K)
        session.flush(GUARD_S)
        # Another process with an empty journal answers at the same address.
        if is_made_again:
            with covis.connect(new.url) as other:
                other.create_map("room")
        proxy.lead_to(new.port)
        proxy.cut()
        with pytest.raises(covis.MapReplaced if is_made_again else covis.ServerRestarted):
            session.finish(GUARD_S)
    old.stop()
    new.stop()


def test_a_session_finds_a_link_that_is_half_open_and_resumes(client, connect, proxy):
    with connect(proxy.url, link=PROBING) as linked:
        with linked.ingest("room", "robot", retry=AT_ONCE) as session:
            send(session, 0)
            session.flush(GUARD_S)
            proxy.freeze()
            send(session, *range(1, 8))
            report = session.finish(GUARD_S)
    assert (report.sent, report.acknowledged, report.rejected) == (9, 9, 0)
    assert report.reconnects >= 1
    found = client.get_map("room")
    assert (found.counts.keyframe_count, found.clients[0].next_sequence) == (8, 10)


def test_a_watch_over_a_link_that_is_half_open_goes_on(client, connect, proxy):
    client.create_map("room")
    with connect(proxy.url, link=PROBING) as linked:
        with linked.watch("room", retry=AT_ONCE) as watched:
            proxy.freeze()
            with client.ingest("room", "robot") as session:
                send(session, 0, 1, 2)
            watched.wait_until(lambda: len(watched.poses) == 3, GUARD_S)


def test_a_call_over_a_link_that_is_half_open_ends_by_its_deadline(connect, proxy):
    with connect(proxy.url, link=covis.LinkOptions(deadline_s=0.3)) as linked:
        linked.server_info()
        proxy.freeze()
        with pytest.raises(covis.DeadlineExceeded):
            linked.server_info()


def test_an_optimized_that_was_lost_with_the_link_is_told_by_the_next_one(client, linked, proxy):
    told = []

    def on_ack(ack):
        if ack.status == v1.AckStatus.ACK_STATUS_OPTIMIZED:
            told.append(ack.sequence)

    with linked.ingest("room", "robot", retry=AT_ONCE, on_ack=on_ack) as session:
        send(session, 0, 1)
        session.wait_optimized(timeout=GUARD_S)
        # The solve ends while nothing comes through to the client.
        proxy.hold(True)
        sequence = send(session, 2)[0]
        with client.ingest("room", "other") as other:
            # The engine is at rest once a later item of another client is optimized.
            holds(client, 3)
            other.camera(0, *SIZE, K)
            send(other, 0)
            other.wait_optimized(timeout=GUARD_S)
        proxy.cut()
        proxy.hold(False)
        session.wait_optimized(sequence, GUARD_S)
        report = session.finish(GUARD_S)
    assert (report.acknowledged, report.optimized_through) == (4, 4)
    assert told[-1] == 4


def test_a_mirror_follows_the_map_over_a_broken_link(client, linked, proxy):
    client.create_map("room")
    watched = linked.watch("room", retry=AT_ONCE)
    with client.ingest("room", "robot") as session:
        send(session, 0)
        session.wait_optimized(timeout=GUARD_S)
        watched.wait(session.report.revision, GUARD_S)
        assert (len(watched.poses), len(watched.landmarks)) == (1, 60)
        proxy.cut()
        send(session, 1, 2, 3)
        session.closure(0, 0, 3, np.linalg.inv(pose(0)) @ pose(3), covis.closure_information(0.01, 0.01))
        report = session.finish(GUARD_S)
    watched.wait(report.revision, GUARD_S)
    # The server goes on with the closure after the last ack.
    client.wait_settled("room", timeout=GUARD_S)
    watched.wait(client.get_map("room").revision, GUARD_S)
    assert (len(watched.poses), len(watched.constraints)) == (4, 1)
    assert watched.map_from_odom("robot") is not None
    with client.watch("room") as fresh:
        assert fresh.poses.keys() == watched.poses.keys()
        assert all(np.array_equal(fresh.poses[id], watched.poses[id]) for id in range(4))
        assert all(np.array_equal(fresh.landmarks[id], p) for id, p in watched.landmarks.items())
    client.delete_map("room")
    with pytest.raises(covis.NotFound):
        watched.wait_until(lambda: False, GUARD_S)


def test_items_without_an_answer_are_given_back_and_the_next_session_sends_them(client, linked, proxy):
    retry = covis.RetryPolicy(max_attempts=3, first_delay_s=0.0, longest_delay_s=0.0)
    session = linked.ingest("room", "robot", retry=retry)
    send(session, 0)
    session.wait_durable(timeout=GUARD_S)
    assert not session.unanswered
    # The acks of these are lost with the link, and the link does not come back.
    proxy.hold(True)
    sent = send(session, 1, 2, 3)
    proxy.close()
    proxy.cut()
    with pytest.raises(covis.RetriesExhausted):
        session.flush(GUARD_S)
    assert [request.sequence for request in session.unanswered] == sent
    with client.ingest("room", "robot") as again:
        for request in session.unanswered:
            again.send(request, sequence=request.sequence)
        report = again.finish(GUARD_S)
    assert (report.acknowledged, report.rejected) == (3, 0)
    assert client.get_map("room").counts.keyframe_count == 4


def test_a_wait_until_the_map_is_settled_goes_on_over_a_broken_link(client, linked, proxy):
    with linked.ingest("room", "robot", retry=AT_ONCE) as session:
        send(session, *range(6))
        proxy.cut()
        session.wait_settled(GUARD_S)
        # The ack comes over another link, and may arrive after the map is settled.
        session.wait_optimized(timeout=GUARD_S)
        assert session.report.optimized_through == 7
    linked.wait_settled("room", GUARD_S)
    assert client.get_map("room").pending_work == v1.PendingWork()
