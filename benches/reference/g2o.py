#!/usr/bin/env python3
"""g2o files of pose graphs: read, write and evaluate them with numpy and nothing of any solver.

usage: g2o.py FILE [--poses SOLVED]     prints one JSON object: cost and size

The cost is 1/2 sum r' Omega r over the edges, r = Log(Z^-1 Xi^-1 Xj) by the logarithm of the whole
group, in SE(2) too, translation first (docs/conventions.md). With --poses the vertices are those of
another file and the edges FILE's, so that a solver cannot change what it is asked.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass

import numpy as np


class Se2:
    """Rows of (x, y, angle)."""

    SIZE, TANGENT, TAG = 3, 3, "SE2"
    IDENTITY = np.zeros(3)

    @staticmethod
    def compose(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.column_stack([a[:, :2] + turn(a[:, 2], b[:, :2]), a[:, 2] + b[:, 2]])

    @staticmethod
    def inverse(a: np.ndarray) -> np.ndarray:
        return np.column_stack([-turn(-a[:, 2], a[:, :2]), -a[:, 2]])

    @staticmethod
    def log(a: np.ndarray) -> np.ndarray:
        angle = np.remainder(a[:, 2] + np.pi, 2.0 * np.pi) - np.pi
        half = 0.5 * angle
        # The inverse of the left Jacobian is h cot h on the diagonal and -+h beside it, h half the angle.
        safe = np.where(np.abs(half) < 1e-4, 1.0, half)
        diagonal = np.where(np.abs(half) < 1e-4, 1.0 - half**2 / 3.0, safe / np.tan(safe))
        x, y = a[:, 0], a[:, 1]
        return np.column_stack([diagonal * x + half * y, diagonal * y - half * x, angle])


class Se3:
    """Rows of (x, y, z, qx, qy, qz, qw), unit quaternions."""

    SIZE, TANGENT, TAG = 7, 6, "SE3:QUAT"
    IDENTITY = np.array([0.0] * 6 + [1.0])

    @staticmethod
    def compose(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        (v, w), (u, s) = (a[:, 3:6], a[:, 6:]), (b[:, 3:6], b[:, 6:])
        vector = w * u + s * v + np.cross(v, u)
        return np.hstack([a[:, :3] + rotate(a[:, 3:], b[:, :3]), vector, w * s - dot(v, u)])

    @staticmethod
    def inverse(a: np.ndarray) -> np.ndarray:
        conjugate = a[:, 3:] * np.array([-1.0, -1.0, -1.0, 1.0])
        return np.hstack([-rotate(conjugate, a[:, :3]), conjugate])

    @staticmethod
    def log(a: np.ndarray) -> np.ndarray:
        # q and -q are the same rotation; the logarithm is that of the shorter way.
        q = np.where(a[:, 6:] < 0.0, -a[:, 3:], a[:, 3:])
        sine = np.linalg.norm(q[:, :3], axis=1, keepdims=True)
        half = np.arctan2(sine, q[:, 3:])
        small = half < 1e-4
        safe = np.where(small, 1.0, half)
        phi = q[:, :3] * np.where(small, 2.0 + half**2 / 3.0, 2.0 * safe / np.where(small, 1.0, sine))
        # J_l^-1 t = t - phi x t / 2 + c phi x (phi x t), c = (1 - h cot h) / (4 h^2), h half the angle.
        c = np.where(small, 1.0 / 12.0 + half**2 / 180.0, (1.0 - safe / np.tan(safe)) / (4.0 * safe**2))
        once = np.cross(phi, a[:, :3])
        return np.hstack([a[:, :3] - 0.5 * once + c * np.cross(phi, once), phi])


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.sum(a * b, axis=1, keepdims=True)


def turn(angle: np.ndarray, x: np.ndarray) -> np.ndarray:
    """The rows of `x`, each turned to the left by its angle, (n, 2)."""
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.column_stack([cosine * x[:, 0] - sine * x[:, 1], sine * x[:, 0] + cosine * x[:, 1]])


def rotate(q: np.ndarray, x: np.ndarray) -> np.ndarray:
    """R(q) x row by row, (n, 3)."""
    twice = 2.0 * np.cross(q[:, :3], x)
    return x + q[:, 3:] * twice + np.cross(q[:, :3], twice)


@dataclass
class Graph:
    """A pose graph; edges name vertices by their row."""

    group: type[Se2] | type[Se3]
    ids: np.ndarray  # (n,), ascending
    poses: np.ndarray  # (n, group.SIZE), world_from_pose
    i: np.ndarray  # (m,)
    j: np.ndarray  # (m,)
    measured: np.ndarray  # (m, group.SIZE), i_from_j
    information: np.ndarray  # (m, d, d), translation first
    has_vertices: bool = True  # false: the poses are the identity and stand for nothing

    def residuals(self) -> np.ndarray:
        """Log(Z^-1 Xi^-1 Xj) of every edge, (m, d), in m and rad."""
        group = self.group
        predicted = group.compose(group.inverse(self.poses[self.i]), self.poses[self.j])
        return group.log(group.compose(group.inverse(self.measured), predicted))

    def cost(self) -> float:
        r = self.residuals()
        return 0.5 * float(np.einsum("mi,mij,mj->", r, self.information, r, optimize=True))

    def closures(self) -> np.ndarray:
        """Which edges are loop closures: those between ids that are not consecutive, (m,)."""
        return np.abs(self.ids[self.i] - self.ids[self.j]) != 1


def spanning_tree(graph: Graph) -> np.ndarray:
    """Poses strung together from the lowest id, as few measurements as possible to each, (n, SIZE)."""
    group = graph.group
    beside: list[list[tuple[int, int, bool]]] = [[] for _ in graph.ids]
    for k, (i, j) in enumerate(zip(graph.i.tolist(), graph.j.tolist())):
        beside[i].append((j, k, False))
        beside[j].append((i, k, True))
    forward, backward = graph.measured, group.inverse(graph.measured)
    poses = np.tile(group.IDENTITY, (len(graph.ids), 1))
    if graph.has_vertices:
        poses[0] = graph.poses[0]
    reached, level = {0}, [0]
    while level:
        here, there, steps = [], [], []
        for vertex in level:
            for other, k, inverted in beside[vertex]:
                if other not in reached:
                    reached.add(other)
                    here.append(vertex)
                    there.append(other)
                    steps.append((backward if inverted else forward)[k])
        if there:
            poses[there] = group.compose(poses[here], np.array(steps))
        level = there
    if len(reached) < len(poses):
        raise ValueError(f"{len(poses) - len(reached)} vertices are not connected to vertex {graph.ids[0]}")
    return poses


def read(path: str) -> Graph:
    """Reads a file; ValueError says what is wrong with it."""
    vertices: dict[int, list[float]] = {}
    edges: list[tuple[int, int, list[float]]] = []
    groups = set()
    with open(path, encoding="ascii") as lines:
        for number, line in enumerate(lines, 1):
            words = line.split()
            if not words:
                continue
            kind, _, tag = words[0].partition("_")
            group = {"SE2": Se2, "SE3:QUAT": Se3}.get(tag)
            ends = {"VERTEX": 1, "EDGE": 2}.get(kind)
            if group is None or ends is None:
                raise ValueError(f"{path}:{number}: no record is called {words[0]}")
            groups.add(group)
            numbers = [float(word) for word in words[1 + ends :]]
            triangle = group.TANGENT * (group.TANGENT + 1) // 2
            if len(numbers) != group.SIZE + (triangle if ends == 2 else 0):
                raise ValueError(f"{path}:{number}: {len(numbers)} numbers after {words[0]} and its ids")
            if ends == 1:
                vertices[int(words[1])] = numbers
            else:
                edges.append((int(words[1]), int(words[2]), numbers))
    if len(groups) != 1:
        raise ValueError(f"{path}: no pose graph of SE2 or of SE3:QUAT")
    return assemble(groups.pop(), vertices, edges, path)


def assemble(group: type, vertices: dict, edges: list, path: str) -> Graph:
    """The graph of parsed records; quaternions become unit."""
    named = [vertex for i, j, _ in edges for vertex in (i, j)]
    ids = np.array(sorted(vertices or set(named)))
    row = {vertex: k for k, vertex in enumerate(ids.tolist())}
    missing = next((vertex for vertex in named if vertex not in row), None)
    if missing is not None:
        raise ValueError(f"{path}: an edge names vertex {missing}, which is not there")
    poses = np.array([vertices[k] for k in ids.tolist()]) if vertices else np.tile(group.IDENTITY, (len(ids), 1))
    columns = group.SIZE + group.TANGENT * (group.TANGENT + 1) // 2
    numbers = np.array([numbers for _, _, numbers in edges]).reshape(-1, columns)
    measured, triangle = numbers[:, : group.SIZE].copy(), numbers[:, group.SIZE :]
    if group is Se3:
        for array in (poses, measured):
            array[:, 3:] /= np.linalg.norm(array[:, 3:], axis=1, keepdims=True)
    information = np.zeros((len(edges), group.TANGENT, group.TANGENT))
    for k, (r, c) in enumerate(zip(*np.triu_indices(group.TANGENT))):
        information[:, r, c] = information[:, c, r] = triangle[:, k]
    i, j = (np.array([row[edge[end]] for edge in edges], dtype=int) for end in (0, 1))
    return Graph(group, ids, poses, i, j, measured, information, bool(vertices))


def write_poses(path: str, graph: Graph, poses: np.ndarray) -> None:
    """Writes vertices and no edges, with 17 digits; reading gives the same numbers."""
    with open(path, "w", encoding="ascii") as out:
        for vertex, pose in zip(graph.ids.tolist(), poses.tolist()):
            out.write(f"VERTEX_{graph.group.TAG} {vertex} {' '.join(f'{x:.17g}' for x in pose)}\n")


def with_poses_of(graph: Graph, path: str) -> Graph:
    """`graph` with the vertices of another file; ValueError where they are not the same."""
    other = read(path)
    if other.group is not graph.group or not other.has_vertices or not np.array_equal(other.ids, graph.ids):
        raise ValueError(f"{path}: not the same vertices")
    graph.poses, graph.has_vertices = other.poses, True
    return graph


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file")
    parser.add_argument("--poses", metavar="SOLVED", help="take the vertices from here")
    options = parser.parse_args()
    graph = read(options.file)
    if options.poses:
        with_poses_of(graph, options.poses)
    facts = {
        "file": options.file,
        "cost": graph.cost() if graph.has_vertices else None,
        "group": graph.group.TAG.partition(":")[0],
        "vertices": len(graph.ids),
        "edges": len(graph.i),
        "closures": int(np.count_nonzero(graph.closures())),
    }
    print(json.dumps(facts))


if __name__ == "__main__":
    main()
