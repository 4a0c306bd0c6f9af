#!/usr/bin/env python3
"""The GTSAM twin of `covis solve pose-graph --incremental`: iSAM2, fed vertex by vertex in id order.

Step k adds the k-th vertex with all its edges to lower ids; a new vertex starts at the estimate of
an older one strung on by a measurement. The vertices of the file are not used but the first, which is held.
A step's time is that of ISAM2.update alone: neither the guess is in it nor the calculation of an
estimate, which covis' steps include.

Prints one JSON document in the words of covis. A row every 100 steps has the cost of the estimate
over what has been added; the last one, and what --out gets, is of the best estimate that iSAM2 gives.
Needs: numpy and gtsam (pip).
"""

from __future__ import annotations

import argparse
import json
import resource
import time

import threads

ROW_EVERY = 100


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file")
    parser.add_argument("--threshold", type=float, default=0.1,
                        help="of an update that relinearizes a pose, m and rad (GTSAM's default: 0.1)")
    parser.add_argument("--skip", type=int, default=10, help="steps between relinearizations (GTSAM's default: 10)")
    parser.add_argument("--threads", type=int)
    parser.add_argument("--out", help="write the solved vertices here")
    return parser.parse_args()


options = arguments()
with threads.bound(options.threads):
    import gtsam

import graphs  # noqa: E402
import numpy as np  # noqa: E402

from graphs import g2o  # noqa: E402


class Growing:
    """iSAM2 and what it must be told at each step."""

    def __init__(self, graph: g2o.Graph) -> None:
        parameters = gtsam.ISAM2Params()
        parameters.setRelinearizeThreshold(options.threshold)
        parameters.relinearizeSkip = options.skip
        self.graph, self.isam = graph, gtsam.ISAM2(parameters)
        flat = graph.group is g2o.Se2
        self.estimate = self.isam.calculateEstimatePose2 if flat else self.isam.calculateEstimatePose3
        self.factors = graphs.factors(graph)
        self.due: list[list[int]] = [[] for _ in graph.ids]
        for k, row in enumerate(np.maximum(graph.i, graph.j).tolist()):
            self.due[row].append(k)

    def guess(self, row: int):
        """Where a new vertex starts: on its edge from the nearest id."""
        graph, ids = self.graph, self.graph.ids
        if row == 0:
            return graphs.pose(graph, graph.poses[0])
        if not self.due[row]:
            raise SystemExit(f"error: vertex {ids[row]} has no edge to a lower id")
        edge = min(self.due[row], key=lambda k: abs(int(graph.i[k]) - int(graph.j[k])))
        i, j, measured = int(graph.i[edge]), int(graph.j[edge]), graphs.pose(graph, graph.measured[edge])
        if j == row:
            return self.estimate(int(ids[i])).compose(measured)
        return self.estimate(int(ids[j])).compose(measured.inverse())

    def step(self, row: int) -> float:
        """Adds a vertex and returns the seconds of the update."""
        key, guess = int(self.graph.ids[row]), self.guess(row)
        added, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        values.insert(key, guess)
        if row == 0:
            added.add(graphs.prior(key, guess))
        for edge in self.due[row]:
            added.add(self.factors[edge])
        start = time.perf_counter()
        self.isam.update(added, values)
        return time.perf_counter() - start


def main() -> None:
    graph = g2o.read(options.file)
    growing = Growing(graph)
    steps, rows = [], []
    for row in range(len(graph.ids)):
        steps.append(growing.step(row))
        is_last = row + 1 == len(graph.ids)
        if (row + 1) % ROW_EVERY == 0 or is_last:
            isam = growing.isam
            values = isam.calculateBestEstimate() if is_last else isam.calculateEstimate()
            cost = isam.getFactorsUnsafe().error(values)
            rows.append({"iteration": row + 1, "cost": cost, "seconds": round(sum(steps), 6)})
    if options.out:
        g2o.write_poses(options.out, graph, graphs.poses_of(graph, values))
    ordered = [1e3 * seconds for seconds in sorted(steps)]
    median, p99 = (ordered[round(share * (len(ordered) - 1))] for share in (0.5, 0.99))
    print(json.dumps({
        "solver": "GTSAM iSAM2",
        "group": graph.group.TAG.partition(":")[0],
        "threads": threads.used(),
        "final_cost": rows[-1]["cost"],
        "solve_seconds": rows[-1]["seconds"],
        "iterations": rows,
        "incremental": {
            "steps": len(steps),
            "median_ms": median,
            "p99_ms": p99,
            "max_ms": ordered[-1],
            "final_cost": rows[-1]["cost"],
        },
        "peak_memory_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0, 1),
    }))


if __name__ == "__main__":
    graphs.run(main)
