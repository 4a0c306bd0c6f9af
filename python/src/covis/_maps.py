"""Calls about one map that take more than a request: making it where it is missing, its trajectory, the
digests of what it holds.
"""

from __future__ import annotations

from contextlib import aclosing
from dataclasses import dataclass

from . import errors
from ._link import Link
from ._mirror import seconds
from ._poses import from_message
from ._retry import RetryPolicy
from .trajectory import Trajectory
from .v1 import CreateMapRequest, GetMapRequest, GetTrajectoryRequest, MapPolicy


@dataclass(frozen=True)
class MapDigests:
    """Digests of one revision of a map; what goes into them is in `map_service.proto`."""

    revision: int
    """The revision that they are of."""
    state_hash: bytes
    """SHA-256 over all that the map holds."""
    keyframe_ids_digest: bytes
    """SHA-256 over the ids of its keyframes."""


async def digests(link: Link, map_id: str) -> MapDigests:
    """Asks for the digests of a map, which take a pass over it."""
    answer = await link.unary(GetMapRequest(map_id=map_id, include_digests=True))
    return MapDigests(answer.map.revision, answer.state_hash, answer.keyframe_ids_digest)


async def ensure(link: Link, map_id: str, policy: MapPolicy | None, retry: RetryPolicy) -> None:
    """Creates a map where it is missing."""
    try:
        await link.unary(GetMapRequest(map_id=map_id), retry=retry)
    except errors.NotFound:
        try:
            await link.unary(CreateMapRequest(map_id=map_id, policy=policy), retry=retry)
        except errors.AlreadyExists:
            # Another client was quicker.
            pass


async def trajectory(link: Link, map_id: str, client_id: str | None) -> Trajectory:
    """The poses of one client's keyframes; of the only client by default."""
    request = GetTrajectoryRequest(map_id=map_id, client_id=client_id or "")
    rows, clients = [], set()
    async with aclosing(link.answers(request)) as parts:  # type: ignore[type-var]
        async for part in parts:
            for pose in part.poses:
                clients.add(pose.keyframe.client_id)
                row = (seconds(pose.capture_time), pose.keyframe.id)
                rows.append((*row, from_message(pose.world_from_camera)))
    if len(clients) > 1:
        raise ValueError(f"map {map_id} has clients {sorted(clients)}: say which")
    return Trajectory.of_rows(rows)
