#!/usr/bin/env python3
"""Solves a g2o file with landmarks and priors with GTSAM: the reference for costs of such graphs.

usage: gtsam_landmarks.py FILE MAX_ITERATIONS [OUT.g2o]
Cost is 1/2 sum r' Omega r: Log(Z^-1 Xi^-1 Xj) of edges, Log(Z^-1 X S) of priors on poses with their sensor S,
S^-1 X^-1 p - z of positions, atan2 minus the angle of bearings, the difference in the world of priors on positions.
Factors on landmarks in the frame of a pose are written here, with numeric derivatives; all others are GTSAM's own.
`FIX` is a constraint; a file without FIX and without priors holds its first pose by a prior of sigma 1e-8.
Prints one line an iteration: iteration cost seconds; last line: FINAL cost iterations seconds. Needs: gtsam, numpy (pip).
"""
import sys
import time

import gtsam
import numpy as np

path, most = sys.argv[1], int(sys.argv[2])
graph, values, sensors, fixed, points, flat = gtsam.NonlinearFactorGraph(), gtsam.Values(), {}, [], [], True
has_priors = False


def symmetric(numbers, size):
    m = np.zeros((size, size))
    m[np.triu_indices(size)] = numbers
    return m + np.triu(m, 1).T


def noise(numbers, size):
    """Of g2o's order, translation first; GTSAM has the rotation of space first."""
    m = symmetric(numbers, size)
    if size == 6:
        order = [3, 4, 5, 0, 1, 2]
        m = m[np.ix_(order, order)]
    return gtsam.noiseModel.Gaussian.Information(m)


def space(s):
    return gtsam.Pose3(gtsam.Rot3.Quaternion(s[6], s[3], s[4], s[5]), np.array(s[:3]))


def custom(keys, model, error, steps):
    """A factor with central differences: `steps` are the dimensions of the variables."""
    at = [[gtsam.Values.atPose2, gtsam.Values.atPoint2], [gtsam.Values.atPose3, gtsam.Values.atPoint3]][not flat]

    def evaluate(this, v, jacobians):
        x = [at[k](v, key) for k, key in zip((0, 1), this.keys())]
        if jacobians is not None:
            for n, size in enumerate(steps):
                columns = []
                for c in range(size):
                    d = np.zeros(size)
                    d[c] = 1e-5
                    moved = [x[:], x[:]]
                    for m, sign in zip(moved, (1, -1)):
                        m[n] = x[n].retract(sign * d) if hasattr(x[n], "retract") else x[n] + sign * d
                    columns.append((error(*moved[0]) - error(*moved[1])) / 2e-5)
                jacobians[n] = np.array(columns).T
        return error(*x)
    return gtsam.CustomFactor(model, keys, evaluate)


for line in open(path):
    s = line.split()
    if not s:
        continue
    tag = s[0]
    n = [float(x) for x in s[1:]]
    i, j = int(n[0]), int(n[1]) if len(n) > 1 else 0
    if tag == "PARAMS_SE3OFFSET":
        sensors[i] = space(n[1:])
    elif tag == "VERTEX_SE2":
        values.insert(i, gtsam.Pose2(*n[1:]))
    elif tag == "VERTEX_SE3:QUAT":
        flat = False
        values.insert(i, space(n[1:]))
    elif tag in ("VERTEX_XY", "VERTEX_TRACKXYZ"):
        points.append(i)
        values.insert(i, np.array(n[1:]))
    elif tag == "FIX":
        fixed.append(i)
    elif tag == "EDGE_SE2":
        graph.add(gtsam.BetweenFactorPose2(i, j, gtsam.Pose2(*n[2:5]), noise(n[5:], 3)))
    elif tag == "EDGE_SE3:QUAT":
        graph.add(gtsam.BetweenFactorPose3(i, j, space(n[2:9]), noise(n[9:], 6)))
    elif tag == "EDGE_SE2_XY":
        z = np.array(n[2:4])
        graph.add(custom([i, j], noise(n[4:], 2), lambda x, p, z=z: x.transformTo(p) - z, (3, 2)))
    elif tag == "EDGE_BEARING_SE2_XY":
        model = gtsam.noiseModel.Isotropic.Precision(1, n[3])
        graph.add(gtsam.BearingFactor2D(i, j, gtsam.Rot2(n[2]), model))
    elif tag == "EDGE_SE3_TRACKXYZ":
        z, sensor = np.array(n[3:6]), sensors[int(n[2])]
        error = lambda x, p, z=z, sensor=sensor: x.compose(sensor).transformTo(p) - z
        graph.add(custom([i, j], noise(n[6:], 3), error, (6, 3)))
    elif tag == "EDGE_PRIOR_SE2":
        has_priors = True
        graph.add(gtsam.PriorFactorPose2(i, gtsam.Pose2(*n[1:4]), noise(n[4:], 3)))
    elif tag == "EDGE_SE3_PRIOR":
        has_priors, z, sensor = True, space(n[2:9]), sensors[j]
        at = lambda x, z=z, sensor=sensor: gtsam.Pose3.Logmap(z.inverse().compose(x).compose(sensor))
        graph.add(custom([i], noise(n[9:], 6), at, (6,)))
    elif tag in ("EDGE_PRIOR_SE2_XY", "EDGE_SE3_XYZ_PRIOR", "EDGE_POINTXYZ_PRIOR"):
        has_priors, dim = True, 2 if flat else 3
        n = n[2:] if tag == "EDGE_SE3_XYZ_PRIOR" else n[1:]
        z, model = np.array(n[:dim]), noise(n[dim:], dim)
        on_point = gtsam.PriorFactorPoint2 if flat else gtsam.PriorFactorPoint3
        on_pose = gtsam.PoseTranslationPrior2D if flat else gtsam.PoseTranslationPrior3D
        graph.add((on_point if i in points else on_pose)(i, z, model))
    else:
        sys.exit(f"{path}: {tag} is not read")

cost = graph.error
for i in fixed:
    model = gtsam.noiseModel.Constrained.All(2 if flat else 3)
    if i in points:
        z = values.atPoint2(i) if flat else values.atPoint3(i)
        graph.add((gtsam.PriorFactorPoint2 if flat else gtsam.PriorFactorPoint3)(i, z, model))
    else:
        sys.exit(f"{path}: FIX of a pose is not read")
if not fixed and not has_priors:
    sys.exit(f"{path}: nothing holds the graph")

parameters = gtsam.LevenbergMarquardtParams()
parameters.setRelativeErrorTol(1e-13)
parameters.setAbsoluteErrorTol(1e-13)
begin = time.perf_counter()
solver = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters)
print(f"0 {solver.error():.12e} 0")
for k in range(1, most + 1):
    before = solver.error()
    solver.iterate()
    print(f"{k} {solver.error():.12e} {time.perf_counter() - begin:.3f}")
    if before - solver.error() <= 1e-13 * before:
        break
solution = solver.values()
print(f"FINAL {graph.error(solution):.12e} {k} {time.perf_counter() - begin:.3f}")
if len(sys.argv) > 3:
    with open(sys.argv[3], "w") as f:
        for key in solution.keys():
            if key in points:
                p = solution.atPoint2(key) if flat else solution.atPoint3(key)
                f.write(f"{'VERTEX_XY' if flat else 'VERTEX_TRACKXYZ'} {key} " + " ".join(f"{x:.12e}" for x in p) + "\n")
            elif flat:
                p = solution.atPose2(key)
                f.write(f"VERTEX_SE2 {key} {p.x():.12e} {p.y():.12e} {p.theta():.12e}\n")
            else:
                p = solution.atPose3(key)
                q = p.rotation().toQuaternion()
                numbers = [*p.translation(), q.x(), q.y(), q.z(), q.w()]
                f.write(f"VERTEX_SE3:QUAT {key} " + " ".join(f"{x:.12e}" for x in numbers) + "\n")
