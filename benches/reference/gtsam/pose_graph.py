#!/usr/bin/env python3
"""The GTSAM twin of `covis solve pose-graph`: the same file, another solver.

Gauss-Newton or Levenberg-Marquardt with multifrontal Cholesky over a g2o file in SE(2) or SE(3),
1/2 sum r' Omega r, the lowest id held by a prior that costs nothing. Starts: the file's vertices,
measurements strung together (tree), or GTSAM's own initialization (chordal: InitializePose3 in
SE(3), LAGO in SE(2)).

Prints one JSON document in the words of `covis solve pose-graph --json`; a row is one `iterate()`.
Seconds count the chordal start and then from the construction of the optimizer; building the graph
and its values is told apart, as build_seconds. The tree is numpy's work and not counted.

GTSAM has no option for threads: --threads binds it to so many processors where it has a pool (Linux).
Needs: numpy and gtsam (pip).
"""

from __future__ import annotations

import argparse
import json
import resource
import time

import threads


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file")
    parser.add_argument("--method", choices=["gn", "lm"], default="gn")
    parser.add_argument("--start", choices=["given", "tree", "chordal"], default="given")
    parser.add_argument("--threads", type=int)
    parser.add_argument("--max-iterations", type=int, default=100)
    parser.add_argument("--out", help="write the solved vertices here")
    return parser.parse_args()


options = arguments()
with threads.bound(options.threads):
    import gtsam

import graphs  # noqa: E402
from graphs import g2o  # noqa: E402


def main() -> None:
    graph = g2o.read(options.file)
    if options.start == "given" and not graph.has_vertices:
        raise SystemExit(f"error: {options.file}: has no vertices: --start tree or chordal")
    begin = time.perf_counter()
    between = graphs.factors(graph)
    problem = gtsam.NonlinearFactorGraph()
    for factor in between:
        problem.add(factor)
    start_seconds = 0.0
    if options.start == "chordal":
        posed = graphs.chordal_problem(graph, between)
        now = time.perf_counter()
        values = graphs.chordal(graph, posed)
        start_seconds = time.perf_counter() - now
    else:
        values = graphs.values(graph, g2o.spanning_tree(graph) if options.start == "tree" else graph.poses)
    first = int(graph.ids[0])
    problem.add(graphs.prior(first, values.atPose2(first) if graph.group is g2o.Se2 else values.atPose3(first)))
    if options.method == "gn":
        chosen, make = gtsam.GaussNewtonParams(), gtsam.GaussNewtonOptimizer
    else:
        chosen, make = gtsam.LevenbergMarquardtParams(), gtsam.LevenbergMarquardtOptimizer
    chosen.setMaxIterations(options.max_iterations)
    chosen.setLinearSolverType("MULTIFRONTAL_CHOLESKY")
    build_seconds = time.perf_counter() - begin - start_seconds

    start = time.perf_counter() - start_seconds
    optimizer = make(problem, values, chosen)
    costs, seconds = [optimizer.error()], [time.perf_counter() - start]
    termination = "max iterations"
    while len(costs) <= options.max_iterations:
        optimizer.iterate()
        costs.append(optimizer.error())
        seconds.append(time.perf_counter() - start)
        # covis' cost tolerance. Gauss-Newton may climb for a while and come down again.
        if abs(costs[-2] - costs[-1]) <= 1e-9 * costs[-2]:
            termination = "cost tolerance"
            break
    if options.out:
        g2o.write_poses(options.out, graph, graphs.poses_of(graph, optimizer.values()))

    rows = [{"iteration": k, "cost": c, "seconds": round(s, 6), "accepted": True}
            for k, (c, s) in enumerate(zip(costs, seconds))]
    print(json.dumps({
        "solver": "GTSAM",
        "group": graph.group.TAG.partition(":")[0],
        "method": options.method,
        "init": options.start,
        "init_seconds": round(start_seconds, 6),
        "threads": threads.used(),
        "initial_cost": costs[0],
        "final_cost": costs[-1],
        "iterations": rows,
        "build_seconds": round(build_seconds, 6),
        "solve_seconds": seconds[-1],
        "peak_memory_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0, 1),
        "termination": termination,
        "converged": termination == "cost tolerance",
    }))


if __name__ == "__main__":
    graphs.run(main)
