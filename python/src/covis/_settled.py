"""Waiting until a map is settled: the server does nothing more to it by itself.

`GetMap` says what is pending; while something is, a watch that leaves out the entities says when nothing
is. A link that breaks is tried again as that of a watch.
"""

from __future__ import annotations

from contextlib import aclosing

from . import errors
from ._link import Link
from ._retry import Retries, RetryPolicy
from .v1 import GetMapRequest, Map, MapDelta, MapState, PendingWork, WatchMapRequest


async def wait_settled(link: Link, map_id: str, retry: RetryPolicy) -> None:
    """Waits until the server does nothing more to a map by itself."""
    retries = Retries(retry)
    while True:
        try:
            return await _settled(link, map_id, retries)
        except errors.CovisError as error:
            link.follow(error)
            await retries.wait(error)


async def _settled(link: Link, map_id: str, retries: Retries) -> None:
    """Waits over one link."""
    answer = await link.unary_once(GetMapRequest(map_id=map_id), link.deadline_s)
    if _is_settled(map_id, answer.map):
        return
    request = WatchMapRequest(
        map_id=map_id,
        from_revision=answer.map.revision,
        map_uid=answer.map.uid,
        omit_landmarks=True,
        omit_constraints=True,
    )
    async with aclosing(link.answers(request)) as deltas:  # type: ignore[type-var]
        async for part in deltas:
            retries.progress()
            if part.delta.last_part and _is_settled(map_id, part.delta):
                return
    # Watching ends with a status; an end without one is a link that went away.
    raise errors.broken("WatchMap", "the stream ended")


def _is_settled(map_id: str, told: Map | MapDelta) -> bool:
    """Whether nothing is pending."""
    if not told.HasField("pending_work"):
        raise errors.Protocol("WatchMap: the server does not say what is pending")
    if told.pending_work == PendingWork():
        return True
    if told.state in (MapState.MAP_STATE_FROZEN, MapState.MAP_STATE_POISONED):
        state = MapState.Name(told.state).removeprefix("MAP_STATE_").lower()
        raise errors.MapNotOpen(map_id, state)
    return False
