"""A camera that slides along an uneven wall of known points: what the tests and the benchmark send."""

from __future__ import annotations

from typing import Any

import covis
import numpy as np

FOCAL_PX = 500.0
CENTER_PX = (319.5, 239.5)
K = np.array([[FOCAL_PX, 0.0, CENTER_PX[0]], [0.0, FOCAL_PX, CENTER_PX[1]], [0.0, 0.0, 1.0]])
SIZE = (640, 480)
LANDMARKS = np.arange(60)
POINTS = np.column_stack(
    [-1.6 + 0.4 * (LANDMARKS % 10), -1.1 + 0.4 * (LANDMARKS // 10), 4.0 + 0.35 * ((7 * LANDMARKS) % 5)]
)

AT_ONCE = covis.RetryPolicy(max_attempts=10_000, first_delay_s=0.005, longest_delay_s=0.005)
"""Retries nearly without waiting, for as long as it takes."""


def pose(id: int, off_m: float = 0.0) -> np.ndarray[Any, Any]:
    """The true pose of a keyframe, or one that is off."""
    out = np.eye(4)
    out[:3, 3] = [0.12 * id + off_m, 0.03 * (id % 3) - off_m, 0.02 * (id % 2)]
    return out


def view(id: int) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Pixels and depths of all landmarks in a keyframe."""
    seen = POINTS - pose(id)[:3, 3]
    return FOCAL_PX * seen[:, :2] / seen[:, 2:] + CENTER_PX, seen[:, 2]


def keyframe(id: int) -> dict[str, Any]:
    """The arguments of a keyframe; its start is off unless it is the first."""
    pixels, depths = view(id)
    return {
        "id": id,
        "t": 100.5 + id,
        "world_from_camera": pose(id, 0.01 if id else 0.0),
        "pixels": pixels,
        "landmark_ids": LANDMARKS,
        "depths": depths,
        "new_points": POINTS + 0.02 * np.sin(LANDMARKS)[:, None],
    }


def send(session: covis.Session, *ids: int) -> list[int]:
    """Sends keyframes, the camera before the first one."""
    if 0 in ids:
        session.camera(0, *SIZE, K)
    return [session.keyframe(**keyframe(id)) for id in ids]
