"""A copy of a map on the client's side, which deltas keep up to date.

Entities come whole, so applying a delta is overwriting; a reset drops all there was. The parts of a delta
are applied together or not at all (docs/wire.md, "Watching a map"). No task and no lock here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from . import _poses
from .errors import Protocol
from .noise import unpack_symmetric
from .v1 import (
    Camera,
    ClientFrame,
    Constraint,
    ConstraintKind,
    KeyframePose,
    Landmark,
    MapDelta,
    PendingWork,
)

Array = _poses.Array
Key = tuple[str, int]
"""An entity's owner and id."""

_RPC = "WatchMap"


@dataclass(frozen=True)
class Closure:
    """A loop closure of a map."""

    client_id: str
    id: int
    keyframe_i: Key
    keyframe_j: Key
    i_from_j: Array
    """4×4, the measured pose of keyframe j in the frame of keyframe i."""
    information: Array
    """6×6, translation first."""
    counts: bool
    """Whether it takes part in solves: false while it is switched off as false."""
    provisional: bool
    """Switched off, and no other closure joins its two places."""
    chi2: float | None
    """χ² at which it was switched off."""


@dataclass
class MapChanges:
    """What a delta changed, by owner and id."""

    revision: int = 0
    """The revision that it led to."""
    reset: bool = False
    """Whether it began anew: what it does not name is gone."""
    keyframes: list[Key] = field(default_factory=list)
    """Keyframes that are new, moved or gone."""
    landmarks: list[Key] = field(default_factory=list)
    """The same of landmarks."""
    constraints: list[Key] = field(default_factory=list)
    """The same of constraints and priors."""


class Mirror:
    """The map as of one revision."""

    def __init__(self) -> None:
        self.uid = ""
        """The map's uid; empty before the first delta."""
        self.revision = 0
        self.state = 0
        self.pending_work: PendingWork | None = None
        self.clear()

    def clear(self) -> None:
        """Drops all entities."""
        self.clients: set[str] = set()
        """Those that own something, or did since the last reset."""
        self.cameras: dict[Key, Camera] = {}
        self.times: dict[Key, float] = {}
        self.poses: dict[Key, Array] = {}
        self.landmarks: dict[Key, Array] = {}
        self.constraints: dict[Key, Constraint] = {}
        self.frames: dict[str, Array] = {}
        self.scales: dict[str, float] = {}

    def apply(self, parts: Sequence[MapDelta]) -> MapChanges:
        """Applies a whole delta, given as all its parts in order, and tells what it changed.

        Raises `Protocol` where the parts do not belong together or the delta starts from another
        revision; the mirror is then unchanged.
        """
        if not parts:
            raise Protocol(f"{_RPC}: a delta without parts")
        first, last = parts[0], len(parts) - 1
        for index, part in enumerate(parts):
            is_last = part.last_part == (index == last)
            if part.revision != first.revision or part.part_index != index or not is_last:
                raise Protocol(f"{_RPC}: the parts of a delta do not belong together")
        base = first.base_revision
        if not first.reset and (base != self.revision or first.revision < base):
            raise Protocol(f"{_RPC}: a delta does not start from the revision before it")
        if first.reset:
            self.clear()
        changes = MapChanges(revision=first.revision, reset=first.reset)
        for part in parts:
            self._apply_part(part, changes)
        self.revision = first.revision
        return changes

    def _apply_part(self, part: MapDelta, changes: MapChanges) -> None:
        self.state = part.state
        self.uid = part.map_uid
        self.pending_work = part.pending_work if part.HasField("pending_work") else None
        for camera in part.cameras:
            self.cameras[camera.client_id, camera.id] = camera
            self.clients.add(camera.client_id)
        self._take_keyframes([k for k in part.keyframes if k.HasField("keyframe")], changes)
        self._take_landmarks(part.landmarks, changes)
        for constraint in part.constraints:
            kind = constraint.WhichOneof("constraint")
            if kind is not None:
                named = getattr(constraint, kind)
                self.constraints[named.client_id, named.id] = constraint
                changes.constraints.append((named.client_id, named.id))
        self._take_frames(part.client_frames)
        removed = (
            (part.removed_keyframes, (self.poses, self.times), changes.keyframes),
            (part.removed_landmarks, (self.landmarks,), changes.landmarks),
            (part.removed_constraints, (self.constraints,), changes.constraints),
        )
        for gone, holders, told in removed:
            for ref in gone:
                for holder in holders:
                    holder.pop((ref.client_id, ref.id), None)  # type: ignore[attr-defined]
                told.append((ref.client_id, ref.id))

    def _take_keyframes(self, keyframes: Sequence[KeyframePose], changes: MapChanges) -> None:
        keys = [(k.keyframe.client_id, k.keyframe.id) for k in keyframes]
        self.poses.update(zip(keys, frozen(_poses.from_messages([k.world_from_camera for k in keyframes]))))
        self.times.update(zip(keys, (seconds(k.capture_time) for k in keyframes)))
        self.clients.update(key[0] for key in keys)
        changes.keyframes += keys

    def _take_landmarks(self, landmarks: Sequence[Landmark], changes: MapChanges) -> None:
        keys = [(mark.client_id, mark.id) for mark in landmarks]
        self.landmarks.update(zip(keys, frozen(points(landmarks))))
        self.clients.update(key[0] for key in keys)
        changes.landmarks += keys

    def _take_frames(self, frames: Sequence[ClientFrame]) -> None:
        for frame in frames:
            if frame.HasField("keyframe"):
                pose = _poses.from_message(frame.map_from_odom)
                pose.flags.writeable = False
                self.frames[frame.client_id] = pose
                # An earlier server sends none.
                self.scales[frame.client_id] = frame.scale or 1.0
            else:
                self.frames.pop(frame.client_id, None)
                self.scales.pop(frame.client_id, None)


def frozen(array: Array) -> Array:
    """The array, whose rows can be handed out without being changed by who gets them."""
    array.flags.writeable = False
    return array


def seconds(time: object) -> float:
    """A timestamp as Unix seconds."""
    return time.seconds + time.nanos / 1e9  # type: ignore[attr-defined,no-any-return]


def points(landmarks: Sequence[Landmark]) -> Array:
    """Positions, N×3; NaN where a landmark has none."""
    nan = (np.nan, np.nan, np.nan)
    rows = [
        (p.x, p.y, p.z) if has else nan
        for has, p in ((m.HasField("point_in_world"), m.point_in_world) for m in landmarks)
    ]
    return np.array(rows, np.float64).reshape(-1, 3)


def closures(constraints: dict[Key, Constraint]) -> list[Closure]:
    """The loop closures among constraints, by owner and id."""
    found = []
    for (client_id, id), constraint in sorted(constraints.items()):
        measured = constraint.relative_pose
        if measured.kind != ConstraintKind.CONSTRAINT_KIND_LOOP_CLOSURE:
            continue
        is_off = measured.HasField("switched_off")
        found.append(
            Closure(
                client_id,
                id,
                (measured.keyframe_i.client_id, measured.keyframe_i.id),
                (measured.keyframe_j.client_id, measured.keyframe_j.id),
                _poses.from_message(measured.keyframe_i_from_keyframe_j),
                unpack_symmetric(list(measured.information.upper_triangle)),
                not is_off,
                measured.switched_off.provisional,
                measured.switched_off.chi2 if is_off else None,
            )
        )
    return found
