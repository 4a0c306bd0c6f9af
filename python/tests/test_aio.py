"""The asyncio twins, and that the blocking classes are theirs."""

import asyncio
import inspect

import covis
import pytest
from conftest import GUARD_S
from covis import v1
from scene import AT_ONCE, K, SIZE, keyframe


def test_a_session_a_watch_and_a_solve_under_asyncio():
    async def drive():
        async with await covis.aio.local() as client:
            async with await client.ingest("room", "robot") as session:
                watched = await client.watch("room")
                await session.camera(0, *SIZE, K)
                # Tasks may send beside each other.
                await asyncio.gather(*(session.keyframe(**keyframe(id)) for id in range(5)))
                await session.wait_durable(timeout=GUARD_S)
                await session.wait_optimized(timeout=GUARD_S)
                await watched.wait(session.report.revision, GUARD_S)
                assert sorted(watched.poses) == [0, 1, 2, 3, 4]
            pages = [page async for page in client.answers(v1.ListKeyframesRequest(map_id="room"))]
            assert len(pages[0].keyframes) == 5
            result = await client.optimize("room")
            with pytest.raises(covis.NotFound):
                await client.get_map("attic")
            return session.report, result

    report, result = asyncio.run(drive())
    assert (report.sent, report.acknowledged) == (6, 6)
    assert result.keyframe_count == 5


def test_a_send_that_is_canceled_sends_nothing(server, proxy):
    async def drive():
        async with await covis.aio.connect(proxy.url) as client:
            async with await client.ingest("room", "robot", max_unanswered=1, retry=AT_ONCE) as session:
                proxy.hold(True)
                await session.camera(0, *SIZE, K)
                with pytest.raises(asyncio.TimeoutError):
                    await asyncio.wait_for(session.keyframe(**keyframe(0)), 0.1)
                proxy.hold(False)
                # The landmarks of the one that was given up come with the next.
                await session.keyframe(**keyframe(1))
                report = await session.finish(GUARD_S)
            return report, await client.get_map("room")

    report, found = asyncio.run(drive())
    assert (report.sent, report.acknowledged) == (2, 2)
    assert (found.counts.keyframe_count, found.counts.landmark_count) == (1, 60)


def test_closing_a_client_ends_its_sessions_and_watches(server):
    async def drive():
        client = await covis.aio.connect(server.url)
        session = await client.ingest("room", "robot")
        watched = await client.watch("room")
        await client.close()
        with pytest.raises(covis.Closed):
            await session.camera(0, *SIZE, K)
        with pytest.raises(covis.Closed):
            await watched.wait(99)
        files = [getattr(task.get_coro(), "cr_code").co_filename for task in asyncio.all_tasks()]
        assert not [file for file in files if file.startswith(covis.__path__[0])]

    asyncio.run(drive())


@pytest.mark.parametrize("name", ["Client", "Session", "Map", "connect", "local"])
def test_the_blocking_twin_has_the_same_signatures(name):
    ours, theirs = getattr(covis, name), getattr(covis.aio, name)
    pairs = [(name, theirs)] if inspect.isfunction(theirs) else inspect.getmembers(theirs)
    for name, member in pairs:
        if name[0] == "_":
            continue
        twin = ours if inspect.isfunction(ours) else getattr(ours, name)
        if isinstance(member, property):
            assert isinstance(twin, property)
            continue
        assert list(inspect.signature(twin).parameters) == list(inspect.signature(member).parameters)
        assert inspect.getdoc(twin) == inspect.getdoc(member)
