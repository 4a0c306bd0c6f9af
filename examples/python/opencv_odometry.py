"""A frontend that nobody here wrote maps through covis: the RGB-D odometry of OpenCV 5 (`cv2.Odometry`).

`python opencv_odometry.py FOLDER [URL] [--out FOLDER]`: a folder as of rgbd_frontend.py. The odometry goes
from frame to frame, keeps no map and drifts. This adapter sends a keyframe where the camera has moved: the
odometry's pose, ORB features with depth, and which of them the last keyframe shows too. Loops are the
server's to find. Written are `alone.tum`, the odometry's own trajectory, and `covis.tum`, the same frames
on the map. The odometry is not told of corrections: both come of one run.
"""

import argparse
from pathlib import Path

import covis
import cv2
import numpy as np
from rgbd_frontend import frames

MOVED_M, TURNED_RAD = 0.1, 0.1
"""A keyframe is sent where the camera moved or turned by more since the last one."""
AGREES_PX = 6.0
"""A feature that two keyframes share lies no further from where the odometry says that it is."""


class Features:
    """The ORB features of a keyframe that have a depth."""

    def __init__(self, orb, gray, depth, K):
        corners, self.words = orb.detectAndCompute(gray, None)
        self.pixels = np.array([corner.pt for corner in corners])
        self.octaves = np.array([corner.octave for corner in corners])
        column, row = np.rint(self.pixels).astype(int).T
        self.depths = depth[row, column]
        self.keep(self.depths > 0)
        rays = np.column_stack([self.pixels, np.ones(len(self.pixels))]) @ np.linalg.inv(K).T
        self.points = rays * self.depths[:, None]
        self.landmarks = np.full(len(self.pixels), -1)

    def keep(self, which):
        self.pixels, self.depths = self.pixels[which], self.depths[which]
        self.words, self.octaves = self.words[which], self.octaves[which]

    def follow(self, last, camera_from_last, K):
        """Takes over the landmarks that the last keyframe shows too."""
        matches = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True).match(last.words, self.words)
        there, here = np.array([(m.queryIdx, m.trainIdx) for m in matches]).reshape(-1, 2).T
        seen = last.points[there] @ camera_from_last[:3, :3].T + camera_from_last[:3, 3]
        with np.errstate(divide="ignore", invalid="ignore"):
            predicted = (seen @ K.T)[:, :2] / seen[:, 2:]
        agrees = np.linalg.norm(predicted - self.pixels[here], axis=1) < AGREES_PX
        self.landmarks[here[agrees]] = last.landmarks[there[agrees]]


class Odometry:
    """OpenCV's odometry, from frame to frame."""

    def __init__(self, K):
        settings = cv2.OdometrySettings()
        settings.setCameraMatrix(K.astype(np.float32))
        self.tracker = cv2.Odometry(cv2.OdometryType_RGB_DEPTH, settings, cv2.OdometryAlgoType_COMMON)
        self.last, self.odom_from_camera = None, np.eye(4)

    def track(self, gray, depth):
        """The pose after this frame; `None` where it cannot be compared with the one before."""
        measured = np.where(depth > 0, depth, np.nan).astype(np.float32)
        frame = cv2.OdometryFrame(measured, cv2.cvtColor(gray, cv2.COLOR_GRAY2BGR))
        self.tracker.prepareFrame(frame)
        last, self.last = self.last, frame
        if last is not None:
            is_found, last_from_frame = self.tracker.compute(frame, last)
            if not is_found:
                return None
            self.odom_from_camera = self.odom_from_camera @ last_from_frame
        return self.odom_from_camera


def run(sequence, session, watched, K, distortion):
    """Time, pose and keyframe of each frame that was tracked; the poses of the keyframes."""
    odometry, orb = Odometry(K), cv2.ORB_create(1000)
    tracked, keyframes, key, last, next_landmark = [], {}, None, None, 0
    for id, (t, gray, depth) in enumerate(sequence):
        if id == 0:
            size = gray.shape[::-1]
            straight = cv2.initUndistortRectifyMap(K, distortion, None, K, size, cv2.CV_32FC1)
            session.camera(0, *size, K)  # of images without distortion
        gray = cv2.remap(gray, *straight, cv2.INTER_LINEAR)
        depth = cv2.remap(depth.astype(np.float32), *straight, cv2.INTER_NEAREST)
        pose = odometry.track(gray, depth)
        if pose is None:
            continue
        moved = np.eye(4) if key is None else np.linalg.inv(keyframes[key]) @ pose
        turn = np.linalg.norm(cv2.Rodrigues(moved[:3, :3])[0])
        if key is None or np.linalg.norm(moved[:3, 3]) > MOVED_M or turn > TURNED_RAD:
            features = Features(orb, gray, depth, K)
            if last is not None:
                features.follow(last, np.linalg.inv(moved), K)
            is_new = features.landmarks < 0
            features.landmarks[is_new] = next_landmark + np.arange(is_new.sum())
            next_landmark += is_new.sum()
            map_from_odom = watched.map_from_odom("opencv")
            start = pose if map_from_odom is None else map_from_odom @ pose
            session.keyframe(
                id, t, start, features.pixels, features.landmarks, features.depths,
                descriptors=features.words, descriptor_name="orb", odom_from_camera=pose,
                sigma_px=1.2**features.octaves,
            )  # fmt: skip
            if key is not None:
                session.odometry(id, key, id, moved, covis.closure_information(0.01, 0.01))
            key, last, keyframes[id] = id, features, pose
        tracked.append((t, pose, key))
    return tracked, keyframes


def main() -> None:
    arguments = argparse.ArgumentParser()
    arguments.add_argument("folder", type=Path)
    arguments.add_argument("url", nargs="?")
    arguments.add_argument("--out", type=Path, default=Path("."))
    given = arguments.parse_args()
    fx, fy, cx, cy, *distortion = np.loadtxt(given.folder / "camera.txt")
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    with covis.connect(given.url) if given.url else covis.local() as client:
        with client.ingest("opencv", "opencv") as session, client.watch("opencv") as watched:
            tracked, keyframes = run(frames(given.folder), session, watched, K, np.array(distortion))
            session.wait_optimized()
            watched.wait(session.report.revision)
            poses, closures = watched.poses, watched.closures
    # A frame moves along with its keyframe.
    moved = {id: poses[id] @ np.linalg.inv(keyframes[id]) for id in keyframes}
    given.out.mkdir(parents=True, exist_ok=True)
    rows = [(t, number, pose) for number, (t, pose, _) in enumerate(tracked)]
    covis.Trajectory.of_rows(rows).write_tum(given.out / "alone.tum")
    rows = [(t, number, moved[key] @ pose) for number, (t, pose, key) in enumerate(tracked)]
    covis.Trajectory.of_rows(rows).write_tum(given.out / "covis.tum")
    counted = sum(closure.counts for closure in closures)
    print(f"{len(tracked)} frames, {len(poses)} keyframes, {counted} loops that the server found")


if __name__ == "__main__":
    main()
