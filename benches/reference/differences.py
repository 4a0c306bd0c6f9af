#!/usr/bin/env python3
"""Looks for problems on which covis and others disagree: small random ones, a seed each.

- pose graphs in SE(2) and SE(3): `covis solve pose-graph` beside GTSAM, from the file's vertices
- bundle adjustment: `covis solve bundle` beside scipy's least squares over numpy's residuals
- trajectories: `covis eval ape` and `rpe` beside evo, with an alignment, a pose relation and a delta by chance

A cost is compared with what numpy finds in the file too, before and after the solve. A solve disagrees
where covis ends above the other, where what it tells is not numpy's cost, or where it does not end well.
The other solver's failures are counted and are no difference. Prints a table of differences and leaves
their files in --keep; exits with 1 where there are any.

Needs: numpy, scipy, gtsam 4.3, evo (pip), and a build of covis.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import bal
import g2o
import scenes

HERE = Path(__file__).resolve().parent
KINDS = ["se2", "se3", "bundle", "trajectory"]
# Costs by compensated sums and by numpy's; statistics of the same errors.
SAME = 1e-9
# Ends of two solvers at one minimum, each by its own criterion.
SAME_MINIMUM = 1e-6
# Problems that hardly determine their intrinsics take hundreds.
MOST_ITERATIONS = 5000


class Covis:
    def __init__(self, program: str) -> None:
        self.program = program

    def __call__(self, *words: object) -> dict:
        """The JSON document of a run; {"error": line} where it fails."""
        command = [self.program, "--log", "off", *map(str, words), "--json"]
        ran = subprocess.run(command, capture_output=True, text=True, timeout=120)
        if ran.returncode != 0:
            return {"error": ran.stderr.strip().splitlines()[-1:] or [f"exit code {ran.returncode}"]}
        return json.loads(ran.stdout)


def differs(ours: float, other: float, tolerance: float) -> bool:
    return not abs(ours - other) <= tolerance * max(abs(ours), abs(other)) + 1e-12


def random_pose(rng: np.random.Generator, group: type, angle: float, reach: float) -> np.ndarray:
    """A motion with a rotation of up to `angle` and a translation of about `reach`, a row of numbers."""
    if group is g2o.Se2:
        return np.array([*(reach * rng.normal(size=2)), rng.uniform(-angle, angle)])
    axis = rng.normal(size=3)
    axis, half = axis / np.linalg.norm(axis), 0.5 * rng.uniform(-angle, angle)
    return np.array([*(reach * rng.normal(size=3)), *(np.sin(half) * axis), np.cos(half)])


def random_information(rng: np.random.Generator, size: int, noise: float) -> np.ndarray:
    """Definite, of deviations that differ by up to a hundredfold, and now and then correlated."""
    deviations = noise * 10.0 ** rng.uniform(-1.0, 1.0, size)
    turn = np.linalg.qr(rng.normal(size=(size, size)))[0] if rng.random() < 0.5 else np.eye(size)
    return turn @ np.diag(deviations**-2) @ turn.T


def pose_graph(rng: np.random.Generator, group: type, path: Path) -> None:
    """A chain with closures, some of them twice, among ids with gaps in any order."""
    count, noise = int(rng.integers(3, 16)), 10.0 ** rng.uniform(-4.0, -1.5)
    reach, compose = 10.0 ** rng.uniform(-1.0, 3.0), group.compose
    # Half turns are where logarithms have two values.
    angle = rng.choice([0.1, 1.0, np.pi])
    one = lambda a, b: compose(a[None], b[None])[0]
    truth = [random_pose(rng, group, angle, reach)]
    for _ in range(count - 1):
        truth.append(one(truth[-1], random_pose(rng, group, angle, 1.0)))
    ids = rng.choice(10 * count, size=count, replace=False)
    pairs = [(k - 1, k) for k in range(1, count)]
    pairs += [tuple(rng.choice(count, size=2, replace=False)) for _ in range(rng.integers(0, 2 * count))]
    text = lambda numbers: " ".join(f"{x:.17g}" for x in numbers)
    lines = []
    for vertex, pose in zip(ids, truth):
        start = one(pose, random_pose(rng, group, 10 * noise, 10 * noise))
        lines.append(f"VERTEX_{group.TAG} {vertex} {text(start)}")
    upper = np.triu_indices(group.TANGENT)
    for i, j in pairs:
        between = one(group.inverse(truth[i][None])[0], truth[j])
        measured = one(between, random_pose(rng, group, noise, noise))
        information = random_information(rng, group.TANGENT, noise)[upper]
        lines.append(f"EDGE_{group.TAG} {ids[i]} {ids[j]} {text(measured)} {text(information)}")
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


def solved(covis: Covis, what: str, path: Path, options: list, cost) -> tuple[dict, list]:
    """Solves a file; the document, and what is wrong with it by `cost`, numpy's cost of a file."""
    out = path.with_suffix(".out")
    document = covis("solve", what, path, *options, "--max-iterations", MOST_ITERATIONS, "--out", out)
    if "error" in document:
        return document, [("fails", document["error"][0], "")]
    wrong = []
    for name, file in (("initial_cost", path), ("final_cost", out)):
        told, found = document[name], cost(file)
        if differs(told, found, SAME):
            wrong.append((f"{name} by numpy", told, found))
    return document, wrong


def compare_graph(covis: Covis, rng: np.random.Generator, path: Path, group: type) -> tuple[list, bool]:
    pose_graph(rng, group, path)

    def cost(file: Path) -> float:
        return g2o.with_poses_of(g2o.read(str(path)), str(file)).cost()

    document, wrong = solved(covis, "pose-graph", path, ["--init", "given"], cost)
    twin = [sys.executable, str(HERE / "gtsam/pose_graph.py"), str(path), "--method", "lm", "--threads", "1"]
    ran = subprocess.run(twin, capture_output=True, text=True, timeout=120)
    other = json.loads(ran.stdout)["final_cost"] if ran.returncode == 0 else None
    return wrong + above(document, other, "GTSAM"), other is not None


def above(document: dict, other: float | None, name: str) -> list:
    ours = document.get("final_cost")
    if ours is None or other is None or not np.isfinite(other) or ours <= other * (1.0 + SAME_MINIMUM) + 1e-9:
        return []
    return [(f"final_cost by {name}", ours, other)]


def compare_bundle(covis: Covis, rng: np.random.Generator, path: Path) -> tuple[list, bool]:
    from scipy.optimize import least_squares

    cameras, points = int(rng.integers(3, 7)), int(rng.integers(15, 50))
    noise = 10.0 ** rng.uniform(-2.0, 0.5)
    problem = scenes.make_window(cameras, points, min(3.0, cameras), noise, int(rng.integers(1 << 31)))
    bal.write(str(path), problem)
    fixed = bool(rng.random() < 0.5)
    cost = lambda file: bal.read(str(file)).cost()
    document, wrong = solved(covis, "bundle", path, ["--fix-intrinsics"] if fixed else [], cost)
    problem = bal.read(str(path))
    size = 6 if fixed else 9
    split = size * len(problem.cameras)

    def residuals(x: np.ndarray) -> np.ndarray:
        problem.cameras[:, :size] = x[:split].reshape(-1, size)
        problem.points[:] = x[split:].reshape(-1, 3)
        return problem.residuals().ravel()

    start = np.concatenate([problem.cameras[:, :size].ravel(), problem.points.ravel()])
    tight = {"ftol": 1e-12, "xtol": 1e-12, "gtol": 1e-10}
    found = least_squares(residuals, start, jac="3-point", x_scale="jac", max_nfev=300, **tight)
    return wrong + above(document, float(found.cost), "scipy"), bool(found.success)


def compare_trajectory(covis: Covis, rng: np.random.Generator, path: Path) -> tuple[list, bool]:
    from evo.core import metrics, sync
    from evo.main_ape import ape
    from evo.main_rpe import rpe
    from evo.tools import file_interface

    count = int(rng.integers(5, 60))
    stamps = np.cumsum(rng.uniform(0.005, 0.2, count)) + rng.choice([0.0, 1.3e9])
    truth = [random_pose(rng, g2o.Se3, np.pi, 3.0)]
    for _ in range(count - 1):
        step = random_pose(rng, g2o.Se3, 0.5, 0.3)
        truth.append(g2o.Se3.compose(truth[-1][None], step[None])[0])
    noise = 10.0 ** rng.uniform(-4.0, 0.0)
    frame = random_pose(rng, g2o.Se3, np.pi, 10.0)
    truth_path = path.with_suffix(".truth")
    with open(truth_path, "w", encoding="ascii") as a, open(path, "w", encoding="ascii") as b:
        for stamp, pose in zip(stamps, truth):
            moved = g2o.Se3.compose(frame[None], pose[None])
            off = g2o.Se3.compose(moved, random_pose(rng, g2o.Se3, noise, noise)[None])[0]
            line = lambda stamp, pose: f"{stamp:.6f} {' '.join(f'{x:.17g}' for x in pose)}\n"
            if rng.random() < 0.9:
                a.write(line(stamp, pose))
            if rng.random() < 0.9:
                b.write(line(stamp + rng.uniform(-0.012, 0.012) * (rng.random() < 0.7), off))
    wrong, answered = [], True
    relations = {"trans_part": "translation_part", "rot_part": "rotation_part", "full": "full_transformation",
                 "angle_deg": "rotation_angle_deg", "angle_rad": "rotation_angle_rad",
                 "point_distance": "point_distance", "point_distance_error_ratio": "point_distance_error_ratio"}
    alignments = {"se3": {"align": True}, "sim3": {"align": True, "correct_scale": True}, "none": {},
                  "scale": {"correct_scale": True}, "origin": {"align_origin": True}}
    units = {"f": metrics.Unit.frames, "m": metrics.Unit.meters, "d": metrics.Unit.degrees, "r": metrics.Unit.radians}
    for name, evaluate in (("ape", ape), ("rpe", rpe)):
        align, relation = rng.choice(list(alignments)), rng.choice(list(relations)[:6 if name == "ape" else 7])
        given, options = ["--align", align, "--pose-relation", relation], dict(alignments[align])
        if name == "rpe":
            unit, all_pairs = rng.choice(list(units)), bool(rng.random() < 0.5)
            low, high = {"f": (1, 8), "m": (0.1, 2.0), "d": (5.0, 90.0), "r": (0.1, 1.5)}[unit]
            delta = int(rng.integers(low, high)) if unit == "f" else rng.uniform(low, high)
            given += ["--delta", str(delta), "--delta-unit", unit] + ["--all-pairs"] * all_pairs
            options.update(delta=float(delta), delta_unit=units[unit], all_pairs=all_pairs)
        document = covis("eval", name, truth_path, path, "--format", "tum", *given)
        name = " ".join([name, *given])
        try:
            files = [file_interface.read_tum_trajectory_file(str(file)) for file in (truth_path, path)]
            pairs = sync.associate_trajectories(*files, max_diff=0.01)
            result = evaluate(*pairs, metrics.PoseRelation[relations[relation]], **options)
            if "error" in document:
                wrong.append((f"{name} fails", document["error"][0], result.stats["rmse"]))
                continue
            wrong += [(f"{name} {statistic}", document[statistic], value)
                      for statistic, value in result.stats.items() if differs(document[statistic], value, 1e-7)]
        except Exception:  # evo has exceptions of several packages.
            answered = False
    return wrong, answered


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--covis", default="target/release/covis")
    parser.add_argument("--seeds", type=int, default=100, help="problems of each kind")
    parser.add_argument("--first", type=int, default=1, help="the first seed")
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--keep", metavar="FOLDER", help="keep the files of differences here")
    options = parser.parse_args()
    covis, total = Covis(str(Path(options.covis).resolve())), 0
    folder = Path(options.keep or tempfile.mkdtemp())
    folder.mkdir(parents=True, exist_ok=True)
    print("| kind | seed | quantity | covis | other |\n|---|---|---|---|---|")
    for kind in options.kinds.split(","):
        unanswered = 0
        for seed in range(options.first, options.first + options.seeds):
            rng = np.random.default_rng([KINDS.index(kind), seed])
            path = folder / f"{kind}-{seed}.txt"
            if kind == "bundle":
                wrong, answered = compare_bundle(covis, rng, path)
            elif kind == "trajectory":
                wrong, answered = compare_trajectory(covis, rng, path)
            else:
                wrong, answered = compare_graph(covis, rng, path, g2o.Se2 if kind == "se2" else g2o.Se3)
            unanswered += not answered
            total += len(wrong)
            for quantity, ours, other in wrong:
                print(f"| {kind} | {seed} | {quantity} | {ours} | {other} |", flush=True)
            if not wrong or not options.keep:
                for file in folder.glob(f"{kind}-{seed}.*"):
                    file.unlink()
        print(f"{kind}: {options.seeds} problems, {unanswered} without an answer of the other", file=sys.stderr)
    sys.exit(1 if total else 0)


if __name__ == "__main__":
    main()
