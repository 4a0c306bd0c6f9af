"""Pose graphs of g2o files in GTSAM's words, for the twins in this folder. Needs: numpy, gtsam (pip)."""

from __future__ import annotations

import sys
from pathlib import Path

# This folder's name is that of the package, so the folder above goes to the end of the path.
sys.path.append(str(Path(__file__).resolve().parent.parent))

import gtsam  # noqa: E402
import numpy as np  # noqa: E402

import g2o  # noqa: E402

# The prior alone decides where the graph lies, so it costs nothing at any pose, and its sigma does
# not matter to the optimum. A much smaller one would to the condition of the system.
PRIOR_SIGMA = 1e-4
# GTSAM's tangent of SE(3) has the rotation first.
ROTATION_FIRST = np.array([3, 4, 5, 0, 1, 2])


def pose(graph: g2o.Graph, numbers: np.ndarray) -> gtsam.Pose2 | gtsam.Pose3:
    """GTSAM's motion of a row of numbers."""
    if graph.group is g2o.Se2:
        return gtsam.Pose2(*numbers)
    x, y, z, w = numbers[3:]
    return gtsam.Pose3(gtsam.Rot3.Quaternion(w, x, y, z), numbers[:3])


def numbers_of(motion: gtsam.Pose2 | gtsam.Pose3) -> list[float]:
    """The row of numbers of GTSAM's motion."""
    if isinstance(motion, gtsam.Pose2):
        return [motion.x(), motion.y(), motion.theta()]
    q = motion.rotation().toQuaternion()
    return [*motion.translation(), q.x(), q.y(), q.z(), q.w()]


def factors(graph: g2o.Graph) -> list:
    """A between factor an edge, in the file's order. GTSAM's residual is the full logarithm too."""
    flat = graph.group is g2o.Se2
    make = gtsam.BetweenFactorPose2 if flat else gtsam.BetweenFactorPose3
    order = np.arange(3) if flat else ROTATION_FIRST
    information = graph.information[:, order][:, :, order]
    ids = graph.ids.tolist()
    rows = zip(graph.i.tolist(), graph.j.tolist(), graph.measured, information)
    gaussian = gtsam.noiseModel.Gaussian
    return [make(ids[i], ids[j], pose(graph, z), gaussian.Information(omega)) for i, j, z, omega in rows]


def prior(key: int, motion: gtsam.Pose2 | gtsam.Pose3):
    """What holds the lowest id."""
    flat = isinstance(motion, gtsam.Pose2)
    make = gtsam.PriorFactorPose2 if flat else gtsam.PriorFactorPose3
    return make(key, motion, gtsam.noiseModel.Isotropic.Sigma(3 if flat else 6, PRIOR_SIGMA))


def values(graph: g2o.Graph, poses: np.ndarray) -> gtsam.Values:
    """Rows of poses as GTSAM's values."""
    chosen = gtsam.Values()
    for key, numbers in zip(graph.ids.tolist(), poses):
        chosen.insert(key, pose(graph, numbers))
    return chosen


def poses_of(graph: g2o.Graph, chosen: gtsam.Values) -> np.ndarray:
    """GTSAM's values as rows of poses."""
    at = chosen.atPose2 if graph.group is g2o.Se2 else chosen.atPose3
    return np.array([numbers_of(at(key)) for key in graph.ids.tolist()])


def chordal_problem(graph: g2o.Graph, between: list) -> gtsam.NonlinearFactorGraph:
    """What GTSAM's own initialization takes. LAGO wants diagonal noise: that of the information."""
    problem = gtsam.NonlinearFactorGraph()
    if graph.group is g2o.Se2:
        ids = graph.ids.tolist()
        diagonals = np.diagonal(graph.information, axis1=1, axis2=2)
        for i, j, z, precisions in zip(graph.i.tolist(), graph.j.tolist(), graph.measured, diagonals):
            noise = gtsam.noiseModel.Diagonal.Precisions(precisions.copy())
            problem.add(gtsam.BetweenFactorPose2(ids[i], ids[j], pose(graph, z), noise))
    else:
        for factor in between:
            problem.add(factor)
    problem.add(prior(int(graph.ids[0]), pose(graph, graph.poses[0])))
    return problem


def chordal(graph: g2o.Graph, problem: gtsam.NonlinearFactorGraph) -> gtsam.Values:
    """LAGO in SE(2); relaxed rotations and one step of Gauss-Newton in SE(3)."""
    if graph.group is g2o.Se3:
        return gtsam.InitializePose3.initialize(problem)
    found = gtsam.lago.initialize(problem)
    # LAGO leaves an anchor of its own among the values.
    kept = gtsam.Values()
    for key in graph.ids.tolist():
        kept.insert(key, found.atPose2(key))
    return kept


def run(main) -> None:
    """Runs a twin; what GTSAM throws becomes one line."""
    try:
        main()
    except (OSError, RuntimeError, ValueError) as error:
        sys.exit(f"error: {' '.join(str(error).split('.')[0].split())}")
