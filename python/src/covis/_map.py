"""Following a map: a mirror that a task keeps up to date over broken links.

After a break the watch goes on from the revision it holds, naming the map's uid; the server answers the
missing deltas, or a reset where it no longer has them or the map is another one. Readers may be in other
threads than the task: each property is one consistent copy.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from contextlib import aclosing
from dataclasses import dataclass
from typing import TypeVar

from . import errors
from ._link import Link
from ._mirror import Array, Closure, Key, MapChanges, Mirror, closures
from ._retry import Retries, RetryPolicy
from ._stream import _call
from ._wait import Signal, end, within
from .trajectory import Trajectory
from .v1 import Camera, Constraint, MapDelta, MapState, PendingWork, WatchMapRequest

T = TypeVar("T")


@dataclass(frozen=True)
class WatchOptions:
    """What is watched."""

    omit_landmarks: bool = False
    omit_constraints: bool = False
    position_resolution_m: float = 0.0
    rotation_resolution_rad: float = 0.0
    retry: RetryPolicy = RetryPolicy()
    on_change: Callable[[MapChanges], None] | None = None


class Map:
    """A live mirror of a map, from `Client.watch`.

    Entities are named by their id, with several clients in the map by (client, id).
    """

    def __init__(self, link: Link, map_id: str, options: WatchOptions) -> None:
        self._link = link
        self._map_id = map_id
        self._options = options
        self._retries = Retries(options.retry)
        self._mirror = Mirror()
        self._lock = threading.Lock()
        self._changed = Signal()
        self._failure: BaseException | None = None
        self._task: asyncio.Task[None] | None = None

    async def _open(self) -> None:
        self._task = asyncio.get_running_loop().create_task(self._run())
        try:
            await self._until(lambda: bool(self._mirror.uid))
        except BaseException:
            await self.close()
            raise

    async def __aenter__(self) -> Map:
        return self

    async def __aexit__(self, kind: object, error: object, trace: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Ends the watch. The mirror stays as it is."""
        await end(self._task)
        self._failure = self._failure or errors.Closed()
        self._changed.fire()

    @property
    def revision(self) -> int:
        """The revision that the mirror holds."""
        return self._mirror.revision

    @property
    def state(self) -> str:
        """Whether the map takes changes: "open", "frozen" or "poisoned"."""
        return MapState.Name(self._mirror.state).removeprefix("MAP_STATE_").lower()  # type: ignore[arg-type]

    @property
    def pending_work(self) -> PendingWork | None:
        """What the server still did to the map by itself when it sent the last delta; `None` from an
        earlier server. See `Client.wait_settled`."""
        return self._mirror.pending_work

    @property
    def clients(self) -> list[str]:
        """Those that own something in the map, sorted."""
        with self._lock:
            return sorted(self._mirror.clients)

    @property
    def poses(self) -> dict[int | Key, Array]:
        """`world_from_camera` of each keyframe, 4×4."""
        return self._named(lambda mirror: mirror.poses)

    @property
    def times(self) -> dict[int | Key, float]:
        """Capture time of each keyframe, Unix seconds."""
        return self._named(lambda mirror: mirror.times)

    @property
    def landmarks(self) -> dict[int | Key, Array]:
        """Position of each landmark in the world frame, m; NaN where it has none yet."""
        return self._named(lambda mirror: mirror.landmarks)

    @property
    def cameras(self) -> dict[int | Key, Camera]:
        """The cameras."""
        return self._named(lambda mirror: mirror.cameras)

    @property
    def constraints(self) -> dict[int | Key, Constraint]:
        """Relative poses and priors, those that are switched off too."""
        return self._named(lambda mirror: mirror.constraints)

    @property
    def closures(self) -> list[Closure]:
        """The loop closures, by client and id, those that are switched off too."""
        with self._lock:
            constraints = dict(self._mirror.constraints)
        return closures(constraints)

    def map_from_odom(self, client_id: str) -> Array | None:
        """Where a client's odometry frame lies in the map, 4×4; `None` while it has no keyframe.

        It is in the client's unit of length, in which the client makes its start estimates:
        `world_from_camera = map_from_odom @ odom_from_camera`. See `scale`.
        """
        return self._mirror.frames.get(client_id)

    def scale(self, client_id: str) -> float:
        """The length in the map of a client's unit of length.

        1, unless its map was made without measured lengths and became part of another one. What a client
        sends is in its own unit; poses and landmarks here are in the map's, and it divides them by this.
        """
        return self._mirror.scales.get(client_id, 1.0)

    def trajectory(self, client_id: str | None = None) -> Trajectory:
        """The poses of one client's keyframes by time; of the only client by default."""
        with self._lock:
            mirror, clients = self._mirror, sorted(self._mirror.clients)
            if client_id is None and len(clients) > 1:
                raise ValueError(f"the map has clients {clients}: say which")
            chosen = client_id if client_id is not None else "".join(clients)
            rows = [(mirror.times[k], k[1], pose) for k, pose in mirror.poses.items() if k[0] == chosen]
        return Trajectory.of_rows(rows)

    async def wait(self, revision: int, timeout: float | None = None) -> None:
        """Waits until the mirror holds `revision` (of an ack, say) or a later one."""
        await self.wait_until(lambda: self._mirror.revision >= revision, timeout)

    async def wait_until(self, is_met: Callable[[], bool], timeout: float | None = None) -> None:
        """Waits until `is_met` is true; it is asked after each change, and reads the map.

        Raises `NotFound` when the map is deleted; why the watch ended; `TimeoutError`.
        """
        await within(timeout, self._until(is_met), "the map did not come so far")

    async def _until(self, is_met: Callable[[], bool]) -> None:
        while not is_met():
            if self._failure is not None:
                raise self._failure.with_traceback(None)
            await self._changed.wait()

    async def _run(self) -> None:
        try:
            while True:
                try:
                    await self._follow()
                except errors.CovisError as error:
                    self._link.follow(error)
                    await self._retries.wait(error)
        except Exception as error:  # A bug of ours too must reach those who wait.
            self._failure = error
        finally:
            self._changed.fire()

    async def _follow(self) -> None:
        """One stream, to its end."""
        options, mirror = self._options, self._mirror
        request = WatchMapRequest(
            map_id=self._map_id,
            omit_landmarks=options.omit_landmarks,
            omit_constraints=options.omit_constraints,
            map_uid=mirror.uid,
            position_resolution_m=options.position_resolution_m,
            rotation_resolution_rad=options.rotation_resolution_rad,
        )
        if mirror.uid:
            request.from_revision = mirror.revision
        parts: list[MapDelta] = []
        async with aclosing(self._link.answers(request)) as answers:  # type: ignore[type-var]
            async for answer in answers:
                if not answer.HasField("delta"):
                    continue
                parts.append(answer.delta)
                if answer.delta.last_part:
                    self._apply(parts)
                    parts = []
        # Watching ends with a status; an end without one is a link that went away.
        raise errors.broken("WatchMap", "the stream ended")

    def _apply(self, parts: list[MapDelta]) -> None:
        with self._lock:
            changes = self._mirror.apply(parts)
        self._retries.opened()
        self._retries.progress()
        if self._options.on_change is not None:
            _call(self._options.on_change, changes)
        self._changed.fire()

    def _named(self, entities: Callable[[Mirror], dict[Key, T]]) -> dict[int | Key, T]:
        with self._lock:
            are_several = len(self._mirror.clients) > 1
            found = entities(self._mirror).items()
            return {key if are_several else key[1]: value for key, value in found}
