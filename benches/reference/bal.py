#!/usr/bin/env python3
"""BAL files: read, write and evaluate them with numpy and nothing of any solver.

usage: bal.py FILE ...        prints one JSON object a file: its cost and its size

The cost is 1/2 sum ||predicted - measured||^2 in px^2 over every observation, those behind their
camera included (docs/conventions.md). A camera of a BAL file is the axis-angle and the translation
of camera_from_world, the focal length, k1 and k2; it looks down -z, with x right and y up.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass

import numpy as np


@dataclass
class Bal:
    """One problem; row k of an array is the file's number k."""

    cameras: np.ndarray  # (n, 9)
    points: np.ndarray  # (m, 3), in the world
    camera_of: np.ndarray  # (o,) camera of each observation
    point_of: np.ndarray  # (o,) point of each observation
    pixels: np.ndarray  # (o, 2), the origin in the middle, v up

    def in_camera(self) -> np.ndarray:
        """Each observation's point in its camera's axes, (o, 3)."""
        camera = self.cameras[self.camera_of]
        return rotate(camera[:, :3], self.points[self.point_of]) + camera[:, 3:6]

    def residuals(self) -> np.ndarray:
        """Predicted minus measured, (o, 2) in px."""
        return project(self.cameras[self.camera_of, 6:], self.in_camera()) - self.pixels

    def cost(self) -> float:
        """1/2 sum of squared residuals, px^2."""
        return 0.5 * float(np.sum(self.residuals() ** 2))

    def behind_camera(self) -> int:
        """Observations whose point is not in front of its camera."""
        return int(np.count_nonzero(self.in_camera()[:, 2] >= 0.0))


def rotate(axis_angle: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Exp(w) x by Rodrigues' formula, row by row, (k, 3)."""
    angle2 = np.sum(axis_angle**2, axis=1, keepdims=True)
    angle = np.sqrt(angle2)
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    sine = np.where(small, 1.0 - angle2 / 6.0, np.sin(safe) / safe)
    versine = np.where(small, 0.5 - angle2 / 24.0, (1.0 - np.cos(safe)) / safe**2)
    once = np.cross(axis_angle, x)
    return x + sine * once + versine * np.cross(axis_angle, once)


def project(intrinsics: np.ndarray, in_camera: np.ndarray) -> np.ndarray:
    """Pixels of points in camera axes; `intrinsics` are rows of (focal, k1, k2)."""
    plane = in_camera[:, :2] / -in_camera[:, 2:]
    r2 = np.sum(plane**2, axis=1)
    focal, k1, k2 = intrinsics.T
    return (focal * (1.0 + r2 * (k1 + r2 * k2)))[:, None] * plane


def read(path: str) -> Bal:
    """Reads a file; ValueError says what is wrong with it."""
    numbers = np.fromfile(path, sep=" ")
    if len(numbers) < 3:
        raise ValueError(f"{path}: no BAL file")
    n, m, k = (int(x) for x in numbers[:3])
    if len(numbers) != 3 + 4 * k + 9 * n + 3 * m:
        raise ValueError(f"{path}: {len(numbers)} numbers for {n} cameras, {m} points, {k} observations")
    observations, cameras, points = np.split(numbers[3:], [4 * k, 4 * k + 9 * n])
    observations = observations.reshape(k, 4)
    camera_of, point_of = observations[:, 0].astype(int), observations[:, 1].astype(int)
    if k and (camera_of.max() >= n or point_of.max() >= m or min(camera_of.min(), point_of.min()) < 0):
        raise ValueError(f"{path}: an index is out of range")
    return Bal(cameras.reshape(n, 9), points.reshape(m, 3), camera_of, point_of, observations[:, 2:].copy())


def write(path: str, bal: Bal) -> None:
    """Writes a file with 17 digits; reading it gives the same numbers."""
    with open(path, "w", encoding="ascii") as out:
        out.write(f"{len(bal.cameras)} {len(bal.points)} {len(bal.pixels)}\n")
        rows = zip(bal.camera_of.tolist(), bal.point_of.tolist(), bal.pixels.tolist())
        out.writelines(f"{camera} {point} {u:.17g} {v:.17g}\n" for camera, point, (u, v) in rows)
        out.writelines(f"{x:.17g}\n" for x in bal.cameras.ravel().tolist())
        out.writelines(f"{x:.17g}\n" for x in bal.points.ravel().tolist())


def main() -> None:
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    for path in sys.argv[1:]:
        bal = read(path)
        facts = {
            "file": path,
            "cost": bal.cost(),
            "cameras": len(bal.cameras),
            "points": len(bal.points),
            "observations": len(bal.pixels),
            "behind_camera": bal.behind_camera(),
        }
        print(json.dumps(facts))


if __name__ == "__main__":
    main()
