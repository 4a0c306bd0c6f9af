#!/usr/bin/env python3
"""The GTSAM twin of `covis solve bundle`: the same file, another solver.

Levenberg-Marquardt with multifrontal Cholesky over a BAL file, 9 unknowns a camera or, with
--fix-intrinsics, 6. Prints one JSON document in the words of `covis solve bundle --json`. A row is
one `iterate()`, which tries dampings until one is accepted, so no row is a rejected step. Seconds
count from the construction of the optimizer; building the graph, the values and the ordering before
is told apart, as build_seconds.

GTSAM leaves an observation out while its point is behind its camera: the objective is covis' only
where none is, as `same_objective` says for the start. With --out the end can be checked too.

GTSAM has no option for threads: --threads binds it to so many processors where it has a pool (Linux).
Needs: numpy and gtsam (pip).
"""

from __future__ import annotations

import argparse
import json
import resource
import sys
import time
from pathlib import Path

import threads


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file")
    parser.add_argument("--ordering", choices=["schur", "colamd", "metis"], default="schur",
                        help="schur: all points, then all cameras")
    parser.add_argument("--threads", type=int)
    parser.add_argument("--max-iterations", type=int, default=100)
    parser.add_argument("--fix-intrinsics", action="store_true")
    parser.add_argument("--out", help="write the solved file here")
    return parser.parse_args()


options = arguments()
# This folder's name is that of the package, so the folder above goes to the end of the path.
sys.path.append(str(Path(__file__).resolve().parent.parent))

with threads.bound(options.threads):
    import gtsam

import numpy as np  # noqa: E402

import bal  # noqa: E402

POINT = gtsam.symbol_shorthand.P
# From BAL's camera axes (y up, looking down -z) to GTSAM's (y down, looking along z).
FLIP = gtsam.Rot3(np.diag([1.0, -1.0, -1.0]))


def pose_of(camera: np.ndarray) -> gtsam.Pose3:
    """GTSAM's world_from_camera of a row of a BAL file."""
    camera_from_world = gtsam.Pose3(gtsam.Rot3.Expmap(camera[:3]), camera[3:6])
    return gtsam.Pose3(FLIP, np.zeros(3)).compose(camera_from_world).inverse()


def row_of(pose: gtsam.Pose3) -> np.ndarray:
    """Axis-angle and translation of a BAL file from GTSAM's world_from_camera."""
    camera_from_world = gtsam.Pose3(FLIP, np.zeros(3)).compose(pose.inverse())
    return np.concatenate([gtsam.Rot3.Logmap(camera_from_world.rotation()), camera_from_world.translation()])


def free_intrinsics(problem: bal.Bal) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """Cameras of 9 unknowns: pose and (focal, k1, k2) are one variable, as GTSAM's own examples do."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    unit = gtsam.noiseModel.Unit.Create(2)
    for i, j, (u, v) in observations(problem):
        graph.add(gtsam.GeneralSFMFactorCal3Bundler(np.array([u, -v]), unit, i, POINT(j)))
    for i, camera in enumerate(problem.cameras):
        focal, k1, k2 = camera[6:]
        intrinsics = gtsam.Cal3Bundler(focal, k1, k2, 0.0, 0.0)
        values.insert(i, gtsam.PinholeCameraCal3Bundler(pose_of(camera), intrinsics))
    return graph, values


def known_intrinsics(problem: bal.Bal) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """Cameras of 6 unknowns. Cal3DS2 without tangential terms is Snavely's model."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    unit = gtsam.noiseModel.Unit.Create(2)
    models = [gtsam.Cal3DS2(f, f, 0.0, 0.0, 0.0, k1, k2) for f, k1, k2 in problem.cameras[:, 6:]]
    for i, j, (u, v) in observations(problem):
        graph.add(gtsam.GenericProjectionFactorCal3DS2(np.array([u, -v]), unit, i, POINT(j), models[i]))
    for i, camera in enumerate(problem.cameras):
        values.insert(i, pose_of(camera))
    return graph, values


def observations(problem: bal.Bal):
    """(camera, point, (u, v)) one by one, in the file's order."""
    return zip(problem.camera_of.tolist(), problem.point_of.tolist(), problem.pixels.tolist())


def parameters(problem: bal.Bal) -> gtsam.LevenbergMarquardtParams:
    """GTSAM's own imitation of Ceres' damping, which needs fewer steps than its defaults here."""
    chosen = gtsam.LevenbergMarquardtParams.CeresDefaults()
    chosen.setLinearSolverType("MULTIFRONTAL_CHOLESKY")
    chosen.setMaxIterations(options.max_iterations)
    if options.ordering == "schur":
        ordering = gtsam.Ordering()
        for j in np.unique(problem.point_of).tolist():
            ordering.push_back(POINT(j))
        for i in np.unique(problem.camera_of).tolist():
            ordering.push_back(i)
        chosen.setOrdering(ordering)
    else:
        chosen.setOrderingType(options.ordering.upper())
    return chosen


def update(problem: bal.Bal, values: gtsam.Values) -> None:
    """Takes the solved variables into the file."""
    for i in range(len(problem.cameras)):
        if options.fix_intrinsics:
            problem.cameras[i, :6] = row_of(values.atPose3(i))
        else:
            camera = values.atPinholeCameraCal3Bundler(i)
            model = camera.calibration()
            problem.cameras[i] = [*row_of(camera.pose()), model.fx(), model.k1(), model.k2()]
    for j in np.unique(problem.point_of).tolist():
        problem.points[j] = values.atPoint3(POINT(j))


def main() -> None:
    problem = bal.read(options.file)
    evaluated = problem.cost()
    begin = time.perf_counter()
    graph, values = (known_intrinsics if options.fix_intrinsics else free_intrinsics)(problem)
    for j in np.unique(problem.point_of).tolist():
        values.insert(POINT(j), problem.points[j])
    chosen = parameters(problem)
    build_seconds = time.perf_counter() - begin

    start = time.perf_counter()
    optimizer = gtsam.LevenbergMarquardtOptimizer(graph, values, chosen)
    costs, seconds = [optimizer.error()], [time.perf_counter() - start]
    termination = "max iterations"
    while len(costs) <= options.max_iterations:
        optimizer.iterate()
        costs.append(optimizer.error())
        seconds.append(time.perf_counter() - start)
        # covis' cost tolerance.
        if costs[-2] - costs[-1] <= 1e-9 * costs[-2]:
            termination = "cost tolerance"
            break
    if options.out:
        update(problem, optimizer.values())
        bal.write(options.out, problem)

    rows = [{"iteration": k, "cost": c, "seconds": round(s, 6), "accepted": True}
            for k, (c, s) in enumerate(zip(costs, seconds))]
    print(json.dumps({
        "solver": "GTSAM",
        "linear_solver": f"multifrontal-cholesky, {options.ordering} ordering",
        "threads": threads.used(),
        "fixed_intrinsics": options.fix_intrinsics,
        "initial_cost": costs[0],
        "final_cost": costs[-1],
        "iterations": rows,
        "build_seconds": round(build_seconds, 6),
        "solve_seconds": seconds[-1],
        "peak_memory_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0, 1),
        "termination": termination,
        "converged": termination == "cost tolerance",
        "same_objective": abs(costs[0] - evaluated) <= 1e-6 * evaluated,
    }))


if __name__ == "__main__":
    main()
