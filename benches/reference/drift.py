"""How far a map drifts behind the odometry that came with it, on recorded drives.

A drive is a folder with calibration.txt (focal lengths, principal point and stereo base of the camera; its
rotation and position in the vehicle), motion.csv (frame, time, rates of turn and speeds of the vehicle, true
position and turn) and tracks.csv (frame, track, pixel on the left and on the right). Depth comes from disparity.
Start poses are the vehicle's own motion, summed up; the map gets nothing else.

    python3 benches/reference/drift.py DRIVE... [--pace burst] [--own-noise] [--wrong SHARE]

--wrong lets a share of the tracks slide, 4 px a frame, as tracks do that lost their point. The script
prints, for each drive and pace, the error over 100 m of odometry and of the map. A server is started for each.
"""

import argparse
import pathlib
from dataclasses import dataclass

import covis
import numpy as np

WAY = 100.0
"""Length over which drift is measured, m."""
LEAST_DISPARITY = 1.0
"""Disparities below it say next to nothing of a depth, px."""
LEAST_TRACKS = 8
"""A frame with fewer tracks makes no keyframe."""
IMAGE = (1400, 500)
SLIDE_PX = 4.0
"""Deviation of the step between two frames of a track that slides, px."""


def rotation(turn: np.ndarray) -> np.ndarray:
    """The rotation matrix of a rotation vector, rad (Rodrigues)."""
    angle = np.linalg.norm(turn)
    x, y, z = turn
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    if angle < 1e-12:
        return np.eye(3) + cross
    return np.eye(3) + np.sin(angle) / angle * cross + (1 - np.cos(angle)) / angle**2 * cross @ cross


def pose(turn: np.ndarray, position: np.ndarray) -> np.ndarray:
    """A rigid motion as a matrix of 4 by 4."""
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = turn, position
    return result


@dataclass
class Drive:
    """What was recorded on a drive. Poses are those of the vehicle."""

    name: str
    intrinsics: np.ndarray
    base_m: float
    vehicle_from_camera: np.ndarray
    times_s: np.ndarray
    truth: list[np.ndarray]
    odometry: list[np.ndarray]
    views: dict[int, np.ndarray]
    """By frame: track, pixel (2), disparity."""

    @staticmethod
    def read(folder: pathlib.Path) -> "Drive":
        """Reads a folder."""
        lines = [x for x in (folder / "calibration.txt").read_text().splitlines() if x[:1] != "#"]
        fu, fv, cu, cv, base = map(float, lines[0].split())
        camera_from_vehicle = np.array(lines[1].split(), float).reshape(3, 3)
        motion = np.loadtxt(folder / "motion.csv", delimiter=",")
        tracks = np.loadtxt(folder / "tracks.csv", delimiter=",")
        truth = [pose(rotation(-row[11:14]).T, row[8:11]) for row in motion]
        odometry = truth[:1]
        for before, now in zip(motion, motion[1:]):
            seconds = now[1] - before[1]
            step = pose(rotation(before[2:5] * seconds), before[5:8] * seconds)
            odometry.append(odometry[-1] @ step)
        views: dict[int, np.ndarray] = {}
        for frame in np.unique(tracks[:, 0]):
            rows = tracks[tracks[:, 0] == frame]
            disparity = rows[:, 2] - rows[:, 4]
            seen = np.column_stack([rows[:, 1:4], disparity])[disparity > LEAST_DISPARITY]
            if len(seen) >= LEAST_TRACKS:
                views[int(frame)] = seen
        return Drive(
            name=folder.name,
            intrinsics=np.array([[fu, 0, cu], [0, fv, cv], [0, 0, 1]]),
            base_m=base,
            vehicle_from_camera=pose(camera_from_vehicle.T, np.array(lines[2].split(), float)),
            times_s=motion[:, 1] - motion[0, 1],
            truth=truth,
            odometry=odometry,
            views=views,
        )

    def spoil(self, share: float) -> None:
        """Lets a share of the tracks slide."""
        random = np.random.default_rng(1)
        tracks = np.unique(np.concatenate([seen[:, 0] for seen in self.views.values()]))
        wrong = random.choice(tracks, int(share * len(tracks)), replace=False)
        slid = {track: np.zeros(2) for track in wrong}
        for seen in self.views.values():
            for row in seen:
                if row[0] in slid:
                    slid[row[0]] += random.normal(0.0, SLIDE_PX, 2)
                    row[1:3] += slid[row[0]]

    def map(self, pace: str, own_noise: bool) -> dict[int, np.ndarray]:
        """The poses of a map that got the drive, "paced" one keyframe after the other or in a "burst"."""
        focal_base = self.intrinsics[0, 0] * self.base_m
        with covis.local() as client:
            session = client.ingest("drive", "car")
            session.camera(0, *IMAGE, self.intrinsics)
            before = None
            for frame, seen in self.views.items():
                depths = focal_base / seen[:, 3]
                start = self.odometry[frame] @ self.vehicle_from_camera
                session.keyframe(
                    frame,
                    float(self.times_s[frame]),
                    start,
                    seen[:, 1:3],
                    seen[:, 0].astype(int),
                    depths=depths,
                    # A pixel of disparity.
                    sigmas=depths**2 / focal_base,
                )
                if own_noise and before is not None:
                    measured = np.linalg.inv(before[1]) @ start
                    way = np.linalg.norm(measured[:3, 3])
                    noise = covis.closure_information(0.02 + 0.02 * way, np.radians(0.15))
                    session.odometry(10_000 + frame, before[0], frame, measured, noise)
                before = (frame, start)
                if pace == "paced":
                    session.wait_optimized()
            session.wait_optimized()
            poses = client.watch("drive").poses
            camera_from_vehicle = np.linalg.inv(self.vehicle_from_camera)
            return {frame: poses[frame] @ camera_from_vehicle for frame in self.views}

    def drift(self, poses: dict[int, np.ndarray]) -> float:
        """The mean error of the motion over 100 m, as a share of the way."""
        frames = list(self.views)
        positions = np.array([truth[:3, 3] for truth in self.truth])
        steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
        way = np.concatenate([[0.0], np.cumsum(steps)])
        errors = []
        for i in frames:
            j = next((j for j in frames if j > i and way[j] - way[i] >= WAY), None)
            if j is None:
                break
            true = np.linalg.inv(self.truth[i]) @ self.truth[j]
            error = np.linalg.inv(true) @ np.linalg.inv(poses[i]) @ poses[j]
            errors.append(np.linalg.norm(error[:3, 3]) / (way[j] - way[i]))
        return float(np.mean(errors)) if errors else float("nan")


def main() -> None:
    """Prints a row for each drive."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("drives", nargs="+", type=pathlib.Path, metavar="DRIVE")
    parser.add_argument("--pace", choices=["paced", "burst"], action="append")
    parser.add_argument("--own-noise", action="store_true", help="send ODOMETRY constraints")
    parser.add_argument("--wrong", type=float, default=0.0, metavar="SHARE", help="let tracks slide")
    arguments = parser.parse_args()
    paces = arguments.pace or ["paced", "burst"]
    print("drive", "odometry", *paces, sep="\t")
    for folder in arguments.drives:
        drive = Drive.read(folder)
        drive.spoil(arguments.wrong)
        odometry = dict(enumerate(drive.odometry))
        maps = [drive.map(pace, arguments.own_noise) for pace in paces]
        row = [f"{100 * drive.drift(poses):.2f} %" for poses in [odometry, *maps]]
        print(drive.name, *row, sep="\t", flush=True)


if __name__ == "__main__":
    main()
