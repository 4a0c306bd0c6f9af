"""An ingest session: what a frontend holds to send items, whatever happens to the link.

Sending numbers an item, keeps it until the server has answered it and waits while too many are
unanswered: that is the back-pressure. A task of its own (`_stream.py`) moves the items. This file turns
arguments into items and waits for acks.
"""

from __future__ import annotations

from collections.abc import Callable
from collections.abc import Set as AbstractSet

import numpy as np
import numpy.typing as npt
from google.protobuf.message import Message

from . import _constraints, _items, _poses
from ._constraints import Ref
from ._items import Time
from ._link import Link
from ._retry import Retries
from ._settled import wait_settled
from ._stream import IngestReport, SessionOptions, Stream
from ._wait import within
from .errors import CovisError, NotDurable, Rejected, RejectedItem, SequenceOrder, TooLarge
from .v1 import (
    Camera,
    ConstraintKind,
    FuseLandmarks,
    GeodeticPosition,
    IngestOpened,
    IngestRequest,
    Keyframe,
    LandmarkBatch,
    ListLandmarksRequest,
    ObservationBatch,
    PosePrior,
    PositionPrior,
    RelativePoseConstraint,
    RemoveLandmarks,
)

# Items that no solve follows, relative poses that are no loop closures besides.
_WITHOUT_SOLVE = (Camera.DESCRIPTOR.full_name, LandmarkBatch.DESCRIPTOR.full_name)


class Session:
    """An open session of one client on one map, from `Client.ingest`.

    As a context manager it ends with `finish`, after an exception with `abort`.
    """

    def __init__(self, link: Link, map_id: str, client_id: str, options: SessionOptions) -> None:
        self._link = link
        self._map_id = map_id
        self._client_id = client_id
        self._options = options
        self._stream = Stream(link, map_id, client_id, options)
        self._last_sequence = 0
        self._next_keyframe = 0
        self._next_landmark = 0
        self._cameras: set[int] = set()
        self._landmarks: set[int] = set()
        self._stream.on_dismissed = self._forget

    async def _open(self) -> None:
        await self._stream.open()
        self._next_keyframe = self.opened.next_keyframe_id
        self._next_landmark = self.opened.next_landmark_id
        if self.opened.next_sequence > 1:
            # An earlier session of this client may have sent landmarks: they are not declared again.
            request = ListLandmarksRequest(map_id=self._map_id)
            request.read_mask.paths.append("id")
            retries = Retries(self._options.retry)
            while True:
                try:
                    async for page in self._link.answers(request):
                        self._landmarks.update(
                            mark.id for mark in page.landmarks if mark.client_id == self._client_id
                        )
                    return
                except CovisError as error:
                    self._link.follow(error)
                    await retries.wait(error)

    async def __aenter__(self) -> Session:
        return self

    async def __aexit__(self, kind: object, error: object, trace: object) -> None:
        if kind is None:
            await self.finish()
        else:
            await self.abort()

    @property
    def opened(self) -> IngestOpened:
        """The server's answer to the first opening: limits, durability, where it goes on."""
        return self._stream.first

    @property
    def next_sequence(self) -> int:
        """The sequence that the next item gets."""
        return max(self.opened.next_sequence, self._last_sequence + 1)

    @property
    def next_keyframe_id(self) -> int:
        """A keyframe id that is free: above those of this client's keyframes that the map holds and that
        this session has sent. A frontend that starts again under its name counts on from here."""
        return self._next_keyframe

    @property
    def next_landmark_id(self) -> int:
        """As `next_keyframe_id`, for landmarks."""
        return self._next_landmark

    @property
    def unanswered(self) -> tuple[IngestRequest, ...]:
        """The items that the server may not have, by sequence: those without an answer, and on a durable
        server those that are not on its disk yet.

        They stay when the session has ended, and the error that ended it has them too. Another session
        sends them by `send(request, sequence=request.sequence)`, which is harmless where the server has
        them.
        """
        return self._stream.unanswered

    @property
    def report(self) -> IngestReport:
        """How far the session has come."""
        return self._stream.copy_report()

    async def camera(
        self,
        id: int,
        width: int,
        height: int,
        K: npt.ArrayLike,
        distortion: npt.ArrayLike | None = None,
        *,
        model: str = "pinhole",
    ) -> int:
        """Adds a camera and returns the item's sequence.

        `K` is the 3×3 matrix without skew, px, an integer at a pixel's center. `distortion` has
        OpenCV's coefficients: (k1, k2, p1, p2[, k3]), or (k1, k2, k3, k4) for the model "fisheye".
        An earlier session of the client may have sent the same camera.
        """
        return await self.send(_items.camera(id, width, height, K, distortion, model))

    async def keyframe(
        self,
        id: int,
        t: Time,
        world_from_camera: npt.ArrayLike,
        pixels: npt.ArrayLike,
        landmark_ids: npt.ArrayLike,
        depths: npt.ArrayLike | None = None,
        sigmas: npt.ArrayLike | None = None,
        descriptors: npt.ArrayLike | None = None,
        new_points: npt.ArrayLike | None = None,
        camera: int | None = None,
        *,
        sigma_px: npt.ArrayLike | None = None,
        odom_from_camera: npt.ArrayLike | None = None,
        descriptor_name: str = "",
        descriptor_kind: str | None = None,
    ) -> int:
        """Adds a keyframe with what it sees, and returns the item's sequence.

        - `t`: middle of the exposure: Unix seconds, `datetime` or `numpy.datetime64` (UTC).
        - `world_from_camera`: 4×4, the start estimate.
        - `pixels`: N×2, (column, row), px, an integer at a pixel's center.
        - `landmark_ids`: N integers. Landmarks not seen before are declared.
        - `depths`: N, z in the camera's frame, m; NaN or 0 where none was measured.
        - `sigmas`: standard deviations of the depths, m, one number or N; missing or NaN: 1.425e-3 z²
          (`covis.kinect_sigma_m`).
        - `descriptors`: N×D, uint8 (binary) or floats.
        - `new_points`: N×3 along `landmark_ids`, world frame, m: start values of landmarks that are
          declared. Without, or where NaN, the server triangulates.
        - `camera`: the only camera by default.
        - `sigma_px`: standard deviation of the pixels, one number or N (1).
        - `odom_from_camera`: 4×4, the pose in the client's own frame, which never jumps
          (`world_from_camera`).
        - `descriptor_name`: what made the descriptors; only those of one name are compared.
          `descriptor_kind`: "binary", "float32" or "uint8", where it is not as usual for the type.

        Raises `ValueError` naming the argument whose shape or type is wrong.
        """
        ids, seen = self._observations(
            9, pixels, landmark_ids, depths, sigmas, descriptors, sigma_px,
            descriptor_name, descriptor_kind,
        )  # fmt: skip
        head = Keyframe(id=id, world_from_camera=_poses.rigid("world_from_camera", world_from_camera))
        head.capture_time.CopyFrom(_items.timestamp(t))
        chosen = self._camera_of(camera, len(ids))
        if chosen is not None:
            head.camera_id = chosen
        if odom_from_camera is not None:
            head.odom_from_camera.CopyFrom(_poses.rigid("odom_from_camera", odom_from_camera))
        unique, first = np.unique(ids, return_index=True)
        declared = set(unique.tolist()) - self._landmarks
        added = b""
        points = None if new_points is None else _poses.shaped("new_points", new_points, None, 3)
        if points is not None and len(points) != len(ids):
            raise ValueError(f"new_points must be one a landmark id, {len(ids)}, not {len(points)}")
        if declared:
            fresh = np.isin(unique, np.fromiter(declared, np.int64, len(declared)))
            start = None if points is None else points[first[fresh]]
            added = _items.landmarks(10, unique[fresh], start)
        payload = head.SerializeToString() + seen + added
        return await self._send(_items.KEYFRAME, payload, True, declared=declared, keyframe=id)

    async def observations(
        self,
        keyframe: int,
        pixels: npt.ArrayLike,
        landmark_ids: npt.ArrayLike,
        depths: npt.ArrayLike | None = None,
        sigmas: npt.ArrayLike | None = None,
        descriptors: npt.ArrayLike | None = None,
        *,
        sigma_px: npt.ArrayLike | None = None,
        descriptor_name: str = "",
        descriptor_kind: str | None = None,
    ) -> int:
        """Adds observations to a keyframe that was sent before; arguments as in `keyframe`.

        The landmarks must be known to the map.
        """
        _, seen = self._observations(
            2, pixels, landmark_ids, depths, sigmas, descriptors, sigma_px,
            descriptor_name, descriptor_kind,
        )  # fmt: skip
        head = ObservationBatch(keyframe=_constraints.ref(keyframe))
        return await self._send(_items.field_of(head), head.SerializeToString() + seen, True)

    async def landmarks(self, ids: npt.ArrayLike, points: npt.ArrayLike | None = None) -> int:
        """Adds landmarks: N ids and, where known, N×3 positions in the world frame, m."""
        checked = _items.ids("ids", ids)
        xyz = None if points is None else _poses.shaped("points", points, len(checked), 3)
        declared = set(checked.tolist()) - self._landmarks
        field, payload = _items.field_of(LandmarkBatch()), _items.landmarks(1, checked, xyz)
        return await self._send(field, payload, False, declared=declared)

    async def closure(
        self,
        id: int,
        keyframe_i: Ref,
        keyframe_j: Ref,
        i_from_j: npt.ArrayLike,
        information: npt.ArrayLike,
    ) -> int:
        """Adds a loop closure: the measured pose of keyframe j in the frame of keyframe i.

        `information` is the 6×6 inverse covariance, translation first (`covis.closure_information`).
        A keyframe of another client is (client, id).
        """
        kind = ConstraintKind.CONSTRAINT_KIND_LOOP_CLOSURE
        return await self.send(_constraints.relative_pose(id, keyframe_i, keyframe_j, i_from_j, information, kind))

    async def odometry(
        self,
        id: int,
        keyframe_i: Ref,
        keyframe_j: Ref,
        i_from_j: npt.ArrayLike,
        information: npt.ArrayLike,
    ) -> int:
        """Adds a relative pose that tracking or wheels measured; arguments as in `closure`."""
        kind = ConstraintKind.CONSTRAINT_KIND_ODOMETRY
        return await self.send(_constraints.relative_pose(id, keyframe_i, keyframe_j, i_from_j, information, kind))

    async def position_prior(
        self,
        id: int,
        keyframe: Ref,
        point_in_world: npt.ArrayLike | None,
        information: npt.ArrayLike,
        *,
        geodetic: tuple[float, float, float] | None = None,
        point_in_camera: npt.ArrayLike | None = None,
    ) -> int:
        """Adds a measured position (GNSS, motion capture), m, with its 3×3 information.

        `geodetic` is (latitude in degrees, longitude in degrees, height in m) in place of
        `point_in_world`, for maps with an anchor. `point_in_camera` is the lever arm, m.
        """
        item = PositionPrior(id=id, keyframe=_constraints.ref(keyframe))
        item.information.CopyFrom(_constraints.information3(information))
        if point_in_world is not None:
            item.point_in_world.CopyFrom(_constraints.vector3("point_in_world", point_in_world))
        if geodetic is not None:
            latitude, longitude, height = geodetic
            item.geodetic_point.CopyFrom(
                GeodeticPosition(latitude_deg=latitude, longitude_deg=longitude, height_m=height)
            )
        if point_in_camera is not None:
            item.point_in_camera.CopyFrom(_constraints.vector3("point_in_camera", point_in_camera))
        return await self.send(item)

    async def pose_prior(
        self, id: int, keyframe: Ref, world_from_camera: npt.ArrayLike, information: npt.ArrayLike
    ) -> int:
        """Adds a measured pose, 4×4, with its 6×6 information, translation first."""
        item = PosePrior(id=id, keyframe=_constraints.ref(keyframe))
        item.world_from_camera.CopyFrom(_poses.rigid("world_from_camera", world_from_camera))
        item.information.CopyFrom(_constraints.information6(information))
        return await self.send(item)

    async def send(self, item: Message, *, sequence: int | None = None) -> int:
        """Sends an item of the wire, an edit for instance, or the item of an `IngestRequest`, and returns
        its sequence.

        `sequence` is above all before on this session. One below `next_sequence` of a fresh session
        sends an item again that an earlier session may have sent: the server compares the two.
        """
        field: int | None = None
        if isinstance(item, IngestRequest):
            field, item = _items.member_of(item)
        name = item.DESCRIPTOR.full_name
        loop_closure = ConstraintKind.CONSTRAINT_KIND_LOOP_CLOSURE
        is_odometry = isinstance(item, RelativePoseConstraint) and item.kind != loop_closure
        is_set_camera = field == _items.SET_CAMERA
        is_solved = is_set_camera or (name not in _WITHOUT_SOLVE and not is_odometry)
        new = item.landmarks if isinstance(item, (Keyframe, LandmarkBatch)) else ()
        declared = {mark.id for mark in new} - self._landmarks
        field, payload = field or _items.field_of(item), item.SerializeToString()
        keyframe = item.id if isinstance(item, Keyframe) else None
        sent = await self._send(
            field, payload, is_solved, sequence=sequence, declared=declared, keyframe=keyframe
        )
        if isinstance(item, Camera) and not is_set_camera:
            self._cameras.add(item.id)
        gone = item.landmarks if isinstance(item, RemoveLandmarks) else ()
        gone = item.absorbed if isinstance(item, FuseLandmarks) else gone
        self._landmarks -= {ref.id for ref in gone if ref.client_id in ("", self._client_id)}
        return sent

    async def set_camera(self, camera: Camera) -> int:
        """Replaces the model and the image size of a camera of the map, of any client."""
        return await self._send(_items.SET_CAMERA, camera.SerializeToString(), True)

    async def flush(self, timeout: float | None = None) -> None:
        """Waits until every item sent so far is answered."""
        last = self._last_sequence
        await self._until(lambda: not self._stream.waits("answer", last), timeout, "no answers")

    async def wait_durable(self, sequence: int | None = None, timeout: float | None = None) -> None:
        """Waits until the item, by default everything sent so far, is on the server's disk.

        Raises `Rejected` where the item was refused, by default where any was of which nobody was
        told yet; `NotDurable` where the server keeps maps in memory; `TimeoutError`.
        """
        if self._stream.is_in_memory:
            raise NotDurable
        await self._covered("durable", sequence, timeout, "not durable")

    async def wait_optimized(self, sequence: int | None = None, timeout: float | None = None) -> None:
        """Waits until solves have covered the item and those before it, by default all sent so far.

        Items that no solve follows (cameras, landmarks, odometry) do not wait. Raises as
        `wait_durable` does.
        """
        await self._covered("optimized", sequence, timeout, "not optimized")

    async def wait_settled(self, timeout: float | None = None) -> None:
        """Waits until everything sent so far is answered and the map is settled: see
        `Client.wait_settled`."""
        await within(timeout, self._settled(), "not settled")

    async def _settled(self) -> None:
        await self.flush()
        await wait_settled(self._link.apart(), self._map_id, self._options.retry)

    async def finish(self, timeout: float | None = None) -> IngestReport:
        """Half-closes the stream, waits for all acks, those of pending solves too, and reports.

        Raises `Rejected` where items were refused of which nobody was told yet; else why the session
        ended before that. After a `TimeoutError` the session still ends by itself, or by `abort`.
        """
        self._stream.close()
        await self._until(lambda: self._stream.is_done, timeout, "the session did not end")
        self._raise_untold()
        return self.report

    async def abort(self) -> None:
        """Ends the session at once. What was not answered may be missing on the server."""
        await self._stream.abort()

    def _observations(
        self,
        field: int,
        pixels: npt.ArrayLike,
        landmark_ids: npt.ArrayLike,
        depths: npt.ArrayLike | None,
        sigmas: npt.ArrayLike | None,
        descriptors: npt.ArrayLike | None,
        sigma_px: npt.ArrayLike | None,
        name: str,
        kind: str | None,
    ) -> tuple[_items.Ids, bytes]:
        ids = _items.ids("landmark_ids", landmark_ids)
        uv = np.asarray(pixels, np.float64)
        uv = uv.reshape(0, 2) if uv.size == 0 else uv
        measured = _items.measurements(uv, depths, sigmas, sigma_px, 3)
        if len(uv) != len(ids):
            raise ValueError(f"landmark_ids must be one a pixel, {len(uv)}, not {len(ids)}")
        described = []
        if descriptors is not None:
            described = _items.descriptor(7, descriptors, len(ids), name, kind)
        return ids, _items.observations(field, ids, measured, described)

    def _camera_of(self, camera: int | None, count: int) -> int | None:
        if camera is not None:
            return camera
        if len(self._cameras) == 1:
            return next(iter(self._cameras))
        if self._cameras:
            raise ValueError(f"the session has cameras {sorted(self._cameras)}: say which")
        if count:
            raise ValueError("the session has no camera: call camera(), or say which one the map has")
        return None

    async def _send(
        self,
        field: int,
        payload: bytes,
        is_solved: bool,
        *,
        sequence: int | None = None,
        declared: AbstractSet[int] = frozenset(),
        keyframe: int | None = None,
    ) -> int:
        """Waits for room and hands an item over. Canceling it before it returns sends nothing."""
        if sequence is not None and sequence <= self._last_sequence:
            raise SequenceOrder(sequence, self._last_sequence)
        limit = self.opened.max_message_bytes
        head = _items.head(sequence or self.next_sequence, field, len(payload))
        size = len(head) + len(payload)
        if size > limit:
            raise TooLarge(size, limit)
        # Also for those who send while this one waits.
        self._landmarks |= declared
        self._next_landmark = max(self._next_landmark, max(declared, default=-1) + 1)
        if keyframe is not None:
            self._next_keyframe = max(self._next_keyframe, keyframe + 1)
        try:
            await self._stream.room()
        except BaseException:
            self._landmarks -= declared
            raise
        if sequence is None:
            sequence = self.next_sequence
        elif sequence <= self._last_sequence:
            raise SequenceOrder(sequence, self._last_sequence)
        self._last_sequence = sequence
        request = _items.request(sequence, field, payload)
        self._stream.push(sequence, request, is_solved, declared)
        return sequence

    async def _covered(self, by: str, sequence: int | None, timeout: float | None, what: str) -> None:
        stream = self._stream
        if sequence is None:
            last = self._last_sequence
            met: Callable[[], bool] = lambda: not (stream.waits(by, last) or stream.waits("answer", last))
            await self._until(met, timeout, what)
            self._raise_untold()
            return
        wanted = sequence
        await self._until(
            lambda: wanted in stream.rejected or not stream.waits(by, wanted), timeout, what
        )
        if wanted in stream.rejected:
            kept = [item for item in stream.report.rejections if item.sequence == wanted]
            stream.untold = [item for item in stream.untold if item.sequence != wanted]
            raise Rejected(kept or [RejectedItem(wanted, ())])

    async def _until(self, met: Callable[[], bool], timeout: float | None, what: str) -> None:
        await within(timeout, self._stream.until(met), what)

    def _raise_untold(self) -> None:
        untold, self._stream.untold = self._stream.untold, []
        if untold:
            raise Rejected(untold)

    def _forget(self, declared: AbstractSet[int]) -> None:
        """Landmarks of an item that was refused are not in the map."""
        self._landmarks -= declared
