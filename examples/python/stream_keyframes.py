"""The shortest frontend in Python: streams keyframes, waits for the solves, prints the corrected poses.

`python stream_keyframes.py [URL]`; without a URL it starts a server of its own ($COVIS_BIN, else covis
from the PATH). A camera slides along a wall of known points; its start poses are off by centimeters.
"""

import sys

import covis
import numpy as np

K = np.array([[500.0, 0.0, 319.5], [0.0, 500.0, 239.5], [0.0, 0.0, 1.0]])  # px
LANDMARKS = np.arange(60)
# An uneven wall about 4 m away, world frame, m.
POINTS = np.column_stack(
    [-1.6 + 0.4 * (LANDMARKS % 10), -1.1 + 0.4 * (LANDMARKS // 10), 4 + 0.35 * (7 * LANDMARKS % 5)]
)


def world_from_camera(x: float, y: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:2, 3] = x, y
    return pose


def main() -> None:
    client = covis.connect(sys.argv[1]) if len(sys.argv) > 1 else covis.local()
    with client:
        # A map of this name from an earlier run is continued.
        with client.ingest("example-py", "robot") as session:
            session.camera(0, 640, 480, K)
            for id in range(6):
                # What tracking measures: pixels and depths of landmarks, and a pose that drifts.
                in_camera = POINTS - [0.1 * id, 0, 0]
                pixels = (in_camera @ K.T)[:, :2] / in_camera[:, 2:]
                start = world_from_camera(0.11 * id, 0.02 * (id % 2))
                depths = in_camera[:, 2]
                # These pixels are better than the 1 px that counts where nothing is stated.
                views = {"pixels": pixels, "landmark_ids": LANDMARKS, "depths": depths, "sigma_px": 0.1}
                session.keyframe(id, 100 + id, start, **views, new_points=POINTS)
            session.wait_durable()
            session.wait_optimized()
        poses = client.watch("example-py").poses
    print("keyframe   start x (m)   optimized x (m)   truth (m)")
    for id, pose in sorted(poses.items()):
        print(f"{id:>8}   {0.11 * id:>11.4f}   {pose[0, 3]:>15.4f}   {0.1 * id:>9.4f}")


if __name__ == "__main__":
    main()
