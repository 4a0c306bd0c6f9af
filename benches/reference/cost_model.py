#!/usr/bin/env python3
"""What an iteration of covis' bundle adjustment must compute and move, counted from a BAL file.

One accepted iteration is the fused pass (residuals, Jacobians, landmark elimination, the reduced
camera system), the solution of that system, the landmark steps and the cost of the trial state.
docs/benchmarking.md derives the counts. A multiplication with addition is two flops, anything else
one; idle lanes of the vectors of eight count, since the processor computes them. Bytes are what each
pass streams once; what stays in a cache between two uses (views, tiles) is not counted.

The two times are lower bounds: flops at the rate of a large matrix product, bytes at that of a copy.
Nothing of covis runs here. Needs: numpy
"""

from __future__ import annotations

import argparse
import heapq
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import bal

LANES = 8
# How the observations are cut (solvers/src/bundle_adjustment/sorted.rs).
MAX_CHUNKS, MIN_CHUNK_OBSERVATIONS = 32, 8192
TILE_LANDMARKS, TILE_OBSERVATIONS = 16, 96
# How the linear solver is chosen (reduced_solver.rs): the price of a pair and of a factorization's flop
# in products with an observation, the products expected, and when a system is dense.
PAIR_COST, FLOP_COST, PRODUCTS = 1.5, 0.01, 40
DENSE_DIMENSION, DENSE_FILL = 300, 0.4
HEAD = ("file", "N", "k", "P", "pairs/N", "solver", "fused", "pairs", "reduced", "products", "steps", "cost",
        "Mflop", "MB", "ms by flops", "ms by bytes")


@dataclass
class Shape:
    """The counts of a problem that the model needs."""

    unknowns: int  # D, of a camera: 6 or 9
    cameras: int  # P
    observations: int  # N
    landmarks: int
    observation_lanes: int  # N, each tile rounded up to eights
    landmark_lanes: int  # landmarks, each tile rounded up to eights
    pairs: int  # of observations of one landmark
    chunk_views: int  # views that a chunk meets, over all chunks
    chunk_pairs: int  # pairs of views that a chunk meets, over all chunks
    neighbors: list[set[int]]  # cameras with a landmark in common

    @property
    def dimension(self) -> int:
        return self.unknowns * self.cameras


@dataclass
class Work:
    """Flops and bytes of a pass."""

    flops: float = 0.0
    bytes: float = 0.0


def rounded(count: int) -> int:
    """The next multiple of eight."""
    return -(-count // LANES) * LANES


def chunks(starts: np.ndarray) -> Iterator[tuple[int, int]]:
    """First and last landmark (excluded) of each chunk, for observations `starts[k]..starts[k + 1]`."""
    landmarks, total = len(starts) - 1, int(starts[-1])
    count = min(max(total // MIN_CHUNK_OBSERVATIONS, 1), MAX_CHUNKS)
    begin = 0
    for chunk in range(1, count + 1):
        end = landmarks if chunk == count else int(np.searchsorted(starts, total * chunk // count))
        yield begin, max(end, begin)
        begin = max(end, begin)


def tiles(starts: list[int], begin: int, end: int) -> Iterator[tuple[int, int]]:
    """First and last landmark (excluded) of each tile of a chunk."""
    while begin < end:
        last = begin + 1
        while last < min(end, begin + TILE_LANDMARKS) and starts[last + 1] <= starts[begin] + TILE_OBSERVATIONS:
            last += 1
        yield begin, last
        begin = last


def shape(problem: bal.Bal, unknowns: int) -> Shape:
    """Counts what covis' order of the observations makes of a problem."""
    cameras = len(problem.cameras)
    first = np.full(len(problem.points), cameras)
    np.minimum.at(first, problem.point_of, problem.camera_of)
    order = np.lexsort((problem.camera_of, problem.point_of, first[problem.point_of]))
    camera_of, point_of = problem.camera_of[order], problem.point_of[order]
    starts = np.append(np.flatnonzero(np.diff(point_of, prepend=-1)), len(point_of))
    lengths = np.diff(starts)
    found = Shape(unknowns, cameras, len(point_of), len(lengths), 0, 0, int(np.sum(lengths * (lengths - 1) // 2)), 0, 0,
                  [set() for _ in range(cameras)])
    bounds = starts.tolist()
    for begin, end in chunks(starts):
        for a, b in tiles(bounds, begin, end):
            found.observation_lanes += rounded(bounds[b] - bounds[a])
            found.landmark_lanes += rounded(b - a)
        seen = camera_of[bounds[begin]:bounds[end]]
        found.chunk_views += len(np.unique(seen))
        met = met_pairs(seen, lengths[begin:end], cameras)
        found.chunk_pairs += len(met)
        for later, earlier in zip(*(side.tolist() for side in np.divmod(met, cameras))):
            if later != earlier:
                found.neighbors[later].add(earlier)
                found.neighbors[earlier].add(later)
    return found


def met_pairs(camera_of: np.ndarray, lengths: np.ndarray, cameras: int) -> np.ndarray:
    """The different pairs of cameras (later · cameras + earlier) that share one of these landmarks."""
    place = np.arange(len(camera_of)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    met = [np.empty(0, int)]
    for back in range(1, int(lengths.max(initial=1))):
        later = np.flatnonzero(place >= back)
        met.append(np.unique(camera_of[later] * cameras + camera_of[later - back]))
    return np.unique(np.concatenate(met))


def choice(s: Shape) -> str:
    """The linear solver that covis takes by itself."""
    if s.dimension <= DENSE_DIMENSION:
        return "dense-schur"
    blocks = s.cameras + sum(map(len, s.neighbors)) / 2
    dense = blocks > DENSE_FILL * s.cameras * (s.cameras + 1) / 2
    flops = s.dimension**3 / 3 if dense else sparse_factor(s)[0]
    if FLOP_COST * flops > PRODUCTS * s.observations - PAIR_COST * s.pairs:
        return "iterative-schur"
    return "dense-schur" if dense else "sparse-schur"


def linearization(unknowns: int) -> int:
    """Flops of an observation's residual and Jacobians."""
    to_camera, project, derive, whiten = 18, 13, 26, 4
    # Two rows: J times 1/σ (3), ∂/∂(t, φ) (12), ∂/∂X (15); then the columns of f, k1, k2.
    return to_camera + project + derive + whiten + 2 * (3 + 12 + 15) + (14 if unknowns == 9 else 0)


def fused(s: Shape, direct: bool) -> Work:
    """The fused pass, without the pairs of a direct solver."""
    columns, tails = min(s.unknowns, LANES), max(s.unknowns - LANES, 0)
    by_lane = linearization(s.unknowns) + 36 + 48  # + H_ll and g_l + G, M and r - G y
    # M J_v, J_vᵀ M J_v by columns, the three vectors of a view; the tail; sums over tracks.
    by_view = 48 + 32 * columns + 96 + 56 * tails + 16
    if direct:
        by_view += 72 + 12 * tails  # E
    flops = by_lane * s.observation_lanes + by_view * s.observations + 55 * s.landmark_lanes
    # Indices and measurements; points and starts; L, g_l and D are left behind.
    return Work(flops, 36 * s.observations + 37 * s.landmarks + 96 * s.landmark_lanes)


def pairs(s: Shape) -> Work:
    """E_i E_jᵀ for each pair of observations of a landmark; blocks are cleared, filled and read."""
    tails = max(s.unknowns - LANES, 0)
    block = 8 * (LANES * s.unknowns + 2 * LANES * tails)
    return Work((48 * s.unknowns + 54 * tails) * s.pairs, 4 * s.pairs + 4 * s.landmarks + 4 * block * s.chunk_pairs)


def reduced(s: Shape, solver: str) -> Work:
    """The sum of the chunks and the factorization; for conjugate gradients the diagonal blocks only."""
    size = s.unknowns**2
    if solver == "iterative-schur":
        # Factor and invert each block.
        return Work(size * s.chunk_views + 4 / 3 * s.unknowns * size * s.cameras, 16 * size * s.cameras)
    if solver == "dense-schur":
        n = s.dimension
        flops, matrix = n**3 / 3, n * n / 2
        stored = matrix
    else:
        flops, stored = sparse_factor(s)
        matrix = size * (s.cameras + sum(map(len, s.neighbors)) / 2)
    sums = size * (s.chunk_views + s.chunk_pairs)
    # Two triangular solves; the residual that checks them reads the matrix once more.
    return Work(sums + flops + 4 * stored + 4 * matrix, 8 * (3 * matrix + 4 * stored))


def sparse_factor(s: Shape) -> tuple[float, float]:
    """Flops and entries of a Cholesky factor in a minimum degree order; supernodes are not widened."""
    neighbors = [set(others) for others in s.neighbors]
    queue = [(len(others), camera) for camera, others in enumerate(neighbors)]
    heapq.heapify(queue)
    done = [False] * len(neighbors)
    flops = stored = 0.0
    while queue:
        degree, camera = heapq.heappop(queue)
        if done[camera] or degree != len(neighbors[camera]):
            continue
        done[camera] = True
        heights = s.unknowns * degree + np.arange(1, s.unknowns + 1)
        flops += float(np.sum(heights**2))
        stored += float(np.sum(heights))
        clique = neighbors[camera]
        for other in clique:
            neighbors[other] |= clique
            neighbors[other] -= {other, camera}
            heapq.heappush(queue, (len(neighbors[other]), other))
    return flops, stored


def product(s: Shape) -> Work:
    """One multiplication with the reduced system without its matrix, and the vectors around it."""
    along, onto_landmark, rest = 4 * s.unknowns, 12, 12
    by_lane = linearization(s.unknowns) + along + onto_landmark + rest + 3 * s.unknowns
    by_view = LANES + LANES + max(s.unknowns - LANES, 0)  # sums over tracks, into views
    vectors = (2 * s.unknowns + 16) * s.dimension
    flops = by_lane * s.observation_lanes + by_view * s.observations + 18 * s.landmark_lanes + vectors
    return Work(flops, 20 * s.observations + 36 * s.landmarks + 48 * s.landmark_lanes)


def steps(s: Shape) -> Work:
    """Landmark steps from the cameras', and taking them."""
    by_lane = linearization(s.unknowns) + 4 * s.unknowns + 12
    flops = by_lane * s.observation_lanes + LANES * s.observations + 48 * s.landmark_lanes + 12 * s.landmarks
    # Points and steps: read and written here, then the state's norm, a backup, the sum.
    return Work(flops, 16 * s.observations + (68 + 32 + 64 + 96) * s.landmarks + 96 * s.landmark_lanes)


def cost(s: Shape) -> Work:
    """½ Σ of squared residuals."""
    return Work(39 * rounded(s.observations), 32 * s.observations + 32 * s.landmarks)


def iteration(s: Shape, solver: str, products: int) -> dict[str, Work]:
    """Every pass of an accepted iteration."""
    direct = solver != "iterative-schur"
    once = product(s)
    return {
        "fused": fused(s, direct),
        "pairs": pairs(s) if direct else Work(),
        "reduced": reduced(s, solver),
        "products": Work() if direct else Work(products * once.flops, products * once.bytes),
        "steps": steps(s),
        "cost": cost(s),
    }


def row(file: str, options: argparse.Namespace) -> list[str]:
    """A file's row of the table."""
    s = shape(bal.read(file), 6 if options.fix_intrinsics else 9)
    solver = options.linear_solver or choice(s)
    passes = iteration(s, solver, options.products)
    flops = sum(work.flops for work in passes.values())
    moved = sum(work.bytes for work in passes.values())
    return [
        Path(file).stem, str(s.observations), f"{s.observations / s.landmarks:.2f}", str(s.cameras),
        f"{s.pairs / s.observations:.2f}", solver.removesuffix("-schur"),
        *(f"{work.flops / 1e6:.1f}" if work.flops else "" for work in passes.values()),
        f"{flops / 1e6:.1f}", f"{moved / 1e6:.1f}", f"{1e-6 * flops / options.gflops / options.threads:.3f}",
        f"{1e-6 * moved / options.gbytes:.3f}",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", metavar="FILE", help="BAL files")
    parser.add_argument("--fix-intrinsics", action="store_true", help="6 unknowns a camera instead of 9")
    parser.add_argument("--linear-solver", choices=["dense-schur", "sparse-schur", "iterative-schur"],
                        help="default: what covis chooses")
    parser.add_argument("--products", type=int, default=PRODUCTS,
                        help="of conjugate gradients an iteration (default: the 40 that covis' choice expects)")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--gflops", type=float, default=52.0, help="of a core, by a large matrix product (default: 52)")
    parser.add_argument("--gbytes", type=float, default=26.0, help="a second from memory (default: 26)")
    options = parser.parse_args()
    print(f"| {' | '.join(HEAD)} |\n{'|---' * len(HEAD)}|")
    for file in options.files:
        print(f"| {' | '.join(row(file, options))} |", flush=True)


if __name__ == "__main__":
    main()
