"""Poses over time, and the ways they leave to other programs. Files and evo's classes, no server."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _poses


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The poses of one client's keyframes, by time, then id."""

    times: npt.NDArray[np.float64]
    """N capture times, Unix seconds."""
    ids: npt.NDArray[np.int64]
    """N keyframe ids."""
    world_from_camera: npt.NDArray[np.float64]
    """N×4×4."""

    @classmethod
    def of_rows(cls, rows: Iterable[tuple[float, int, npt.NDArray[np.float64]]]) -> Trajectory:
        """Of (time, id, pose)."""
        ordered = sorted(rows, key=lambda row: row[:2])
        return cls(
            np.array([row[0] for row in ordered], np.float64),
            np.array([row[1] for row in ordered], np.int64),
            np.array([row[2] for row in ordered], np.float64).reshape(-1, 4, 4),
        )

    def __len__(self) -> int:
        return len(self.times)

    def write_tum(self, path: str | os.PathLike[str]) -> None:
        """Writes "time x y z qx qy qz qw" a line, which evo and `covis eval` read.

        Numbers have the fewest digits that read back exactly.
        """
        quaternions = _poses.quaternions(self.world_from_camera[:, :3, :3])
        table = np.column_stack([self.times, self.world_from_camera[:, :3, 3], quaternions])
        lines = (" ".join(map(repr, row)) + "\n" for row in table.tolist())
        Path(path).write_text("".join(lines), encoding="utf-8")

    def to_evo(self) -> Any:
        """The same as evo's `PoseTrajectory3D`; needs the extra `evo`."""
        from evo.core.trajectory import PoseTrajectory3D

        return PoseTrajectory3D(
            poses_se3=list(self.world_from_camera), timestamps=self.times.copy()
        )
