"""Standard deviations and information of measurements. Plain formulas; no message is made here.

A depth from a disparity has a standard deviation that grows with the square of the distance. A share of
the distance (1 % of z) is a poor substitute: it is too small far away, and distant landmarks then
outweigh the pixels.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_KINECT_PER_M = 1.425e-3


def kinect_sigma_m(depth_m: npt.ArrayLike) -> Array:
    """Standard deviation of depths of a structured-light sensor like the first Kinect, m.

    1.425e-3 z² / m, for depths from 0.5 m to 5 m (Khoshelham and Elberink 2012). It is that of the
    sensor on a plane; `SolveSummary.residuals` of a solve tells where it is too small.
    """
    return _KINECT_PER_M * np.square(np.asarray(depth_m, np.float64))


def stereo_sigma_m(
    depth_m: npt.ArrayLike, sigma_disparity_px: float, focal_px: float, baseline_m: float
) -> Array:
    """Standard deviation of depths from stereo, m: z² σ_d / (f b), to first order.

    `sigma_disparity_px` is 0.2 to 1 px for most matchers; `focal_px` is the rectified focal length.
    """
    scale = sigma_disparity_px / (focal_px * baseline_m)
    return scale * np.square(np.asarray(depth_m, np.float64))


def closure_information(sigma_m: npt.ArrayLike, sigma_rad: npt.ArrayLike) -> Array:
    """The 6×6 information of a relative pose with independent errors: diag(1/σ²).

    `sigma_m` and `sigma_rad` are the standard deviations of translation (m) and rotation (rad), one
    number or three. Order: translation x y z, then rotation x y z.
    """
    parts = [np.broadcast_to(np.asarray(s, np.float64), 3) for s in (sigma_m, sigma_rad)]
    sigmas = np.concatenate(parts)
    if not (sigmas > 0).all():
        raise ValueError("sigma_m and sigma_rad must be greater than 0")
    return np.diag(sigmas**-2.0)


def position_information(sigma_m: npt.ArrayLike) -> Array:
    """The 3×3 information of a position with independent errors along x, y, z of the world, 1/m²."""
    sigmas = np.broadcast_to(np.asarray(sigma_m, np.float64), 3)
    if not (sigmas > 0).all():
        raise ValueError("sigma_m must be greater than 0")
    return np.diag(sigmas**-2.0)


def pack_symmetric(matrix: npt.ArrayLike, name: str = "matrix") -> list[float]:
    """The upper triangle of a symmetric n×n matrix, row by row: the order of messages and of g2o."""
    square = np.asarray(matrix, np.float64)
    if square.ndim != 2 or square.shape[0] != square.shape[1]:
        raise ValueError(f"{name} must be a square matrix, not of shape {square.shape}")
    if not np.allclose(square, square.T, rtol=1e-9, atol=0.0, equal_nan=True):
        raise ValueError(f"{name} is not symmetric")
    packed: list[float] = square[np.triu_indices(len(square))].tolist()
    return packed


def unpack_symmetric(values: npt.ArrayLike) -> Array:
    """The symmetric matrix of a packed upper triangle: 3×3 of 6 values, 6×6 of 21."""
    packed = np.asarray(values, np.float64)
    size = round((np.sqrt(8 * packed.size + 1) - 1) / 2)
    if packed.ndim != 1 or size * (size + 1) // 2 != packed.size:
        raise ValueError(f"values of shape {packed.shape} are no upper triangle")
    matrix = np.zeros((size, size))
    matrix[np.triu_indices(size)] = packed
    return matrix + np.triu(matrix, 1).T
