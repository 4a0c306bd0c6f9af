#!/usr/bin/env python3
"""A picture of a solved pose graph: its trajectory, its loop closures and what it should have been.

The trajectory (edges between consecutive ids) is black, closures that were kept are blue.
With --report, the JSON of `covis solve pose-graph --robust ... --json`, closures that were switched
off are red. With --truth the trajectory of another graph lies below, in orange: no correspondence of
ids is assumed, both are drawn in their own frames, and a line tells how far the vertices lie from
the nearest point of it. --align-start moves the truth rigidly so that both begin at one point and are
at one bearing from there after so many meters of way; nothing else is fitted, and the distances
depend on how many meters these are.

SE3 graphs are seen from above, or in 3D with --view 3d. Needs: numpy, matplotlib (pip).
"""

from __future__ import annotations

import argparse
import json
import sys

import g2o
import matplotlib
import numpy as np

matplotlib.use("Agg")

import matplotlib.pyplot as plt  # noqa: E402
from matplotlib.collections import LineCollection  # noqa: E402
from mpl_toolkits.mplot3d.art3d import Line3DCollection  # noqa: E402


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("solved", metavar="SOLVED.g2o")
    parser.add_argument("out", metavar="OUT.png", help="or .svg, .pdf")
    parser.add_argument("--truth", metavar="OTHER.g2o")
    parser.add_argument("--report", metavar="REPORT.json", help="what the solve printed with --json")
    parser.add_argument("--align-start", type=float, metavar="METERS", help="of way that give the bearing")
    parser.add_argument("--view", choices=["above", "3d"], default="above")
    return parser.parse_args()


def switched_off(path: str, graph: g2o.Graph) -> np.ndarray:
    """Which edges a report switched off, (m,); ValueError where it speaks of another graph."""
    with open(path, encoding="utf-8") as file:
        found = json.load(file).get("robust", {}).get("switched_off")
    if found is None:
        raise ValueError(f"{path}: has no robust.switched_off; the solve needs --robust and --json")
    off = np.zeros(len(graph.i), dtype=bool)
    for entry in found:
        k = entry["edge"]
        if k >= len(off) or (graph.ids[graph.i[k]], graph.ids[graph.j[k]]) != (entry["i"], entry["j"]):
            raise ValueError(f"{path}: edge {k} is not one from {entry['i']} to {entry['j']} in the graph")
        off[k] = True
    return off


def positions(graph: g2o.Graph) -> np.ndarray:
    """Where the vertices are, (n, 3)."""
    if graph.group is g2o.Se3:
        return graph.poses[:, :3]
    return np.column_stack([graph.poses[:, :2], np.zeros(len(graph.poses))])


def lines(graph: g2o.Graph, points: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """The chosen edges as pairs of points, (k, 2, 3)."""
    return np.stack([points[graph.i[chosen]], points[graph.j[chosen]]], axis=1)


def bearing(points: np.ndarray, meters: float) -> float:
    """The angle in the plane from the first point to the one after so many meters of way."""
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    x, y, _ = points[min(int(np.searchsorted(way, meters)), len(points) - 1)] - points[0]
    return float(np.arctan2(y, x))


def align_start(truth: np.ndarray, solved: np.ndarray, meters: float) -> np.ndarray:
    """The truth, turned about the vertical and moved, to begin as the solved trajectory does."""
    turn = bearing(solved, meters) - bearing(truth, meters)
    rotation = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    return (truth - truth[0]) @ rotation.T + solved[0]


def distances(points: np.ndarray, segments: np.ndarray) -> np.ndarray:
    """Of each point the distance to the nearest of the segments (k, 2, 3), (n,)."""
    begin, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    length2 = np.maximum(np.sum(along**2, axis=1), 1e-300)
    nearest = []
    for point in points:
        share = np.clip(np.sum((point - begin) * along, axis=1) / length2, 0.0, 1.0)
        nearest.append(np.min(np.linalg.norm(begin + share[:, None] * along - point, axis=1)))
    return np.array(nearest)


def draw(layers: list[tuple[np.ndarray, dict]], view: str, title: str, out: str) -> None:
    """One layer of segments over another, with one scale on all axes."""
    flat = view == "above"
    figure, axes = plt.subplots(figsize=(9.0, 9.0), layout="constrained",
                                subplot_kw={} if flat else {"projection": "3d"})
    for order, (segments, look) in enumerate(layers):
        if len(segments):
            collection = LineCollection(segments[:, :, :2]) if flat else Line3DCollection(segments)
            collection.set(zorder=2 + order, **look)
            axes.add_collection(collection)
    ends = np.concatenate([segments.reshape(-1, 3) for segments, _ in layers])
    low, high = ends.min(axis=0), ends.max(axis=0)
    if flat:
        axes.autoscale_view()
        axes.set_aspect("equal")
        axes.grid(color="0.9")
    else:
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]), zlabel="z (m)")
        axes.set_box_aspect(np.maximum(high - low, 1e-3 * np.max(high - low)))
        axes.locator_params(axis="z", nbins=3)
    axes.set(xlabel="x (m)", ylabel="y (m)")
    axes.set_title(title, fontsize="medium")
    axes.legend(loc="upper left", fontsize="small")
    figure.savefig(out, dpi=150)
    plt.close(figure)


def main() -> None:
    options = arguments()
    graph = g2o.read(options.solved)
    if not graph.has_vertices:
        raise ValueError(f"{options.solved}: has no vertices")
    points, closures = positions(graph), graph.closures()
    off = switched_off(options.report, graph) if options.report else np.zeros(len(closures), dtype=bool)
    kept = closures & ~off
    way = lines(graph, points, ~closures)
    # Closures that hold are short where a place was seen again: they come last, to be seen at all.
    layers = [
        (lines(graph, points, off), {"color": "red", "linewidth": 0.5, "alpha": 0.6,
                                     "label": f"{np.count_nonzero(off)} closures switched off"}),
        (way, {"color": "black", "linewidth": 0.9, "label": "trajectory"}),
        (lines(graph, points, kept), {"color": "C0", "linewidth": 1.0,
                                      "label": f"{np.count_nonzero(kept)} closures kept"}),
    ]
    title = f"{len(points)} vertices, {len(closures)} edges"
    if options.truth:
        other = g2o.read(options.truth)
        truth = positions(other)
        if options.align_start is not None:
            truth = align_start(truth, points, options.align_start)
        segments = lines(other, truth, ~other.closures())
        layers.insert(0, (segments, {"color": "orange", "linewidth": 3.0, "alpha": 0.7, "label": "truth"}))
        there, back = distances(points, segments), distances(truth, way)
        for name, found in (("the vertices to the truth", there), ("the truth to the trajectory", back)):
            low, high = np.quantile(found, [0.5, 0.95])
            print(f"from {name}: median {low:.2f} m, 95 % {high:.2f} m, most {found.max():.2f} m")
        title += f"; to the truth: median {np.median(there):.2f} m, most {there.max():.2f} m"
    draw(layers, options.view, title, options.out)
    print(options.out)


if __name__ == "__main__":
    try:
        main()
    except (OSError, ValueError) as error:
        sys.exit(f"error: {error}")
