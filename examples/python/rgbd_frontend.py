"""An RGB-D frontend on OpenCV: ORB features, pose by PnP, keyframes to covis, whose map it tracks in.

`python rgbd_frontend.py FOLDER [URL] [--out FILE]`: a folder as the TUM RGB-D benchmark has them, with
rgb.txt, depth.txt and camera.txt (fx fy cx cy k1 k2 p1 p2 k3). Without a URL it starts a server of its own.
"""

import argparse
from pathlib import Path

import covis
import cv2
import numpy as np


def frames(folder: Path, depth_scale: float = 5000.0):
    """Time, gray image and depth in meters of each frame; the nearest depth in time is taken."""
    rgb, depth = ([line.split()[:2] for line in open(folder / f"{name}.txt") if line[0] != "#"]
                  for name in ("rgb", "depth"))
    times = np.array([float(t) for t, _ in depth])
    for t, name in rgb:
        nearest = depth[np.argmin(abs(times - float(t)))][1]
        z = cv2.imread(str(folder / nearest), cv2.IMREAD_UNCHANGED) / depth_scale
        yield float(t), cv2.imread(str(folder / name), cv2.IMREAD_GRAYSCALE), z


def track(sequence, session, watched, K, distortion):
    orb, matcher = cv2.ORB_create(1000), cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True)
    session.camera(0, 640, 480, K, distortion)
    odom_from_camera, key, next_landmark = np.eye(4), None, 0
    for id, (t, gray, z) in enumerate(sequence):
        corners, words = orb.detectAndCompute(gray, None)
        pixels = np.array([corner.pt for corner in corners])
        column, row = np.rint(pixels).astype(int).T
        depths = z[row, column]
        rays = cv2.undistortPoints(pixels[:, None], K, distortion)[:, 0]
        points = np.column_stack([rays, np.ones(len(rays))]) * depths[:, None]  # in the camera
        landmarks = np.full(len(pixels), -1)
        if key is not None:
            # The pose relative to the last keyframe, from points there and pixels here.
            pairs = [(m.queryIdx, m.trainIdx) for m in matcher.match(key["words"], words)]
            there, here = np.array([p for p in pairs if key["depths"][p[0]] > 0]).T
            found, turn, shift, inliers = cv2.solvePnPRansac(
                key["points"][there], pixels[here], K, distortion, reprojectionError=3.0)
            if not found or len(inliers) < 30:
                continue  # lost in this frame; the next one is compared with the same keyframe
            camera_from_key = np.eye(4)
            camera_from_key[:3, :3], camera_from_key[:3, 3] = cv2.Rodrigues(turn)[0], shift[:, 0]
            odom_from_camera = key["odom_from_camera"] @ np.linalg.inv(camera_from_key)
            there, here = there[inliers[:, 0]], here[inliers[:, 0]]
            if len(inliers) > 150 and np.linalg.norm(shift) < 0.1 and np.linalg.norm(turn) < 0.1:
                continue  # the last keyframe still shows what is seen
            landmarks[here] = key["landmarks"][there]
        is_new = (landmarks < 0) & (depths > 0)
        landmarks[is_new] = next_landmark + np.arange(is_new.sum())
        next_landmark += is_new.sum()
        used = landmarks >= 0
        # Tracking stays in its own frame, which never jumps; the map may have moved meanwhile.
        map_from_odom = watched.map_from_odom("camera")
        start = odom_from_camera if map_from_odom is None else map_from_odom @ odom_from_camera
        in_map = points[used] @ start[:3, :3].T + start[:3, 3]
        session.keyframe(id, t, start, pixels[used], landmarks[used], depths[used],
                         descriptors=words[used], new_points=in_map, descriptor_name="orb",
                         odom_from_camera=odom_from_camera)
        key = {"words": words[used], "points": points[used], "depths": depths[used],
               "landmarks": landmarks[used], "odom_from_camera": odom_from_camera}


def main() -> None:
    arguments = argparse.ArgumentParser()
    arguments.add_argument("folder", type=Path)
    arguments.add_argument("url", nargs="?")
    arguments.add_argument("--out", default="trajectory.tum")
    given = arguments.parse_args()
    fx, fy, cx, cy, *distortion = np.loadtxt(given.folder / "camera.txt")
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    with covis.connect(given.url) if given.url else covis.local() as client:
        map_id = given.folder.resolve().name.lower()
        with client.ingest(map_id, "camera") as session, client.watch(map_id) as watched:
            track(frames(given.folder), session, watched, K, np.array(distortion))
        trajectory = client.trajectory(map_id)
    trajectory.write_tum(given.out)
    print(f"{len(trajectory)} keyframes, written to {given.out}")


if __name__ == "__main__":
    main()
