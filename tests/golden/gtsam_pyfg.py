#!/usr/bin/env python3
"""Solves a pyfg file (PyFactorGraph's) with GTSAM: the reference for costs of graphs with ranges.

usage: gtsam_pyfg.py FILE MAX_ITERATIONS [OUT]
Cost is 1/2 sum r' S^-1 r with the file's covariances S: Log(Z^-1 Xi^-1 Xj) of edges, Log(Z^-1 X) of priors on poses,
X^-1 p - z of landmarks as poses see them, p - z of priors on landmarks, |a - b| - z of ranges. Residuals and derivatives are GTSAM's own.
A file without priors holds its first pose by a constraint.
Prints one line an iteration: iteration cost seconds; last line: FINAL cost iterations seconds. Needs: gtsam, numpy (pip).
"""
import sys
import time

import gtsam
import numpy as np

path, most = sys.argv[1], int(sys.argv[2])
graph, values, poses, points, has_priors = gtsam.NonlinearFactorGraph(), gtsam.Values(), {}, {}, False
lines = [line.split() for line in open(path)]
flat = not any(line and line[0].startswith("VERTEX_SE3") for line in lines)
dim, size = (2, 3) if flat else (3, 7)
point_tag, pose_tag = ("VERTEX_XY", "VERTEX_SE2") if flat else ("VERTEX_XYZ", "VERTEX_SE3:QUAT")


def key(name):
    return gtsam.symbol(name[0], int(name[1:]))


def pose(s):
    n = [float(x) for x in s]
    return gtsam.Pose2(*n) if flat else gtsam.Pose3(gtsam.Rot3.Quaternion(n[6], n[3], n[4], n[5]), np.array(n[:3]))


def vector(s):
    return np.array([float(x) for x in s])


def noise(s, count):
    """Of the file's order, translation first; GTSAM has the rotation of space first."""
    m = np.zeros((count, count))
    m[np.triu_indices(count)] = vector(s)
    m = m + np.triu(m, 1).T
    if count == 6:
        order = [3, 4, 5, 0, 1, 2]
        m = m[np.ix_(order, order)]
    return gtsam.noiseModel.Gaussian.Covariance(m, False)


tangent = 3 if flat else 6
between, prior, on_point = [
    (gtsam.BetweenFactorPose2, gtsam.PriorFactorPose2, gtsam.PriorFactorPoint2),
    (gtsam.BetweenFactorPose3, gtsam.PriorFactorPose3, gtsam.PriorFactorPoint3)][not flat]
range_of = [  # by how many of the two are poses
    (gtsam.RangeFactor2, gtsam.RangeFactor2D, gtsam.RangeFactorPose2),
    (gtsam.RangeFactor3, gtsam.RangeFactor3D, gtsam.RangeFactorPose3)][not flat]


def seen(a, b, z, model):
    """GTSAM has the function, and no factor of it here."""
    def error(this, v, jacobians):
        x, p = (v.atPose2(a), v.atPoint2(b)) if flat else (v.atPose3(a), v.atPoint3(b))
        of_pose, of_point = np.zeros((dim, tangent), order="F"), np.zeros((dim, dim), order="F")
        r = x.transformTo(p, of_pose, of_point) - z
        if jacobians is not None:
            jacobians[0], jacobians[1] = of_pose, of_point
        return r
    return gtsam.CustomFactor(model, [a, b], error)


for s in lines:
    if s and s[0] == pose_tag:
        poses[s[2]] = s[1]
        values.insert(key(s[2]), pose(s[3:]))
    elif s and s[0] == point_tag:
        points[s[1]] = ""
        values.insert(key(s[1]), vector(s[2:]))
for s in lines:
    if not s or s[0] in (pose_tag, point_tag):
        continue
    tag = s[0]
    if tag == pose_tag + ":PRIOR":
        has_priors = True
        graph.add(prior(key(s[2]), pose(s[3:3 + size]), noise(s[3 + size:], tangent)))
    elif tag == point_tag + ":PRIOR":
        has_priors = True
        graph.add(on_point(key(s[2]), vector(s[3:3 + dim]), noise(s[3 + dim:], dim)))
    elif tag in ("EDGE_SE2", "EDGE_SE3:QUAT"):
        graph.add(between(key(s[2]), key(s[3]), pose(s[4:4 + size]), noise(s[4 + size:], tangent)))
    elif tag in ("EDGE_SE2_XY", "EDGE_SE3_XYZ"):
        graph.add(seen(key(s[2]), key(s[3]), vector(s[4:4 + dim]), noise(s[4 + dim:], dim)))
    elif tag == "EDGE_RANGE":
        # GTSAM's factor between a pose and a point has the pose first.
        a, b = sorted(s[2:4], key=lambda name: name in points)
        model = gtsam.noiseModel.Isotropic.Variance(1, float(s[5]))
        graph.add(range_of[(a in poses) + (b in poses)](key(a), key(b), float(s[4]), model))
    else:
        sys.exit(f"{path}: {tag} is not read")
if not has_priors:
    first = key(next(iter(poses)))
    at = values.atPose2(first) if flat else values.atPose3(first)
    graph.add(prior(first, at, gtsam.noiseModel.Constrained.All(tangent)))

parameters = gtsam.LevenbergMarquardtParams()
parameters.setRelativeErrorTol(1e-14)
parameters.setAbsoluteErrorTol(1e-14)
begin = time.perf_counter()
solver = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters)
print(f"0 {solver.error():.12e} 0")
for k in range(1, most + 1):
    before = solver.error()
    solver.iterate()
    print(f"{k} {solver.error():.12e} {time.perf_counter() - begin:.3f}")
    if before - solver.error() <= 1e-14 * before:
        break
solution = solver.values()
print(f"FINAL {graph.error(solution):.12e} {k} {time.perf_counter() - begin:.3f}")
if len(sys.argv) > 3:
    with open(sys.argv[3], "w") as f:
        for name, stamp in {**poses, **points}.items():
            if name in points:
                numbers = solution.atPoint2(key(name)) if flat else solution.atPoint3(key(name))
            elif flat:
                p = solution.atPose2(key(name))
                numbers = [p.x(), p.y(), p.theta()]
            else:
                p = solution.atPose3(key(name))
                q = p.rotation().toQuaternion()
                numbers = [*p.translation(), q.x(), q.y(), q.z(), q.w()]
            f.write(f"VERTEX {name} " + " ".join(f"{x:.12e}" for x in numbers) + "\n")
