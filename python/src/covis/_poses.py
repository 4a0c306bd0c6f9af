"""Poses as matrices here, as translation and quaternion in messages. Wrong shapes are named.

All functions take whole arrays; quaternions are Hamilton's, listed x, y, z, w.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from .v1 import RigidTransform, RigidTransform2

Array = npt.NDArray[np.float64]


def matrices(name: str, value: npt.ArrayLike, size: int = 4) -> Array:
    """N rigid transforms as N×size×size, checked."""
    array = np.asarray(value, np.float64)
    if array.ndim != 3 or array.shape[1:] != (size, size):
        raise ValueError(f"{name} must be N×{size}×{size}, not of shape {array.shape}")
    last = np.zeros(size)
    last[-1] = 1.0
    rotation = array[:, :-1, :-1]
    # Comparisons with NaN are false.
    with np.errstate(invalid="ignore"):
        product = rotation @ rotation.transpose(0, 2, 1)
        is_rigid = (np.abs(array[:, -1] - last) < 1e-9).all(axis=1)
        is_rigid &= (np.abs(product - np.eye(size - 1)) < 2e-3).all(axis=(1, 2))
        is_rigid &= np.linalg.det(rotation) > 0
    if not is_rigid.all():
        wrong = int(np.argmin(is_rigid))
        raise ValueError(f"{name}[{wrong}] is no rigid transform: rotation and last row are checked")
    return array


def matrix(name: str, value: npt.ArrayLike, size: int = 4) -> Array:
    """One rigid transform, checked."""
    array = np.asarray(value, np.float64)
    if array.shape != (size, size):
        raise ValueError(f"{name} must be {size}×{size}, not of shape {array.shape}")
    try:
        return matrices(name, array[None], size)[0]
    except ValueError as error:
        raise ValueError(str(error).replace(f"{name}[0]", name)) from None


def quaternions(rotation: Array) -> Array:
    """Unit quaternions of N rotation matrices, N×4.

    The largest of the four components is computed from the diagonal, the others are divided by it
    (Shepperd 1978), so that none is divided by something near 0.
    """
    m = rotation
    trace = np.trace(m, axis1=1, axis2=2)
    diagonal = np.diagonal(m, axis1=1, axis2=2)
    squares = np.column_stack([1 + 2 * diagonal - trace[:, None], 1 + trace])
    sums = np.empty((len(m), 4, 4))
    for k in range(4):
        sums[:, k, k] = squares[:, k]
    for i, j in ((0, 1), (0, 2), (1, 2)):
        sums[:, i, j] = sums[:, j, i] = m[:, i, j] + m[:, j, i]
    for i, (j, k) in enumerate(((2, 1), (0, 2), (1, 0))):
        sums[:, i, 3] = sums[:, 3, i] = m[:, j, k] - m[:, k, j]
    best = np.argmax(squares, axis=1)
    row: Array = sums[np.arange(len(m)), best]
    unit: Array = row / np.linalg.norm(row, axis=1, keepdims=True)
    return unit


def rotations(quaternion: Array) -> Array:
    """Rotation matrices of N quaternions, N×3×3."""
    q = quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)
    x, y, z, w = q.T
    out = np.empty((len(q), 3, 3))
    out[:, 0] = np.column_stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)])
    out[:, 1] = np.column_stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)])
    out[:, 2] = np.column_stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
    return out


def split_pose(pose: npt.ArrayLike) -> tuple[Array, Array]:
    """Translation (3) and unit quaternion (x, y, z, w) of a 4×4 transform, as ROS and TUM have them."""
    checked = matrix("pose", pose)
    return checked[:3, 3], quaternions(checked[None, :3, :3])[0]


def join_pose(translation: npt.ArrayLike, quaternion: npt.ArrayLike) -> Array:
    """The 4×4 transform of a translation and a quaternion (x, y, z, w), which is normalized."""
    out = np.eye(4)
    out[:3, 3] = shaped("translation", translation, 3)
    out[:3, :3] = rotations(shaped("quaternion", quaternion, 4)[None])[0]
    return out


def message(pose: Array) -> RigidTransform:
    """The message of one checked 4×4 transform."""
    out = RigidTransform()
    x, y, z = pose[:3, 3].tolist()
    out.translation.x, out.translation.y, out.translation.z = x, y, z
    q = out.rotation
    q.x, q.y, q.z, q.w = quaternions(pose[None, :3, :3])[0].tolist()
    return out


def rigid(name: str, value: npt.ArrayLike) -> RigidTransform:
    """The message of one 4×4 transform."""
    return message(matrix(name, value))


def planar(pose: Array) -> RigidTransform2:
    """The message of one checked 3×3 transform."""
    out = RigidTransform2(angle_rad=float(np.arctan2(pose[1, 0], pose[0, 0])))
    out.translation.x, out.translation.y = pose[:2, 2].tolist()
    return out


def from_messages(transforms: Sequence[RigidTransform]) -> Array:
    """Messages to N×4×4."""
    numbers = [
        (t.x, t.y, t.z, q.x, q.y, q.z, q.w)
        for t, q in ((m.translation, m.rotation) for m in transforms)
    ]
    array = np.array(numbers, np.float64).reshape(-1, 7)
    out = np.zeros((len(array), 4, 4))
    out[:, :3, :3] = rotations(array[:, 3:])
    out[:, :3, 3] = array[:, :3]
    out[:, 3, 3] = 1.0
    return out


def from_message(transform: RigidTransform) -> Array:
    """One message to 4×4."""
    pose: Array = from_messages([transform])[0]
    return pose


def from_planar(transforms: Sequence[RigidTransform2]) -> Array:
    """Messages to N×3×3."""
    rows = [(m.translation.x, m.translation.y, m.angle_rad) for m in transforms]
    array = np.array(rows, np.float64).reshape(-1, 3)
    sine, cosine = np.sin(array[:, 2]), np.cos(array[:, 2])
    out = np.zeros((len(array), 3, 3))
    out[:, 0, 0] = out[:, 1, 1] = cosine
    out[:, 0, 1], out[:, 1, 0] = -sine, sine
    out[:, :2, 2] = array[:, :2]
    out[:, 2, 2] = 1.0
    return out


def shaped(name: str, value: Any, *shape: int | None) -> Array:
    """A float array of the shape, where None is any length."""
    array = np.asarray(value, np.float64)
    fits = array.ndim == len(shape) and all(
        want is None or want == has for want, has in zip(shape, array.shape)
    )
    if not fits:
        text = "×".join("N" if want is None else str(want) for want in shape)
        raise ValueError(f"{name} must be {text}, not of shape {array.shape}")
    return array
