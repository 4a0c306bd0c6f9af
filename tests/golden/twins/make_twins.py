#!/usr/bin/env python3
"""Makes the small synthetic problems beside this file, on which tests lean where no real data is at hand.

usage: python3 tests/golden/twins/make_twins.py [FOLDER]     (default: this file's folder)
Needs numpy only. Every file has its own fixed seed, so that a run writes the same bytes again;
after a change here, `tests/golden/record.py` must make the goldens anew.

window-6-80.txt      BAL: 6 cameras on an arc, 80 points, 0.5 px noise, perturbed start; two observations start
                     behind their camera (depth about -0.15 m, the truth is 0.35 m in front)
sphere-200.g2o       SE(3): a spiral on a sphere, 10 rings of 20 poses, odometry and closures to the ring below,
                     full (correlated, anisotropic) information, start from noisy odometry
grid-200.g2o         SE(2) with vertices: a walk on a street grid that comes by its own track, full information
grid-100-edges.g2o   SE(2), edges only, a blank line in the middle: the start has to be made
park-80.g2o          SE(2) with landmarks: a loop among 25 trees, seen by position or by bearing; two trees are surveyed
                     (one fixed, one by a prior), and some poses have priors of all of them or of their position
hall-60.g2o          SE(3) with landmarks: two sensors off the body, full information, priors of the body and of a sensor
fleet-2d.pyfg, fleet-3d.pyfg   two robots with ranges to beacons, between beacons and to each other, which alone tie the
                     robots together; beacons seen by position; a prior of a pose and one of a beacon in 3D, none in 2D
colmap-room/         COLMAP text model: 6 images, 60 points, one OPENCV and one SIMPLE_RADIAL camera; image ids have
                     gaps and their order is not that of the names (frame_2 before frame_10)
walk-truth.txt, walk-estimate.txt   TUM trajectories at 30 Hz and about 22 Hz with jitter, in frames of their own
mono-truth.txt, mono-estimate.txt   TUM trajectories at 10 Hz; the estimate is of one camera, with a scale of its own that
                     drifts, and the truth rests for a while: there the ratio of an error to a motion is not defined
"""
import os
import sys

import numpy as np


def exp_so3(w):
    """Rotation matrix of the rotation vector w (Rodrigues)."""
    angle = np.linalg.norm(w)
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = w / angle
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def quaternion(r):
    """Unit quaternion (x, y, z, w), w >= 0, by the largest of its four squares."""
    m = np.array([
        [1 + r[0, 0] - r[1, 1] - r[2, 2], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0], r[2, 1] - r[1, 2]],
        [r[0, 1] + r[1, 0], 1 - r[0, 0] + r[1, 1] - r[2, 2], r[1, 2] + r[2, 1], r[0, 2] - r[2, 0]],
        [r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], 1 - r[0, 0] - r[1, 1] + r[2, 2], r[1, 0] - r[0, 1]],
        [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], 1 + r[0, 0] + r[1, 1] + r[2, 2]],
    ])
    q = m[int(np.argmax(np.diag(m)))]
    q = q / np.linalg.norm(q)
    return -q if q[3] < 0 else q


def log_so3(r):
    """Rotation vector of a rotation matrix, through its quaternion."""
    q = quaternion(r)
    n = np.linalg.norm(q[:3])
    return 2 * q[:3] if n < 1e-12 else 2 * np.arctan2(n, q[3]) / n * q[:3]


def looking_at(eye, target, up, axes):
    """Rotation world_from_camera at eye; axes: (x, y, z) signs times (right, down, forward)."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    return np.stack([axes[0] * right, axes[1] * down, axes[2] * forward], 1)


def numbers(values, digits):
    return " ".join(f"{v:.{digits}f}".rstrip("0").rstrip(".") if v else "0" for v in values)


# ---------------------------------------------------------------- BAL


def project_bal(camera, points):
    """Pixels and depths (positive in front) of points seen by (rotation vector, translation, f, k1, k2)."""
    p = points @ exp_so3(camera[:3]).T + camera[3:6]
    n = -p[:, :2] / p[:, 2:]
    r2 = (n * n).sum(1)
    return camera[6] * (1 + r2 * (camera[7] + camera[8] * r2))[:, None] * n, -p[:, 2]


def window(path):
    rng = np.random.default_rng(6080)
    points = rng.uniform([-2.0, -1.5, -2.0], [2.0, 1.5, 2.0], (80, 3))
    cameras = []
    for k in range(6):
        a, distance = np.radians(-36 + 15 * k), (2.0, 5.0, 5.6, 2.3, 5.2, 6.0)[k]
        eye = np.array([distance * np.sin(a), 0.5 * (k % 2), distance * np.cos(a)])
        target = np.array([0.3 * (k % 3 - 1), 0.2 * (k % 2), 0.0])
        camera_from_world = looking_at(eye, target, np.array([0.0, 1, 0]), (1, -1, -1)).T
        intrinsics = [500 + 3 * k, -0.04 + 0.004 * k, 0.01]
        cameras.append(np.concatenate([log_so3(camera_from_world), -camera_from_world @ eye, intrinsics]))
    cameras = np.array(cameras)
    # Points 78 and 79 stand on the optical axes of the two near cameras, where a depth of the wrong sign does not move
    # the image: from a start behind the camera the other views can still pull them back to the front.
    backward = {}
    for j, k in ((78, 0), (79, 3)):
        r = exp_so3(cameras[k, :3])
        backward[j] = r[2]
        points[j] = -r.T @ cameras[k, 3:6] - 0.35 * r[2]
    seen = []
    for j in range(80):
        who = []
        for k in range(6):
            _, depth = project_bal(cameras[k], points[j: j + 1])
            p = exp_so3(cameras[k, :3]) @ points[j] + cameras[k, 3:6]
            if depth[0] > 0.3 and np.linalg.norm(p[:2] / p[2]) < 0.8 and (j >= 78 or rng.random() < 0.9):
                who.append(k)
        seen += [(k, j) for k in who]
    start_points = points + rng.normal(0, 0.03, points.shape)
    for j, axis in backward.items():
        start_points[j] = points[j] + 0.5 * axis
    start = cameras.copy()
    start[:, :3] += rng.normal(0, 0.003, (6, 3))
    start[:, 3:6] += rng.normal(0, 0.02, (6, 3))
    start[:, 6] += rng.normal(0, 1.0, 6)
    start[:, 7:] += rng.normal(0, 0.001, (6, 2))
    with open(path, "w") as f:
        f.write(f"6 80 {len(seen)}\n")
        for k, j in seen:
            pixel = project_bal(cameras[k], points[j: j + 1])[0][0] + rng.normal(0, 0.5, 2)
            f.write(f"{k} {j} {pixel[0]:.6e} {pixel[1]:.6e}\n")
        for v in np.concatenate([start.ravel(), start_points.ravel()]):
            f.write(f"{v:.12e}\n")


# ---------------------------------------------------------------- pose graphs


def information(rng, sigmas):
    """A symmetric positive-definite matrix near diag(1/sigma²), correlated, of whole numbers."""
    root = np.diag(1 / np.array(sigmas)) @ (np.eye(len(sigmas)) + 0.15 * rng.normal(size=(len(sigmas),) * 2))
    return np.round(root @ root.T)


def upper(matrix):
    return " ".join(f"{matrix[r, c]:.0f}" for r in range(len(matrix)) for c in range(r, len(matrix)))


def draw(rng, matrix):
    """Noise whose covariance is the inverse of the information matrix."""
    return np.linalg.solve(np.linalg.cholesky(matrix).T, rng.normal(size=len(matrix)))


def sphere(path):
    rng = np.random.default_rng(200)
    rings, per_ring, radius = 10, 20, 5.0
    truth = []
    for i in range(rings * per_ring):
        latitude = np.radians(-70 + 140 * i / (rings * per_ring - 1))
        longitude = 2 * np.pi * i / per_ring
        up = np.array([np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)])
        east = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
        truth.append((np.stack([east, np.cross(up, east), up], 1), radius * up))
    kinds = [information(rng, (0.05, 0.05, 0.1, 0.02, 0.02, 0.05)), information(rng, (0.1, 0.05, 0.08, 0.05, 0.03, 0.03))]

    def measure(i, j, kind):
        (ra, ta), (rb, tb) = truth[i], truth[j]
        e = draw(rng, kinds[kind])
        r = ra.T @ rb
        return i, j, r @ exp_so3(e[3:]), ra.T @ (tb - ta) + r @ e[:3], kind

    edges = [measure(i, i + 1, 0) for i in range(len(truth) - 1)]
    start = [truth[0]]
    for _, _, r, t, _ in edges:
        start.append((start[-1][0] @ r, start[-1][1] + start[-1][0] @ t))
    edges += [measure(i - per_ring + s, i, 1) for i in range(per_ring, len(truth)) for s in ((0, 1) if i % 3 == 0 else (0,))]
    with open(path, "w") as f:
        for i, (r, t) in enumerate(start):
            f.write(f"VERTEX_SE3:QUAT {i} {numbers(t, 7)} {numbers(quaternion(r), 12)}\n")
        for i, j, r, t, kind in edges:
            f.write(f"EDGE_SE3:QUAT {i} {j} {numbers(t, 7)} {numbers(quaternion(r), 12)} {upper(kinds[kind])}\n")


def wrap(a):
    return (a + np.pi) % (2 * np.pi) - np.pi


def relative_se2(a, b):
    c, s, d = np.cos(a[2]), np.sin(a[2]), b[:2] - a[:2]
    return np.array([c * d[0] + s * d[1], -s * d[0] + c * d[1], wrap(b[2] - a[2])])


def compose_se2(a, b):
    c, s = np.cos(a[2]), np.sin(a[2])
    return np.array([a[0] + c * b[0] - s * b[1], a[1] + s * b[0] + c * b[1], wrap(a[2] + b[2])])


def grid(path, count, seed, vertices):
    """A walk with a turn every few meters inside a square of 8 m; each return near an old pose may close a loop."""
    rng = np.random.default_rng(seed)
    truth = [np.zeros(3)]
    while len(truth) < count:
        heading = truth[-1][2]
        if len(truth) % 4 == 0:
            heading = wrap(heading + rng.choice([-1, 1]) * np.pi / 2)
        for turn in (0, 1, 2, 3):
            a = wrap(heading + turn * np.pi / 2)
            step = truth[-1] + np.array([np.cos(a), np.sin(a), 0.0])
            if np.abs(step[:2]).max() <= 4.5:
                truth.append(np.array([step[0], step[1], a]))
                break
    kinds = [information(rng, (0.05, 0.03, 0.02)), information(rng, (0.08, 0.08, 0.03))]

    def measure(i, j, kind):
        return i, j, compose_se2(relative_se2(truth[i], truth[j]), draw(rng, kinds[kind])), kind

    edges = [measure(i, i + 1, 0) for i in range(count - 1)]
    start = [truth[0]]
    for _, _, z, _ in edges:
        start.append(compose_se2(start[-1], z))
    for j in range(count):
        near = [i for i in range(j - 10) if np.linalg.norm(truth[i][:2] - truth[j][:2]) < 1.1]
        if near and rng.random() < 0.6:
            edges.append(measure(int(rng.choice(near)), j, 1))
    with open(path, "w") as f:
        if vertices:
            for i, x in enumerate(start):
                f.write(f"VERTEX_SE2 {i} {numbers(x, 9)}\n")
        for n, (i, j, z, kind) in enumerate(edges):
            if not vertices and n == len(edges) // 2:
                f.write("\n")
            f.write(f"EDGE_SE2 {i} {j} {numbers(z, 9)} {upper(kinds[kind])}\n")


def park(path):
    rng = np.random.default_rng(80)
    count, ids = 80, lambda tree: 1000 + 7 * tree
    truth = [np.array([12 * np.cos(a), 8 * np.sin(a), wrap(np.arctan2(8 * np.cos(a), -12 * np.sin(a)))])
             for a in np.linspace(0, 2 * np.pi, count)]
    trees = rng.uniform([-15, -11], [15, 11], (25, 2))
    odometry, seen = information(rng, (0.05, 0.03, 0.02)), information(rng, (0.1, 0.07))
    start, lines = [truth[0]], []
    for i in range(count - 1):
        z = compose_se2(relative_se2(truth[i], truth[i + 1]), draw(rng, odometry))
        start.append(compose_se2(start[-1], z))
        lines.append(f"EDGE_SE2 {i} {i + 1} {numbers(z, 9)} {upper(odometry)}")
    for i, x in enumerate(truth):
        c, s = np.cos(x[2]), np.sin(x[2])
        for tree, p in enumerate(trees):
            q = np.array([[c, s], [-s, c]]) @ (p - x[:2])
            if np.linalg.norm(q) > 6:
                continue
            if tree % 4 == 3:
                bearing = wrap(np.arctan2(q[1], q[0]) + rng.normal(0, 0.02))
                lines.append(f"EDGE_BEARING_SE2_XY {i} {ids(tree)} {numbers([bearing], 9)} 2500")
            else:
                lines.append(f"EDGE_SE2_XY {i} {ids(tree)} {numbers(q + draw(rng, seen), 9)} {upper(seen)}")
    whole = information(rng, (0.2, 0.2, 0.05))
    lines.append(f"EDGE_PRIOR_SE2 40 {numbers(compose_se2(truth[40], draw(rng, whole)), 9)} {upper(whole)}")
    lines.append(f"EDGE_PRIOR_SE2_XY 20 {numbers(truth[20][:2] + rng.normal(0, 0.1, 2), 9)} 100 20 80")
    lines.append(f"EDGE_PRIOR_SE2_XY {ids(6)} {numbers(trees[6] + rng.normal(0, 0.05, 2), 9)} 400 0 400")
    named = {word for line in lines for word in line.split()[1:3]}
    with open(path, "w") as f:
        for i, x in enumerate(start):
            f.write(f"VERTEX_SE2 {i} {numbers(x, 9)}\n")
        for tree, p in enumerate(trees):
            if str(ids(tree)) not in named:
                continue  # no pose sees it
            f.write(f"VERTEX_XY {ids(tree)} {numbers(p + (0 if tree == 2 else rng.normal(0, 0.5, 2)), 9)}\n")
        f.write(f"FIX {ids(2)}\n" + "\n".join(lines) + "\n")


def hall(path):
    rng = np.random.default_rng(60)
    count, ids = 60, lambda mark: 500 + mark
    compose = lambda a, b: (a[0] @ b[0], a[0] @ b[1] + a[1])
    inverse = lambda a: (a[0].T, -a[0].T @ a[1])
    noisy = lambda a, xi: compose(a, (exp_so3(xi[3:]), xi[:3]))
    put = lambda a: f"{numbers(a[1], 9)} " + " ".join(f"{x:.12f}" for x in quaternion(a[0]))
    truth = []
    for k in range(count):
        a = 2.2 * np.pi * k / count
        eye = np.array([6 * np.cos(a), 5 * np.sin(a), 1 + 0.5 * np.sin(3 * a)])
        truth.append((exp_so3(np.array([0.1 * np.sin(a), 0.2 * np.cos(2 * a), a + 1.6])), eye))
    marks = rng.uniform([-9, -8, 0], [9, 8, 4], (40, 3))
    sensors = {3: (exp_so3(np.array([0.2, -1.1, 0.4])), np.array([0.3, -0.1, 0.2])),
               8: (exp_so3(np.array([-0.5, 0.3, 2.0])), np.array([-0.2, 0.4, 0.1]))}
    odometry, seen = information(rng, (0.03, 0.02, 0.03, 0.01, 0.01, 0.02)), information(rng, (0.05, 0.04, 0.08))
    start, lines = [truth[0]], []
    for i in range(count - 1):
        z = noisy(compose(inverse(truth[i]), truth[i + 1]), draw(rng, odometry))
        start.append(compose(start[-1], z))
        lines.append(f"EDGE_SE3:QUAT {i} {i + 1} {put(z)} {upper(odometry)}")
    for i, x in enumerate(truth):
        for mark, p in enumerate(marks):
            sensor = 3 if (i + mark) % 2 else 8
            q = compose(inverse(compose(x, sensors[sensor])), (np.eye(3), p))[1]
            if np.linalg.norm(q) < 5 and rng.random() < 0.6:
                lines.append(f"EDGE_SE3_TRACKXYZ {i} {ids(mark)} {sensor} {numbers(q + draw(rng, seen), 9)} {upper(seen)}")
    whole = information(rng, (0.1, 0.1, 0.1, 0.03, 0.04, 0.05))
    for i, sensor in ((0, 3), (30, 8)):
        z = noisy(compose(truth[i], sensors[sensor]), draw(rng, whole))
        lines.append(f"EDGE_SE3_PRIOR {i} {sensor} {put(z)} {upper(whole)}")
    lines.append(f"EDGE_SE3_XYZ_PRIOR 45 3 {numbers(truth[45][1] + rng.normal(0, 0.1, 3), 9)} 100 10 0 90 5 120")
    lines.append(f"EDGE_POINTXYZ_PRIOR {ids(4)} {numbers(marks[4] + rng.normal(0, 0.1, 3), 9)} 100 0 0 100 0 100")
    named = {word for line in lines for word in line.split()[1:3]}
    with open(path, "w") as f:
        for sensor, pose in sensors.items():
            f.write(f"PARAMS_SE3OFFSET {sensor} {put(pose)}\n")
        for i, x in enumerate(start):
            f.write(f"VERTEX_SE3:QUAT {i} {put(x)}\n")
        for mark, p in enumerate(marks):
            if str(ids(mark)) not in named:
                continue  # no sensor sees it
            f.write(f"VERTEX_TRACKXYZ {ids(mark)} {numbers(p + rng.normal(0, 0.3, 3), 9)}\n")
        f.write("\n".join(lines) + "\n")


def fleet(path, space):
    rng = np.random.default_rng(40 + space)
    steps, flat = 30, space == 2
    tags = ("SE2", "XY", "SE2_XY") if flat else ("SE3:QUAT", "XYZ", "SE3_XYZ")
    compose = compose_se2 if flat else lambda a, b: (a[0] @ b[0], a[0] @ b[1] + a[1])
    inverse = lambda a: (a[0].T, -a[0].T @ a[1])
    relative = relative_se2 if flat else lambda a, b: compose(inverse(a), b)
    at = (lambda a: a[:2]) if flat else (lambda a: a[1])
    exp = (lambda xi: xi) if flat else (lambda xi: (exp_so3(xi[3:]), xi[:3]))
    put = (lambda a: numbers(a, 9)) if flat else (lambda a: f"{numbers(a[1], 9)} {numbers(quaternion(a[0]), 12)}")
    rotated = (lambda a, p: np.array([[np.cos(a[2]), np.sin(a[2])], [-np.sin(a[2]), np.cos(a[2])]]) @ (p - a[:2])) if flat \
        else (lambda a, p: a[0].T @ (p - a[1]))

    def covariance(sigmas):
        """Correlated, with about these standard deviations."""
        a = np.diag(sigmas) @ (np.eye(len(sigmas)) + rng.uniform(-0.3, 0.3, (len(sigmas),) * 2))
        return a @ a.T

    def spelled(m):
        return " ".join(f"{m[r, c]:.12e}" for r in range(len(m)) for c in range(r, len(m)))

    def noise(m):
        return np.linalg.cholesky(m) @ rng.normal(size=len(m))

    truth, start, lines = {}, {}, {"edge": [], "range": [], "seen": [], "prior": []}
    odometry = covariance((0.05, 0.03, 0.02) if flat else (0.05, 0.03, 0.04, 0.01, 0.01, 0.02))
    for robot, (center, phase) in {"A": (-2.0, 0.0), "B": (2.0, 2.5)}.items():
        for k in range(steps):
            a = phase + 2.2 * np.pi * k / steps
            p = np.array([center + 6 * np.cos(a), 5 * np.sin(a), 1 + 0.8 * np.sin(3 * a)])
            heading = a + 1.6
            truth[robot, k] = np.array([p[0], p[1], wrap(heading)]) if flat else \
                (exp_so3(np.array([0.1 * np.sin(a), 0.2 * np.cos(2 * a), heading])), p)
        start[robot, 0] = compose(truth[robot, 0], exp(0.02 * rng.normal(size=3 if flat else 6)))
        for k in range(1, steps):
            z = compose(relative(truth[robot, k - 1], truth[robot, k]), exp(noise(odometry)))
            start[robot, k] = compose(start[robot, k - 1], z)
            lines["edge"].append(f"EDGE_{tags[0]} {k / 2 - 0.25} {robot}{k - 1} {robot}{k} {put(z)} {spelled(odometry)}")
    beacons = rng.uniform([-9, -8, 0][:space], [9, 8, 4][:space], (5, space))
    length = lambda a, b, sigma: np.linalg.norm(a - b) + sigma * rng.normal()
    for (robot, k), x in truth.items():
        for n, p in enumerate(beacons):
            if (k + n) % 3 == 0:
                ends = f"{robot}{k} L{n}" if n % 2 else f"L{n} {robot}{k}"
                lines["range"].append(f"EDGE_RANGE {k / 2} {ends} {length(at(x), p, 0.1):.9f} 0.01")
        if robot == "A":
            other = 29 - k
            distance = length(at(x), at(truth["B", other]), 0.05)
            lines["range"].append(f"EDGE_RANGE {k / 2} A{k} B{other} {distance:.9f} 0.0025")
    lines["range"].append(f"EDGE_RANGE 0 L0 L3 {length(beacons[0], beacons[3], 0.02):.9f} 0.0004")
    sight = covariance((0.1, 0.08, 0.12)[:space])
    for robot, k, n in (("A", 3, 0), ("A", 17, 2), ("B", 8, 4), ("B", 21, 1)):
        z = rotated(truth[robot, k], beacons[n]) + noise(sight)
        lines["seen"].append(f"EDGE_{tags[2]} {k / 2} {robot}{k} L{n} {numbers(z, 9)} {spelled(sight)}")
    if not flat:
        whole, surveyed = covariance((0.1, 0.1, 0.1, 0.03, 0.04, 0.05)), covariance((0.1, 0.1, 0.1))
        z = compose(truth["A", 4], exp(noise(whole)))
        lines["prior"].append(f"VERTEX_SE3:QUAT:PRIOR 2 A4 {put(z)} {spelled(whole)}")
        lines["prior"].append(f"VERTEX_XYZ:PRIOR 0 L2 {numbers(beacons[2] + noise(surveyed), 9)} {spelled(surveyed)}")
    with open(path, "w") as f:
        for (robot, k), x in start.items():
            f.write(f"VERTEX_{tags[0]} {1700000000 + k // 2}.{'500000123' if k % 2 else '000000123'} {robot}{k} {put(x)}\n")
        for n, p in enumerate(beacons):
            f.write(f"VERTEX_{tags[1]} L{n} {numbers(p + rng.normal(0, 0.4, space), 9)}\n")
        for kind in ("prior", "edge", "seen", "range"):
            f.write("".join(line + "\n" for line in lines[kind]))


# ---------------------------------------------------------------- COLMAP


def project_colmap(model, p, points):
    """COLMAP's pixels (center of the first pixel at 0.5) of points in camera coordinates (z forward)."""
    n = points[:, :2] / points[:, 2:]
    x, y, r2 = n[:, 0], n[:, 1], (n * n).sum(1)
    if model == "SIMPLE_RADIAL":
        return p[0] * (1 + p[3] * r2)[:, None] * n + p[1:3]
    fx, fy, cx, cy, k1, k2, p1, p2 = p
    radial = 1 + k1 * r2 + k2 * r2 * r2
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + 2 * p2 * x * y + p1 * (r2 + 2 * y * y)
    return np.stack([fx * u + cx, fy * v + cy], 1)


def room(folder):
    rng = np.random.default_rng(60)
    os.makedirs(folder, exist_ok=True)
    cameras = {1: ("OPENCV", 640, 480, [520.0, 515.0, 321.5, 239.0, -0.12, 0.03, 0.0008, -0.0005]),
               4: ("SIMPLE_RADIAL", 640, 480, [500.0, 320.0, 240.0, 0.02])}
    points = rng.uniform([-2, -1.5, 3], [2, 1.5, 6], (60, 3))
    ids = [3 * k + 2 for k in range(60)]
    images = [(7, "frame_2.jpg", 1), (3, "frame_10.jpg", 1), (9, "frame_1.jpg", 4), (12, "frame_11.jpg", 1),
              (5, "frame_3.jpg", 4), (20, "frame_20.jpg", 4)]
    order = [9, 7, 5, 3, 12, 20]  # by natural name
    lines, tracks, poses = [], {j: [] for j in range(60)}, {}
    for image_id, name, camera in images:
        k = order.index(image_id)
        eye = np.array([-1.0 + 0.4 * k, 0.1 * (k % 2), 0.15 * k])
        camera_from_world = looking_at(eye, np.array([0.0, 0, 4.5]), np.array([0.0, -1, 0]), (1, 1, 1)).T
        pixels = project_colmap(cameras[camera][0], cameras[camera][3], points @ camera_from_world.T - camera_from_world @ eye)
        pixels = pixels + rng.normal(0, 0.5, pixels.shape)
        rows = []
        for j in rng.permutation(60):
            inside = 0 <= pixels[j, 0] < 640 and 0 <= pixels[j, 1] < 480
            if inside and rng.random() < 0.85:
                rows.append((j, pixels[j]))
            if rng.random() < 0.08:  # a keypoint that belongs to no point
                rows.append((None, rng.uniform([0, 0], [640, 480])))
        poses[image_id] = (camera_from_world, eye)
        lines.append((image_id, name, camera, rows))
    for image_id, _, _, rows in lines:
        for n, (j, _) in enumerate(rows):
            if j is not None:
                tracks[j].append((image_id, n))
    kept = [j for j in range(60) if len(tracks[j]) >= 2]
    with open(os.path.join(folder, "cameras.txt"), "w") as f:
        f.write("# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n")
        for c, (model, w, h, p) in cameras.items():
            f.write(f"{c} {model} {w} {h} {' '.join(repr(x) for x in p)}\n")
    with open(os.path.join(folder, "images.txt"), "w") as f:
        f.write("# Two lines an image: IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME / (X, Y, POINT3D_ID)...\n")
        for image_id, name, camera, rows in lines:
            r, eye = poses[image_id]
            eye = eye + (rng.normal(0, 0.02, 3) if image_id != order[0] else 0)
            r = r @ exp_so3(rng.normal(0, 0.004, 3) if image_id != order[0] else np.zeros(3))
            x, y, z, w = quaternion(r)
            f.write(f"{image_id} {w:.15f} {x:.15f} {y:.15f} {z:.15f} {numbers(-r @ eye, 12)} {camera} {name}\n")
            f.write(" ".join(f"{p[0]:.4f} {p[1]:.4f} {ids[j] if j in kept else -1}" for j, p in rows) + "\n")
    with open(os.path.join(folder, "points3D.txt"), "w") as f:
        f.write("# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n")
        for j in kept:
            p, color = points[j] + rng.normal(0, 0.03, 3), rng.integers(0, 256, 3)
            track = " ".join(f"{i} {n}" for i, n in tracks[j])
            f.write(f"{ids[j]} {numbers(p, 9)} {color[0]} {color[1]} {color[2]} {rng.uniform(0.2, 0.9):.4f} {track}\n")


# ---------------------------------------------------------------- trajectories


def write_trajectory(path, head, rows):
    with open(path, "w") as f:
        f.write(head)
        for t, r, p in rows:
            f.write(f"{t:.6f} {p[0]:.9f} {p[1]:.9f} {p[2]:.9f} " + " ".join(f"{x:.9f}" for x in quaternion(r)) + "\n")


def walk(truth_path, estimate_path):
    rng = np.random.default_rng(30)
    t0 = 1700000000.0

    def at(t):
        p = np.array([2 * np.sin(0.9 * t), 1.5 * np.sin(1.3 * t + 0.4), 0.4 * t])
        return exp_so3(np.array([0.2 * np.sin(t), 0.3 * np.cos(0.7 * t), 1.1 * t])), p

    stamps = np.round(t0 + np.arange(90) / 30, 6)
    write_trajectory(truth_path, "# timestamp tx ty tz qx qy qz qw\n", [(t, *at(t - t0)) for t in stamps])
    # the estimate: another frame, jittered times (some past 10 ms of any true one), drift and noise
    times = np.sort(np.round(t0 - 0.03 + np.arange(64) / 21.7 + rng.normal(0, 0.006, 64), 6))
    # two estimates that share one true pose, and one past the end of the truth but within 10 ms of it
    times = np.sort(np.append(times, np.round([t0 + 1.0 - 0.004, t0 + 1.0 + 0.003, t0 + 89 / 30 + 0.006], 6)))
    frame_r, frame_t, drift, rows = exp_so3(np.array([0.3, -0.5, 0.8])), np.array([3.0, -1, 0.5]), np.zeros(3), []
    for t in times:
        r, p = at(t - t0)
        drift = drift + rng.normal(0, 0.004, 3)
        p = p + drift + rng.normal(0, 0.002, 3)
        rows.append((t, frame_r @ r @ exp_so3(rng.normal(0, 0.004, 3)), frame_r @ p + frame_t))
    write_trajectory(estimate_path, "# a synthetic estimate\n", rows)


def mono(truth_path, estimate_path):
    rng = np.random.default_rng(31)
    t0 = 1600000000.0
    frame_r, frame_t, truth, estimate = exp_so3(np.array([-0.9, 0.4, 1.7])), np.array([-1.0, 0.2, 4]), [], []
    for k in range(70):
        # Seconds of motion: it rests from 3 s to 3.6 s.
        s = 0.1 * (k if k < 30 else max(k - 6, 30))
        p = np.array([1.2 * np.sin(0.8 * s), 0.5 * np.sin(1.7 * s), 0.9 * np.cos(0.6 * s)])
        r = exp_so3(np.array([0.4 * np.sin(0.9 * s), 0.7 * s, 0.3 * np.cos(s)]))
        t = t0 + 0.1 * k
        truth.append((t, r, p))
        q = 0.37 * (1 + 0.004 * k) * (frame_r @ (p + rng.normal(0, 0.004, 3))) + frame_t
        estimate.append((t + rng.uniform(-0.004, 0.004), frame_r @ r @ exp_so3(rng.normal(0, 0.006, 3)), q))
    write_trajectory(truth_path, "# timestamp tx ty tz qx qy qz qw\n", truth)
    write_trajectory(estimate_path, "# a synthetic estimate of one camera\n", estimate)


def main():
    folder = sys.argv[1] if len(sys.argv) > 1 else os.path.dirname(os.path.abspath(__file__))
    inside = lambda name: os.path.join(folder, name)
    window(inside("window-6-80.txt"))
    sphere(inside("sphere-200.g2o"))
    grid(inside("grid-200.g2o"), 200, 201, True)
    grid(inside("grid-100-edges.g2o"), 100, 101, False)
    park(inside("park-80.g2o"))
    hall(inside("hall-60.g2o"))
    fleet(inside("fleet-2d.pyfg"), 2)
    fleet(inside("fleet-3d.pyfg"), 3)
    room(inside("colmap-room"))
    walk(inside("walk-truth.txt"), inside("walk-estimate.txt"))
    mono(inside("mono-truth.txt"), inside("mono-estimate.txt"))


if __name__ == "__main__":
    main()
