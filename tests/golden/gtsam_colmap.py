#!/usr/bin/env python3
"""Bundle adjustment of a COLMAP sparse model (text or binary) with GTSAM: cost before and after.

usage: gtsam_colmap.py FOLDER MAX_ITERATIONS
Cost is 1/2 sum of squared reprojection errors in px^2 over all observations of a 3D point; intrinsics fixed; the first
image in natural order of the names is held. Cameras: OPENCV, PINHOLE, SIMPLE_PINHOLE, SIMPLE_RADIAL, RADIAL.
Prints "iteration cost seconds" lines, then "EVALUATED initial final observations" (numpy, not GTSAM, over the same
observations), then "FINAL cost iterations seconds".
Needs: numpy, gtsam
"""
import os
import re
import struct
import sys
import time

import gtsam
import numpy as np

MODELS = {0: ("SIMPLE_PINHOLE", 3), 1: ("PINHOLE", 4), 2: ("SIMPLE_RADIAL", 4), 3: ("RADIAL", 5), 4: ("OPENCV", 8)}


def rows(folder, name):
    """Lines of a text file of the model without comments; a trailing empty line is not one."""
    return [l for l in open(os.path.join(folder, name)).read().splitlines() if not l.startswith("#")]


def read_text(folder):
    cameras, images, points = {}, {}, {}
    for line in rows(folder, "cameras.txt"):
        s = line.split()
        cameras[int(s[0])] = (s[1], np.array(s[4:], float))
    lines = rows(folder, "images.txt")
    for head, body in zip(lines[0::2], lines[1::2]):
        s, b = head.split(), body.split()
        seen = [(float(b[k]), float(b[k + 1]), int(b[k + 2])) for k in range(0, len(b), 3)]
        images[int(s[0])] = (np.array(s[1:5], float), np.array(s[5:8], float), int(s[8]), s[9], seen)
    for line in rows(folder, "points3D.txt"):
        s = line.split()
        points[int(s[0])] = np.array(s[1:4], float)
    return cameras, images, points


def read_binary(folder):
    def take(f, form):
        return struct.unpack("<" + form, f.read(struct.calcsize("<" + form)))

    cameras, images, points = {}, {}, {}
    with open(os.path.join(folder, "cameras.bin"), "rb") as f:
        for _ in range(*take(f, "Q")):
            c, model, _, _ = take(f, "IiQQ")
            cameras[c] = (MODELS[model][0], np.array(take(f, f"{MODELS[model][1]}d")))
    with open(os.path.join(folder, "images.bin"), "rb") as f:
        for _ in range(*take(f, "Q")):
            v = take(f, "I7dI")
            name = b""
            while (c := f.read(1)) != b"\0":
                name += c
            seen = [take(f, "ddq") for _ in range(*take(f, "Q"))]
            images[v[0]] = (np.array(v[1:5]), np.array(v[5:8]), v[8], name.decode(), seen)
    with open(os.path.join(folder, "points3D.bin"), "rb") as f:
        for _ in range(*take(f, "Q")):
            v = take(f, "Q3d3Bd")
            points[v[0]] = np.array(v[1:4])
            f.read(8 * take(f, "Q")[0])
    return cameras, images, points


def as_opencv(model, p):
    """fx, fy, cx, cy, k1, k2, p1, p2 of any of the models."""
    if model == "OPENCV":
        return p
    if model == "PINHOLE":
        return np.array([*p, 0, 0, 0, 0])
    k = {"SIMPLE_PINHOLE": [0, 0], "SIMPLE_RADIAL": [*p[3:4], 0], "RADIAL": p[3:5]}[model]
    return np.array([p[0], p[0], p[1], p[2], *k, 0, 0])


def evaluate(groups, pose_of, point_of):
    """The cost by plain numpy; observations behind the camera are counted like all others."""
    total = 0.0
    for image, (k, keys, pixels) in groups.items():
        r, t = pose_of(image)  # camera_from_world
        p = np.array([point_of(j) for j in keys]) @ r.T + t
        x, y = p[:, 0] / p[:, 2], p[:, 1] / p[:, 2]
        r2 = x * x + y * y
        g = 1 + k[4] * r2 + k[5] * r2 * r2
        u = k[0] * (x * g + 2 * k[6] * x * y + k[7] * (r2 + 2 * x * x)) + k[2]
        v = k[1] * (y * g + 2 * k[7] * x * y + k[6] * (r2 + 2 * y * y)) + k[3]
        total += 0.5 * (((np.stack([u, v], 1) - pixels) ** 2).sum())
    return float(total)


def natural(name):
    return [int(s) if s.isdigit() else s for s in re.split(r"(\d+)", name)]


def main():
    folder, iterations = sys.argv[1], int(sys.argv[2])
    read = read_text if os.path.exists(os.path.join(folder, "images.txt")) else read_binary
    cameras, images, points = read(folder)
    X, L = gtsam.symbol_shorthand.X, gtsam.symbol_shorthand.L
    graph, values, groups, used = gtsam.NonlinearFactorGraph(), gtsam.Values(), {}, set()
    unit = gtsam.noiseModel.Unit.Create(2)
    for i, (q, t, camera, _, seen) in images.items():
        k = as_opencv(*cameras[camera])
        calibration = gtsam.Cal3DS2(k[0], k[1], 0, k[2], k[3], k[4], k[5], k[6], k[7])
        r = gtsam.Rot3.Quaternion(*(q / np.linalg.norm(q)))
        values.insert(X(i), gtsam.Pose3(r, t).inverse())
        seen = [s for s in seen if s[2] != -1]
        groups[i] = (k, [s[2] for s in seen], np.array([s[:2] for s in seen]))
        for u, v, j in seen:
            graph.add(gtsam.GenericProjectionFactorCal3DS2(np.array([u, v]), unit, X(i), L(j), calibration))
            used.add(j)
    for j in sorted(used):
        values.insert(L(j), points[j])
    first = min(images, key=lambda i: natural(images[i][3]))
    graph.add(gtsam.NonlinearEqualityPose3(X(first), values.atPose3(X(first))))
    params = gtsam.LevenbergMarquardtParams()
    params.setMaxIterations(iterations)

    def cost(v):
        def pose(i):
            p = v.atPose3(X(i)).inverse()
            return p.rotation().matrix(), p.translation()

        return evaluate(groups, pose, lambda j: v.atPoint3(L(j)))

    t0 = time.perf_counter()
    optimizer, last = gtsam.LevenbergMarquardtOptimizer(graph, values, params), None
    print(f"0 {graph.error(values):.12e} 0.0")
    for n in range(1, iterations + 1):
        optimizer.iterate()
        e = optimizer.error()
        print(f"{n} {e:.12e} {time.perf_counter() - t0:.6f}", flush=True)
        if last is not None and abs(last - e) <= 1e-10 * last:
            break
        last = e
    count = sum(len(g[1]) for g in groups.values())
    print(f"EVALUATED {cost(values):.17g} {cost(optimizer.values()):.17g} {count}")
    print(f"FINAL {optimizer.error():.12e} {n} {time.perf_counter() - t0:.6f}")


if __name__ == "__main__":
    main()
