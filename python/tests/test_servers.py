"""Several servers that share maps: a client finds the one that has its map, and follows where it goes.

Who does not have the map is played by a gRPC server that answers everything as a server of covis does
then; who has it is a real one.
"""

import asyncio
from collections import Counter
from concurrent.futures import ThreadPoolExecutor

import covis
import grpc
import pytest
from conftest import GUARD_S, Server
from covis._link import Credentials, Link, LinkOptions
from covis._retry import RetryPolicy
from google.protobuf.any_pb2 import Any
from google.rpc.error_details_pb2 import ErrorInfo
from google.rpc.status_pb2 import Status
from scene import K, SIZE, keyframe


QUICK = RetryPolicy(max_attempts=1000, first_delay_s=0.001, longest_delay_s=0.01)


def details(owner):
    """The status of a call for a map that `owner` has, or nobody knows who."""
    metadata = {} if owner is None else {"owner": owner}
    packed = Any()
    packed.Pack(ErrorInfo(reason="MAP_OWNED_ELSEWHERE", domain="covis", metadata=metadata))
    return Status(code=14, message="another server has the map", details=[packed]).SerializeToString()


class Elsewhere(grpc.GenericRpcHandler):
    """A server that is healthy and has no map; `owner` has them."""

    def __init__(self, owner):
        self.owner = owner
        self._server = grpc.server(ThreadPoolExecutor(4), handlers=[self])
        self.url = f"http://127.0.0.1:{self._server.add_insecure_port('127.0.0.1:0')}"
        self._server.start()

    def service(self, call):
        def answer(_requests, context):
            if call.method.endswith("/Check"):
                yield b"\x08\x01"
                return
            context.set_trailing_metadata((("grpc-status-details-bin", details(self.owner)),))
            context.abort(grpc.StatusCode.UNAVAILABLE, "another server has the map")

        return grpc.stream_stream_rpc_method_handler(answer)

    def stop(self):
        self._server.stop(None).wait(GUARD_S)


@pytest.fixture
def elsewhere(server):
    running = Elsewhere(server.url)
    yield running
    running.stop()


class Starting(grpc.GenericRpcHandler):
    """In front of a server: refuses the first two calls of each method, with a reason as one that still
    opens its maps, without one as a link that breaks. Then it hands calls on."""

    def __init__(self, server, reason):
        self._reason = reason
        self.calls = Counter()
        self._behind = grpc.insecure_channel(server.url.removeprefix("http://"))
        self._server = grpc.server(ThreadPoolExecutor(8), handlers=[self])
        self.url = f"http://127.0.0.1:{self._server.add_insecure_port('127.0.0.1:0')}"
        self._server.start()

    def service(self, call):
        name = call.method.rpartition("/")[2]

        def answer(requests, context):
            self.calls[name] += 1
            if self.calls[name] > 2 or name == "Check":
                answers = self._behind.stream_stream(call.method)(requests)
                try:
                    yield from answers
                except grpc.RpcError:
                    context.set_trailing_metadata(answers.trailing_metadata())
                    context.abort(answers.code(), answers.details())
                return
            if self._reason:
                packed = Any()
                packed.Pack(ErrorInfo(reason=self._reason, domain="covis"))
                status = Status(code=14, details=[packed]).SerializeToString()
                context.set_trailing_metadata((("grpc-status-details-bin", status),))
            context.abort(grpc.StatusCode.UNAVAILABLE, "not now")

        return grpc.stream_stream_rpc_method_handler(answer)

    def stop(self):
        self._server.stop(None).wait(GUARD_S)
        self._behind.close()


def test_calls_wait_for_a_server_that_still_opens_its_maps(server, connect):
    starting = Starting(server, "STARTING")
    with connect(starting.url) as client:
        with client.ingest("room", "robot", retry=QUICK) as session:
            session.camera(0, *SIZE, K)
            session.keyframe(**keyframe(0))
            session.wait_settled(GUARD_S)
        client.server_info()
    wanted = {"GetMap", "CreateMap", "GetServerInfo", "Ingest"}
    assert wanted <= {name for name, count in starting.calls.items() if count > 2}
    starting.stop()
    with covis.connect(server.url) as direct:
        assert direct.get_map("room").counts.keyframe_count == 1


def test_over_a_link_that_breaks_only_calls_that_change_nothing_are_made_again(server):
    breaking = Starting(server, None)
    with covis.connect(breaking.url, link=LinkOptions(retry=QUICK)) as client:
        assert client.list_maps() == []
        assert breaking.calls["ListMaps"] == 3
        with pytest.raises(covis.RpcError) as broken:
            client.create_map("room")
        assert (broken.value.code, breaking.calls["CreateMap"]) == (grpc.StatusCode.UNAVAILABLE, 1)
    once = RetryPolicy(max_attempts=1)
    with covis.connect(breaking.url, link=LinkOptions(retry=once)) as client:
        with pytest.raises(covis.RpcError, match="GetServerInfo: not now"):
            client.server_info()
    assert breaking.calls["GetServerInfo"] == 1
    breaking.stop()


def test_the_first_server_that_answers_is_taken(server, tmp_path):
    (tmp_path / "gone").mkdir()
    gone = Server(tmp_path / "gone", in_memory=True)
    gone.kill()
    with covis.connect(f"{gone.url}, {server.url}") as client:
        assert client.url == server.url
        assert client.list_maps() == []
    with pytest.raises(covis.Unreachable, match=gone.url):
        covis.connect(f"{gone.url},{gone.url}")
    with pytest.raises(covis.InvalidUrl):
        covis.connect(f"{server.url},nonsense")


def test_calls_sessions_and_watches_go_to_the_server_that_has_the_map(server, elsewhere):
    with covis.connect(elsewhere.url) as client:
        with client.ingest("room", "robot") as session:
            session.camera(0, *SIZE, K)
            session.keyframe(**keyframe(0))
        map = client.watch("room")
        map.wait(session.report.revision, GUARD_S)
        assert list(map.poses) == [0]
        assert len(client.trajectory("room").times) == 1
        assert client.url == server.url
    with covis.connect(server.url) as direct:
        assert direct.get_map("room").counts.keyframe_count == 1


def test_a_session_and_a_watch_go_to_the_server_that_has_the_map(server, client, elsewhere, connect):
    client.create_map("room")
    with connect(elsewhere.url) as led:
        with led.ingest("room", "robot", retry=QUICK) as session:
            session.camera(0, *SIZE, K)
            session.keyframe(**keyframe(0))
            session.wait_durable(timeout=GUARD_S)
        with led.watch("room", retry=QUICK) as watched:
            watched.wait_until(lambda: len(watched.poses) == 1, GUARD_S)
    assert client.get_map("room").counts.keyframe_count == 1


def test_a_session_asks_again_who_has_the_map_when_its_server_is_gone(server, elsewhere, connect):
    with connect(elsewhere.url) as led:
        with led.ingest("room", "robot", retry=QUICK) as session:
            session.camera(0, *SIZE, K)
            session.keyframe(**keyframe(0))
            session.wait_durable(timeout=GUARD_S)
            server.kill()
            session.keyframe(**keyframe(1))
            # The map is served again, at another address, which the client was not given.
            server.start()
            elsewhere.owner = server.url
            session.wait_durable(timeout=GUARD_S)
            assert session.report.reconnects >= 1
    with covis.connect(server.url) as direct:
        assert direct.get_map("room").counts.keyframe_count == 2


def test_the_second_server_is_asked_where_the_first_is_gone(server, tmp_path, connect):
    (tmp_path / "gone").mkdir()
    gone = Server(tmp_path / "gone", in_memory=True)
    gone.kill()
    with connect(f"{gone.url},{server.url}") as led:
        assert led.server_info()


def test_a_server_that_names_itself_does_not_hold_a_call_for_ever(elsewhere):
    elsewhere.owner = elsewhere.url
    with covis.connect(elsewhere.url) as client:
        with pytest.raises(covis.RpcError, match="MAP_OWNED|another server has the map"):
            client.get_map("room")


def test_a_link_goes_to_the_owner_and_back_and_on_when_the_owner_is_gone():
    class Ended:
        """What gRPC tells of a call."""

        def __init__(self, metadata=()):
            self._metadata = metadata

        def code(self):
            return grpc.StatusCode.UNAVAILABLE

        def details(self):
            return "gone"

        def trailing_metadata(self):
            return self._metadata

    def named(owner):
        return covis.RpcError("GetMap", Ended((("grpc-status-details-bin", details(owner)),)))

    async def play():
        link = Link("http://127.0.0.1:1,http://127.0.0.1:2", Credentials(), LinkOptions())
        broken = covis.RpcError("GetMap", Ended())
        assert link.follow(named("http://127.0.0.1:3")) and link.url.endswith(":3")
        # Who named it may know the next owner.
        assert not link.follow(broken) and link.url.endswith(":1")
        assert not link.follow(broken) and link.url.endswith(":2")
        assert not link.follow(named(None)) and link.url.endswith(":1")
        apart = link.apart()
        assert apart.follow(named("http://127.0.0.1:3"))
        assert apart.url.endswith(":3") and link.url.endswith(":1")
        # An address that is none is not followed.
        assert not link.follow(named("nowhere")) and link.url.endswith(":1")
        await link.close()

    asyncio.run(play())
